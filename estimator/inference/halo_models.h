// The scattering models as the fit takes them. The default is the one that measures best: the glow table.
#pragma once

#include <memory>
#include <optional>
#include <string_view>

#include "estimator/inference/scene.h"

namespace lampglow::inference {

enum class HaloKind { table, apsf_series, single, diffusion };

std::string_view to_string(HaloKind kind);
std::optional<HaloKind> parse_halo_kind(std::string_view text);  // "table" and so on

// Shared and immutable; made once.
std::shared_ptr<const HaloModel> halo_model(HaloKind kind);

}  // namespace lampglow::inference
