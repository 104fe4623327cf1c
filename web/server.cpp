#include "web/server.h"

#include <algorithm>
#include <array>
#include <boost/asio.hpp>
#include <boost/asio/ssl.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <map>
#include <set>
#include <stdexcept>
#include <thread>
#include <type_traits>
#include <utility>

#include "web/large_answers.h"
#include "web/reader_pool.h"
#include "web/wire.h"

namespace lampglow::web {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
using asio::ip::tcp;
using boost::system::error_code;

constexpr auto kNoThrow = asio::as_tuple(asio::use_awaitable);
constexpr int kMissedObservations = 2000;
constexpr size_t kPiece_bytes = 65536;
constexpr size_t kSlowest_bytes_per_s = 16384;

using PlainStream = beast::tcp_stream;
using TlsStream = asio::ssl::stream<beast::tcp_stream>;  // through Beast's own ssl_stream answers over 64 KiB
                                                         // did not arrive

// Null without a certificate.
std::shared_ptr<asio::ssl::context> tls_context(const TlsFiles& files) {
  if (files.certificate.empty()) return nullptr;
  auto context = std::make_shared<asio::ssl::context>(asio::ssl::context::tls_server);
  context->set_options(asio::ssl::context::default_workarounds | asio::ssl::context::no_tlsv1 |
                       asio::ssl::context::no_tlsv1_1);
  error_code error;
  context->use_certificate_chain_file(files.certificate.string(), error);
  if (error)
    throw std::runtime_error(files.certificate.string() + ": no usable PEM certificate: " + error.message());
  context->use_private_key_file(files.key.string(), asio::ssl::context::pem, error);
  if (error) throw std::runtime_error(files.key.string() + ": no usable PEM key for it: " + error.message());
  return context;
}

struct Held {
  Response response;
  Place place;
};

// A host has a whole /64 of IPv6 addresses.
asio::ip::address one_host(const asio::ip::address& address) {
  if (!address.is_v6() || address.to_v6().is_v4_mapped()) return address;
  auto bytes = address.to_v6().to_bytes();
  std::fill(bytes.begin() + 8, bytes.end(), static_cast<unsigned char>(0));
  return asio::ip::address_v6(bytes);
}

// Takes a piece off the front.
std::string_view take_piece(std::string_view& body) {
  const std::string_view piece = body.substr(0, kPiece_bytes);
  body.remove_prefix(piece.size());
  return piece;
}

}  // namespace

struct Server::Impl {
  Impl(const ServerOptions& given, LiveState& state, const ApiOptions& api_options)
      : options(given),
        live(state),
        api(state, api_options),
        tls(tls_context(given.tls)),
        acceptor(io),
        readers(api_options.database.value_or("")),
        large_answers(given.max_large_answers_bytes) {
    listen();
    live.on_message([this] { asio::post(io, [this] { wake_streams(); }); });
  }

  ~Impl() {
    live.on_message({});
    stop();
  }

  void listen() {
    error_code error;
    const auto address = asio::ip::make_address(options.address, error);
    if (error) throw std::runtime_error("http address " + options.address + ": expected an IP address");
    const tcp::endpoint endpoint(address, options.port);
    acceptor.open(endpoint.protocol());
    acceptor.set_option(asio::socket_base::reuse_address(true));
    acceptor.bind(endpoint, error);
    if (!error) acceptor.listen(asio::socket_base::max_listen_connections, error);
    if (error)
      throw std::runtime_error("cannot listen on " + options.address + " port " +
                               std::to_string(options.port) + ": " + error.message());
  }

  void start() {
    asio::co_spawn(io, accept_all(), asio::detached);
    thread = std::thread([this] { io.run(); });
  }

  void stop() {
    io.stop();
    if (thread.joinable()) thread.join();
    database_threads.stop();
    database_threads.join();
  }

  void end_streams() {
    ++access_version;
    wake_streams();
  }

  void wake_streams() {
    for (asio::steady_timer* timer : waiting_streams) timer->cancel();
  }

