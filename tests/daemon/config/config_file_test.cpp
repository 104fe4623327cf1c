#include "daemon/config/config_file.h"

#include <gmock/gmock.h>

#include "daemon/errors.h"
#include "tests/support/messages.h"

namespace lampglow::daemon {
namespace {

using test::complaint_of;

TEST(ConfigFile, GivesWhatIsThere) {
  ConfigFile file("name = \"x\"\non = true\nlist = [1, 2.5]\n[a]\nn = 3\n[[b]]\nx = 1.5\n[[b]]\nx = 2\n",
                  "c.toml");
  ConfigTable root = file.root();
  EXPECT_EQ(root.text("name"), "x");
  EXPECT_EQ(root.boolean("on"), true);
  EXPECT_EQ(root.numbers("list", 2), (std::vector<double>{1, 2.5}));
  EXPECT_EQ(root.required_table("a").required_integer("n", 1, 5), 3);
  auto tables = root.tables("b");
  ASSERT_EQ(tables.size(), 2U);
  EXPECT_EQ(tables[0].number("x"), 1.5);
  EXPECT_EQ(tables[1].number("x"), 2.0);
  EXPECT_FALSE(root.text("absent"));
  file.finish();
}

TEST(ConfigFile, TellsAllProblemsAtOnceInTheOrderOfTheFile) {
  const auto complaint = complaint_of([] {
    ConfigFile file("mode = \"fats\"\nwidht = 3\n[a]\nn = 9\nx = \"one\"\ny = nan\n", "c.toml");
    ConfigTable root = file.root();
    root.one_of("mode", {"fast", "slow"});
    root.integer("width", 1, 5);
    ConfigTable a = root.required_table("a");
    a.required_integer("n", 1, 5);
    a.number("x", kPositive);
    a.number("y");
    a.required_text("id");
    file.finish();
  });
  EXPECT_EQ(complaint.exit_code, kExitConfig);
  EXPECT_EQ(complaint.text,
            "c.toml:1:8: mode: expected one of \"fast\", \"slow\", got \"fats\"\n"
            "c.toml:2:1: widht: unknown key; did you mean width?\n"
            "c.toml:3:1: a.id: is missing; expected a text in quotes\n"
            "c.toml:4:5: a.n: expected a whole number from 1 to 5, got 9\n"
            "c.toml:5:5: a.x: expected a number above 0, got \"one\"\n"
            "c.toml:6:5: a.y: expected a finite number, got nan");
}

TEST(ConfigFile, NamesTheKnownKeysWhereNoneIsNear) {
  const auto complaint = complaint_of([] {
    ConfigFile file("colour = 1\n[deep]\nx = 1\n", "c.toml");
    ConfigTable root = file.root();
    root.number("width");
    root.number("height");
    file.finish();
  });
  EXPECT_EQ(complaint.text,
            "c.toml:1:1: colour: unknown key; expected one of width, height\n"
            "c.toml:2:2: deep: unknown key; expected one of width, height");
}

TEST(ConfigFile, ATableThatIsNoneIsToldOnce) {
  const auto complaint = complaint_of([] {
    ConfigFile file("a = 1\nb = [1]\n", "c.toml");
    file.root().required_table("a").required_integer("n", 0, 1);
    file.root().tables("b");
    file.finish();
  });
  EXPECT_EQ(complaint.text,
            "c.toml:1:5: a: expected a table [a], got 1\n"
            "c.toml:2:5: b: expected tables [[b]], got a list");
}

TEST(ConfigFile, WhatIsNoTomlIsToldWithItsPlace) {
  const auto complaint = complaint_of([] { ConfigFile("a = 1\nb = = 2\n", "c.toml"); });
  EXPECT_EQ(complaint.exit_code, kExitConfig);
  EXPECT_THAT(complaint.text, testing::StartsWith("c.toml:2:5: "));
}

TEST(ConfigFile, NearestKey) {
  const std::vector<std::string> known{"width_px", "height_px", "bit_depth"};
  EXPECT_EQ(nearest_key("widht_px", known), "width_px");
  EXPECT_EQ(nearest_key("heigth", known), std::nullopt);
  EXPECT_EQ(nearest_key("bitdepth", known), "bit_depth");
}

TEST(ConfigFile, WrittenValuesReadBack) {
  for (const double value : {0.1, 1e-300, 12345678.9, -3.0, 1e22, 100.0}) {
    ConfigFile file("x = " + format_number(value) + "\n", "c.toml");
    EXPECT_EQ(file.root().number("x"), value) << format_number(value);
  }
  for (const char* text :
       {"plain", "with \"quotes\" and \\", "line\nbreak\t", "umlaut \xC3\xBC", "\x7F\x01"}) {
    ConfigFile file("x = " + format_text(text) + "\n", "c.toml");
    EXPECT_EQ(file.root().text("x"), text);
  }
}

}  // namespace
}  // namespace lampglow::daemon
