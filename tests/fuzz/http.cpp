// An HTTP request as it comes from the network: read as the server reads it, answered with a database behind
// it, and put into the form that goes back.
#include <boost/asio/buffer.hpp>
#include <cstdlib>
#include <filesystem>

#include "storage/reader.h"
#include "storage/store.h"
#include "tests/storage/sample.h"
#include "web/api.h"
#include "web/wire.h"

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
  web::RequestParser parser;
  web::limit(parser, 8192, 1024);
  parser.eager(true);
  boost::system::error_code error;
  parser.put(boost::asio::buffer(data, size), error);
  if (error) {
    const int status = web::status_of(error);
    if (status != 0 && (status < 400 || status > 499)) std::abort();
    return 0;
  }
  if (!parser.is_header_done()) return 0;
  const web::Request request = web::to_request(parser.get());
  (void)api.kind(request);
  const web::Response response = api.answer(request, station.reader.get());
  if (response.status < 200 || response.status == 500 || response.status > 503) std::abort();
  // The head ends where it should: no header's value brings a line of its own.
  const std::string head = web::head_of(response, parser.get().version(), true);
  if (head.find("\r\n\r\n") + 4 != head.size()) std::abort();
  if (const auto position = web::parse_stream_id(request.last_event_id))
    (void)web::missed_messages(station.live, *station.reader, *position, 100);
  return 0;
}
