// An HTTP request as it comes from the network: Beast's parser with the server's limits, then the interface
// with a database behind it.
#include <boost/beast/http.hpp>
#include <cstdlib>
#include <filesystem>

#include "storage/reader.h"
#include "storage/store.h"
#include "tests/storage/sample.h"
#include "web/api.h"

namespace {

using namespace lampglow;

struct Station {
  Station() {
    const auto file =
        std::filesystem::temp_directory_path() / ("lampglow-fuzz-" + std::to_string(getpid()) + ".db");
    storage::Store store(file);
    const auto camera = store.upsert_camera("quay", testing_support::harbour());
    for (int i = 0; i < 20; ++i)
      store.put(camera, testing_support::foggy(testing_support::at("2026-11-22T00:00:00Z") +
                                               std::chrono::minutes(i)));
    store.commit();
    live.set_camera("quay", testing_support::harbour());
    live.publish("quay", testing_support::foggy(testing_support::at("2026-11-22T00:30:00Z")));
    options.database = file;
    reader = std::make_unique<storage::Reader>(file);
  }
  web::LiveState live;
  web::ApiOptions options;
  std::unique_ptr<storage::Reader> reader;
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static Station station;
  static const web::Api api(station.live, station.options);
  namespace http = boost::beast::http;
  http::request_parser<http::string_body> parser;
  parser.header_limit(8192);
  parser.body_limit(1024);
  parser.eager(true);
  boost::beast::error_code error;
  parser.put(boost::asio::buffer(data, size), error);
  if (error || !parser.is_header_done()) return 0;
  const auto& wire = parser.get();
  const web::Request request{std::string(wire.method_string()),  std::string(wire.target()),
                             std::string(wire["If-None-Match"]), std::string(wire["Accept"]),
                             std::string(wire["Authorization"]), std::string(wire["Last-Event-ID"])};
  (void)api.kind(request);
  const web::Response response = api.answer(request, station.reader.get());
  if (response.status < 200 || response.status == 500 || response.status > 503) std::abort();
  if (const auto position = web::parse_stream_id(request.last_event_id))
    (void)web::missed_messages(station.live, *station.reader, *position, 100);
  return 0;
}
