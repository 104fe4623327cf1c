#include "storage/schema.h"

#include <SQLiteCpp/SQLiteCpp.h>

#include <array>
#include <string>

#include "storage/break_off.h"
#include "storage/error.h"

namespace lampglow::storage {
namespace {

// Times are milliseconds since 1970-01-01 UTC without leap seconds. NULL is unknown, everywhere. The meaning
// of stored numbers (limit, method, weather, lamp state, quality bits) is that of estimator/observation.h and
// estimator/quality.h and never changes.
constexpr const char* kVersion1 = R"sql(
CREATE TABLE station (
  id INTEGER PRIMARY KEY,      -- number of the station in this database
  name TEXT NOT NULL UNIQUE,   -- [site] name of the configuration
  latitude_deg REAL,           -- north positive, WGS 84
  longitude_deg REAL,          -- east positive, WGS 84
  elevation_m REAL             -- above mean sea level
) STRICT;

CREATE TABLE camera (
  id INTEGER PRIMARY KEY,      -- number of the camera in this database
  station_id INTEGER NOT NULL REFERENCES station(id),  -- where it stands
  name TEXT NOT NULL UNIQUE,   -- name in the configuration and in URLs
  width_px INTEGER,            -- picture width
  height_px INTEGER,           -- picture height
  focal_length_px REAL         -- pinhole focal length
) STRICT;

CREATE TABLE lamp (
  id INTEGER PRIMARY KEY,      -- number of the lamp in this database
  camera_id INTEGER NOT NULL REFERENCES camera(id),    -- who sees it
  name TEXT NOT NULL,          -- id in the site's catalogue
  UNIQUE (camera_id, name)
) STRICT;

CREATE TABLE lamp_reference (
  lamp_id INTEGER NOT NULL REFERENCES lamp(id),        -- which lamp
  valid_from_ms INTEGER NOT NULL,  -- time of the first frame that was measured against this entry
  x_px REAL NOT NULL,          -- column in the clear reference, pixel centres at .5
  y_px REAL NOT NULL,          -- row in the clear reference
  distance_m REAL,             -- camera to lamp
  distance_sigma_m REAL,       -- one standard deviation; NULL: known exactly
  PRIMARY KEY (lamp_id, valid_from_ms)
) STRICT, WITHOUT ROWID;

CREATE TABLE frame (
  camera_id INTEGER NOT NULL REFERENCES camera(id),    -- who took it
  time_ms INTEGER NOT NULL,    -- when, UTC
  shift_x_px REAL NOT NULL,    -- registration to the reference: shift right
  shift_y_px REAL NOT NULL,    -- registration to the reference: shift down
  rotation_rad REAL NOT NULL,  -- registration to the reference: rotation
  reason TEXT,                 -- why there is no value; NULL if there is one
  PRIMARY KEY (camera_id, time_ms)
) STRICT, WITHOUT ROWID;

CREATE TABLE observation (
  camera_id INTEGER NOT NULL REFERENCES camera(id),    -- whose
  time_ms INTEGER NOT NULL,    -- when, UTC
  extinction_per_m REAL,       -- sigma; with a limit the bound itself
  extinction_low_per_m REAL,   -- lower 95 % bound of sigma
  extinction_high_per_m REAL,  -- upper 95 % bound of sigma
  limit_kind INTEGER NOT NULL, -- 0 none, 1 above (visibility at least), 2 below (at most)
  q REAL,                      -- Henyey-Greenstein asymmetry, 0 to 1
  q_low REAL,                  -- lower 95 % bound of q
  q_high REAL,                 -- upper 95 % bound of q
  weather INTEGER NOT NULL,    -- 0 unknown, 1 clear, 2 haze, 3 mist, 4 fog, 5 rain
  probability_unknown REAL,    -- probability of weather 0; NULL in all six: nothing is known
  probability_clear REAL,      -- probability of weather 1
  probability_haze REAL,       -- probability of weather 2
  probability_mist REAL,       -- probability of weather 3
  probability_fog REAL,        -- probability of weather 4
  probability_rain REAL,       -- probability of weather 5
  lecture_class INTEGER,       -- weather by the lecture's q classes alone
  wmo_4680 INTEGER,            -- present weather, WMO code table 4680
  relative_humidity REAL,      -- 0 to 1
  method INTEGER NOT NULL,     -- 0 none, 1 glow, 2 contrast
  lights_used INTEGER NOT NULL,-- lamps, or targets by day, in the fit
  quality INTEGER NOT NULL,    -- bits of the quality flags
  PRIMARY KEY (camera_id, time_ms)
) STRICT, WITHOUT ROWID;

CREATE TABLE lamp_fit (
  camera_id INTEGER NOT NULL REFERENCES camera(id),    -- whose frame
  time_ms INTEGER NOT NULL,    -- which frame
  lamp_id INTEGER NOT NULL REFERENCES lamp(id),        -- which lamp
  state INTEGER NOT NULL,      -- 0 unknown, 1 seen, 2 faded, 3 off, 4 hidden, 5 saturated
  x_px REAL NOT NULL,          -- where it was looked for in this frame: column
  y_px REAL NOT NULL,          -- where it was looked for in this frame: row
  distance_m REAL,             -- distance that the fit used
  strength_ratio REAL,         -- fitted strength over the reference's
  optical_thickness REAL,      -- sigma times distance
  residual_rms REAL,           -- of the fit, in standard deviations
  PRIMARY KEY (camera_id, time_ms, lamp_id)
) STRICT, WITHOUT ROWID;

CREATE TABLE ring_profile (
  camera_id INTEGER NOT NULL REFERENCES camera(id),    -- whose frame
  time_ms INTEGER NOT NULL,    -- which frame
  lamp_id INTEGER NOT NULL REFERENCES lamp(id),        -- which lamp
  rings BLOB NOT NULL,         -- little-endian float32: theta_deg, radiance, sigma of each ring, one column after another, then the model if fitted
  ring_count INTEGER NOT NULL, -- number of rings in each column
  PRIMARY KEY (camera_id, time_ms, lamp_id)
) STRICT, WITHOUT ROWID;

CREATE TABLE mean (
  camera_id INTEGER NOT NULL REFERENCES camera(id),    -- whose
  period_s INTEGER NOT NULL,   -- 60, 600 or 3600
  end_ms INTEGER NOT NULL,     -- end of the period, which belongs to it; its start does not
  frames INTEGER NOT NULL,     -- frames in the period
  value_count INTEGER NOT NULL,-- frames that had a value
  extinction_per_m REAL,       -- mean of sigma
  extinction_low_per_m REAL,   -- mean of the lower 95 % bounds; an 'above' counts as 0
  extinction_high_per_m REAL,  -- mean of the upper 95 % bounds; NULL if any is unknown
  limit_kind INTEGER NOT NULL, -- 0 none, 1 above, 2 below
  q REAL,                      -- mean of q where known
  q_low REAL,                  -- mean of q_low where known
  q_high REAL,                 -- mean of q_high where known
  weather INTEGER NOT NULL,    -- the most frequent that is known
  relative_humidity REAL,      -- mean where known
  method INTEGER NOT NULL,     -- of the latest frame with a value
  lights_used INTEGER NOT NULL,-- the most of any frame
  quality INTEGER NOT NULL,    -- all flags of all frames
  PRIMARY KEY (camera_id, period_s, end_ms)
) STRICT, WITHOUT ROWID;

CREATE TABLE event (
  id INTEGER PRIMARY KEY AUTOINCREMENT,  -- ascending in the order of writing, never used again
  time_ms INTEGER NOT NULL,    -- when, by the station's clock
  camera_id INTEGER REFERENCES camera(id),             -- NULL: the whole station
  kind INTEGER NOT NULL,       -- storage/records.h EventKind
  severity INTEGER NOT NULL,   -- 1 info, 2 warning, 3 error
  message TEXT NOT NULL        -- for people; never holds a secret
) STRICT;
CREATE INDEX event_by_time ON event(time_ms);
)sql";

// Pictures that are kept as files beside the database.
constexpr const char* kVersion2 = R"sql(
CREATE TABLE picture (
  camera_id INTEGER NOT NULL REFERENCES camera(id),    -- who took it
  time_ms INTEGER NOT NULL,    -- when, UTC
  kept_for INTEGER NOT NULL,   -- 1 one an hour, 2 onset of fog
  size_bytes INTEGER NOT NULL, -- of the JPEG file pictures/CAMERA/TIME_MS.jpg
  PRIMARY KEY (camera_id, time_ms)
) STRICT, WITHOUT ROWID;
CREATE INDEX picture_by_time ON picture(time_ms);
)sql";

