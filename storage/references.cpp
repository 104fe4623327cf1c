#include "storage/references.h"

#include "storage/schema.h"
#include "storage/sqlite.h"

namespace lampglow::storage {

struct ReferenceReader::Impl {
  Impl(const std::filesystem::path& path, int busy_timeout_ms)
      : file(path.string()), database(file, SQLite::OPEN_READONLY, busy_timeout_ms) {
    if (schema_version(database) != schema_version())
      throw StorageError(StorageError::Kind::io, file + ": its schema is of another version of lampglow");
  }
  template <typename... Values>
  SQLite::Statement ask(const std::string& sql, const Values&... values) {
    SQLite::Statement statement(database, sql);
    Binder binder(statement);
    (binder << ... << values);
    return statement;
  }

  std::string file;
  SQLite::Database database;
};

namespace {

constexpr const char* kReferenceColumns =
    "SELECT id, valid_from_ms, origin, base_ms, frames, hours, mor_low_m, ln_common, restored_id, "
    "halo_frames FROM reference ";

ReferenceRecord read_reference(SQLite::Statement& statement) {
  RowReader row(statement);
  ReferenceRecord reference;
  reference.number = row.integer();
  reference.valid_from_utc = from_ms(row.integer());
  reference.origin = static_cast<ReferenceOrigin>(row.small());
  reference.base_utc = from_ms(row.integer());
  reference.frames = row.small();
  reference.hours = row.real();
  reference.mor_low_m = row.maybe_real();
  reference.ln_common = row.maybe_real();
  reference.restored_number = row.maybe_integer();
  reference.halo_frames = row.small();
  return reference;
}

}  // namespace

std::string_view to_string(ReferenceOrigin value) {
  switch (value) {
    case ReferenceOrigin::clear_brackets:
      return "clear_brackets";
    case ReferenceOrigin::relearned:
      return "relearned";
    case ReferenceOrigin::restored:
      return "restored";
  }
  return "unknown";
}

ReferenceReader::ReferenceReader(const std::filesystem::path& file, int busy_timeout_ms)
    : impl_(guarded(file.string(), [&] { return std::make_unique<Impl>(file, busy_timeout_ms); })) {}
ReferenceReader::~ReferenceReader() = default;

std::vector<ReferenceRecord> ReferenceReader::references(CameraNumber camera) {
  return guarded(impl_->file, [&] {
    SQLite::Statement rows =
        impl_->ask(std::string(kReferenceColumns) + "WHERE camera_id = ? ORDER BY id", camera);
    std::vector<ReferenceRecord> out;
    while (rows.executeStep()) out.push_back(read_reference(rows));
    return out;
  });
}

std::optional<ReferenceRecord> ReferenceReader::reference(CameraNumber camera,
                                                          std::optional<std::int64_t> number) {
  return guarded(impl_->file, [&]() -> std::optional<ReferenceRecord> {
    std::optional<ReferenceRecord> out;
    {
      SQLite::Statement rows =
          impl_->ask(std::string(kReferenceColumns) +
                         "WHERE camera_id = ?1 AND id = coalesce(?2, (SELECT max(id) FROM "
                         "reference WHERE camera_id = ?1))",
                     camera, number);
      if (rows.executeStep()) out = read_reference(rows);
    }
    if (!out) return out;
    SQLite::Statement rows = impl_->ask(
        "SELECT name, strength, ln_relearned, relearned_ms, ln_halo, halo_ms FROM reference_lamp WHERE "
        "reference_id = ? ORDER BY name",
        out->number);
    while (rows.executeStep()) {
      RowReader row(rows);
      ReferenceLampRecord lamp{row.text(), row.real(), row.real(), {}, 0, {}};
      if (const auto time = row.maybe_integer()) lamp.relearned_utc = from_ms(*time);
      lamp.ln_halo = row.real();
      if (const auto time = row.maybe_integer()) lamp.halo_utc = from_ms(*time);
      out->lamps.push_back(std::move(lamp));
    }
    return out;
  });
}

}  // namespace lampglow::storage