  asio::awaitable<void> accept_all();
  asio::awaitable<void> connection(tcp::socket socket);
  template <typename Stream>
  asio::awaitable<void> serve(Stream& stream);
  template <typename Stream>
  asio::awaitable<bool> answer(Stream& stream, const WireRequest& wire);
  template <typename Stream>
  asio::awaitable<bool> write_all(Stream& stream, std::string_view head, std::string_view body);
  template <typename Stream>
  asio::awaitable<void> refuse(Stream& stream, int status);
  template <typename Stream>
  asio::awaitable<void> follow(Stream& stream, const Request& request, const std::string& head);
  template <typename Work>
  asio::awaitable<std::invoke_result_t<Work>> on_database_thread(Work work);
  Held read_database(const Request& request);
  asio::awaitable<Held> first_messages(const Request& request, std::uint64_t& sequence);
  Held read_missed(const StreamPosition& position);

  ServerOptions options;
  LiveState& live;
  Api api;
  asio::io_context io{1};
  std::shared_ptr<asio::ssl::context> tls;  // null: plain HTTP; the io thread's
  tcp::acceptor acceptor;
  ReaderPool readers;
  LargeAnswers large_answers;
  asio::thread_pool database_threads{2};
  std::thread thread;
  std::set<asio::steady_timer*> waiting_streams;
  std::map<asio::ip::address, int> by_address;
  int connections = 0;
  int streams = 0;
  int access_version = 0;
};

asio::awaitable<void> Server::Impl::accept_all() {
  for (;;) {
    auto [error, socket] = co_await acceptor.async_accept(kNoThrow);
    if (error == asio::error::operation_aborted) co_return;
    if (error) {  // out of file descriptors: let some of them come back
      asio::steady_timer pause(io, std::chrono::milliseconds(100));
      co_await pause.async_wait(kNoThrow);
      continue;
    }
    error_code gone;
    const auto peer = socket.remote_endpoint(gone);
    if (gone || connections >= options.max_connections) continue;
    if (by_address[one_host(peer.address())] >= options.max_connections_per_address) continue;
    asio::co_spawn(io, connection(std::move(socket)), asio::detached);
  }
}

asio::awaitable<void> Server::Impl::connection(tcp::socket socket) {
  error_code error;
  const auto address = one_host(socket.remote_endpoint(error).address());
  ++connections;
  ++by_address[address];
  socket.set_option(tcp::no_delay(true), error);
  try {
    if (!tls) {
      PlainStream stream(std::move(socket));
      co_await serve(stream);
    } else {
      const std::shared_ptr<asio::ssl::context> context = tls;
      TlsStream stream(std::move(socket), *context);
      beast::get_lowest_layer(stream).expires_after(options.header_timeout);
      const auto [failed] = co_await stream.async_handshake(asio::ssl::stream_base::server, kNoThrow);
      if (!failed) co_await serve(stream);
    }
  } catch (const std::exception&) {  // out of memory for one connection must not end the server
  }
  --connections;
  if (--by_address[address] == 0) by_address.erase(address);
}

template <typename Stream>
asio::awaitable<void> Server::Impl::serve(Stream& stream) {
  beast::flat_buffer buffer(static_cast<size_t>(options.max_header_bytes + options.max_body_bytes));
  for (bool first = true;; first = false) {
    RequestParser parser;
    limit(parser, options.max_header_bytes, options.max_body_bytes);
    auto& lowest = beast::get_lowest_layer(stream);
    if (!first && buffer.size() == 0) {
      // Waiting between requests is no sin; being slow within one is.
      lowest.expires_after(options.keep_alive_timeout);
      const auto [error, count] = co_await stream.async_read_some(buffer.prepare(1024), kNoThrow);
      if (error) co_return;
      buffer.commit(count);
    }
    lowest.expires_after(options.header_timeout);
    const auto [error, ignored] = co_await http::async_read(stream, buffer, parser, kNoThrow);
    if (error) {
      if (const int status = status_of(error)) co_await refuse(stream, status);
      break;
    }
    const auto request = parser.release();
    if (request.version() == 11 && request.count(http::field::host) != 1) {  // RFC 9112, 3.2
      co_await refuse(stream, 400);
      break;
    }
    if (!co_await answer(stream, request)) break;
  }
  error_code ignored;
  beast::get_lowest_layer(stream).socket().shutdown(tcp::socket::shutdown_send, ignored);
}

