#include "daemon/sources/http_transfer.h"

#include <curl/curl.h>
#include <fmt/format.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <mutex>

#include "daemon/sources/credentials.h"
#include "daemon/sources/fault.h"

namespace lampglow::daemon {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

namespace {

void init_curl_once() {
  static std::once_flag once;
  std::call_once(once, [] { curl_global_init(CURL_GLOBAL_DEFAULT); });
}

struct EasyDeleter {
  void operator()(CURL* handle) const { curl_easy_cleanup(handle); }
};
struct MultiDeleter {
  void operator()(CURLM* handle) const { curl_multi_cleanup(handle); }
};

// X509_V_ERR_CERT_NOT_YET_VALID and X509_V_ERR_CERT_HAS_EXPIRED of OpenSSL.
bool is_about_dates(long verify_result) {
  return verify_result == 9 || verify_result == 10;
}

Fault fault_of_connect(CURL* easy) {
  long os_error = 0;
  curl_easy_getinfo(easy, CURLINFO_OS_ERRNO, &os_error);
  if (os_error == ECONNREFUSED) return Fault::connection_refused;
  if (os_error == ETIMEDOUT) return Fault::connect_timeout;
  return Fault::unreachable;
}

Fault fault_of_peer(CURL* easy) {
  long verify_result = 0;
  curl_easy_getinfo(easy, CURLINFO_SSL_VERIFYRESULT, &verify_result);
  return is_about_dates(verify_result) ? Fault::tls_expired : Fault::tls_untrusted;
}

Fault fault_of_code(CURL* easy, CURLcode code) {
  switch (code) {
    case CURLE_COULDNT_RESOLVE_HOST:
    case CURLE_COULDNT_RESOLVE_PROXY:
      return Fault::name_not_found;
    case CURLE_COULDNT_CONNECT:
      return fault_of_connect(easy);
    case CURLE_OPERATION_TIMEDOUT:  // only the connect phase has curl's own limit
      return Fault::connect_timeout;
    case CURLE_PEER_FAILED_VERIFICATION:
      return fault_of_peer(easy);
    case CURLE_SSL_CONNECT_ERROR:
    case CURLE_SSL_CACERT_BADFILE:
    case CURLE_SSL_CIPHER:
    case CURLE_SSL_CERTPROBLEM:
      return Fault::tls_error;
    case CURLE_TOO_MANY_REDIRECTS:
      return Fault::redirect_loop;
    case CURLE_FILESIZE_EXCEEDED:
      return Fault::too_large;
    case CURLE_LOGIN_DENIED:
      return Fault::unauthorised;
    case CURLE_GOT_NOTHING:
    case CURLE_PARTIAL_FILE:
    case CURLE_RECV_ERROR:
    case CURLE_SEND_ERROR:
      return Fault::connection_lost;
    default:
      return Fault::protocol_error;
  }
}

}  // namespace

class HttpTransfer::Curl {
 public:
  Curl(const SourceOptions& options, const std::string& url)
      : options_(options),
        name_(redacted_url(options.url)),
        easy_(curl_easy_init()),
        multi_(curl_multi_init()) {
    if (!easy_ || !multi_) throw SourceError(Fault::internal, "libcurl can't start");
    set_request(url);
    set_limits();
    set_credentials();
    curl_multi_add_handle(multi_.get(), easy_.get());
    window_began_ = Clock::now();
  }
  Curl(const Curl&) = delete;
  Curl& operator=(const Curl&) = delete;
  ~Curl() { curl_multi_remove_handle(multi_.get(), easy_.get()); }

  State read(Deadline deadline, std::stop_token stop) {
    const std::stop_callback wake(stop, [this] { curl_multi_wakeup(multi_.get()); });
    const std::size_t before = bytes_.size();
    while (!stop.stop_requested()) {
      if (perform()) return bytes_.size() > before ? State::more : State::ended;
      if (bytes_.size() > before) return State::more;
      check_time(deadline);
      curl_multi_poll(multi_.get(), nullptr, 0, poll_timeout_ms(deadline), nullptr);
    }
    return State::stopped;
  }

