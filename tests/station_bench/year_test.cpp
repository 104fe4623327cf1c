// A year of observations every minute with eight lamps: size, answers, and ten years under retention. Minutes
// long: label bench. Run alone: ctest --preset release -L bench -R Year
#include <gtest/gtest.h>

#include <chrono>
#include <cstdio>

#include "storage/maintenance.h"
#include "storage/reader.h"
#include "storage/store.h"
#include "tests/storage/sample.h"
#include "tests/storage/temporary_directory.h"
#include "web/api.h"

namespace lampglow::storage {
namespace {

using namespace testing_support;
using Clock = std::chrono::steady_clock;

double ms_since(Clock::time_point begin) {
  return std::chrono::duration<double, std::milli>(Clock::now() - begin).count();
}

FrameResult eight_lamps(TimePoint time, int i) {
  FrameResult frame = foggy(time, 0.002 + 0.01 * (i % 997) / 997.0);
  frame.lamps.resize(1);
  frame.lamps[0].profile = {};
  while (frame.lamps.size() < 8) {
    frame.lamps.push_back(frame.lamps[0]);
    frame.lamps.back().id = "L" + std::to_string(frame.lamps.size());
  }
  return frame;
}

// The median of some answers, so that one disturbance on a busy machine does not decide.
double median_ms(web::Api& api, Reader& reader, const std::string& target) {
  std::vector<double> times;
  for (int i = 0; i < 7; ++i) {
    const auto begin = Clock::now();
    const web::Response response = api.answer({"GET", target, "", "", "", ""}, &reader);
    times.push_back(ms_since(begin));
    EXPECT_EQ(response.status, 200) << response.body;
  }
  std::sort(times.begin(), times.end());
  return times[3];
}

TEST(Year, IsStoredAndAnsweredFastEnough) {
  TemporaryDirectory directory;
  const auto file = directory / "year.db";
  const TimePoint start = at("2026-01-01T00:01:00Z");
  const auto begin = Clock::now();
  Store store(file, {.batch_frames = 1440});
  const CameraNumber camera = store.upsert_camera("quay", harbour());
  for (int i = 0; i < 525600; ++i) store.put(camera, eight_lamps(start + std::chrono::minutes(i), i));
  store.checkpoint();
  const double size_mb = static_cast<double>(std::filesystem::file_size(file)) / 1e6;
  std::printf("525600 frames with 8 lamps each: %.0f s, %.0f MB\n", ms_since(begin) / 1000, size_mb);

  web::LiveState live;
  live.set_camera("quay", harbour());
  web::ApiOptions options;
  options.database = file;
  web::Api api(live, options);
  Reader reader(file);
  const double day =
      median_ms(api, reader, "/v1/observations?from=2026-06-15T00:00:00Z&to=2026-06-16T00:00:00Z&limit=2000");
  const double first =
      median_ms(api, reader, "/v1/observations?from=2026-01-01T00:00:00Z&to=2026-01-02T00:00:00Z&limit=2000");
  const double year =
      median_ms(api, reader,
                "/v1/observations?from=2026-01-01T00:00:00Z&to=2027-01-02T00:00:00Z&step=hour&limit=10000");
  std::printf("a day by frame: %.1f ms, %.1f ms; the year by hour: %.1f ms\n", day, first, year);
  EXPECT_LE(day, 20);
  EXPECT_LE(first, 20);
  EXPECT_LE(year, 100);
}

// Ten years at one frame every ten minutes, everything kept 100 days.
TEST(Year, RetentionKeepsTheFileFlatOverTenYears) {
  TemporaryDirectory directory;
  const auto file = directory / "ten.db";
  Store store(file, {.batch_frames = 144});
  const CameraNumber camera = store.upsert_camera("quay", harbour());
  Retention retention{100, 100, 2, 100, 100, 100, 100};
  TimePoint now = at("2026-01-01T00:00:00Z");
  std::uintmax_t after_first_year = 0, largest = 0;
  for (int day = 0; day < 3650; ++day) {
    for (int i = 0; i < 144; ++i) store.put(camera, eight_lamps(now += std::chrono::minutes(10), i));
    store.commit();
    while (apply_retention(store, retention, now) > 0) {
    }
    if (day % 30 == 0) store.checkpoint();
    if (day == 365) {
      store.checkpoint();
      after_first_year = std::filesystem::file_size(file);
    }
    if (day > 365) largest = std::max(largest, std::filesystem::file_size(file));
  }
  std::printf("after a year %.1f MB, at most %.1f MB in the nine after it\n",
              static_cast<double>(after_first_year) / 1e6, static_cast<double>(largest) / 1e6);
  EXPECT_LE(largest, after_first_year * 12 / 10);
  EXPECT_EQ(check(file, false), "ok");
}

}  // namespace
}  // namespace lampglow::storage
