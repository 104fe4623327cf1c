// `lampglow survey` and `lampglow calibrate-response`, run as people run them.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cmath>
#include <cstdlib>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string>

#include "daemon/config/site_file.h"
#include "estimator/photometry/response.h"
#include "tests/estimator/photometry/scene.h"
#include "tests/support/temporary_folder.h"

namespace lampglow {
namespace {

namespace scene = photometry::scene;
using ::testing::HasSubstr;

struct Outcome {
  int exit_code = -1;
  std::string output;  // both streams
};

Outcome run(const std::string& arguments) {
  const test::TemporaryFolder folder;
  const std::string log = (folder.path() / "log").string();
  const int status =
      std::system((std::string(LAMPGLOW_BINARY) + " " + arguments + " > " + log + " 2>&1").c_str());
  return {WEXITSTATUS(status), test::read_all(log)};
}

void write_png(const std::filesystem::path& path, const Exposure& exposure, int type) {
  cv::Mat picture(exposure.pixels.height_px, exposure.pixels.width_px, type);
  for (int y = 0; y < picture.rows; ++y)
    for (int x = 0; x < picture.cols; ++x) {
      if (type == CV_8U) picture.at<std::uint8_t>(y, x) = static_cast<std::uint8_t>(exposure.pixels.at(x, y));
      if (type == CV_16U) picture.at<std::uint16_t>(y, x) = exposure.pixels.at(x, y);
    }
  ASSERT_TRUE(cv::imwrite(path.string(), picture));
}

constexpr const char* kSite =
    "[site]\nname = \"x\"\n\n[camera]\nwidth_px = 240\nheight_px = 160\nbit_depth = 12\nblack_level_dn = 64\n"
    "saturation_dn = 4095\nresponse = \"linear\"\n";

TEST(SurveyCommand, WritesLightsThatTheSiteFileTakes) {
  const test::TemporaryFolder folder;
  std::mt19937_64 random(1);
  std::string files;
  for (int f = 0; f < 3; ++f) {
    Image<double> truth(240, 160, 40.0);
    for (int i = 0; i < 4; ++i) scene::add_lamp(truth, {40.3 + 50 * i, 60.7 + 10 * i, 9000.0 * (4 - i)});
    scene::add_lamp(truth, {30.0 + 60 * f, 130, 30000, 1.2});  // a car
    const std::string file = (folder.path() / (std::to_string(f) + ".png")).string();
    write_png(file, scene::expose(truth, scene::camera_12_bit(240, 160), 1, 0.269, 0.8, random), CV_16U);
    files += file + " ";
  }
  const auto site = folder.write("site.toml", kSite);
  const auto out = folder.path() / "lights.toml", picture = folder.path() / "lights.png";
  const Outcome result = run("survey " + files + "--camera " + site.string() + " --out " + out.string() +
                             " --annotated " + picture.string());
  ASSERT_EQ(result.exit_code, 0) << result.output;

  const Site read = daemon::read_site_file(folder.write("all.toml", kSite + test::read_all(out)));
  ASSERT_EQ(read.lights.size(), 4U) << test::read_all(out);
  for (size_t i = 0; i < 4; ++i) {
    EXPECT_EQ(read.lights[i].id, "L" + std::to_string(i + 1));
    EXPECT_NEAR(read.lights[i].x_px, 40.3 + 50 * static_cast<double>(i), 0.1);
    EXPECT_NEAR(read.lights[i].y_px, 60.7 + 10 * static_cast<double>(i), 0.1);
    EXPECT_FALSE(read.lights[i].distance_m.has_value());
  }
  const cv::Mat annotated = cv::imread(picture.string(), cv::IMREAD_COLOR);
  EXPECT_EQ(annotated.cols, 480);
  EXPECT_EQ(annotated.rows, 320);
  EXPECT_NE(cv::countNonZero(annotated.reshape(1) > 0), 0);
}

// A bright sky down to row 70, dark woods to row 110, a smooth field below.
TEST(SurveyCommand, ByDayItWritesTargetsThatTheSiteFileTakesAndMarksThem) {
  const test::TemporaryFolder folder;
  std::mt19937_64 random(5), woods(1);
  std::normal_distribution<double> normal;
  Image<double> truth(240, 160, 10000.0);
  for (int y = 70; y < 160; ++y)
    for (int x = 0; x < 240; ++x) truth.at(x, y) = y < 110 ? 900 * std::exp(0.4 * normal(woods)) : 3000;
  const auto file = folder.path() / "day.png", out = folder.path() / "targets.toml",
             picture = folder.path() / "targets.png";
  write_png(file, scene::expose(truth, scene::camera_12_bit(240, 160), 1, 0.269, 0.8, random), CV_16U);
  const Outcome result =
      run("survey --day " + file.string() + " --camera " + folder.write("site.toml", kSite).string() +
          " --out " + out.string() + " --annotated " + picture.string());
  ASSERT_EQ(result.exit_code, 0) << result.output;
  const Site read = daemon::read_site_file(folder.write("all.toml", kSite + test::read_all(out)));
  ASSERT_GE(read.targets.size(), 16U) << test::read_all(out);
  const cv::Mat annotated = cv::imread(picture.string(), cv::IMREAD_COLOR);
  ASSERT_EQ(annotated.cols, 480);
  // The left edge of a target's box has the targets' colour; the grey picture has none.
  const Target& target = read.targets.front();
  int coloured = 0;
  for (int y = static_cast<int>(2 * target.y_px); y < static_cast<int>(2 * (target.y_px + target.height_px));
       ++y) {
    const auto pixel = annotated.at<cv::Vec3b>(y, static_cast<int>(2 * target.x_px));
    coloured += pixel[0] > pixel[2] + 60;
  }
  EXPECT_GT(coloured, target.height_px);
}

TEST(SurveyCommand, ComplainsInWords) {
  const test::TemporaryFolder folder;
  std::mt19937_64 random(2);
  const auto file = folder.path() / "dark.png";
  write_png(file,
            scene::expose(Image<double>(100, 80, 30.0), scene::camera_12_bit(100, 80), 1, 0.269, 0.8, random),
            CV_16U);
  const Outcome nothing = run("survey " + file.string());
  EXPECT_EQ(nothing.exit_code, 65);
  EXPECT_THAT(nothing.output, HasSubstr("no lamp found"));
  EXPECT_EQ(run("survey /nowhere.png").exit_code, 64);
  const Outcome wrong_size =
      run("survey " + file.string() + " --camera " + folder.write("site.toml", kSite).string());
  EXPECT_EQ(wrong_size.exit_code, 65);
  EXPECT_THAT(wrong_size.output, HasSubstr("100x80 pixels, expected 240x160"));
}

TEST(CalibrateResponseCommand, WritesACurveThatTheSiteFileTakes) {
  const test::TemporaryFolder folder;
  std::mt19937_64 random(3);
  Image<double> truth(240, 160);
  for (int y = 0; y < 160; ++y)
    for (int x = 0; x < 240; ++x) truth.at(x, y) = 40 + 5e4 * std::exp(-std::hypot(x - 60, y - 80) / 18.0);
  std::string inputs;
  for (const char* time : {"1/16", "1/8", "1/4", "0.5", "1", "2"}) {
    const std::string file = (folder.path() / (std::to_string(inputs.size()) + ".png")).string();
    const std::string text = time;
    const double seconds = text[1] == '/' ? 1 / std::stod(text.substr(2)) : std::stod(text);
    write_png(file, scene::expose(truth, scene::camera_8_bit_srgb(240, 160), seconds, 0.01, 0.1, random),
              CV_8U);
    inputs += file + "@" + time + " ";
  }
  const auto curve = folder.path() / "curve.csv";
  const Outcome result = run("calibrate-response " + inputs + "--out " + curve.string());
  ASSERT_EQ(result.exit_code, 0) << result.output;
  const std::vector<double> read = daemon::read_response_curve(curve, 8);
  ASSERT_EQ(read.size(), 256U);
  EXPECT_NEAR(read[200] / read[100] /
                  (photometry::srgb_to_linear(200 / 255.0) / photometry::srgb_to_linear(100 / 255.0)),
              1, 0.06);
}

TEST(CalibrateResponseCommand, ComplainsInWords) {
  const Outcome no_time = run("calibrate-response a.png b.png");
  EXPECT_EQ(no_time.exit_code, 64);
  EXPECT_THAT(no_time.output, HasSubstr("FILE@SECONDS"));
  EXPECT_EQ(run("calibrate-response a.png@zero").exit_code, 64);
}

}  // namespace
}  // namespace lampglow