template <typename Stream>
asio::awaitable<void> Server::Impl::refuse(Stream& stream, int status) {
  live.count_request(status);
  const Response response = problem(status, "the request could not be read");
  const std::string text = head_of(response, 11, false) + response.body;
  beast::get_lowest_layer(stream).expires_after(options.write_timeout);
  co_await asio::async_write(stream, asio::buffer(text), kNoThrow);
}

// Runs `work` on a database thread; the connection goes on with what it gave as soon as it is there.
// (co_spawn on the pool would put a finished coroutine behind all that waits there.)
template <typename Work>
asio::awaitable<std::invoke_result_t<Work>> Server::Impl::on_database_thread(Work work) {
  using Result = std::invoke_result_t<Work>;
  return asio::async_initiate<const asio::use_awaitable_t<>, void(Result)>(
      [this](auto handler, Work wanted) {
        asio::post(database_threads,
                   [this, handler = std::move(handler), wanted = std::move(wanted)]() mutable {
                     asio::post(io, [handler = std::move(handler), result = wanted()]() mutable {
                       handler(std::move(result));
                     });
                   });
      },
      asio::use_awaitable, std::move(work));
}

// On a database thread. A large answer has its place in memory from here on until it is sent.
Held Server::Impl::read_database(const Request& request) {
  try {
    Response response = readers.use([&](storage::Reader& reader) { return api.answer(request, &reader); });
    Place place(large_answers, response.content().size());
    if (place.given()) return {std::move(response), std::move(place)};
    Response busy = problem(503, "too many large answers are being sent; ask for less, or later");
    busy.headers.emplace_back("Retry-After", "10");
    return {std::move(busy), {}};
  } catch (const std::exception&) {  // StorageError, or out of memory
    return {problem(503, "the database cannot be read at the moment"), {}};
  }
}

// False: close the connection.
template <typename Stream>
asio::awaitable<bool> Server::Impl::answer(Stream& stream, const WireRequest& wire) {
  const Request request = to_request(wire);
  const Route::Kind kind = api.kind(request);
  Held held;
  if (kind == Route::Kind::database)
    held = co_await on_database_thread([this, &request] { return read_database(request); });
  else
    held.response = api.answer(request, nullptr);
  const Response& response = held.response;
  live.count_request(response.status);
  const bool streaming = kind == Route::Kind::stream && response.status == 200;
  const bool keep_alive = wire.keep_alive() && !streaming;
  const std::string head = head_of(response, wire.version(), keep_alive, !streaming);
  if (streaming) {
    beast::get_lowest_layer(stream).expires_after(options.write_timeout);
    co_await follow(stream, request, head);
    co_return false;
  }
  const bool head_only = wire.method() == http::verb::head || response.status == 304;
  const std::string_view body = head_only ? std::string_view() : response.content();
  co_return co_await write_all(stream, head, body) && keep_alive;
}

// The time limit is for each piece and, by the slowest connection that is worth it, for the whole: a slow one
// gets a long answer, a dead one is closed. False: it is.
template <typename Stream>
asio::awaitable<bool> Server::Impl::write_all(Stream& stream, std::string_view head, std::string_view body) {
  using Clock = std::chrono::steady_clock;
  auto& lowest = beast::get_lowest_layer(stream);
  const auto end =
      Clock::now() + options.write_timeout + std::chrono::seconds(body.size() / kSlowest_bytes_per_s);
  const std::array<asio::const_buffer, 2> first{asio::buffer(head), asio::buffer(take_piece(body))};
  lowest.expires_after(options.write_timeout);
  auto [error, count] = co_await asio::async_write(stream, first, kNoThrow);
  while (!error && !body.empty()) {
    const asio::const_buffer piece = asio::buffer(take_piece(body));
    lowest.expires_at(std::min(Clock::now() + options.write_timeout, end));
    std::tie(error, count) = co_await asio::async_write(stream, piece, kNoThrow);
  }
  co_return !error;
}

