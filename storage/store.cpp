#include "storage/store.h"

#include <fcntl.h>
#include <sqlite3.h>
#include <unistd.h>

#include <map>
#include <set>
#include <tuple>

#include "storage/kept.h"
#include "storage/means.h"
#include "storage/references.h"
#include "storage/rows.h"
#include "storage/schema.h"
#include "storage/sqlite.h"

namespace lampglow::storage {
namespace {

std::string question_marks(int count) {
  std::string text = "?";
  for (int i = 1; i < count; ++i) text += ",?";
  return text;
}

SQLite::Database open_writer(const std::filesystem::path& file, const StoreOptions& options,
                             const std::stop_token& stop) {
  SQLite::Database database(file.string(), SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE,
                            options.busy_timeout_ms);
  if (schema_version(database) == 0) database.exec("PRAGMA auto_vacuum = INCREMENTAL");
  database.exec("PRAGMA journal_mode = WAL");
  database.exec("PRAGMA synchronous = NORMAL");
  database.exec("PRAGMA foreign_keys = ON");
  migrate(database, schema_version(), stop);
  return database;
}

// SQLite holds no lock on a WAL's own descriptor, so closing another one of it takes none away.
void sync_file(const std::string& file) {
  const int descriptor = ::open(file.c_str(), O_RDONLY | O_CLOEXEC);
  if (descriptor < 0) return;
  const int failed = ::fdatasync(descriptor);
  ::close(descriptor);
  if (failed) throw StorageError(StorageError::Kind::io, file + ": cannot be synced");
}

// While it lives, what another connection holds is not waited for.
class Unpatient {
 public:
  Unpatient(SQLite::Database& database, int patience_ms) : database_(database), patience_ms_(patience_ms) {
    database_.setBusyTimeout(0);
  }
  ~Unpatient() { sqlite3_busy_timeout(database_.getHandle(), patience_ms_); }
  Unpatient(const Unpatient&) = delete;
  Unpatient& operator=(const Unpatient&) = delete;

 private:
  SQLite::Database& database_;
  int patience_ms_;
};

}  // namespace

// A period of a camera whose mean is to be renewed: camera, period in s, end in ms.
using Period = std::tuple<CameraNumber, int, std::int64_t>;

struct Store::Impl {
  Impl(const std::filesystem::path& path, const StoreOptions& given, const std::stop_token& stop)
      : file(path.string()), options(given), database(open_writer(path, given, stop)) {}

  SQLite::Statement& statement(const std::string& sql) {
    auto& slot = statements[sql];
    if (!slot) slot = std::make_unique<SQLite::Statement>(database, sql);
    slot->reset();
    slot->clearBindings();
    return *slot;
  }
  template <typename... Values>
  SQLite::Statement& bound(const std::string& sql, const Values&... values) {
    SQLite::Statement& prepared = statement(sql);
    Binder binder(prepared);
    (binder << ... << values);
    return prepared;
  }
  template <typename... Values>
  void run(const std::string& sql, const Values&... values) {
    bound(sql, values...).exec();
  }

  void begin() {
    if (!transaction)
      transaction = std::make_unique<SQLite::Transaction>(database, SQLite::TransactionBehavior::IMMEDIATE);
  }
  void commit();
  std::int64_t lamp_number(CameraNumber camera, const std::string& name);
  void put_references(CameraNumber camera, std::int64_t time_ms);
  void put_frame(CameraNumber camera, const FrameResult& result);
  void put_lamp(CameraNumber camera, std::int64_t time_ms, const LampFit& lamp);
  void renew_mean(const Period& period);

