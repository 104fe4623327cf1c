// Rows that a damaged or newer database may hold: read without a crash, told without bad JSON.
#include <boost/json.hpp>
#include <cstdint>
#include <cstdlib>
#include <string>

#include "storage/rows.h"
#include "web/shapes.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace lampglow;
  if (size < 2) return 0;
  const std::string_view bytes(static_cast<const char*>(static_cast<const void*>(data)), size);
  const RingProfile profile = storage::unpack_rings(bytes.substr(1), data[0]);
  if (profile.radiance.size() != profile.theta_deg.size()) std::abort();
  static SQLite::Database database(":memory:");
  static const std::string sql = "SELECT ?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?";
  SQLite::Statement row(database, sql);
  for (int i = 1; i <= 20; ++i) {
    const std::uint8_t kind = data[static_cast<std::size_t>(i) % size];
    if (kind % 4 == 0) row.bind(i);
    if (kind % 4 == 1) row.bind(i, static_cast<double>(kind) * 1e300 * (kind > 128 ? -1e10 : 1));
    if (kind % 4 == 2) row.bind(i, static_cast<int64_t>(kind) << (kind % 56));
    if (kind % 4 == 3) row.bind(i, std::string(bytes));
  }
  row.executeStep();
  storage::RowReader reader(row);
  storage::ObservationRow out;
  out.observation = storage::read_observation(reader);
  out.reason = std::string(bytes);
  std::string text;
  web::append_observation_json(text, out);
  boost::json::error_code error;
  (void)boost::json::parse(web::observation_feature({1, "c", "s", {}, {}, {}, 0, 0}, out), error);
  return 0;
}
