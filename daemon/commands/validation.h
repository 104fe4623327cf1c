// The lecture's checks of the scattering models, as numbers; `lampglow validate` writes them down.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "estimator/scattering/executor.h"
#include "estimator/scattering/glow_model.h"
#include "estimator/scattering/monte_carlo.h"

namespace lampglow::daemon {

struct ValidationOptions {
  std::uint64_t photons = 3'000'000;  // for each q
  std::uint64_t seed = 1;
  std::uint64_t paths = 4'000;  // for each ring of a camera's view
};

// What photons say about one concentration.
struct PhotonProfile {
  double thickness = 0, q = 0;
  std::vector<double> theta_rad;               // middles of the rings, 0.25° to 12°
  std::vector<scattering::Estimate> radiance;  // all scattered light, optical units per unit flux
};

// Errors are root mean squares of ln(model/photons) over the rings, weighted by the photons' precision and
// with the photons' own noise taken out.
struct ModelError {
  double error = 0;
  double thickness = 0, q = 0, scale = 1;  // at which it was taken
};

// 15 thicknesses from 0.3 to 8 for each of three q.
std::vector<PhotonProfile> count_photons(const ValidationOptions& options,
                                         const scattering::Executor& executor);

// Nearer to 1 the series needs thousands of terms, and gets no better.
inline constexpr double kApsfLeastFitted = 1.05;

// With T and q as they are, the brightness as the model says. Empty where the model has no value.
std::optional<ModelError> error_as_given(scattering::GlowModel model, const PhotonProfile& photons);
// With T, q and the brightness fitted to the photons.
std::optional<ModelError> error_when_fitted(scattering::GlowModel model, const PhotonProfile& photons);

}  // namespace lampglow::daemon
