// Real servers and a bad network for the camera tests: everything on 127.0.0.1, everything ended by the
// destructors.
#pragma once

#include <sys/types.h>

#include <atomic>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "estimator/photometry/image.h"

namespace lampglow::testing {

namespace fs = std::filesystem;

class TempFolder {
 public:
  TempFolder();
  ~TempFolder();
  TempFolder(const TempFolder&) = delete;
  TempFolder& operator=(const TempFolder&) = delete;
  fs::path operator/(const std::string& name) const { return path_ / name; }
  const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

// A child program, killed at the end. Its output goes to `log`.
class Program {
 public:
  Program(const std::vector<std::string>& command, const fs::path& log);
  ~Program();
  Program(const Program&) = delete;
  Program& operator=(const Program&) = delete;
  void kill();       // SIGKILL, and waits
  void terminate();  // SIGTERM, and waits
  bool running();

 private:
  pid_t pid_ = -1;
};

// The program's full path; empty if the machine does not have it (then the test is skipped).
std::string find_program(const std::string& name);

int free_port();
// Until something listens there; fails the test after 10 s.
void wait_for_port(int port);
void write_file(const fs::path& path, const std::string& text);
void write_bytes(const fs::path& path, const std::vector<std::uint8_t>& bytes);

// Until the condition holds; false after the limit.
bool eventually(std::chrono::milliseconds limit, const std::function<bool()>& condition);

// A foggy night of three lamps with shot-like noise, different for every number, the same for the same
// number.
Image<std::uint16_t> night(int number, int width_px = 320, int height_px = 240, int bits = 8);
std::vector<std::uint8_t> jpeg_of(const Image<std::uint16_t>& picture, int quality = 95);
std::vector<std::uint8_t> png_of(const Image<std::uint16_t>& picture, int bits);
void save_picture(const fs::path& path, const std::vector<std::uint8_t>& bytes);  // atomically

// TCP proxy that can be made to misbehave (after toxiproxy).
class BadNetwork {
 public:
  explicit BadNetwork(int target_port);
  ~BadNetwork();
  BadNetwork(const BadNetwork&) = delete;
  BadNetwork& operator=(const BadNetwork&) = delete;
  int port() const { return port_; }

  struct Toxics {
    int delay_ms = 0;             // before the answer's first byte
    long cut_after_bytes = -1;    // of the answer; then the connection is reset
    long stall_after_bytes = -1;  // then nothing more, the connection stays
    int bytes_per_s = 0;          // after the first 1000 bytes; 0: unlimited
    int corrupt_every_bytes = 0;  // one byte in so many of the answer's body is changed; 0: none
  };
  void set(Toxics toxics);
  void heal() { set({}); }

 private:
  void accept_loop(std::stop_token stop);
  void serve(int client, std::stop_token stop);
  bool forward(int client, const std::uint8_t* data, std::size_t size, long& sent, std::stop_token stop);
  Toxics toxics() const;  // all of one moment: set() is called from another thread

  int target_port_;
  int port_ = 0;
  int listener_ = -1;
  mutable std::mutex mutex_;
  Toxics toxics_;
  struct Connection {
    std::jthread thread;
    std::shared_ptr<std::atomic<bool>> ended;
  };
  std::vector<Connection> connections_;
  std::jthread acceptor_;
};

// A self-signed certificate for 127.0.0.1, valid from and to so many days from now.
void write_certificate(const fs::path& certificate, const fs::path& key, int from_days, int to_days);

// How many descriptors this process has open, and its resident memory.
int open_descriptors();
long resident_kib();

}  // namespace lampglow::testing
