#include "estimator/inference/calibrate_day.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <iostream>
#include <random>

namespace lampglow::inference {
namespace {

// Views made straight from attenuation, with what the learner does not know: light that comes and goes on
// each target in its own way, scatter, a sensor that errs, dirt on the window.
struct Made {
  std::vector<Target> targets;
  std::vector<bool> skyline;
  std::vector<double> distance_m, contrast, sunlit, dirt;
  DayCalibration day;
};

Made make_targets(std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform;
  Made made;
  made.day.sky_width_px = made.day.sky_height_px = 10;
  for (int i = 0; i < 30; ++i) {
    Target target;
    target.id = "t" + std::to_string(i);
    target.width_px = target.height_px = 10;
    made.targets.push_back(target);
    made.skyline.push_back(i % 3 == 0);
    made.distance_m.push_back(40 * std::pow(60.0, uniform(random)));
    made.contrast.push_back(-2.5 + 0.5 * normal(random));
    made.sunlit.push_back(i % 3 == 0 ? 0.1 : 0.8 + 0.2 * normal(random));
    made.dirt.push_back(0.03 * uniform(random));
  }
  return made;
}

DaySample make_sample(const Made& made, double mor_m, int minute, std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  DaySample sample;
  sample.time_utc = TimePoint{} + std::chrono::minutes(minute);
  sample.mor_m = mor_m * std::exp(0.15 * normal(random));
  sample.view.sky = 1;
  const double light = mor_m < 1000 ? -0.8 : 0.4 * normal(random);
  for (size_t i = 0; i < made.targets.size(); ++i) {
    const double u = made.contrast[i] + made.sunlit[i] * light + 0.06 * normal(random) -
                     kMorTimesExtinction / mor_m * made.distance_m[i];
    TargetView view;
    view.noise_energy = 1e-5;
    view.gradient_energy =
        std::exp(2 * u) + std::exp(2 * made.contrast[i]) * made.dirt[i] * made.dirt[i] + 1e-5;
    sample.view.targets.push_back(view);
  }
  return sample;
}

TEST(LearnDay, ForeseesFramesThatItHasNotSeen) {
  std::vector<double> errors;
  int covered = 0, bounded = 0;
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> uniform;
    const Made made = make_targets(random);
    std::vector<DaySample> samples;
    for (int i = 0; i < 36; ++i)
      samples.push_back(make_sample(made, 150 * std::pow(150.0, uniform(random)), 10 * i, random));
    std::string why;
    const auto learning = learn_day(samples, made.targets, made.skyline, made.day, {}, why);
    ASSERT_TRUE(learning) << why;
    EXPECT_GT(learning->cross_validated, 10);
    Site site;
    site.targets = learning->targets;
    site.day = learning->day;
    for (int i = 0; i < 25; ++i) {
      const double mor = 150 * std::pow(60.0, uniform(random));
      DaySample sample = make_sample(made, mor, 0, random);
      DayView view;
      for (const Target& target : site.targets)
        view.targets.push_back(sample.view.targets[static_cast<size_t>(std::stoi(target.id.substr(1)))]);
      const ContrastFit fit = fit_contrast(view, site);
      const SigmaBounds bounds = sigma_bounds(fit.posterior, {.widest_ratio = 1e9});
      errors.push_back(std::abs(std::log(bounds.value * mor / kMorTimesExtinction)));
      ++bounded;
      const double sigma = kMorTimesExtinction / mor;
      // The bounds of one frame, widened by the error that cross-validation found.
      const double wide = std::exp(1.96 * learning->day.log_extinction_sigma);
      covered += sigma >= bounds.low.value_or(0) / wide && sigma <= bounds.high.value_or(1) * wide;
    }
  }
  std::sort(errors.begin(), errors.end());
  std::cout << "median |ln| " << errors[errors.size() / 2] << ", 95 % " << errors[errors.size() * 95 / 100]
            << ", covered " << covered << " of " << bounded << "\n";
  EXPECT_LT(errors[errors.size() / 2], 0.2);
  EXPECT_LT(errors[errors.size() * 95 / 100], 0.7);
  EXPECT_GE(covered, bounded * 90 / 100);
}

TEST(LearnDay, SaysWhenTheDataCannotSupportIt) {
  std::mt19937_64 random(9);
  const Made made = make_targets(random);
  std::string why;
  std::vector<DaySample> few;
  for (int i = 0; i < 4; ++i) few.push_back(make_sample(made, 300 * (i + 1), 10 * i, random));
  EXPECT_FALSE(learn_day(few, made.targets, made.skyline, made.day, {}, why));
  EXPECT_NE(why.find("too few daylight frames"), std::string::npos) << why;

  std::vector<DaySample> same;
  for (int i = 0; i < 20; ++i) same.push_back(make_sample(made, 20000, 10 * i, random));
  EXPECT_FALSE(learn_day(same, made.targets, made.skyline, made.day, {}, why));
  EXPECT_NE(why.find("less than a factor of 3"), std::string::npos) << why;
}

TEST(LearnDay, TheSameSamplesTeachTheSameToTheBit) {
  std::mt19937_64 random(11);
  const Made made = make_targets(random);
  std::vector<DaySample> samples;
  for (int i = 0; i < 12; ++i)
    samples.push_back(make_sample(made, 200 * std::pow(2.0, i % 7), 10 * i, random));
  std::string why;
  const auto a = learn_day(samples, made.targets, made.skyline, made.day, {}, why);
  const auto b = learn_day(samples, made.targets, made.skyline, made.day, {}, why);
  ASSERT_TRUE(a && b) << why;
  ASSERT_EQ(a->targets.size(), b->targets.size());
  for (size_t i = 0; i < a->targets.size(); ++i)
    EXPECT_EQ(*a->targets[i].distance_m, *b->targets[i].distance_m);
  EXPECT_EQ(a->day.log_extinction_sigma, b->day.log_extinction_sigma);
}

}  // namespace
}  // namespace lampglow::inference
