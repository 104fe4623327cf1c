#include "tests/system/station/serving.h"

#include <curl/curl.h>
#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <sstream>
#include <vector>

#include "tests/support/temporary_folder.h"

namespace lampglow::testing {

namespace {

// Takes the handle, and gives it back to curl.
Answer perform(CURL* curl, const std::string& url) {
  Answer answer;
  curl_easy_setopt(curl, CURLOPT_URL, url.c_str());
  curl_easy_setopt(curl, CURLOPT_TIMEOUT_MS, 3000L);
  curl_easy_setopt(curl, CURLOPT_WRITEDATA, &answer.body);
  curl_easy_setopt(
      curl, CURLOPT_WRITEFUNCTION, +[](char* data, std::size_t size, std::size_t count, std::string* body) {
        body->append(data, size * count);
        return size * count;
      });
  const CURLcode result = curl_easy_perform(curl);
  if (result == CURLE_OK)
    curl_easy_getinfo(curl, CURLINFO_RESPONSE_CODE, &answer.status);
  else
    answer.failure = curl_easy_strerror(result);
  curl_easy_cleanup(curl);
  return answer;
}

}  // namespace

Answer ask(int port, const std::string& path) {
  return perform(curl_easy_init(), "http://127.0.0.1:" + std::to_string(port) + path);
}

Answer ask_securely(int port, const std::string& path, const fs::path& trusted, TlsVersions versions) {
  CURL* curl = curl_easy_init();
  curl_easy_setopt(curl, CURLOPT_CAINFO, trusted.c_str());
  if (versions == TlsVersions::up_to_1_1) {
    curl_easy_setopt(
        curl, CURLOPT_SSLVERSION,
        static_cast<long>(CURL_SSLVERSION_TLSv1_0) | static_cast<long>(CURL_SSLVERSION_MAX_TLSv1_1));
    curl_easy_setopt(curl, CURLOPT_SSL_CIPHER_LIST, "DEFAULT@SECLEVEL=0");  // else curl refuses first
  }
  return perform(curl, "https://127.0.0.1:" + std::to_string(port) + path);
}

Serving::Serving(const fs::path& config, fs::path log) : log_(std::move(log)) {
  const std::string text = config.string();
  std::vector<char*> words;
  for (const char* word : {LAMPGLOW_BINARY, "serve", "--config", text.c_str()})
    words.push_back(const_cast<char*>(word));
  words.push_back(nullptr);
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addopen(&actions, 2, log_.c_str(), O_WRONLY | O_CREAT | O_APPEND, 0600);
  if (posix_spawn(&pid_, words[0], &actions, nullptr, words.data(), environ) != 0) pid_ = -1;
  posix_spawn_file_actions_destroy(&actions);
}

Serving::~Serving() {
  if (pid_ > 0) {
    signal(SIGKILL);
    ::waitpid(pid_, nullptr, 0);
  }
}

void Serving::signal(int number) const {
  if (pid_ > 0) ::kill(pid_, number);
}

int Serving::wait(std::chrono::milliseconds limit) {
  int status = 0;
  const bool ended = eventually(limit, [&] { return ::waitpid(pid_, &status, WNOHANG) == pid_; });
  if (!ended) return -1;
  pid_ = -1;
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

std::string Serving::log() const {
  return test::read_all(log_);
}

void lengthen(const fs::path& archive, int brackets, const std::string& role) {
  std::istringstream rows(test::read_all(archive / "frames.csv"));
  std::string text, row;
  std::vector<std::string> fields;
  while (std::getline(rows, row)) {
    if (row.starts_with("2027")) continue;  // of an earlier call
    text += row + "\n";
    if (row.find("," + role) != std::string::npos) fields.push_back(row.substr(row.find(',')));
  }
  for (int i = 0; i < brackets; ++i) {
    char time[32];
    std::snprintf(time, sizeof time, "2027-01-01T%02d:%02d:%02dZ", i / 3600, i / 60 % 60, i % 60);
    text += time + fields[static_cast<std::size_t>(i) % fields.size()] + "\n";
  }
  write_file(archive / "frames.csv", text);
}

}  // namespace lampglow::testing
