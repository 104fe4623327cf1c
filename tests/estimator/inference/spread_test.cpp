// The clear reference's fit and the scene, against pictures made of closed forms: a skirt of glare round
// every lamp, averaged over each ring's own points.
#include "estimator/inference/spread.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "estimator/inference/halo_models.h"

namespace lampglow::inference {
namespace {

constexpr double kFocal_px = 522;

Camera camera() {
  Camera c;
  c.width_px = 380;
  c.height_px = 252;
  c.focal_length_px = kFocal_px;
  c.principal_x_px = 190;
  c.principal_y_px = 126;
  return c;
}

// Per pixel, of a point of unit energy: 4 % of it in a skirt a / (2π (r² + a²)^1.5), which integrates to 1.
double glare(double r_px) {
  constexpr double kShare = 0.04, kWidth_px = 6;
  const double square = r_px * r_px + kWidth_px * kWidth_px;
  return kShare * kWidth_px / (2 * std::numbers::pi * square * std::sqrt(square));
}

struct Clear {
  std::vector<SceneLamp> lamps;
  std::vector<double> flux;
  photometry::RingMap map;
  RingData data;
};

// Lamps on a sky that brightens by half of itself per half picture; the brightest outshines it, the faintest
// does not. All saturate in their cores, so that glare alone tells their strengths.
Clear clear_picture() {
  Clear clear;
  const double flux[] = {3e5, 8e4, 2e4, 6e3};
  std::vector<photometry::RingCentre> centres;
  for (size_t j = 0; j < std::size(flux); ++j) {
    SceneLamp lamp;
    lamp.x_px = 50 + 90.0 * static_cast<double>(j);
    lamp.y_px = 80 + 50.0 * static_cast<double>(j % 2);
    lamp.distance_m = 100.0 * static_cast<double>(j + 1);
    clear.lamps.push_back(lamp);
    clear.flux.push_back(flux[j]);
    centres.push_back({lamp.x_px, lamp.y_px, flux[j] / 1e4});
  }
  clear.map = photometry::make_ring_map(camera(), centres, {.rings = 30});
  const photometry::AngularScale scale(camera());
  clear.data.sky_unit = 10;
  for (const auto& ring : clear.map.rings) {
    double light = 0;
    for (size_t j = 0; j < clear.flux.size(); ++j)
      for (const auto& sample : ring.samples) {
        const double r_px =
            kFocal_px *
            photometry::plane_distance(sample, scale.direction(clear.lamps[j].x_px, clear.lamps[j].y_px));
        light += clear.flux[j] * glare(r_px) / static_cast<double>(ring.samples.size());
      }
    const double sky = 10 * (1 + 0.5 * (2 * ring.mean_y_px - 252) / 380);
    const bool core = ring.theta_low_rad == 0;
    clear.data.value.push_back(light + sky);
    clear.data.sigma.push_back(std::hypot(0.02 * light, 0.02));
    clear.data.noise.push_back(0.01);
    clear.data.used.push_back(!ring.samples.empty() && !core ? 1 : 0);
  }
  clear.data.lit.assign(clear.lamps.size(), 1);
  return clear;
}

TEST(Spread, StrengthsAreRightUnderASlopingSky) {
  const Clear clear = clear_picture();
  const LearnedSpread learned =
      learn_spread(camera(), clear.map, clear.lamps, *halo_model(HaloKind::table), clear.data, 1e-7, {});
  for (size_t j = 1; j < clear.flux.size(); ++j) {
    const double ratio = std::exp(learned.ln_strength[j] - learned.ln_strength[0]);
    EXPECT_NEAR(ratio / (clear.flux[j] / clear.flux[0]), 1, 0.1) << "lamp " << j;
  }
  EXPECT_LT(learned.chi2_per_ring, 1);
}

TEST(Scene, AGuestIsAveragedOverWhatTheFrameShows) {
  const Clear clear = clear_picture();
  PointSpread spread;
  for (int n = 0; n < 40; ++n) {
    spread.theta_rad.push_back(3.5 / kFocal_px * std::pow(1.12, n));
    spread.ln_density.push_back(std::log(glare(spread.theta_rad.back() * kFocal_px)));
  }
  spread.core_theta_rad = spread.theta_rad.front();
  spread.core_fraction = 0.97;
  const Scene scene(camera(), clear.lamps, spread, clear.map);
  SceneLamp guest;
  guest.x_px = 95;
  guest.y_px = 60;
  guest.distance_m = 200;
  guest.ln_beam = 0;
  guest.masked_rad = 12 / kFocal_px;
  const Scene with = scene.with_guests(std::vector<SceneLamp>{guest});
  for (size_t r = 0; r < with.ring_count(); ++r)
    EXPECT_LE(with.direct(r, clear.lamps.size()), glare(12) * 1.02) << "ring " << r;
}

}  // namespace
}  // namespace lampglow::inference