// The clear reference over time: the audit trail of relearning in service. Never dropped.
constexpr const char* kVersion3 = R"sql(
CREATE TABLE reference (
  id INTEGER PRIMARY KEY AUTOINCREMENT,  -- ascending in the order of writing, never used again
  camera_id INTEGER NOT NULL REFERENCES camera(id),    -- whose
  valid_from_ms INTEGER NOT NULL,  -- frames from this time on are measured against it, until the next row
  origin INTEGER NOT NULL,     -- 1 from clear brackets, 2 relearned in service, 3 restored by hand
  base_ms INTEGER NOT NULL,    -- time of the newest clear bracket that it rests on
  frames INTEGER NOT NULL,     -- clear frames, or brackets, that taught this step
  hours REAL NOT NULL,         -- the time they span; 0 for clear brackets
  mor_low_m REAL,              -- the lowest of their 95 % lower bounds of visibility; NULL: not known
  ln_common REAL,              -- what all lamps had lost or won over the row before; NULL: not relearned
  restored_id INTEGER REFERENCES reference(id)         -- the row that was gone back to; NULL: none
) STRICT;
CREATE INDEX reference_by_camera ON reference(camera_id, id);

CREATE TABLE reference_lamp (
  reference_id INTEGER NOT NULL REFERENCES reference(id),  -- which reference
  name TEXT NOT NULL,          -- id in the catalogue; stray-1 and so on for lights that are in none
  strength REAL NOT NULL,      -- radiance times square pixels, in clear air
  ln_relearned REAL NOT NULL,  -- of strength over what the clear brackets gave
  relearned_ms INTEGER,        -- when it last changed; NULL: never
  PRIMARY KEY (reference_id, name)
) STRICT, WITHOUT ROWID;
)sql";

