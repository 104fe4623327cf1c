#include "daemon/config/site_file.h"

#include <gmock/gmock.h>

#include <cmath>

#include "tests/support/messages.h"
#include "tests/support/temporary_folder.h"

namespace lampglow::daemon {
namespace {

using test::complaint_of;
using test::TemporaryFolder;

constexpr std::string_view kExample = R"([site]
name = "harbour"
latitude_deg = 52.1
longitude_deg = 5.18
elevation_m = 10.0

[camera]
width_px = 760
height_px = 504
focal_length_px = 1044.0            # pinhole; may be missing
principal_point_px = [380.5, 252.0]
bit_depth = 12
black_level_dn = 64.0
saturation_dn = 4095.0
response = "linear"                 # or "srgb", or a file with a measured curve
read_noise_dn = 0.8                 # optional
gain_dn_per_electron = 0.269        # optional

[[light]]
id = "L1"
x_px = 96.3
y_px = 214.7
distance_m = 60.0

[[light]]
id = "L2"
x_px = 9
y_px = 21

[[target]]
id = "treeline"
box_px = [440, 285, 120, 70]
distance_m = 450.0
)";

Site parse(std::string_view text) {
  return parse_site(text, "site.toml", "/nowhere");
}

std::string complaint(std::string_view text) {
  return complaint_of([&] { parse(text); }).text;
}

// The example with one piece replaced.
std::string changed(std::string_view from, std::string_view to) {
  std::string text(kExample);
  const auto at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
}

TEST(SiteFile, ReadsTheFormatsExample) {
  const Site site = parse(kExample);
  EXPECT_EQ(site.name, "harbour");
  EXPECT_EQ(site.latitude_deg, 52.1);
  EXPECT_EQ(site.camera.width_px, 760);
  EXPECT_EQ(site.camera.focal_length_px, 1044.0);
  EXPECT_EQ(site.camera.principal_x_px, 380.5);
  EXPECT_EQ(site.camera.bit_depth, 12);
  EXPECT_EQ(site.camera.response.kind, Response::Kind::linear);
  EXPECT_EQ(site.camera.gain_dn_per_electron, 0.269);
  ASSERT_EQ(site.lights.size(), 2U);
  EXPECT_EQ(site.lights[0].distance_m, 60.0);
  EXPECT_FALSE(site.lights[1].distance_m) << "unknown is empty, never 0";
  ASSERT_EQ(site.targets.size(), 1U);
  EXPECT_EQ(site.targets[0].width_px, 120);
}

TEST(SiteFile, PrincipalPointIsTheMiddleUnlessGiven) {
  const Site site = parse(changed("principal_point_px = [380.5, 252.0]", ""));
  EXPECT_EQ(site.camera.principal_x_px, 380);
  EXPECT_EQ(site.camera.principal_y_px, 252);
}

TEST(SiteFile, EveryMissingFieldIsTold) {
  EXPECT_EQ(complaint("[camera]\n"),
            "site.toml:1:1: site: is missing; expected a table [site]\n"
            "site.toml:1:1: camera.width_px: is missing; expected a whole number from 1 to 32767\n"
            "site.toml:1:1: camera.height_px: is missing; expected a whole number from 1 to 32767\n"
            "site.toml:1:1: camera.bit_depth: is missing; expected a whole number from 8 to 16\n"
            "site.toml:1:1: camera.black_level_dn: is missing; expected a number from 0 to 65535\n"
            "site.toml:1:1: camera.saturation_dn: is missing; expected a number from 1 to 65535\n"
            "site.toml:1:1: camera.response: is missing; expected a text in quotes");
}

TEST(SiteFile, SeveralMistakesAreToldAtOnce) {
  std::string text = changed("focal_length_px", "focal_lenght_px");
  text.replace(text.find("52.1"), 4, "98.0");
  text.replace(text.find("distance_m = 60.0"), 17, "distance_m = -60.0");
  EXPECT_EQ(complaint(text),
            "site.toml:3:16: site.latitude_deg: expected a number from -90 to 90, got 98.0\n"
            "site.toml:10:1: camera.focal_lenght_px: unknown key; did you mean focal_length_px?\n"
            "site.toml:23:14: light[1].distance_m: expected a number above 0, got -60.0");
}

TEST(SiteFile, RefusesWhatCannotBe) {
  EXPECT_EQ(complaint(changed("id = \"L2\"", "id = \"L1\"")),
            "site.toml:26:6: light[2].id: expected an id of its own, \"L1\" stands twice");
  EXPECT_EQ(
      complaint(changed("id = \"L2\"", "id = \"no spaces\"")),
      "site.toml:26:6: light[2].id: expected 1 to 64 letters, digits, '_', '.' or '-', got \"no spaces\"");
  EXPECT_EQ(complaint(changed("x_px = 96.3", "x_px = 960.3")),
            "site.toml:21:8: light[1].x_px: expected a number from 0 to 760, got 960.3");
  EXPECT_EQ(
      complaint(changed("[440, 285, 120, 70]", "[700, 285, 120, 70]")),
      "site.toml:32:10: target[1].box_px: expected x, y, width, height of a box within the picture, at least "
      "1 px wide and high");
  EXPECT_EQ(complaint(changed("black_level_dn = 64.0", "black_level_dn = 4095.0")),
            "site.toml:13:18: camera.black_level_dn: expected a number below saturation_dn");
  EXPECT_EQ(complaint(changed("bit_depth = 12", "bit_depth = 12.0")),
            "site.toml:12:13: camera.bit_depth: expected a whole number from 8 to 16, got 12.0");
  EXPECT_EQ(complaint(changed("saturation_dn = 4095.0", "saturation_dn = 65535.0")),
            "site.toml:14:17: camera.saturation_dn: expected a number from 1 to 4095, got 65535.0");
  EXPECT_EQ(complaint(changed("width_px = 760", "width_px = 100000")),
            "site.toml:8:12: camera.width_px: expected a whole number from 1 to 32767, got 100000");
}

TEST(SiteFile, ManyLightsAreReadAndTooManyAreTold) {
  std::string text(kExample);
  for (int i = 3; i <= 800; ++i)
    text += "[[light]]\nid = \"L" + std::to_string(i) + "\"\nx_px = 9\ny_px = 21\n";
  EXPECT_EQ(parse(text).lights.size(), 800U);
  EXPECT_THAT(complaint(text + "[[light]]\nid = \"L801\"\nx_px = 9\ny_px = 21\n"),
              testing::EndsWith("light[801].id: is one too many; expected at most 800 lights"));
}

TEST(SiteFile, ResponseFileMayNotLeaveTheFolder) {
  for (const char* path : {"../curve.csv", "/etc/passwd", "a/../../b"})
    EXPECT_EQ(complaint(changed("response = \"linear\"", "response = \"" + std::string(path) + "\"")),
              "site.toml:15:12: camera.response: expected \"linear\", \"srgb\" or a CSV file within the site "
              "file's "
              "folder, got \"" +
                  std::string(path) + "\"");
}

TEST(SiteFile, VignettingIsReadWrittenAndChecked) {
  const auto with = [](const std::string& value) {
    return changed("response = \"linear\"", "vignetting = " + value + "\nresponse = \"linear\"");
  };
  const Site site = parse(with("[-0.3, 0.05]"));
  EXPECT_EQ(site.camera.vignetting, (std::vector<double>{-0.3, 0.05}));
  EXPECT_EQ(parse(format_site(site, "")).camera.vignetting, site.camera.vignetting);
  EXPECT_TRUE(parse(kExample).camera.vignetting.empty()) << "it may be missing";
  EXPECT_THAT(complaint(with("[]")), testing::HasSubstr("camera.vignetting: expected 1 to 4 numbers, got 0"));
  EXPECT_THAT(complaint(with("[-1.2]")),
              testing::HasSubstr("camera.vignetting: expected a transmission of 0.05 to 2"));
  EXPECT_THAT(complaint(with("\"edge.png\"")), testing::HasSubstr("camera.vignetting"));
}

TEST(SiteFile, WhatIsWrittenReadsBack) {
  const TemporaryFolder folder;
  Site site = parse(kExample);
  site.name = "quote \" and back\\slash";
  site.lights[0].distance_sigma_m = 3.25;
  site.camera.bit_depth = 8;
  site.camera.saturation_dn = 255;
  site.camera.response.kind = Response::Kind::curve;
  for (int dn = 0; dn < 256; ++dn) site.camera.response.curve.push_back(std::pow(dn / 255.0, 2.2));
  write_site_file(folder.path() / "site.toml", site);
  const Site back = read_site_file(folder.path() / "site.toml");
  EXPECT_EQ(format_site(back), format_site(site));
  EXPECT_EQ(back.name, site.name);
  EXPECT_EQ(back.lights[0].distance_sigma_m, 3.25);
  EXPECT_FALSE(back.lights[1].distance_m);
  EXPECT_EQ(back.targets[0].y_px, 285);
  EXPECT_EQ(back.camera.response.curve, site.camera.response.curve) << "to the last bit";
}

TEST(SiteFile, WhatCalibrateLearnedReadsBack) {
  Site site = parse(kExample);
  Target& target = site.targets[0];
  target.distance_sigma_m = 31.5;
  target.brightness_ratio = 0.0625;
  target.brightness_ratio_sigma = 0.015625;
  target.contrast = TargetContrast{-3.5, 0.25, -2.125, {0.375, -0.5}};
  site.day = DayCalibration{4, 60, 700, 90, 0.3125, 6.5, true};
  site.night = PatchCalibration{32,    true, true,         -5.5,        0.4375,
                                -8.25, -4.5, {1.5, -2.25}, {0.5, 0.75}, {0.0625, -0.125}};
  const Site back = parse(format_site(site));
  ASSERT_TRUE(back.targets[0].contrast && back.day && back.night);
  EXPECT_EQ(back.targets[0].distance_sigma_m, 31.5);
  EXPECT_EQ(back.targets[0].brightness_ratio, 0.0625);
  EXPECT_EQ(back.targets[0].brightness_ratio_sigma, 0.015625);
  const TargetContrast& contrast = *back.targets[0].contrast;
  EXPECT_EQ(contrast.log_contrast, -3.5);
  EXPECT_EQ(contrast.log_contrast_sigma, 0.25);
  EXPECT_EQ(contrast.log_floor, -2.125);
  EXPECT_EQ(contrast.lighting, (std::array<double, 2>{0.375, -0.5}));
  EXPECT_EQ(back.day->sky_x_px, 4);
  EXPECT_EQ(back.day->sky_y_px, 60);
  EXPECT_EQ(back.day->sky_width_px, 700);
  EXPECT_EQ(back.day->sky_height_px, 90);
  EXPECT_EQ(back.day->log_extinction_sigma, 0.3125);
  EXPECT_EQ(back.day->independent_targets, 6.5);
  EXPECT_TRUE(back.day->colour);
  EXPECT_EQ(back.night->patch_px, 32);
  EXPECT_TRUE(back.night->texture && back.night->colour && !back.day_patches);
  EXPECT_EQ(back.night->log_extinction_mean, -5.5);
  EXPECT_EQ(back.night->log_extinction_sigma, 0.4375);
  EXPECT_EQ(back.night->log_extinction_low, -8.25);
  EXPECT_EQ(back.night->log_extinction_high, -4.5);
  EXPECT_EQ(back.night->mean, site.night->mean);
  EXPECT_EQ(back.night->scale, site.night->scale);
  EXPECT_EQ(back.night->weight, site.night->weight);
}

TEST(SiteFile, ACurveThatIsNoneIsToldWithItsPlace) {
  const TemporaryFolder folder;
  std::string curve = "dn,relative_radiance\n";
  for (int dn = 0; dn < 256; ++dn)
    curve += std::to_string(dn) + "," + std::to_string(dn == 7 ? 1 : dn) + "\n";
  folder.write("curve.csv", curve);
  std::string text = changed("response = \"linear\"", "response = \"curve.csv\"");
  text.replace(text.find("bit_depth = 12"), 14, "bit_depth = 8 ");
  text.replace(text.find("4095.0"), 6, "255.0 ");
  const auto found = complaint_of([&] { parse_site(text, "site.toml", folder.path()); });
  EXPECT_EQ(
      found.text,
      "site.toml:15:12: camera.response: expected \"linear\", \"srgb\" or a file with a measured curve; " +
          (folder.path() / "curve.csv").string() +
          ":9:3: relative_radiance: expected a number of at least 0 that is not below the row before, got "
          "\"1\"");
}

TEST(SiteFile, AFileThatIsNotThereIsAnIoError) {
  const auto found = complaint_of([] { read_site_file("/nowhere/site.toml"); });
  EXPECT_EQ(found.exit_code, daemon::kExitIo);
  EXPECT_EQ(found.text, "/nowhere/site.toml: cannot be opened: No such file or directory");
}

}  // namespace
}  // namespace lampglow::daemon
