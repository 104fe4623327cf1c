// A running `lampglow serve` and questions to it, for the tests of the whole station.
#pragma once

#include <sys/types.h>

#include "tests/system/cameras/support.h"

namespace lampglow::testing {

struct Answer {
  long status = 0;  // of HTTP; 0: nobody answered
  std::string body;
  std::string failure;  // why nobody answered, in curl's words
};

// GET http://127.0.0.1:PORT/PATH, within 3 s.
Answer ask(int port, const std::string& path);

// The same over TLS, trusting this certificate alone.
enum class TlsVersions { all, up_to_1_1 };
Answer ask_securely(int port, const std::string& path, const fs::path& trusted,
                    TlsVersions versions = TlsVersions::all);

// The program with this configuration; what it logs goes to a file. Killed at the end if it still runs.
class Serving {
 public:
  Serving(const fs::path& config, fs::path log);
  ~Serving();
  Serving(const Serving&) = delete;
  Serving& operator=(const Serving&) = delete;

  void signal(int number) const;
  // The exit code; -1 if it does not end in time or is ended by a signal.
  int wait(std::chrono::milliseconds limit);
  std::string log() const;
  pid_t pid() const { return pid_; }

 private:
  fs::path log_;
  pid_t pid_ = -1;
};

// The archive's pictures of this role ("observation", "clear_reference") again and again, a second apart, for
// so many brackets more; those of an earlier call go.
void lengthen(const fs::path& archive, int brackets, const std::string& role = "observation");

}  // namespace lampglow::testing