  State read_available() {
    const std::size_t before = bytes_.size();
    if (perform() && bytes_.size() == before) return State::ended;
    if (bytes_.size() == before) return State::waiting;
    start_window();
    return State::more;
  }

  std::vector<std::uint8_t>& bytes() { return bytes_; }
  std::string content_type() const {
    const char* type = nullptr;
    curl_easy_getinfo(easy_.get(), CURLINFO_CONTENT_TYPE, &type);
    return type == nullptr ? "" : type;
  }
  const std::string& server() const { return server_; }

 private:
  void set_request(const std::string& url) {
    set(CURLOPT_URL, url.c_str());
    const bool tls = url.starts_with("https:");
    set(CURLOPT_PROTOCOLS_STR, tls ? "https" : "http,https");
    set(CURLOPT_REDIR_PROTOCOLS_STR, tls ? "https" : "http,https");
    set(CURLOPT_PROXY, "");  // a camera is reached directly, whatever the environment says
    set(CURLOPT_HTTP_VERSION, static_cast<long>(CURL_HTTP_VERSION_1_1));
    set(CURLOPT_USERAGENT, "lampglow");
    set(CURLOPT_NOSIGNAL, 1L);
    set(CURLOPT_WRITEFUNCTION, &Curl::on_data);
    set(CURLOPT_WRITEDATA, this);
    set(CURLOPT_HEADERFUNCTION, &Curl::on_header);
    set(CURLOPT_HEADERDATA, this);
    set(CURLOPT_ERRORBUFFER, error_);
    if (!options_.ca_file.empty()) set(CURLOPT_CAINFO, options_.ca_file.c_str());
  }

  void set_limits() {
    set(CURLOPT_FOLLOWLOCATION, 1L);
    set(CURLOPT_MAXREDIRS, static_cast<long>(options_.max_redirects));
    set(CURLOPT_CONNECTTIMEOUT_MS, static_cast<long>(options_.connect_timeout.count()));
    set(CURLOPT_BUFFERSIZE, 64L * 1024);
  }

  void set_credentials() {
    const auto credentials = read_credentials(options_);
    if (!credentials) return;
    set(CURLOPT_HTTPAUTH, static_cast<long>(CURLAUTH_BASIC | CURLAUTH_DIGEST));
    set(CURLOPT_USERNAME, credentials->user.c_str());
    set(CURLOPT_PASSWORD, credentials->password.c_str());
  }

  template <typename Value>
  void set(CURLoption option, Value value) {
    const CURLcode code = curl_easy_setopt(easy_.get(), option, value);
    if (code != CURLE_OK)
      fail(Fault::internal, fmt::format("libcurl refuses option {}", static_cast<int>(option)));
  }

  static std::size_t on_data(char* data, std::size_t size, std::size_t count, void* self) {
    return static_cast<Curl*>(self)->take(data, size * count);
  }
  static std::size_t on_header(char* data, std::size_t size, std::size_t count, void* self) {
    const std::string_view line(data, size * count);
    static_cast<Curl*>(self)->window_bytes_ += line.size();
    auto& server = static_cast<Curl*>(self)->server_;
    if (line.size() > 8 && strncasecmp(line.data(), "server: ", 8) == 0) {
      server = line.substr(8, line.find_last_not_of("\r\n") + 1 - 8);
    }
    return line.size();
  }

  // The body of an error answer is of no use: we end there.
  std::size_t take(const char* data, std::size_t size) {
    if (status() >= 400) return 0;
    too_large_ = bytes_.size() + size > options_.max_bytes || announced_bytes() > options_.max_bytes;
    if (too_large_) return 0;
    const auto* begin = reinterpret_cast<const std::uint8_t*>(data);
    bytes_.insert(bytes_.end(), begin, begin + size);
    window_bytes_ += size;
    return size;
  }

  std::size_t announced_bytes() const {
    curl_off_t length = -1;
    curl_easy_getinfo(easy_.get(), CURLINFO_CONTENT_LENGTH_DOWNLOAD_T, &length);
    return length > 0 ? static_cast<std::size_t>(length) : 0;
  }

  long status() const {
    long code = 0;
    curl_easy_getinfo(easy_.get(), CURLINFO_RESPONSE_CODE, &code);
    return code;
  }

