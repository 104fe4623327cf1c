#include "estimator/quality.h"

#include <gtest/gtest.h>

#include <set>

namespace lampglow {
namespace {

TEST(Quality, RegistryHoldsEveryFlagOnceInTheOrderOfBits) {
  std::set<std::string_view> names;
  int last = -1;
  for (const QualityFlag& entry : quality_registry()) {
    EXPECT_GT(static_cast<int>(entry.flag), last) << entry.name;
    last = static_cast<int>(entry.flag);
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
