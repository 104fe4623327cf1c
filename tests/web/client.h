// A plain HTTP client for tests: a socket, what is written to it, and what comes back.
#pragma once

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#include <cstdlib>
#include <stdexcept>
#include <string>

namespace lampglow::testing_support {

class Client {
 public:
  // `receive_bytes`: of the socket's buffer, for one that is not to take much; 0: the system's.
  explicit Client(unsigned short port, int receive_bytes = 0)
      : fd_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(port);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    const timeval patience{10, 0};
    if (receive_bytes) ::setsockopt(fd_, SOL_SOCKET, SO_RCVBUF, &receive_bytes, sizeof receive_bytes);
    ::setsockopt(fd_, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    if (::connect(fd_, static_cast<const sockaddr*>(static_cast<const void*>(&address)), sizeof address) != 0)
      throw std::runtime_error("cannot connect");
  }
  Client(const Client&) = delete;
  Client& operator=(const Client&) = delete;
  ~Client() { ::close(fd_); }

  void send(const std::string& text) {
    if (::send(fd_, text.data(), text.size(), MSG_NOSIGNAL) != static_cast<ssize_t>(text.size()))
      throw std::runtime_error("cannot send");
  }
  // Until `end` is among what has come, or the server closes, or ten seconds pass.
  std::string read_until(const std::string& end) {
    while (text_.find(end) == std::string::npos && read_some()) {
    }
    return text_;
  }
  // Until the server closes.
  std::string read_all() {
    while (read_some()) {
    }
    return text_;
  }
  bool closed() { return !read_some(); }
  bool ended() const { return ended_; }  // the server said that nothing more comes

 private:
  bool read_some() {
    char bytes[65536];
    const ssize_t count = ::recv(fd_, bytes, sizeof bytes, 0);
    ended_ = count == 0;
    if (count <= 0) return false;
    text_.append(bytes, static_cast<size_t>(count));
    return true;
  }
  int fd_;
  std::string text_;
  bool ended_ = false;
};

struct Answer {
  int status = 0;
  std::string head, body;
  bool has(const std::string& text) const { return head.find(text) != std::string::npos; }
};

inline Answer to_answer(const std::string& text) {
  Answer answer;
  const size_t end = text.find("\r\n\r\n");
  if (text.size() < 12 || end == std::string::npos) return answer;
  answer.status = std::atoi(text.c_str() + 9);
  answer.head = text.substr(0, end + 2);
  answer.body = text.substr(end + 4);
  return answer;
}

inline Answer get(unsigned short port, const std::string& target, const std::string& fields = "") {
  Client client(port);
  client.send("GET " + target + " HTTP/1.1\r\nHost: test\r\nConnection: close\r\n" + fields + "\r\n");
  return to_answer(client.read_all());
}

}  // namespace lampglow::testing_support
