// Simulates the night that the virtual machine's loopback camera shows: on the host, which is much faster.
#include <gtest/gtest.h>

#include "tests/system/chain/chain.h"

int main(int argc, char** argv) {
  ::testing::InitGoogleTest(&argc, argv);
  const lampglow::testing::fs::path folder = LAMPGLOW_VM_NIGHT;
  if (!lampglow::testing::fs::exists(folder / "png/site.toml")) {
    lampglow::testing::fs::remove_all(folder);
    lampglow::testing::make_night(folder, 2);
  }
  return ::testing::Test::HasFailure() ? 1 : 0;
}
