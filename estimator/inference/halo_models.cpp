#include "estimator/inference/halo_models.h"

#include <vector>

#include "estimator/scattering/glow_model.h"
#include "estimator/scattering/glow_table.h"

namespace lampglow::inference {
namespace {

constexpr std::string_view kNames[] = {"table", "apsf_series", "single", "diffusion"};
constexpr double kFogAlbedo = 1.0;  // droplets do not absorb visible light

struct Domain {
  double min_thickness, max_thickness, max_q;
};

// Within what glow_model.h says of each model, and where the fit has any use for it.
constexpr Domain kDomains[] = {{0.01, 15, 0.965}, {1.01, 15, 0.98}, {0.001, 15, 0.965}, {0.001, 15, 0.965}};

class Scattering : public HaloModel {
 public:
  explicit Scattering(HaloKind kind)
      : model_(static_cast<scattering::GlowModel>(kind)), domain_(kDomains[static_cast<size_t>(kind)]) {}
  void profile(double thickness, double q, std::span<const double> theta_rad, std::span<double> value,
               std::span<double> d_ln_thickness, std::span<double> d_q) const override {
    std::vector<double> unwanted;  // these models always give them
    if (d_q.empty()) {
      unwanted.resize(2 * theta_rad.size());
      d_ln_thickness = std::span(unwanted).first(theta_rad.size());
      d_q = std::span(unwanted).last(theta_rad.size());
    }
    scattering::glow_profile(model_, thickness, q, kFogAlbedo, theta_rad, value, d_ln_thickness, d_q);
  }
  double min_thickness() const override { return domain_.min_thickness; }
  double max_thickness() const override { return domain_.max_thickness; }
  double max_q() const override { return domain_.max_q; }

 private:
  scattering::GlowModel model_;
  Domain domain_;
};

// A fit asks for the scene's own angles alone: there the table is summed up beforehand.
class TableHalo final : public Scattering {
 public:
  TableHalo() : Scattering(HaloKind::table) {}
  void profile(double thickness, double q, std::span<const double> theta_rad, std::span<double> value,
               std::span<double> d_ln_thickness, std::span<double> d_q) const override {
    if (theta_rad.data() == scene_nodes_rad().data())
      at_nodes_.profile(thickness, q, value, d_ln_thickness, d_q);
    else
      Scattering::profile(thickness, q, theta_rad, value, d_ln_thickness, d_q);
  }

 private:
  scattering::GlowAtAngles at_nodes_{scattering::default_glow_table(), kFogAlbedo, scene_nodes_rad()};
};

static_assert(static_cast<int>(scattering::GlowModel::table) == static_cast<int>(HaloKind::table));
static_assert(static_cast<int>(scattering::GlowModel::apsf_series) ==
              static_cast<int>(HaloKind::apsf_series));
static_assert(static_cast<int>(scattering::GlowModel::single) == static_cast<int>(HaloKind::single));
static_assert(static_cast<int>(scattering::GlowModel::diffusion) == static_cast<int>(HaloKind::diffusion));

}  // namespace

std::string_view to_string(HaloKind kind) {
  return kNames[static_cast<size_t>(kind)];
}

std::optional<HaloKind> parse_halo_kind(std::string_view text) {
  for (size_t i = 0; i < std::size(kNames); ++i)
    if (text == kNames[i]) return static_cast<HaloKind>(i);
  return std::nullopt;
}

std::shared_ptr<const HaloModel> halo_model(HaloKind kind) {
  static const std::shared_ptr<const HaloModel> kModels[] = {
      std::make_shared<const TableHalo>(), std::make_shared<const Scattering>(HaloKind::apsf_series),
      std::make_shared<const Scattering>(HaloKind::single),
      std::make_shared<const Scattering>(HaloKind::diffusion)};
  return kModels[static_cast<size_t>(kind)];
}

}  // namespace lampglow::inference