  // Moves the transfer on as far as it goes without waiting; true when it has ended.
  bool perform() {
    int running = 0;
    curl_multi_perform(multi_.get(), &running);
    int left = 0;
    while (CURLMsg* message = curl_multi_info_read(multi_.get(), &left)) {
      if (message->msg == CURLMSG_DONE) finish(message->data.result);
    }
    return running == 0;
  }

  void finish(CURLcode code) {
    const long http = status();
    if (too_large_) fail(Fault::too_large, fmt::format("more than {} bytes", options_.max_bytes));
    // A redirect that was not followed is the redirect limit's doing and has its own code.
    if (code == CURLE_OK || code == CURLE_WRITE_ERROR) {
      if (http == 401 || http == 403) fail(Fault::unauthorised, fmt::format("HTTP status {}", http));
      if (http != 200) fail(Fault::http_error, fmt::format("HTTP status {}", http));
    }
    if (code == CURLE_OK) return;
    fail(fault_of_code(easy_.get(), code), error_[0] != '\0' ? error_ : curl_easy_strerror(code));
  }

  void start_window() {
    window_began_ = Clock::now();
    window_bytes_ = 0;
  }

  // The rate is counted over windows of stall_timeout, from the moment the request is out.
  void check_time(Deadline deadline) {
    const auto now = Clock::now();
    if (now >= deadline) {
      const bool trickles = !bytes_.empty();
      fail(trickles ? Fault::too_slow : Fault::stalled, "not complete in time");
    }
    if (!connected()) {
      start_window();  // connecting has a limit of its own
    } else if (now - window_began_ >= options_.stall_timeout) {
      check_window(now);
      start_window();
    }
  }

  void check_window(Clock::time_point now) {
    const double seconds = std::chrono::duration<double>(now - window_began_).count();
    const double rate = static_cast<double>(window_bytes_) / seconds;
    if (window_bytes_ == 0) fail(Fault::stalled, fmt::format("nothing received for {:.1f} s", seconds));
    if (rate < options_.min_bytes_per_s) {
      fail(Fault::too_slow, fmt::format("{:.0f} bytes/s, less than {}", rate, options_.min_bytes_per_s));
    }
  }

  bool connected() const {
    curl_off_t sent_us = 0;  // until the request was sent
    curl_easy_getinfo(easy_.get(), CURLINFO_PRETRANSFER_TIME_T, &sent_us);
    return sent_us > 0;
  }

  int poll_timeout_ms(Deadline deadline) const {
    const auto next = std::min(deadline, window_began_ + options_.stall_timeout);
    const auto wait = std::chrono::ceil<milliseconds>(next - Clock::now());
    return static_cast<int>(std::clamp<milliseconds::rep>(wait.count(), 0, 60'000));
  }

  [[noreturn]] void fail(Fault fault, const std::string& what) const {
    throw SourceError(fault, fmt::format("{}: {}", name_, what));
  }

  const SourceOptions options_;
  const std::string name_;
  std::unique_ptr<CURL, EasyDeleter> easy_;
  std::unique_ptr<CURLM, MultiDeleter> multi_;
  std::vector<std::uint8_t> bytes_;
  std::string server_;
  Clock::time_point window_began_;
  std::size_t window_bytes_ = 0;
  bool too_large_ = false;
  char error_[CURL_ERROR_SIZE] = "";
};

HttpTransfer::HttpTransfer(const SourceOptions& options, const std::string& url) {
  init_curl_once();
  curl_ = std::make_unique<Curl>(options, url);
}
HttpTransfer::~HttpTransfer() = default;
HttpTransfer::State HttpTransfer::read(Deadline deadline, std::stop_token stop) {
  return curl_->read(deadline, stop);
}
HttpTransfer::State HttpTransfer::read_available() {
  return curl_->read_available();
}
std::vector<std::uint8_t>& HttpTransfer::bytes() {
  return curl_->bytes();
}
std::string HttpTransfer::content_type() const {
  return curl_->content_type();
}
std::string HttpTransfer::server() const {
  return curl_->server();
}

}  // namespace lampglow::daemon
