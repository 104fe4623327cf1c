#include "tests/system/cameras/support.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/x509v3.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmath>
#include <cstdlib>
#include <fstream>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <sstream>

extern char** environ;

namespace lampglow::testing {

using namespace std::chrono_literals;

TempFolder::TempFolder() {
  std::string pattern = (fs::temp_directory_path() / "lampglow-cameras-XXXXXX").string();
  path_ = mkdtemp(pattern.data());
  fs::permissions(path_, fs::perms::owner_all | fs::perms::others_read | fs::perms::others_exec);
}
TempFolder::~TempFolder() {
  std::error_code ignored;
  fs::remove_all(path_, ignored);
}

Program::Program(const std::vector<std::string>& command, const fs::path& log) {
  std::vector<char*> arguments;
  for (const std::string& word : command) arguments.push_back(const_cast<char*>(word.c_str()));
  arguments.push_back(nullptr);
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addopen(&actions, 0, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_addopen(&actions, 1, log.c_str(), O_WRONLY | O_CREAT | O_APPEND, 0600);
  posix_spawn_file_actions_adddup2(&actions, 1, 2);
  if (posix_spawn(&pid_, command[0].c_str(), &actions, nullptr, arguments.data(), environ) != 0) pid_ = -1;
  posix_spawn_file_actions_destroy(&actions);
}
Program::~Program() {
  kill();
}
void Program::kill() {
  if (pid_ <= 0) return;
  ::kill(pid_, SIGKILL);
  ::waitpid(pid_, nullptr, 0);
  pid_ = -1;
}
void Program::terminate() {
  if (pid_ > 0) ::kill(pid_, SIGTERM);
  eventually(2s, [this] { return !running(); });
  kill();
}
bool Program::running() {
  return pid_ > 0 && ::waitpid(pid_, nullptr, WNOHANG) == 0;
}

std::string find_program(const std::string& name) {
  for (const char* folder : {"/usr/bin/", "/usr/sbin/", "/usr/local/bin/"}) {
    if (::access((folder + name).c_str(), X_OK) == 0) return folder + name;
  }
  return "";
}

namespace {

sockaddr_in loopback(int port) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<std::uint16_t>(port));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  return address;
}

int listen_on(int port) {
  const int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const int on = 1;
  ::setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
  const sockaddr_in address = loopback(port);
  if (::bind(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0 || ::listen(fd, 16) != 0) {
    ::close(fd);
    return -1;
  }
  return fd;
}

int port_of(int fd) {
  sockaddr_in address{};
  socklen_t size = sizeof address;
  ::getsockname(fd, reinterpret_cast<sockaddr*>(&address), &size);
  return ntohs(address.sin_port);
}

int connect_to(int port) {
  const int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const sockaddr_in address = loopback(port);
  if (::connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0) return fd;
  ::close(fd);
  return -1;
}

}  // namespace

int free_port() {
  const int fd = listen_on(0);
  const int port = port_of(fd);
  ::close(fd);
  return port;
}

void wait_for_port(int port) {
  const bool up = eventually(10s, [port] {
    const int fd = connect_to(port);
    if (fd >= 0) ::close(fd);
    return fd >= 0;
  });
  ASSERT_TRUE(up) << "nothing listens on port " << port;
}

void write_file(const fs::path& path, const std::string& text) {
  std::ofstream(path, std::ios::binary) << text;
}
void write_bytes(const fs::path& path, const std::vector<std::uint8_t>& bytes) {
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
}
void save_picture(const fs::path& path, const std::vector<std::uint8_t>& bytes) {
  const fs::path part = path.string() + ".part";
  write_bytes(part, bytes);
  fs::rename(part, path);
}

bool eventually(std::chrono::milliseconds limit, const std::function<bool()>& condition) {
  const auto end = std::chrono::steady_clock::now() + limit;
  while (!condition()) {
    if (std::chrono::steady_clock::now() > end) return false;
    std::this_thread::sleep_for(10ms);
  }
  return true;
}

Image<std::uint16_t> night(int number, int width_px, int height_px, int bits) {
  const double full = std::ldexp(1.0, bits) - 1;
  cv::Mat picture(height_px, width_px, CV_64F);
  for (int row = 0; row < height_px; ++row) {
    for (int column = 0; column < width_px; ++column) {
      double value = 0.04 + 0.02 * row / height_px;
      for (int lamp = 1; lamp <= 3; ++lamp) {
        const double distance = std::hypot(column - width_px * lamp / 4.0, row - height_px / 2.0);
        value += 0.9 * std::exp(-distance * distance / 8) + 0.15 / (1 + distance * distance / 150);
      }
      picture.at<double>(row, column) = value * full;
    }
  }
  cv::Mat noise(height_px, width_px, CV_64F);
  cv::RNG random(static_cast<std::uint64_t>(number) + 1000);
  random.fill(noise, cv::RNG::NORMAL, 0, full * 0.01);
  Image<std::uint16_t> image(width_px, height_px);
  for (int row = 0; row < height_px; ++row) {
    for (int column = 0; column < width_px; ++column) {
      const double value = picture.at<double>(row, column) + noise.at<double>(row, column);
      image.at(column, row) =
          static_cast<std::uint16_t>(std::clamp(std::lround(value), 0L, std::lround(full)));
    }
  }
  return image;
}

namespace {

std::vector<std::uint8_t> encode(const Image<std::uint16_t>& picture, const char* extension, int depth,
                                 const std::vector<int>& options) {
  const cv::Mat wide(picture.height_px, picture.width_px, CV_16U,
                     const_cast<std::uint16_t*>(picture.pixels.data()));
  cv::Mat samples;
  wide.convertTo(samples, depth);
  std::vector<std::uint8_t> bytes;
  cv::imencode(extension, samples, bytes, options);
  return bytes;
}

}  // namespace

std::vector<std::uint8_t> jpeg_of(const Image<std::uint16_t>& picture, int quality) {
  return encode(picture, ".jpg", CV_8U, {cv::IMWRITE_JPEG_QUALITY, quality});
}
std::vector<std::uint8_t> png_of(const Image<std::uint16_t>& picture, int bits) {
  return encode(picture, ".png", bits > 8 ? CV_16U : CV_8U, {cv::IMWRITE_PNG_COMPRESSION, 1});
}

BadNetwork::BadNetwork(int target_port) : target_port_(target_port), listener_(listen_on(0)) {
  port_ = port_of(listener_);
  acceptor_ = std::jthread([this](std::stop_token stop) { accept_loop(stop); });
}
BadNetwork::~BadNetwork() {
  acceptor_.request_stop();
  acceptor_.join();
  connections_.clear();
  ::close(listener_);
}

void BadNetwork::set(Toxics toxics) {
  const std::scoped_lock lock(mutex_);
  toxics_ = toxics;
}

BadNetwork::Toxics BadNetwork::toxics() const {
  const std::scoped_lock lock(mutex_);
  return toxics_;
}

void BadNetwork::accept_loop(std::stop_token stop) {
  while (!stop.stop_requested()) {
    pollfd wait{listener_, POLLIN, 0};
    if (::poll(&wait, 1, 20) <= 0) continue;
    const int client = ::accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC);
    if (client < 0) continue;
    std::erase_if(connections_, [](const Connection& connection) { return connection.ended->load(); });
    const auto ended = std::make_shared<std::atomic<bool>>(false);
    connections_.push_back({std::jthread([this, client, ended](std::stop_token stopped) {
                              serve(client, stopped);
                              *ended = true;
                            }),
                            ended});
  }
}

