// lighttpd and nginx as cameras.
#pragma once

#include "tests/system/cameras/support.h"

namespace lampglow::testing {

// lighttpd: /open/ free, /secret/ with digest (user "admin", password kPassword), /loop redirecting to
// itself.
class Lighttpd {
 public:
  explicit Lighttpd(const fs::path& folder);
  static bool available() { return !find_program("lighttpd").empty(); }
  int port() const { return port_; }
  void start();
  void kill() { program_.reset(); }
  std::string url(const std::string& path) const {
    return "http://127.0.0.1:" + std::to_string(port_) + path;
  }

 private:
  fs::path folder_;
  int port_;
  std::unique_ptr<Program> program_;
};

// nginx: TLS with a self-signed certificate, basic authentication below /secret/.
class Nginx {
 public:
  Nginx(const fs::path& folder, int certificate_from_days, int certificate_to_days);
  static bool available() { return !find_program("nginx").empty(); }
  std::string url(const std::string& path) const {
    return "https://127.0.0.1:" + std::to_string(port_) + path;
  }
  std::string ca_file() const { return (folder_ / "cert.pem").string(); }

 private:
  fs::path folder_;
  int port_;
  std::unique_ptr<Program> program_;
};

// With all the punctuation that breaks naive clients.
inline const std::string kPassword = "p:a ss@w/ö?r#d%41&\"'+\\";

}  // namespace lampglow::testing
