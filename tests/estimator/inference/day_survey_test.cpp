#include <gtest/gtest.h>

#include <random>

#include "estimator/photometry/targets.h"

namespace lampglow::photometry {
namespace {

// A bright sky down to row 100, dark textured woods to row 130, a smooth field below.
RadianceImage landscape(std::uint64_t seed, bool with_skyline = true) {
  std::mt19937_64 random(seed), woods(1);  // the woods stay, the noise does not
  std::normal_distribution<float> normal;
  RadianceImage image;
  image.radiance = Image<float>(320, 200, 1000.0F);
  image.variance = Image<float>(320, 200, 25.0F);
  image.mask = Image<std::uint8_t>(320, 200);
  for (int y = 0; y < 200; ++y)
    for (int x = 0; x < 320; ++x) {
      float& value = image.radiance.at(x, y);
      if (with_skyline && y >= 100) value = y < 130 ? 80.0F + 30.0F * normal(woods) : 300.0F;
      value += 5.0F * normal(random);
    }
  return image;
}

TEST(SurveyDay, FindsTheSkylineTheSkyAndTheWoods) {
  const std::vector<RadianceImage> frames{landscape(1), landscape(2), landscape(3)};
  const DaySurvey survey = survey_day(frames);
  for (const int row : survey.skyline_px) EXPECT_NEAR(row, 100, 4);
  EXPECT_LE(survey.day.sky_y_px + survey.day.sky_height_px, 100);
  EXPECT_GE(survey.day.sky_height_px, 8);
  ASSERT_GE(survey.targets.size(), 16U);
  for (size_t i = 0; i < survey.targets.size(); ++i) {
    const Target& target = survey.targets[i];
    EXPECT_GT(target.y_px + target.height_px, 100) << target.id << " lies in the sky";
    EXPECT_LE(target.y_px, 131) << target.id << " lies in the smooth field";
    EXPECT_EQ(survey.skyline[i], target.y_px < 104 && target.y_px + target.height_px > 104) << target.id;
  }
}

TEST(SurveyDay, NoSkylineNoTargets) {
  const std::vector<RadianceImage> frames{landscape(1, false)};
  EXPECT_TRUE(survey_day(frames).targets.empty());
  EXPECT_TRUE(survey_day({}).targets.empty());
}

}  // namespace
}  // namespace lampglow::photometry