void BadNetwork::serve(int client, std::stop_token stop) {
  const int server = connect_to(target_port_);
  long sent = 0;
  std::vector<std::uint8_t> buffer(16384);
  bool open = server >= 0;
  while (open && !stop.stop_requested()) {
    pollfd waits[2]{{client, POLLIN, 0}, {server, POLLIN, 0}};
    if (::poll(waits, 2, 20) <= 0) continue;
    if (waits[0].revents != 0) {
      const ssize_t count = ::recv(client, buffer.data(), buffer.size(), 0);
      open =
          count > 0 && ::send(server, buffer.data(), static_cast<std::size_t>(count), MSG_NOSIGNAL) == count;
    }
    if (open && waits[1].revents != 0) {
      const ssize_t count = ::recv(server, buffer.data(), buffer.size(), 0);
      open = count > 0 && forward(client, buffer.data(), static_cast<std::size_t>(count), sent, stop);
    }
  }
  if (server >= 0) ::close(server);
  ::close(client);
}

bool BadNetwork::forward(int client, const std::uint8_t* data, std::size_t size, long& sent,
                         std::stop_token stop) {
  if (const int delay_ms = toxics().delay_ms; sent == 0 && delay_ms > 0) {
    const auto end = std::chrono::steady_clock::now() + std::chrono::milliseconds(delay_ms);
    while (std::chrono::steady_clock::now() < end && !stop.stop_requested()) std::this_thread::sleep_for(5ms);
  }
  for (std::size_t at = 0; at < size && !stop.stop_requested();) {
    const Toxics now = toxics();
    if (now.cut_after_bytes >= 0 && sent >= now.cut_after_bytes) {
      const linger reset{1, 0};
      ::setsockopt(client, SOL_SOCKET, SO_LINGER, &reset, sizeof reset);
      return false;
    }
    if (now.stall_after_bytes >= 0 && sent >= now.stall_after_bytes) {
      std::this_thread::sleep_for(5ms);
      continue;
    }
    const bool trickle = now.bytes_per_s > 0 && sent >= 1000;
    std::size_t piece = size - at;
    if (now.bytes_per_s > 0) piece = std::min<std::size_t>(piece, trickle ? 1 : 1000);
    if (now.cut_after_bytes >= 0)
      piece = std::min(piece, static_cast<std::size_t>(now.cut_after_bytes - sent));
    std::vector<std::uint8_t> bytes(data + at, data + at + piece);
    for (std::size_t i = 0; now.corrupt_every_bytes > 0 && i < piece; ++i) {
      const long position = sent + static_cast<long>(i);
      if (position > 2000 && position % now.corrupt_every_bytes == 0)
        bytes[i] ^= 0x55;  // the headers stay whole
    }
    if (::send(client, bytes.data(), piece, MSG_NOSIGNAL) < 0) return false;
    at += piece;
    sent += static_cast<long>(piece);
    if (trickle) std::this_thread::sleep_for(1000ms / now.bytes_per_s);
  }
  return true;
}