// What nights in fog teach of each lamp's halo: street lights send most of their light elsewhere than towards
// the camera.
constexpr const char* kVersion4 = R"sql(
ALTER TABLE lamp_fit ADD COLUMN
  ln_halo REAL /* halo strength in fog (q 0.87) over the reference's, by this frame alone; NULL: not told */;
ALTER TABLE lamp_fit ADD COLUMN
  ln_halo_sigma REAL /* its standard deviation */;
ALTER TABLE reference ADD COLUMN
  halo_frames INTEGER NOT NULL DEFAULT 0 /* frames of haze and fog that taught this step */;
ALTER TABLE reference_lamp ADD COLUMN
  ln_halo REAL NOT NULL DEFAULT 0 /* halo strength in fog (q 0.87) over an even lamp's, against the mean of all lamps' */;
ALTER TABLE reference_lamp ADD COLUMN
  halo_ms INTEGER /* when ln_halo last changed; NULL: never */;
)sql";

constexpr std::array kMigrations = {kVersion1, kVersion2, kVersion3, kVersion4};

}  // namespace

std::span<const char* const> migrations() {
  return kMigrations;
}

int schema_version() {
  return static_cast<int>(kMigrations.size());
}

int schema_version(SQLite::Database& database) {
  return database.execAndGet("PRAGMA user_version").getInt();
}

void migrate(SQLite::Database& database, int target, const std::stop_token& stop) {
  int version = schema_version(database);
  if (version > schema_version())
    throw StorageError(StorageError::Kind::too_new,
                       database.getFilename() + ": schema version " + std::to_string(version) +
                           " was written by a later lampglow; this one knows up to " +
                           std::to_string(schema_version()));
  for (; version < target; ++version) {
    SQLite::Transaction transaction(database, SQLite::TransactionBehavior::IMMEDIATE);
    until_stopped(database, stop, "the migration", [&] {
      database.exec(kMigrations[static_cast<size_t>(version)]);
      database.exec("PRAGMA user_version = " + std::to_string(version + 1));
    });
    transaction.commit();
  }
}

}  // namespace lampglow::storage
