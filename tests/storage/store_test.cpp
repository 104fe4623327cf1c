#include "storage/store.h"

#include <SQLiteCpp/SQLiteCpp.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "storage/reader.h"
#include "tests/storage/sample.h"
#include "tests/storage/temporary_directory.h"

namespace lampglow::storage {
namespace {

using testing_support::at;
using testing_support::foggy;
using testing_support::harbour;
using testing_support::TemporaryDirectory;
using testing_support::without_value;

class StoreTest : public testing::Test {
 protected:
  TemporaryDirectory directory;
  std::filesystem::path file = directory / "lampglow.db";
};

TEST_F(StoreTest, GivesBackEveryFieldOfAFrame) {
  const FrameResult frame = foggy(at("2026-11-22T01:00:30.25Z"));
  {
    Store store(file);
    store.put(store.upsert_camera("quay", harbour()), frame);
    store.commit();
  }
  Reader reader(file);
  const auto camera = reader.camera("quay");
  ASSERT_TRUE(camera);
  EXPECT_EQ(camera->station, "harbour");
  EXPECT_EQ(camera->elevation_m, 10);
  EXPECT_EQ(camera->width_px, 760);
  const auto row = reader.latest(camera->number);
  ASSERT_TRUE(row);
  const Observation &was = frame.observation, &is = row->observation;
  EXPECT_EQ(is.time_utc, was.time_utc);
  EXPECT_EQ(is.extinction_per_m, was.extinction_per_m);
  EXPECT_EQ(is.extinction_low_per_m, was.extinction_low_per_m);
  EXPECT_EQ(is.extinction_high_per_m, was.extinction_high_per_m);
  EXPECT_EQ(is.limit, was.limit);
  EXPECT_EQ(is.q, was.q);
  EXPECT_EQ(is.q_low, was.q_low);
  EXPECT_EQ(is.q_high, was.q_high);
  EXPECT_EQ(is.weather, was.weather);
  EXPECT_EQ(is.weather_probability, was.weather_probability);
  EXPECT_EQ(is.lecture_class, was.lecture_class);
  EXPECT_EQ(is.wmo_4680, was.wmo_4680);
  EXPECT_EQ(is.relative_humidity, was.relative_humidity);
  EXPECT_EQ(is.method, was.method);
  EXPECT_EQ(is.lights_used, was.lights_used);
  EXPECT_EQ(is.quality, was.quality);

  const auto fits = reader.fits(camera->number);
  ASSERT_EQ(fits.size(), 2u);
  EXPECT_EQ(fits[0].time_utc, was.time_utc);
  EXPECT_EQ(fits[0].fit.id, "L1");
  EXPECT_EQ(fits[0].fit.state, LampState::seen);
  EXPECT_EQ(fits[0].fit.x_px, 96.5);
  EXPECT_EQ(fits[0].fit.y_px, 213.25);
  EXPECT_EQ(fits[0].fit.distance_m, 60);
  EXPECT_EQ(fits[0].fit.strength_ratio, 0.97);
  EXPECT_EQ(fits[0].fit.optical_thickness, frame.lamps[0].optical_thickness);
  EXPECT_EQ(fits[0].fit.residual_rms, 1.125);
  EXPECT_EQ(fits[0].fit.ln_halo, -0.0625);
  EXPECT_EQ(fits[0].fit.ln_halo_sigma, 0.03125);
  EXPECT_EQ(fits[1].fit.state, LampState::faded);
  EXPECT_FALSE(fits[1].fit.strength_ratio);
  EXPECT_FALSE(fits[1].fit.ln_halo);

  const auto rings = reader.rings(camera->number, "L1");
  ASSERT_TRUE(rings);
  EXPECT_EQ(rings->second.theta_deg, frame.lamps[0].profile.theta_deg);
  EXPECT_EQ(rings->second.radiance, frame.lamps[0].profile.radiance);
  EXPECT_EQ(rings->second.radiance_sigma, frame.lamps[0].profile.radiance_sigma);
  EXPECT_EQ(rings->second.model, frame.lamps[0].profile.model);
  EXPECT_FALSE(reader.rings(camera->number, "L2"));
}

TEST_F(StoreTest, UnknownStaysUnknownAndHasItsReason) {
  Store store(file);
  const CameraNumber camera = store.upsert_camera("quay", harbour());
  store.put(camera, without_value(at("2026-11-22T12:00:00Z")));
  store.commit();
  const auto row = Reader(file).latest(camera);
  ASSERT_TRUE(row);
  EXPECT_FALSE(row->observation.extinction_per_m);
  EXPECT_FALSE(row->observation.q);
  EXPECT_FALSE(row->observation.wmo_4680);
  EXPECT_EQ(row->values, 0);
  EXPECT_EQ(row->reason, "daylight");
  EXPECT_EQ(row->observation.quality.to_string(), "daylight");
  SQLite::Database raw(file.string());
  EXPECT_TRUE(raw.execAndGet("SELECT extinction_per_m FROM observation").isNull());
  EXPECT_TRUE(raw.execAndGet("SELECT probability_fog FROM observation").isNull());
}

TEST_F(StoreTest, StoringTwiceIsStoringOnce) {
  std::string once;
  for (int run = 0; run < 2; ++run) {
    Store store(file);
    const CameraNumber camera = store.upsert_camera("quay", harbour());
    for (int minute = 0; minute < 150; ++minute)
      store.put(camera,
                foggy(at("2026-11-22T01:00:00Z") + std::chrono::minutes(minute), 0.01 + 1e-5 * minute));
    store.commit();
    if (run == 0) once = Reader(file).content();
  }
  EXPECT_FALSE(once.empty());
  EXPECT_EQ(Reader(file).content(), once);
}

TEST_F(StoreTest, ContentDoesNotDependOnTheBatches) {
  std::string content[2];
  for (int i = 0; i < 2; ++i) {
    const auto path = directory / ("batch" + std::to_string(i));
    Store store(path, {.batch_frames = i == 0 ? 1 : 64});
    const CameraNumber camera = store.upsert_camera("quay", harbour());
    for (int k = 0; k < 200; ++k)
      store.put(camera, foggy(at("2026-11-22T01:00:00Z") + std::chrono::seconds(20 * k)));
    store.commit();
    content[i] = Reader(path).content();
  }
  EXPECT_EQ(content[0], content[1]);
}

TEST_F(StoreTest, AReplacedFrameLosesTheLampsItNoLongerHas) {
  Store store(file);
  const CameraNumber camera = store.upsert_camera("quay", harbour());
  FrameResult frame = foggy(at("2026-11-22T01:00:00Z"));
  store.put(camera, frame);
  frame.lamps.pop_back();
  store.put(camera, frame);
  store.commit();
  EXPECT_EQ(Reader(file).fits(camera).size(), 1u);
}

TEST_F(StoreTest, ALampThatMovedHasANewReferenceFromTheNextFrameOn) {
  Store store(file);
  Site site = harbour();
  const CameraNumber camera = store.upsert_camera("quay", site);
  store.put(camera, foggy(at("2026-11-22T01:00:00Z")));
  site.lights[0].distance_m = 62.5;
  EXPECT_EQ(store.upsert_camera("quay", site), camera);
  store.put(camera, foggy(at("2026-11-22T01:01:00Z")));
  store.put(camera, foggy(at("2026-11-22T01:02:00Z")));
  store.commit();
  const auto lamps = Reader(file).lamps(camera);
  ASSERT_EQ(lamps.size(), 3u);
  EXPECT_EQ(lamps[0].distance_m, 62.5);
  EXPECT_EQ(lamps[0].reference_since, at("2026-11-22T01:01:00Z"));
  EXPECT_EQ(lamps[1].reference_since, at("2026-11-22T01:00:00Z"));
  SQLite::Database raw(file.string());
  EXPECT_EQ(raw.execAndGet("SELECT count(*) FROM lamp_reference").getInt(), 4);
}

TEST_F(StoreTest, HasTheSettingsOfTheConventions) {
  Store store(file);
  store.put(store.upsert_camera("quay", harbour()), foggy(at("2026-11-22T01:00:00Z")));
  store.commit();
  SQLite::Database raw(file.string());
  EXPECT_EQ(raw.execAndGet("PRAGMA journal_mode").getString(), "wal");
  EXPECT_EQ(raw.execAndGet("PRAGMA auto_vacuum").getInt(), 2);
}

TEST_F(StoreTest, KeysetPagesGiveEveryRowOnce) {
  Store store(file);
  const CameraNumber camera = store.upsert_camera("quay", harbour());
  const TimePoint start = at("2026-11-22T01:00:00Z");
  for (int k = 0; k < 25; ++k) store.put(camera, foggy(start + std::chrono::seconds(30 * k)));
  store.commit();
  Reader reader(file);
  ObservationQuery query{camera, start, start + std::chrono::hours(1), 0, {}, 10};
  std::vector<TimePoint> seen;
  for (auto page = reader.observations(query); !page.empty(); page = reader.observations(query)) {
    EXPECT_LE(page.size(), 10u);
    for (const auto& row : page) seen.push_back(row.observation.time_utc);
    query.after = seen.back();
  }
  ASSERT_EQ(seen.size(), 25u);
  for (int k = 0; k < 25; ++k) EXPECT_EQ(seen[static_cast<size_t>(k)], start + std::chrono::seconds(30 * k));
}

TEST_F(StoreTest, EventsKeepTheirOrderAndNumber) {
  Store store(file);
  store.upsert_camera("quay", harbour());
  const auto first =
      store.put_event({0, at("2026-11-22T01:00:00Z"), EventKind::started, Severity::info, "", "up"});
  const auto second = store.put_event(
      {0, at("2026-11-22T00:00:00Z"), EventKind::source_failed, Severity::error, "quay", "dead"});
  EXPECT_GT(second, first);
  Reader reader(file);
  const auto events = reader.events(first, 10);
  ASSERT_EQ(events.size(), 1u);
  EXPECT_EQ(events[0].camera, "quay");
  EXPECT_EQ(events[0].kind, EventKind::source_failed);
  EXPECT_EQ(reader.last_events(10).size(), 2u);
}

TEST_F(StoreTest, RollbackForgetsWhatIsPendingAndGoesOn) {
  Store store(file);
  const CameraNumber camera = store.upsert_camera("quay", harbour());
  store.put(camera, foggy(at("2026-11-22T01:00:00Z")));
  store.rollback();
  store.put(camera, foggy(at("2026-11-22T01:01:00Z")));
  store.commit();
  Reader reader(file);
  EXPECT_EQ(reader.span(camera)->first, at("2026-11-22T01:01:00Z"));
  EXPECT_EQ(reader.lamps(camera)[0].distance_m, 60.0);
}

}  // namespace
}  // namespace lampglow::storage