  std::string file;
  StoreOptions options;
  SQLite::Database database;
  std::map<std::string, std::unique_ptr<SQLite::Statement>> statements;
  std::unique_ptr<SQLite::Transaction> transaction;  // rolls back when it goes without a commit
  std::map<std::pair<CameraNumber, std::string>, std::int64_t> lamps;
  std::map<CameraNumber, std::vector<Light>> catalogue;
  std::set<CameraNumber> fresh;  // catalogues to be compared with the stored ones at the camera's next frame
  std::set<Period> dirty;
  int pending = 0;
};

void Store::Impl::commit() {
  if (!transaction) return;
  for (const Period& period : dirty) renew_mean(period);
  // A question that was not read to its end would keep a checkpoint from its lock.
  for (auto& [sql, prepared] : statements) prepared->tryReset();
  transaction->commit();
  transaction.reset();
  dirty.clear();
  pending = 0;
}

std::int64_t Store::Impl::lamp_number(CameraNumber camera, const std::string& name) {
  const auto known = lamps.find({camera, name});
  if (known != lamps.end()) return known->second;
  run("INSERT INTO lamp (camera_id, name) VALUES (?, ?) ON CONFLICT DO NOTHING", camera, name);
  SQLite::Statement& row = bound("SELECT id FROM lamp WHERE camera_id = ? AND name = ?", camera, name);
  row.executeStep();
  lamps[{camera, name}] = row.getColumn(0).getInt64();
  row.reset();  // a statement left on a row keeps a read open, and the checkpoint finds the tables locked
  return lamps[{camera, name}];
}

// The catalogue as the camera's first frame after upsert_camera() finds it: an entry that differs from the
// last one is a new one from this frame on.
void Store::Impl::put_references(CameraNumber camera, std::int64_t time_ms) {
  if (fresh.erase(camera) == 0) return;
  for (const Light& light : catalogue[camera]) {
    const std::int64_t lamp = lamp_number(camera, light.id);
    SQLite::Statement& last = bound(
        "SELECT x_px, y_px, distance_m, distance_sigma_m FROM lamp_reference WHERE lamp_id = ? "
        "ORDER BY valid_from_ms DESC LIMIT 1",
        lamp);
    bool same = last.executeStep();
    if (same) {
      RowReader row(last);
      same = row.real() == light.x_px && row.real() == light.y_px && row.maybe_real() == light.distance_m &&
             row.maybe_real() == light.distance_sigma_m;
    }
    last.reset();
    if (same) continue;
    run("INSERT OR REPLACE INTO lamp_reference (lamp_id, valid_from_ms, x_px, y_px, distance_m, "
        "distance_sigma_m) "
        "VALUES (?, ?, ?, ?, ?, ?)",
        lamp, time_ms, light.x_px, light.y_px, light.distance_m, light.distance_sigma_m);
  }
}

void Store::Impl::put_lamp(CameraNumber camera, std::int64_t time_ms, const LampFit& lamp) {
  const std::int64_t number = lamp_number(camera, lamp.id);
  run("INSERT OR REPLACE INTO lamp_fit (camera_id, time_ms, lamp_id, state, x_px, y_px, distance_m, "
      "strength_ratio, optical_thickness, residual_rms, ln_halo, ln_halo_sigma) VALUES (?, ?, ?, ?, ?, ?, ?, "
      "?, ?, ?, ?, ?)",
      camera, time_ms, number, static_cast<int>(lamp.state), lamp.x_px, lamp.y_px, lamp.distance_m,
      lamp.strength_ratio, lamp.optical_thickness, lamp.residual_rms, lamp.ln_halo, lamp.ln_halo_sigma);
  if (!options.keep_ring_profiles || lamp.profile.theta_deg.empty()) return;
  SQLite::Statement& insert = statement(
      "INSERT OR REPLACE INTO ring_profile (camera_id, time_ms, lamp_id, ring_count, rings) VALUES (?, ?, ?, "
      "?, ?)");
  Binder binder(insert);
  binder << camera << time_ms << number << static_cast<std::int64_t>(lamp.profile.theta_deg.size());
  const std::string rings = pack_rings(lamp.profile);
  insert.bind(5, rings.data(), static_cast<int>(rings.size()));
  insert.exec();
}

void Store::Impl::put_frame(CameraNumber camera, const FrameResult& result) {
  const std::int64_t time_ms = to_ms(result.observation.time_utc);
  put_references(camera, time_ms);
  run("INSERT OR REPLACE INTO frame (camera_id, time_ms, shift_x_px, shift_y_px, rotation_rad, reason) "
      "VALUES (?, ?, ?, ?, ?, ?)",
      camera, time_ms, result.shift_x_px, result.shift_y_px, result.rotation_rad,
      result.reason.empty() ? std::optional<std::string>() : std::optional<std::string>(result.reason));
  static const std::string insert = std::string("INSERT OR REPLACE INTO observation (camera_id, time_ms, ") +
                                    kObservationColumns + ") VALUES (" + question_marks(22) + ")";
  SQLite::Statement& prepared = statement(insert);
  Binder binder(prepared);
  binder << camera << time_ms;
  bind_observation(binder, result.observation);
  prepared.exec();
  run("DELETE FROM lamp_fit WHERE camera_id = ? AND time_ms = ?", camera, time_ms);
  run("DELETE FROM ring_profile WHERE camera_id = ? AND time_ms = ?", camera, time_ms);
  for (const LampFit& lamp : result.lamps) put_lamp(camera, time_ms, lamp);
  for (const int period_s : kMeanPeriods_s)
    dirty.emplace(camera, period_s, to_ms(period_end(result.observation.time_utc, period_s)));
}

void Store::Impl::renew_mean(const Period& period) {
  const auto [camera, period_s, end_ms] = period;
  SQLite::Statement& rows =
      bound(std::string("SELECT time_ms, ") + kObservationColumns +
                " FROM observation WHERE camera_id = ? AND time_ms > ? AND time_ms <= ? "
                "ORDER BY time_ms",
            camera, end_ms - std::int64_t{period_s} * 1000, end_ms);
  std::vector<Observation> frames;
  while (rows.executeStep()) {
    RowReader row(rows);
    const TimePoint time = from_ms(row.integer());
    frames.push_back(read_observation(row));
    frames.back().time_utc = time;
  }
  rows.reset();
  // Where retention has already dropped raw frames, the stored mean knows more than what is left of them.
  SQLite::Statement& stored =
      bound("SELECT frames FROM mean WHERE camera_id = ? AND period_s = ? AND end_ms = ?", camera, period_s,
            end_ms);
  const bool fewer = stored.executeStep() && stored.getColumn(0).getInt64() > std::ssize(frames);
  stored.reset();
  if (fewer) return;
  static const std::string insert =
      std::string("INSERT OR REPLACE INTO mean (camera_id, period_s, end_ms, ") + kMeanColumns +
      ") VALUES (" + question_marks(17) + ")";
  SQLite::Statement& prepared = statement(insert);
  Binder binder(prepared);
  binder << camera << period_s << end_ms;
  bind_mean(binder, mean_of(frames, from_ms(end_ms), period_s));
  prepared.exec();
}

Store::Store(const std::filesystem::path& file, const StoreOptions& options, const std::stop_token& stop)
    : impl_(guarded(file.string(), [&] { return std::make_unique<Impl>(file, options, stop); })) {}

Store::~Store() {
  if (!impl_) return;
  try {
    commit();
  } catch (const std::exception&) {  // the owner was told to commit first
  }
}

Store::Store(Store&&) noexcept = default;
Store& Store::operator=(Store&&) noexcept = default;

CameraNumber Store::upsert_camera(const std::string& name, const Site& site) {
  return guarded(impl_->file, [&] {
    impl_->begin();
    impl_->run(
        "INSERT INTO station (name, latitude_deg, longitude_deg, elevation_m) VALUES (?, ?, ?, ?) "
        "ON CONFLICT (name) DO UPDATE SET latitude_deg = excluded.latitude_deg, "
        "longitude_deg = excluded.longitude_deg, elevation_m = excluded.elevation_m",
        site.name, site.latitude_deg, site.longitude_deg, site.elevation_m);
    impl_->run(
        "INSERT INTO camera (name, station_id, width_px, height_px, focal_length_px) "
        "VALUES (?, (SELECT id FROM station WHERE name = ?), ?, ?, ?) "
        "ON CONFLICT (name) DO UPDATE SET station_id = excluded.station_id, width_px = excluded.width_px, "
        "height_px = excluded.height_px, focal_length_px = excluded.focal_length_px",
        name, site.name, site.camera.width_px, site.camera.height_px, site.camera.focal_length_px);
    SQLite::Statement& row = impl_->bound("SELECT id FROM camera WHERE name = ?", name);
    row.executeStep();
    const CameraNumber camera = row.getColumn(0).getInt64();
    row.reset();
    for (const Light& light : site.lights) impl_->lamp_number(camera, light.id);
    impl_->catalogue[camera] = site.lights;
    impl_->fresh.insert(camera);
    if (impl_->pending == 0) impl_->commit();
    return camera;
  });
}

void Store::put(CameraNumber camera, const FrameResult& result) {
  guarded(impl_->file, [&] {
    impl_->begin();
    impl_->put_frame(camera, result);
    if (++impl_->pending >= impl_->options.batch_frames) impl_->commit();
  });
}

std::int64_t Store::put_event(const Event& event) {
  return guarded(impl_->file, [&] {
    impl_->begin();
    impl_->run(
        "INSERT INTO event (time_ms, camera_id, kind, severity, message) "
        "VALUES (?, (SELECT id FROM camera WHERE name = ?), ?, ?, ?)",
        to_ms(event.time_utc), event.camera, static_cast<int>(event.kind), static_cast<int>(event.severity),
        event.message);
    const std::int64_t number = impl_->database.getLastInsertRowid();
    impl_->commit();
    return number;
  });
}

std::int64_t Store::put_reference(CameraNumber camera, const ReferenceRecord& reference) {
  return guarded(impl_->file, [&] {
    impl_->begin();
    impl_->run(
        "INSERT INTO reference (camera_id, valid_from_ms, origin, base_ms, frames, hours, mor_low_m, "
        "ln_common, restored_id, halo_frames) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
        camera, to_ms(reference.valid_from_utc), static_cast<int>(reference.origin),
        to_ms(reference.base_utc), reference.frames, reference.hours, reference.mor_low_m,
        reference.ln_common, reference.restored_number, reference.halo_frames);
    const std::int64_t number = impl_->database.getLastInsertRowid();
    for (const ReferenceLampRecord& lamp : reference.lamps)
      impl_->run(
          "INSERT INTO reference_lamp (reference_id, name, strength, ln_relearned, relearned_ms, ln_halo, "
          "halo_ms) VALUES (?, ?, ?, ?, ?, ?, ?)",
          number, lamp.id, lamp.strength, lamp.ln_relearned,
          lamp.relearned_utc ? std::optional(to_ms(*lamp.relearned_utc)) : std::nullopt, lamp.ln_halo,
          lamp.halo_utc ? std::optional(to_ms(*lamp.halo_utc)) : std::nullopt);
    impl_->commit();
    return number;
  });
}

void Store::put_picture(CameraNumber camera, const PictureRecord& picture) {
  guarded(impl_->file, [&] {
    impl_->begin();
    impl_->run(
        "INSERT OR REPLACE INTO picture (camera_id, time_ms, kept_for, size_bytes) VALUES (?, ?, ?, ?)",
        camera, to_ms(picture.time_utc), static_cast<int>(picture.kept_for), picture.size_bytes);
    if (impl_->pending == 0) impl_->commit();
  });
}

void Store::erase_picture(const PictureRecord& picture) {
  guarded(impl_->file, [&] {
    impl_->begin();
    impl_->run("DELETE FROM picture WHERE camera_id = (SELECT id FROM camera WHERE name = ?) AND time_ms = ?",
               picture.camera, to_ms(picture.time_utc));
    if (impl_->pending == 0) impl_->commit();
  });
}

void Store::commit() {
  guarded(impl_->file, [&] { impl_->commit(); });
}

void Store::rollback() noexcept {
  for (auto& [sql, statement] : impl_->statements) statement->tryReset();
  impl_->transaction.reset();
  impl_->dirty.clear();
  impl_->lamps.clear();  // numbers of lamps that were inserted in what is now undone
  for (const auto& [camera, lights] : impl_->catalogue) impl_->fresh.insert(camera);
  impl_->pending = 0;
}

int Store::pending_frames() const {
  return impl_->pending;
}

bool Store::checkpoint() {
  return guarded(impl_->file, [&] {
    impl_->commit();
    const Unpatient unpatient(impl_->database, impl_->options.busy_timeout_ms);
    SQLite::Statement pragma(impl_->database, "PRAGMA wal_checkpoint(TRUNCATE)");
    const bool whole = pragma.executeStep() && pragma.getColumn(0).getInt() == 0;  // 1: it was held up
    if (!whole) sync_file(impl_->file + "-wal");  // SQLite may have left that out, too
    return whole;
  });
}

// Up to the time of the row that is max_rows behind the oldest: the key's order makes that a short scan.
int Store::drop_before(Kept what, TimePoint before, int max_rows) {
  return guarded(impl_->file, [&] {
    const Place place = place_of(what);
    const std::string time = place.time;
    impl_->begin();
    int dropped = 0;
    if (what == Kept::events) {
      impl_->run(
          "DELETE FROM event WHERE id IN (SELECT id FROM event WHERE time_ms < ? ORDER BY time_ms LIMIT ?)",
          to_ms(before), max_rows);
      dropped = impl_->database.getChanges();
    } else {
      std::vector<std::int64_t> cameras;
      SQLite::Statement& rows = impl_->statement("SELECT id FROM camera");
      while (rows.executeStep()) cameras.push_back(rows.getColumn(0).getInt64());
      rows.reset();
      const std::string of_camera = std::string(" WHERE camera_id = ?1") + place.where;
      const std::string sql = "DELETE FROM " + std::string(place.table) + of_camera + " AND " + time +
                              " < min(?2, coalesce((SELECT " + time + " FROM " + place.table + of_camera +
                              " ORDER BY " + time + " LIMIT 1 OFFSET ?3), ?2))";
      for (const std::int64_t camera : cameras) {
        impl_->run(sql, camera, to_ms(before), max_rows);
        dropped += impl_->database.getChanges();
      }
    }
    if (impl_->pending == 0) impl_->commit();
    return dropped;
  });
}

void Store::release_pages(int most) {
  guarded(impl_->file, [&] {
    impl_->commit();
    SQLite::Statement pragma(impl_->database, "PRAGMA incremental_vacuum(" + std::to_string(most) + ")");
    while (pragma.executeStep()) {
    }
  });
}

}  // namespace lampglow::storage
