#include "estimator/quality.h"

#include <gtest/gtest.h>

#include <set>

namespace lampglow {
namespace {

TEST(Quality, RegistryHoldsEveryFlagOnceInTheOrderOfBits) {
  std::set<std::string_view> names;
  unsigned expected = 0;
  for (const QualityFlag& entry : quality_registry()) {
    EXPECT_EQ(static_cast<unsigned>(entry.flag), expected++) << entry.name;
    EXPECT_TRUE(names.insert(entry.name).second) << entry.name << " stands twice";
    EXPECT_FALSE(entry.meaning.empty()) << entry.name;
  }
}

TEST(Quality, TextIsInTheOrderOfTheRegistry) {
  QualityFlags flags;
  EXPECT_EQ(flags.to_string(), "");
  flags.set(Quality::no_reference);
  flags.set(Quality::daylight);
  EXPECT_EQ(flags.to_string(), "daylight;no_reference");
}

}  // namespace
}  // namespace lampglow
