// Builds the glow table from the transfer equation's solution. Deterministic: the same bytes for any
// executor.
#pragma once

#include <cstddef>
#include <functional>
#include <vector>

#include "estimator/scattering/executor.h"
#include "estimator/scattering/glow_table_file.h"

namespace lampglow::scattering {

// Nodes within the domain (issue: T 0.01..15, q 0..0.97, ω0 0.8..1, θ 0.01°..90°).
struct GlowTableOptions {
  std::size_t albedo_nodes = 9;
  std::size_t q_nodes = 21;
  std::size_t thickness_nodes = 50;
  std::size_t theta_nodes = 47;
};

// `progress` is called after each of `total` solutions, from the executor's threads.
std::vector<std::byte> build_glow_table(const GlowTableOptions& options,
                                        const Executor& executor = run_serially,
                                        const std::function<void(std::size_t total)>& progress = {});

}  // namespace lampglow::scattering
