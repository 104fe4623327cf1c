// The joint fit against random truths: rings made by the forward model with noise of known size, drift,
// strengths and outliers that the fit is not told of. (Against photons it is tested by replaying simulated
// archives.)
#include "estimator/inference/joint_fit.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <random>

#include "estimator/inference/halo_models.h"
#include "estimator/inference/posterior.h"
#include "estimator/observation.h"
#include "tests/estimator/inference/small_camera.h"

namespace lampglow::inference {
namespace {

Camera camera() {
  return pinhole(380, 252, 522);
}

struct Fixture {
  std::vector<SceneLamp> lamps;
  photometry::RingMap map;
  std::unique_ptr<Scene> scene;
  std::shared_ptr<const HaloModel> halo = halo_model(HaloKind::table);
  FitOptions options;

  explicit Fixture(int count) {
    std::vector<photometry::RingCentre> centres;
    for (int j = 0; j < count; ++j) {
      SceneLamp lamp;
      lamp.id = "L" + std::to_string(j);
      lamp.x_px = 40 + 300.0 * j / std::max(1, count - 1);
      lamp.y_px = 90 + 60.0 * (j % 3);
      lamp.distance_m = 60 * std::pow(20.0, static_cast<double>(j) / std::max(1, count - 1));
      lamp.ln_strength = std::log(8e9 / (*lamp.distance_m * *lamp.distance_m));
      lamps.push_back(lamp);
      centres.push_back({lamp.x_px, lamp.y_px, std::exp(lamp.ln_strength) / 1e4});
    }
    map = photometry::make_ring_map(camera(), centres, {.rings = 30});
    scene = std::make_unique<Scene>(camera(), lamps, plain_spread(522, 20), map);
  }