// What the client has missed: from memory, else from the database; nothing for a new client but the present
// state. Where there is no room for it: the 503 that closes the connection, so that the client tries again.
asio::awaitable<Held> Server::Impl::first_messages(const Request& request, std::uint64_t& sequence) {
  Held first;
  first.response.body = "retry: 3000\n\n";
  sequence = live.last_sequence();
  const auto position = parse_stream_id(request.last_event_id);
  if (!position) co_return first;
  const auto kept = position->run == live.run_id() ? live.messages_after(position->sequence) : std::nullopt;
  if (kept) sequence = position->sequence;
  if (kept || !api.options().database) co_return first;
  Held missed = co_await on_database_thread([this, &position] { return read_missed(*position); });
  missed.response.body.insert(0, first.response.body);
  co_return missed;
}

// On a database thread.
Held Server::Impl::read_missed(const StreamPosition& position) {
  Held missed;
  try {
    missed.response.body = readers.use([&](storage::Reader& reader) {
      return missed_messages(live, reader, position, kMissedObservations);
    });
  } catch (const std::exception&) {  // what came since the station runs is told nevertheless
    return {};
  }
  missed.place = Place(large_answers, missed.response.body.size());
  if (!missed.place.given()) missed.response = problem(503, "too many large answers are being sent");
  return missed;
}

template <typename Stream>
asio::awaitable<void> Server::Impl::follow(Stream& stream, const Request& request, const std::string& head) {
  const int admitted = access_version;
  if (const auto [error, count] = co_await asio::async_write(stream, asio::buffer(head), kNoThrow); error)
    co_return;
  std::uint64_t sequence = 0;
  Held first = co_await first_messages(request, sequence);
  if (first.response.status != 200) co_return;
  std::string text = std::move(first.response.body);
  asio::steady_timer timer(io);
  waiting_streams.insert(&timer);
  live.set_stream_clients(++streams);
  while (admitted == access_version) {
    if (const auto news = live.messages_after(sequence)) {
      text += news->text;
      sequence = news->last_sequence;
    } else {  // it fell behind what is kept
      sequence = live.last_sequence();
    }
    if (!text.empty()) {
      beast::get_lowest_layer(stream).expires_after(options.write_timeout);
      const auto [error, count] = co_await asio::async_write(stream, asio::buffer(text), kNoThrow);
      if (error) break;
      text = {};
      first.place = {};
    }
    if (live.last_sequence() != sequence || admitted != access_version) continue;
    timer.expires_after(options.stream_heartbeat);
    const auto [woken] = co_await timer.async_wait(kNoThrow);
    if (!woken) text = ": still here\n\n";
  }
  waiting_streams.erase(&timer);
  live.set_stream_clients(--streams);
}

Server::Server(const ServerOptions& options, LiveState& live, const ApiOptions& api)
    : impl_(std::make_unique<Impl>(options, live, api)) {}
Server::~Server() = default;

void Server::start() {
  impl_->start();
}
void Server::stop() {
  impl_->stop();
}
void Server::set_tls(const TlsFiles& files) {
  asio::post(impl_->io, [impl = impl_.get(), fresh = tls_context(files)] { impl->tls = fresh; });
}
void Server::set_access(Access access) {
  impl_->api.set_access(std::move(access));
  asio::post(impl_->io, [impl = impl_.get()] { impl->end_streams(); });
}
void Server::use_database(std::optional<storage::FileId> file) {
  impl_->readers.use_only(file);
}
unsigned short Server::port() const {
  return impl_->acceptor.local_endpoint().port();
}

}  // namespace lampglow::web
