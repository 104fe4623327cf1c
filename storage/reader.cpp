#include "storage/reader.h"

#include <algorithm>
#include <map>

#include "storage/rows.h"
#include "storage/schema.h"
#include "storage/sqlite.h"

namespace lampglow::storage {

struct Reader::Impl {
  Impl(const std::filesystem::path& path, int busy_timeout_ms)
      : file(path.string()), database(file, SQLite::OPEN_READONLY, busy_timeout_ms) {
    const int version = schema_version(database);
    if (version > schema_version())
      throw StorageError(StorageError::Kind::too_new, file + ": written by a later lampglow");
    if (version < schema_version())
      throw StorageError(StorageError::Kind::io, file + ": not migrated yet (schema version " +
                                                     std::to_string(version) +
                                                     "); `lampglow db vacuum` migrates it");
  }

  // A statement kept for its next use. The guard resets it, so that no read transaction stays open.
  struct Lease {
    SQLite::Statement& statement;
    ~Lease() { statement.tryReset(); }
  };
  template <typename... Values>
  Lease ask(const std::string& sql, const Values&... values) {
    auto& slot = statements[sql];
    if (!slot) slot = std::make_unique<SQLite::Statement>(database, sql);
    slot->reset();
    slot->clearBindings();
    [[maybe_unused]] Binder binder(*slot);
    if constexpr (sizeof...(values) > 0) (binder << ... << values);
    return {*slot};
  }