void write_certificate(const fs::path& certificate, const fs::path& key, int from_days, int to_days) {
  EVP_PKEY* pair = EVP_RSA_gen(2048);
  X509* x509 = X509_new();
  ASN1_INTEGER_set(X509_get_serialNumber(x509), 1);
  X509_gmtime_adj(X509_getm_notBefore(x509), 86400L * from_days);
  X509_gmtime_adj(X509_getm_notAfter(x509), 86400L * to_days);
  X509_set_version(x509, 2);
  X509_set_pubkey(x509, pair);
  X509_NAME* name = X509_get_subject_name(x509);
  X509_NAME_add_entry_by_txt(name, "CN", MBSTRING_ASC, reinterpret_cast<const unsigned char*>("camera"), -1,
                             -1, 0);
  X509_set_issuer_name(x509, name);
  X509_EXTENSION* extension = X509V3_EXT_conf_nid(nullptr, nullptr, NID_subject_alt_name, "IP:127.0.0.1");
  X509_add_ext(x509, extension, -1);
  X509_sign(x509, pair, EVP_sha256());
  FILE* file = std::fopen(certificate.c_str(), "w");
  PEM_write_X509(file, x509);
  std::fclose(file);
  file = std::fopen(key.c_str(), "w");
  PEM_write_PrivateKey(file, pair, nullptr, nullptr, 0, nullptr, nullptr);
  std::fclose(file);
  X509_EXTENSION_free(extension);
  X509_free(x509);
  EVP_PKEY_free(pair);
}

int open_descriptors() {
  int count = 0;
  for ([[maybe_unused]] const auto& entry : fs::directory_iterator("/proc/self/fd")) ++count;
  return count;
}

long resident_kib() {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);) {
    if (line.starts_with("VmRSS:")) return std::stol(line.substr(6));
  }
  return 0;
}

}  // namespace lampglow::testing
