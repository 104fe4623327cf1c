#include "estimator/photometry/registration.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/estimator/photometry/scene.h"

namespace lampglow::photometry {
namespace {

constexpr int kWidth = 480, kHeight = 320;

struct Pose {
  double shift_x = 0, shift_y = 0, rotation = 0;
};

std::pair<double, double> moved(const Pose& pose, double x, double y) {
  const double dx = x - 0.5 * kWidth, dy = y - 0.5 * kHeight;
  return {0.5 * kWidth + std::cos(pose.rotation) * dx - std::sin(pose.rotation) * dy + pose.shift_x,
          0.5 * kHeight + std::sin(pose.rotation) * dx + std::cos(pose.rotation) * dy + pose.shift_y};
}

struct Night {
  std::vector<CatalogueLamp> catalogue;
  std::vector<double> electrons_per_s;
};

// Lamps spread over the picture, strengths over a decade and a half.
Night make_night(size_t lamps, std::mt19937_64& random) {
  std::uniform_real_distribution<double> part(0, 1);
  Night night;
  for (size_t i = 0; i < lamps; ++i) {
    CatalogueLamp lamp;
    lamp.id = "L" + std::to_string(i + 1);
    lamp.x_px = 40 + (kWidth - 80) * (static_cast<double>(i) + part(random)) / static_cast<double>(lamps);
    lamp.y_px = 80 + 160 * part(random);
    lamp.position_sigma_px = 0.05;
    night.catalogue.push_back(lamp);
    night.electrons_per_s.push_back(std::pow(10, 3.5 + 1.5 * part(random)));
  }
  return night;
}

struct Trouble {
  std::vector<size_t> off;       // lamps out
  int strays = 0;                // bright lights at random places
  bool car_beside_lamp = false;  // a bright light 5 px beside lamp 0
};

RadianceImage picture(const Night& night, const Pose& pose, const Trouble& trouble, std::mt19937_64& random) {
  std::uniform_real_distribution<double> part(0, 1);
  Image<double> truth(kWidth, kHeight, 30.0);
  for (size_t i = 0; i < night.catalogue.size(); ++i) {
    if (std::count(trouble.off.begin(), trouble.off.end(), i)) continue;
    const auto [x, y] = moved(pose, night.catalogue[i].x_px, night.catalogue[i].y_px);
    scene::add_lamp(truth, {x, y, night.electrons_per_s[i], 0.9, 0.03, 12});
  }
  for (int i = 0; i < trouble.strays; ++i)
    scene::add_lamp(truth, {30 + (kWidth - 60) * part(random), 100 + 120 * part(random),
                            std::pow(10, 4 + 1.5 * part(random)), 0.9});
  if (trouble.car_beside_lamp) {
    const auto [x, y] = moved(pose, night.catalogue[0].x_px, night.catalogue[0].y_px);
    scene::add_lamp(truth, {x + 5, y + 2, 2e5, 1.2});
  }
  const Camera camera = scene::camera_12_bit(kWidth, kHeight);
  return to_radiance(scene::bracket(truth, camera, {4, 0.5}, random), camera);
}

// How far the transform is off, at the middle of the picture and at its ends.
double error_px(const RegisteredFrame& frame, const Pose& pose) {
  double worst = 0;
  for (const double x : {40.0, 240.0, 440.0}) {
    double fx = x, fy = 160;
    frame.to_frame(fx, fy, kWidth, kHeight);
    const auto [tx, ty] = moved(pose, x, 160);
    worst = std::max(worst, std::hypot(fx - tx, fy - ty));
  }
  return worst;
}

TEST(Registration, HoldsToATenthOfAPixelWithStraysOutagesAndCars) {
  std::mt19937_64 random(1);
  std::normal_distribution<double> normal(0, 1);
  std::vector<double> errors;
  int off_seen = 0, seen_off = 0;
  for (int trial = 0; trial < 21; ++trial) {
    const Night night = make_night(7, random);
    const Pose pose{2.5 * normal(random), 2.5 * normal(random), 0.002 * normal(random)};
    const Trouble trouble{{static_cast<size_t>(trial % 7)}, 4, trial % 3 == 0};
    const RegisteredFrame frame = register_frame(picture(night, pose, trouble, random), night.catalogue);
    ASSERT_TRUE(frame.registered);
    errors.push_back(error_px(frame, pose));
    for (size_t i = 0; i < 7; ++i) {
      const bool off = i == trouble.off[0], beside_car = i == 0 && trouble.car_beside_lamp;
      if (beside_car) continue;
      if (off) off_seen += frame.lamps[i].state == LampState::seen;
      if (!off) seen_off += frame.lamps[i].state != LampState::seen;
    }
  }
  std::sort(errors.begin(), errors.end());
  std::printf("error at the worst of three places: median %.3f px, 95 %% %.3f px, worst %.3f px\n",
              errors[10], errors[19], errors[20]);
  EXPECT_LT(errors[10], 0.03);
  EXPECT_LT(errors[20], 0.1);
  EXPECT_LE(seen_off, 2) << "of 126 lamps that shine, not seen";
  EXPECT_LE(off_seen, 2) << "of 21 lamps that are out, taken for seen";
}

TEST(Registration, ClaimsTheErrorItHas) {
  std::mt19937_64 random(2);
  double pull = 0;
  for (int trial = 0; trial < 40; ++trial) {
    const Night night = make_night(5, random);
    std::normal_distribution<double> normal(0, 1);
    const Pose pose{2 * normal(random), 2 * normal(random), 0.001 * normal(random)};
    // A catalogue that is itself uncertain.
    Night known = night;
    for (CatalogueLamp& lamp : known.catalogue) {
      lamp.position_sigma_px = 0.3;
      lamp.x_px += 0.3 * normal(random), lamp.y_px += 0.3 * normal(random);
    }
    const RegisteredFrame frame = register_frame(picture(night, pose, {}, random), known.catalogue);
    pull += (std::pow(frame.shift_x_px - pose.shift_x, 2) + std::pow(frame.shift_y_px - pose.shift_y, 2)) /
            2 / std::pow(frame.shift_sigma_px, 2) / 40;
  }
  EXPECT_GT(pull, 0.4);
  EXPECT_LT(pull, 1.8);
}

TEST(Registration, OneLampGivesAShiftAlone) {
  std::mt19937_64 random(3);
  std::vector<double> errors;
  for (int trial = 0; trial < 20; ++trial) {
    Night night = make_night(1, random);
    const Pose pose{3.3, -1.7, 0};
    const RegisteredFrame frame = register_frame(picture(night, pose, {}, random), night.catalogue);
    ASSERT_TRUE(frame.registered);
    EXPECT_EQ(frame.lamps_used, 1);
    EXPECT_EQ(frame.lamps[0].state, LampState::seen);
    EXPECT_NEAR(frame.rotation_rad, 0, 2e-4);
    double x = night.catalogue[0].x_px, y = night.catalogue[0].y_px;
    const auto [tx, ty] = moved(pose, x, y);
    frame.to_frame(x, y, kWidth, kHeight);
    errors.push_back(std::hypot(x - tx, y - ty));
  }
  EXPECT_LT(*std::max_element(errors.begin(), errors.end()), 0.1);
}

TEST(Registration, NoLampIsNoRegistration) {
  std::mt19937_64 random(4);
  const Night night = make_night(3, random);
  const RegisteredFrame frame = register_frame(picture(night, {}, {{0, 1, 2}}, random), night.catalogue);
  EXPECT_FALSE(frame.registered);
  EXPECT_EQ(frame.shift_x_px, 0);
  for (const LampSighting& lamp : frame.lamps) EXPECT_EQ(lamp.state, LampState::off);
  EXPECT_TRUE(frame.strays.empty());
  EXPECT_FALSE(register_frame(RadianceImage{}, night.catalogue).registered);
}

TEST(Registration, ReportsLightsInNoCatalogueWhereTheyAre) {
  std::mt19937_64 random(5);
  Night night = make_night(5, random);
  Night with_stray = night;
  CatalogueLamp stray;
  stray.x_px = 300, stray.y_px = 50;
  with_stray.catalogue.push_back(stray);
  with_stray.electrons_per_s.push_back(5000);
  const Pose pose{1.5, 2, 0};
  const RegisteredFrame frame = register_frame(picture(with_stray, pose, {}, random), night.catalogue);
  ASSERT_EQ(frame.strays.size(), 1U);
  EXPECT_NEAR(frame.strays[0].x_px, 301.5, 0.1);
  EXPECT_NEAR(frame.strays[0].y_px, 52, 0.1);
}

// Thick fog: no core, broad halos of like size over each other. The halo's centre is still the lamp's.
TEST(Registration, HoldsOnToHalosWhereTheCoresAreGone) {
  std::mt19937_64 random(6);
  const Camera camera = scene::camera_12_bit(kWidth, kHeight);
  std::vector<double> errors;
  for (int trial = 0; trial < 20; ++trial) {
    const Night night = make_night(3, random);
    std::normal_distribution<double> normal(0, 1);
    const Pose pose{2 * normal(random), 2 * normal(random), 0};
    Image<double> truth(kWidth, kHeight, 100.0);
    for (const CatalogueLamp& lamp : night.catalogue) {
      const auto [x, y] = moved(pose, lamp.x_px, lamp.y_px);
      scene::add_lamp(truth, {x, y, 2e6, 0.9, 1.0, 10});
    }
    const RegisteredFrame frame =
        register_frame(to_radiance(scene::bracket(truth, camera, {4, 0.5}, random), camera), night.catalogue);
    EXPECT_TRUE(frame.registered);
    errors.push_back(error_px(frame, pose));
  }
  std::sort(errors.begin(), errors.end());
  std::printf("halos alone: median %.3f px, worst %.3f px\n", errors[10], errors[19]);
  EXPECT_LT(errors[10], 0.2);
  EXPECT_LT(errors[19], 0.6);
}

TEST(Registration, RefinesTheCatalogueFromClearFrames) {
  std::mt19937_64 random(7);
  const Night night = make_night(7, random);
  std::normal_distribution<double> normal(0, 1);
  Night rough = night;
  for (CatalogueLamp& lamp : rough.catalogue) {
    lamp.position_sigma_px = 0.7;
    lamp.x_px += 0.6 * normal(random), lamp.y_px += 0.6 * normal(random);
  }
  std::vector<RegisteredFrame> frames;
  for (int i = 0; i < 5; ++i) {
    const Pose pose{2 * normal(random), 2 * normal(random), 0.001 * normal(random)};
    frames.push_back(register_frame(picture(night, pose, {}, random), rough.catalogue));
  }
  const auto refined = refine_catalogue(rough.catalogue, frames, kWidth, kHeight);
  // All may be moved together (the camera's mean pose); against each other they are right.
  double mean_x = 0, mean_y = 0;
  for (size_t i = 0; i < 7; ++i) {
    mean_x += (refined[i].x_px - night.catalogue[i].x_px) / 7;
    mean_y += (refined[i].y_px - night.catalogue[i].y_px) / 7;
  }
  for (size_t i = 0; i < 7; ++i) {
    EXPECT_NEAR(refined[i].x_px - mean_x, night.catalogue[i].x_px, 0.25) << i;
    EXPECT_NEAR(refined[i].y_px - mean_y, night.catalogue[i].y_px, 0.25) << i;
    EXPECT_LT(refined[i].position_sigma_px, 0.6);
    ASSERT_TRUE(refined[i].core_flux.has_value());
    EXPECT_NEAR(*refined[i].core_flux / (0.269 * night.electrons_per_s[i]), 0.98, 0.05);
  }
}

TEST(Registration, LightsOnTheMoveAreToldFromStrays) {
  RegisteredFrame before, now;
  now.shift_x_px = 1;
  const auto at = [](double x) {
    DetectedLight light;
    light.x_px = x, light.y_px = 10;
    return light;
  };
  before.strays = {at(100), at(200)};
  now.strays = {at(101), at(220), at(400)};  // stands, moved by 19 px, is new
  const auto moving = moving_lights(before, now);
  ASSERT_EQ(moving.size(), 1U);
  EXPECT_EQ(moving[0].x_px, 220);
}

}  // namespace
}  // namespace lampglow::photometry