  std::string file;
  SQLite::Database database;
  std::map<std::string, std::unique_ptr<SQLite::Statement>> statements;
};

namespace {

constexpr const char* kCameraColumns =
    "SELECT camera.id, camera.name, station.name, latitude_deg, longitude_deg, elevation_m, "
    "coalesce(width_px, 0), coalesce(height_px, 0) FROM camera JOIN station ON station.id = station_id ";

CameraRecord read_camera(SQLite::Statement& statement) {
  RowReader row(statement);
  CameraRecord camera;
  camera.number = row.integer();
  camera.name = row.text();
  camera.station = row.text();
  camera.latitude_deg = row.maybe_real();
  camera.longitude_deg = row.maybe_real();
  camera.elevation_m = row.maybe_real();
  camera.width_px = row.small();
  camera.height_px = row.small();
  return camera;
}

std::string raw_select() {
  return std::string("SELECT o.time_ms, reason, ") + kObservationColumns +
         " FROM observation AS o LEFT JOIN frame AS f ON f.camera_id = o.camera_id AND f.time_ms = "
         "o.time_ms ";
}

ObservationRow read_raw(SQLite::Statement& statement) {
  RowReader row(statement);
  ObservationRow out;
  const TimePoint time = from_ms(row.integer());
  out.reason = row.text();
  out.observation = read_observation(row);
  out.observation.time_utc = time;
  out.values = out.observation.extinction_per_m ? 1 : 0;
  return out;
}

std::string mean_select() {
  return std::string("SELECT end_ms, ") + kMeanColumns + " FROM mean ";
}

ObservationRow read_mean_row(SQLite::Statement& statement, int period_s) {
  RowReader row(statement);
  const TimePoint time = from_ms(row.integer());
  ObservationRow out = read_mean(row);
  out.observation.time_utc = time;
  out.period_s = period_s;
  return out;
}

Event read_event(SQLite::Statement& statement) {
  RowReader row(statement);
  Event event;
  event.number = row.integer();
  event.time_utc = from_ms(row.integer());
  event.camera = row.text();
  event.kind = static_cast<EventKind>(row.small());
  event.severity = static_cast<Severity>(row.small());
  event.message = row.text();
  return event;
}

constexpr const char* kEventColumns =
    "SELECT event.id, time_ms, coalesce(camera.name, ''), kind, severity, message FROM event "
    "LEFT JOIN camera ON camera.id = event.camera_id ";

}  // namespace

Reader::Reader(const std::filesystem::path& file, int busy_timeout_ms)
    : impl_(guarded(file.string(), [&] { return std::make_unique<Impl>(file, busy_timeout_ms); })) {}
Reader::~Reader() = default;
Reader::Reader(Reader&&) noexcept = default;
Reader& Reader::operator=(Reader&&) noexcept = default;

std::vector<CameraRecord> Reader::cameras() {
  return guarded(impl_->file, [&] {
    const auto lease = impl_->ask(std::string(kCameraColumns) + "ORDER BY camera.id");
    std::vector<CameraRecord> out;
    while (lease.statement.executeStep()) out.push_back(read_camera(lease.statement));
    return out;
  });
}

std::optional<CameraRecord> Reader::camera(const std::string& name) {
  return guarded(impl_->file, [&]() -> std::optional<CameraRecord> {
    const auto lease = impl_->ask(std::string(kCameraColumns) + "WHERE camera.name = ?", name);
    if (!lease.statement.executeStep()) return std::nullopt;
    return read_camera(lease.statement);
  });
}

std::vector<ObservationRow> Reader::observations(const ObservationQuery& query) {
  return guarded(impl_->file, [&] {
    const std::int64_t first =
        query.after ? std::max(to_ms(*query.after) + 1, to_ms(query.from)) : to_ms(query.from);
    const std::string order = query.newest ? " DESC LIMIT ?" : " LIMIT ?";
    std::vector<ObservationRow> out;
    if (query.period_s == 0) {
      const auto lease = impl_->ask(
          raw_select() + "WHERE o.camera_id = ? AND o.time_ms >= ? AND o.time_ms < ? ORDER BY o.time_ms" +
              order,
          query.camera, first, to_ms(query.to), query.limit);
      while (lease.statement.executeStep()) out.push_back(read_raw(lease.statement));
    } else {
      const auto lease = impl_->ask(
          mean_select() +
              "WHERE camera_id = ? AND period_s = ? AND end_ms >= ? AND end_ms < ? ORDER BY end_ms" + order,
          query.camera, query.period_s, first, to_ms(query.to), query.limit);
      while (lease.statement.executeStep()) out.push_back(read_mean_row(lease.statement, query.period_s));
    }
    if (query.newest) std::reverse(out.begin(), out.end());
    return out;
  });
}

std::optional<TimePoint> Reader::newest_of_a_day(CameraNumber camera) {
  constexpr std::int64_t kDay_ms = 86'400'000, kWeek_ms = 7 * kDay_ms;
  return guarded(impl_->file, [&]() -> std::optional<TimePoint> {
    const auto lease = impl_->ask(
        "SELECT end_ms FROM mean WHERE camera_id = ? AND period_s = 3600 ORDER BY end_ms DESC", camera);
    std::optional<std::int64_t> newest, last;  // of the stretch that is walked through, backwards
    while (lease.statement.executeStep()) {
      const std::int64_t end_ms = lease.statement.getColumn(0).getInt64();
      if (!newest || *last - end_ms > kWeek_ms) newest = end_ms;
      last = end_ms;
      if (*newest - end_ms >= kDay_ms) break;
    }
    return newest ? std::optional(from_ms(*newest)) : std::nullopt;
  });
}

std::optional<ObservationRow> Reader::latest(CameraNumber camera, int period_s) {
  return guarded(impl_->file, [&]() -> std::optional<ObservationRow> {
    if (period_s == 0) {
      static const std::string sql = raw_select() + "WHERE o.camera_id = ? ORDER BY o.time_ms DESC LIMIT 1";
      const auto lease = impl_->ask(sql, camera);
      if (!lease.statement.executeStep()) return std::nullopt;
      return read_raw(lease.statement);
    }
    static const std::string sql =
        mean_select() + "WHERE camera_id = ? AND period_s = ? ORDER BY end_ms DESC LIMIT 1";
    const auto lease = impl_->ask(sql, camera, period_s);
    if (!lease.statement.executeStep()) return std::nullopt;
    return read_mean_row(lease.statement, period_s);
  });
}

std::optional<std::pair<TimePoint, TimePoint>> Reader::span(CameraNumber camera) {
  return guarded(impl_->file, [&]() -> std::optional<std::pair<TimePoint, TimePoint>> {
    const auto lease = impl_->ask(
        "SELECT (SELECT min(time_ms) FROM observation WHERE camera_id = ?1), "
        "(SELECT max(time_ms) FROM observation WHERE camera_id = ?1)",
        camera);
    lease.statement.executeStep();
    RowReader row(lease.statement);
    if (row.null()) return std::nullopt;
    const TimePoint first = from_ms(row.integer());
    return std::pair{first, from_ms(row.integer())};
  });
}

std::vector<LampRecord> Reader::lamps(CameraNumber camera) {
  return guarded(impl_->file, [&] {
    const auto lease = impl_->ask(
        "SELECT name, x_px, y_px, distance_m, valid_from_ms FROM lamp LEFT JOIN lamp_reference AS r "
        "ON r.lamp_id = lamp.id AND r.valid_from_ms = "
        "(SELECT max(valid_from_ms) FROM lamp_reference WHERE lamp_id = lamp.id) "
        "WHERE camera_id = ? ORDER BY lamp.id",
        camera);
    std::vector<LampRecord> out;
    while (lease.statement.executeStep()) {
      RowReader row(lease.statement);
      LampRecord lamp;
      lamp.id = row.text();
      lamp.x_px = row.real();
      lamp.y_px = row.real();
      lamp.distance_m = row.maybe_real();
      if (const auto since = row.maybe_integer()) lamp.reference_since = from_ms(*since);
      out.push_back(lamp);
    }
    return out;
  });
}

std::vector<LampFitRow> Reader::fits(CameraNumber camera, std::optional<TimePoint> time) {
  return guarded(impl_->file, [&] {
    const auto lease = impl_->ask(
        "SELECT time_ms, name, state, x_px, y_px, distance_m, strength_ratio, optical_thickness, "
        "residual_rms, ln_halo, ln_halo_sigma "
        "FROM lamp_fit JOIN lamp ON lamp.id = lamp_id WHERE lamp_fit.camera_id = ?1 AND time_ms = "
        "coalesce(?2, (SELECT max(time_ms) FROM lamp_fit WHERE camera_id = ?1)) ORDER BY lamp_id",
        camera, time ? std::optional(to_ms(*time)) : std::nullopt);
    std::vector<LampFitRow> out;
    while (lease.statement.executeStep()) {
      RowReader row(lease.statement);
      LampFitRow entry;
      entry.time_utc = from_ms(row.integer());
      entry.fit.id = row.text();
      entry.fit.state = lamp_state(row.small());
      entry.fit.x_px = row.real();
      entry.fit.y_px = row.real();
      entry.fit.distance_m = row.maybe_real();
      entry.fit.strength_ratio = row.maybe_real();
      entry.fit.optical_thickness = row.maybe_real();
      entry.fit.residual_rms = row.maybe_real();
      entry.fit.ln_halo = row.maybe_real();
      entry.fit.ln_halo_sigma = row.maybe_real();
      out.push_back(entry);
    }
    return out;
  });
}

std::optional<std::pair<TimePoint, RingProfile>> Reader::rings(CameraNumber camera, const std::string& lamp,
                                                               std::optional<TimePoint> time) {
  return guarded(impl_->file, [&]() -> std::optional<std::pair<TimePoint, RingProfile>> {
    // A lamp that was hidden in the last frames has its rings further back: within the last hundred frames.
    const auto lease = impl_->ask(
        "SELECT time_ms, ring_count, rings FROM ring_profile WHERE camera_id = ?1 AND lamp_id = "
        "(SELECT id FROM lamp WHERE camera_id = ?1 AND name = ?2) AND (?3 IS NULL OR time_ms = ?3) "
        "ORDER BY time_ms DESC LIMIT 1",
        camera, lamp, time ? std::optional(to_ms(*time)) : std::nullopt);
    if (!lease.statement.executeStep()) return std::nullopt;
    RowReader row(lease.statement);
    const TimePoint at = from_ms(row.integer());
    const std::int64_t count = row.integer();
    const SQLite::Column blob = row.column();
    const std::string_view bytes(static_cast<const char*>(blob.getBlob()),
                                 static_cast<size_t>(blob.getBytes()));
    return std::pair{at, unpack_rings(bytes, count)};
  });
}

std::vector<Event> Reader::events(std::int64_t after, int limit, std::optional<TimePoint> from,
                                  std::optional<TimePoint> to) {
  return guarded(impl_->file, [&] {
    const auto lease =
        impl_->ask(std::string(kEventColumns) +
                       "WHERE event.id > ?1 AND time_ms >= ?2 AND time_ms < ?3 ORDER BY event.id LIMIT ?4",
                   after, from ? to_ms(*from) : INT64_MIN, to ? to_ms(*to) : INT64_MAX, limit);
    std::vector<Event> out;
    while (lease.statement.executeStep()) out.push_back(read_event(lease.statement));
    return out;
  });
}

std::vector<Event> Reader::last_events(int limit) {
  return guarded(impl_->file, [&] {
    const auto lease = impl_->ask(std::string(kEventColumns) + "ORDER BY event.id DESC LIMIT ?", limit);
    std::vector<Event> out;
    while (lease.statement.executeStep()) out.push_back(read_event(lease.statement));
    std::reverse(out.begin(), out.end());
    return out;
  });
}

std::vector<PictureRecord> Reader::pictures(const std::optional<std::string>& camera, TimePoint from,
                                            TimePoint to, int limit) {
  return guarded(impl_->file, [&] {
    const auto lease = impl_->ask(
        "SELECT name, time_ms, kept_for, size_bytes FROM picture JOIN camera ON camera.id = camera_id "
        "WHERE (?1 IS NULL OR name = ?1) AND time_ms >= ?2 AND time_ms < ?3 AND time_ms <= "
        "coalesce((SELECT time_ms FROM picture JOIN camera ON camera.id = camera_id "
        "WHERE (?1 IS NULL OR name = ?1) AND time_ms >= ?2 AND time_ms < ?3 ORDER BY time_ms LIMIT 1 "
        "OFFSET ?4 - 1), ?3) ORDER BY time_ms, camera_id",
        camera, to_ms(from), to_ms(to), limit);
    std::vector<PictureRecord> out;
    while (lease.statement.executeStep()) {
      RowReader row(lease.statement);
      PictureRecord picture;
      picture.camera = row.text();
      picture.time_utc = from_ms(row.integer());
      picture.kept_for = static_cast<KeptFor>(row.small());
      picture.size_bytes = row.integer();
      out.push_back(picture);
    }
    return out;
  });
}

std::int64_t Reader::picture_bytes() {
  return guarded(impl_->file, [&] {
    return impl_->database.execAndGet("SELECT coalesce(sum(size_bytes), 0) FROM picture").getInt64();
  });
}

std::string Reader::content() {
  return guarded(impl_->file, [&] {
    std::string out;
    for (const char* table : {"station", "camera", "lamp", "lamp_reference", "frame", "observation",
                              "lamp_fit", "ring_profile", "mean", "reference", "reference_lamp"}) {
      SQLite::Statement rows(impl_->database, std::string("SELECT * FROM ") + table + " ORDER BY 1, 2, 3");
      while (rows.executeStep()) {
        out += table;
        for (int i = 0; i < rows.getColumnCount(); ++i)
          out += rows.isColumnNull(i) ? "|" : "|" + rows.getColumn(i).getString();
        out += '\n';
      }
    }
    return out;
  });
}

std::string Reader::check(bool full) {
  return guarded(impl_->file, [&] {
    SQLite::Statement pragma(impl_->database, full ? "PRAGMA integrity_check" : "PRAGMA quick_check");
    std::string out;
    while (pragma.executeStep()) {
      if (!out.empty()) out += '\n';
      out += pragma.getColumn(0).getString();
    }
    return out;
  });
}

}  // namespace lampglow::storage