  // Parameters of a random night, and its rings with noise.
  std::vector<double> truth(double mor_m, std::mt19937_64& random) const {
    std::normal_distribution<double> normal;
    const Layout at(lamps.size());
    std::vector<double> p(at.size(), 0.0);
    p[Layout::ln_sigma] = std::log(kMorTimesExtinction / mor_m);
    p[Layout::q] = prior_q(p[Layout::ln_sigma], options) + 0.03 * normal(random);
    p[Layout::ln_gain] = 0.12 * normal(random);
    p[Layout::emission] = options.emission_mean + 0.5 * options.emission_sigma * normal(random);
    for (size_t j = 0; j < lamps.size(); ++j) {
      p[at.ln_strength(j)] = lamps[j].ln_strength_sigma * normal(random);
      p[at.ln_halo(j)] = lamps[j].ln_halo_sigma * normal(random);
      p[at.sky(j)] = 1 + 0.05 * normal(random);
    }
    return p;
  }
  RingData rings(const std::vector<double>& p, double sky, double outliers, std::mt19937_64& random) const {
    std::normal_distribution<double> normal;
    std::uniform_real_distribution<double> uniform;
    RingData data;
    data.sky_unit = sky;
    data.lit.assign(lamps.size(), 1);
    Scene::Output output;
    scene->evaluate(*halo, p, data.lit, sky, output, false);
    for (const double value : output.model) {
      const double sigma = std::hypot(0.02 * (value - sky), 0.005 * sky);
      const double stray = uniform(random) < outliers ? 15 * sigma : 0.0;
      data.value.push_back(value + sigma * normal(random) + stray);
      data.sigma.push_back(sigma);
      data.used.push_back(1);
    }
    return data;
  }
};

TEST(JointFit, JacobianIsThatOfFiniteDifferences) {
  Fixture f(4);
  *f.scene = f.scene->with_halos(std::vector{0.4, -0.2, 0.0, 0.7});
  std::mt19937_64 random(7);
  std::normal_distribution<double> normal;
  Scene::RingPattern pattern;
  for (size_t r = 0; r < f.scene->ring_count(); ++r) {
    pattern.lens.push_back(0.05 * normal(random));
    pattern.sky.push_back(0.05 * normal(random));
  }
  f.scene->set_pattern(std::move(pattern));
  for (const double mor : {80.0, 900.0, 9000.0}) {
    const std::vector<double> p = f.truth(mor, random);
    const RingData data = f.rings(p, 20, 0, random);
    std::vector<double> at = f.truth(mor * 1.1, random);
    const Residuals base = residuals_at(*f.scene, *f.halo, data, f.options, at);
    const size_t columns = at.size();
    for (size_t c = 0; c < columns; ++c) {
      const double step = 1e-5;
      std::vector<double> up = at, down = at;
      up[c] += step;
      down[c] -= step;
      const Residuals high = residuals_at(*f.scene, *f.halo, data, f.options, up);
      const Residuals low = residuals_at(*f.scene, *f.halo, data, f.options, down);
      for (size_t r = 0; r < base.value.size(); ++r) {
        const double numeric = (high.value[r] - low.value[r]) / (2 * step);
        ASSERT_NEAR(base.jacobian[r * columns + c], numeric, 2e-3 * std::abs(numeric) + 2e-3)
            << "residual " << r << " parameter " << c << " MOR " << mor;
      }
    }
  }
}

// Share of truths within the 95 % bounds, and the median error in σ.
struct Score {
  int inside = 0, limits = 0, count = 0;
  std::vector<double> errors;
};

Score score(const Fixture& f, double outliers, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  Score s;
  for (int night = 0; night < 40; ++night) {
    const double mor = 60 * std::pow(100.0, night / 39.0);
    const std::vector<double> p = f.truth(mor, random);
    const RingData data = f.rings(p, 20, outliers, random);
    const JointFit fit = fit_jointly(*f.scene, *f.halo, data, f.options);
    const SigmaBounds bounds = sigma_bounds(fit.posterior, {});
    const double truth = std::exp(p[Layout::ln_sigma]);
    s.inside += truth >= bounds.low.value_or(0) && truth <= bounds.high.value_or(1e9) ? 1 : 0;
    s.limits += bounds.limit != Limit::none ? 1 : 0;
    s.errors.push_back(std::abs(std::log(bounds.value / truth)));
    ++s.count;
  }
  std::sort(s.errors.begin(), s.errors.end());
  return s;
}

TEST(JointFit, RandomTruthsLieWithinTheClaimedBounds) {
  const Score s = score(Fixture(4), 0.0, 11);
  EXPECT_GE(s.inside, 35) << "of " << s.count;
  EXPECT_LT(s.errors[20], 0.08);
}

TEST(RingMap, OuterRingsAreOfSkyAloneWhereTheSkylineIsKnown) {
  photometry::RingOptions options{.rings = 30};
  options.skyline_px.assign(static_cast<size_t>(camera().width_px), 100);
  options.skyline_px[7] = -1;  // a column of nothing but sky
  const std::vector<photometry::RingCentre> centres{{60, 120}};
  const auto map = photometry::make_ring_map(camera(), centres, options);
  const auto whole = photometry::make_ring_map(camera(), centres, {.rings = 30});
  const int edge = 100 - options.skyline_margin_px;
  EXPECT_EQ(map.ring_of_pixel.at(90, edge - 1), whole.ring_of_pixel.at(90, edge - 1));
  EXPECT_GE(map.ring_of_pixel.at(90, edge - 1), 0);
  EXPECT_EQ(map.ring_of_pixel.at(90, edge), -1);
  EXPECT_EQ(map.ring_of_pixel.at(7, 120), whole.ring_of_pixel.at(7, 120));
  EXPECT_EQ(map.ring_of_pixel.at(61, 121), 0) << "the lamp itself stays, whatever it stands before";
}

TEST(JointFit, OutliersDoNotCarryTheAnswerAway) {
  const Score s = score(Fixture(4), 0.05, 12);
  EXPECT_GE(s.inside, 34) << "of " << s.count;
  EXPECT_LT(s.errors[20], 0.1);
}

TEST(JointFit, SameDataSameNumbers) {
  const Fixture f(3);
  std::mt19937_64 random(5);
  const std::vector<double> p = f.truth(400, random);
  const RingData data = f.rings(p, 20, 0.02, random);
  const JointFit a = fit_jointly(*f.scene, *f.halo, data, f.options);
  const JointFit b = fit_jointly(*f.scene, *f.halo, data, f.options);
  EXPECT_EQ(a.parameters, b.parameters);
  EXPECT_EQ(a.cost, b.cost);
}

}  // namespace
}  // namespace lampglow::inference
