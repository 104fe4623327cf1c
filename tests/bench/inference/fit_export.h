// A fit's problem as files that numpy reads: the frame's rings, the scene's matrices, the priors, the glow on
// a fine grid, and what our own fit found.
#pragma once

#include <filesystem>

#include "tests/bench/inference/night.h"

namespace lampglow::bench {

// Writes problem.json (single numbers) and one .npy for each array. Throws std::runtime_error.
void export_fit(const FitCall& call, const Night& night, const std::filesystem::path& folder);

}  // namespace lampglow::bench
