// `lampglow simulate`: from options to an archive on disk.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <stop_token>
#include <string>

#include "daemon/simulation/night.h"

namespace lampglow::simulation {

struct SimulationRun {
  std::filesystem::path directory{};  // made if it is not there; must be empty
  std::uint64_t photons = 1'000'000;  // for each q of the night
  int workers = 1;
};

// What is being done, how much of it is done, and of how much.
using Progress = std::function<void(const std::string& stage, int done, int of)>;

// Writes the night's archive. The same options give the same bytes, for any number of workers.
// After a stop the frames that were done, references first, are a whole archive with their truth; while
// photons are still counted, nothing is left in the directory. Returns the number of observations written.
int simulate_night(const NightOptions& options, const SimulationRun& run, const Progress& progress,
                   const std::stop_token& stop = {});

}  // namespace lampglow::simulation
