#include "tests/bench/inference/fit_export.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <iterator>
#include <numeric>
#include <stdexcept>

#include "estimator/inference/halo_models.h"

namespace lampglow::bench {
namespace {

using inference::Scene;
using inference::SceneLamp;

// numpy's own format, version 1.0: a magic, the length of a Python literal, the literal, the numbers.
class Arrays {
 public:
  explicit Arrays(std::filesystem::path folder) : folder_(std::move(folder)) {
    std::filesystem::create_directories(folder_);
  }

  template <typename Values>
  void write(const std::string& name, const std::vector<std::size_t>& shape, const Values& values) const {
    const std::vector<double> numbers(values.begin(), values.end());
    const auto count = std::accumulate(shape.begin(), shape.end(), std::size_t{1}, std::multiplies<>());
    if (numbers.size() != count) throw std::runtime_error(name + ": not of the shape that it should have");
    std::string lengths;
    for (const std::size_t length : shape) lengths += fmt::format("{},", length);
    std::string head = fmt::format("{{'descr': '<f8', 'fortran_order': False, 'shape': ({}), }}", lengths);
    head.resize((head.size() + 10 + 64) / 64 * 64 - 10 - 1, ' ');
    head += '\n';
    std::ofstream file(folder_ / (name + ".npy"), std::ios::binary);
    file << "\x93NUMPY\x01" << '\0' << static_cast<char>(head.size() & 255)
         << static_cast<char>(head.size() >> 8) << head;
    file.write(reinterpret_cast<const char*>(numbers.data()),
               static_cast<std::streamsize>(numbers.size() * sizeof(double)));
    if (!file) throw std::runtime_error("cannot write " + (folder_ / name).string());
  }

 private:
  std::filesystem::path folder_;
};

void write_rings(const FitCall& call, const Night& night, const Arrays& arrays) {
  const Scene& scene = call.scene;
  const std::size_t rings = scene.ring_count(), lamps = scene.lamps().size(), nodes = inference::kSceneNodes;
  std::vector<double> lamp_of, core, x, y, direct, average;
  for (std::size_t r = 0; r < rings; ++r) {
    const photometry::Ring& ring = night.reference().rings->rings[r];
    const inference::SkyPosition position = inference::sky_position(ring, night.site().camera);
    lamp_of.push_back(scene.lamp_of_ring(r));
    core.push_back(ring.theta_low_rad == 0);
    x.push_back(position.x);
    y.push_back(position.y);
    for (std::size_t j = 0; j < lamps; ++j) {
      direct.push_back(scene.direct(r, j));
      for (std::size_t n = 0; n < nodes; ++n) {
        std::vector<double> one(nodes, 0.0);
        one[n] = 1;
        average.push_back(scene.average(r, j, one));
      }
    }
  }
  const auto or_zeros = [&](const std::vector<double>& v) {
    return v.empty() ? std::vector<double>(rings) : v;
  };
  arrays.write("ring_value", {rings}, call.data.value);
  arrays.write("ring_sigma", {rings}, call.data.sigma);
  arrays.write("ring_used", {rings}, call.data.used);
  arrays.write("ring_lamp", {rings}, lamp_of);
  arrays.write("ring_core", {rings}, core);
  arrays.write("ring_x", {rings}, x);
  arrays.write("ring_y", {rings}, y);
  arrays.write("pattern_lens", {rings}, or_zeros(scene.pattern().lens));
  arrays.write("pattern_sky", {rings}, or_zeros(scene.pattern().sky));
  arrays.write("direct", {rings, lamps}, direct);
  arrays.write("average", {rings, lamps, nodes}, average);
  arrays.write("convolution", {nodes, nodes}, scene.convolution());  // [source][target]
  arrays.write("node_theta_rad", {nodes}, inference::scene_nodes_rad());
}

void write_lamps(const FitCall& call, const Night& night, const Arrays& arrays) {
  const std::vector<SceneLamp>& lamps = call.scene.lamps();
  const photometry::AngularScale scale(night.site().camera);
  const auto of_each = [&](const std::string& name, const auto& number) {
    std::vector<double> values;
    std::ranges::transform(lamps, std::back_inserter(values), number);
    arrays.write(name, {lamps.size()}, values);
  };
  of_each("solid_angle_sr", [&](const SceneLamp& l) { return scale.pixel_solid_angle_sr(l.x_px, l.y_px); });
  of_each("distance_m", [](const SceneLamp& l) { return l.distance_m.value_or(1.0); });
  of_each("distance_ln_sigma", [](const SceneLamp& l) { return l.distance_ln_sigma; });
  of_each("ln_strength", [](const SceneLamp& l) { return l.ln_strength; });
  of_each("ln_strength_sigma", [](const SceneLamp& l) { return l.ln_strength_sigma; });
  of_each("ln_halo", [](const SceneLamp& l) { return l.ln_halo; });
  of_each("ln_halo_sigma", [](const SceneLamp& l) { return l.ln_halo_sigma; });
  of_each("core_seen", [](const SceneLamp& l) { return l.core_seen; });
  of_each("guest", [](const SceneLamp& l) { return l.guest(); });
  of_each("ln_beam", [](const SceneLamp& l) { return l.ln_beam.value_or(0.0); });
  of_each("ln_beam_sigma", [](const SceneLamp& l) { return l.ln_beam_sigma; });
  arrays.write("lit", {lamps.size()}, call.data.lit);
}

// ln of the glow at the scene's nodes, even in ln T and in −ln(1 − q).
void write_glow(const inference::HaloModel& halo, std::span<const double> theta, const Arrays& arrays) {
  constexpr std::size_t kThicknesses = 241, kQs = 121;
  std::vector<double> ln_thickness, minus_ln_1_q, ln_glow;
  for (std::size_t i = 0; i < kThicknesses; ++i)
    ln_thickness.push_back(std::lerp(std::log(halo.min_thickness()), std::log(halo.max_thickness()),
                                     static_cast<double>(i) / (kThicknesses - 1)));
  for (std::size_t i = 0; i < kQs; ++i)
    minus_ln_1_q.push_back(-std::log1p(-halo.max_q()) * static_cast<double>(i) / (kQs - 1));
  std::vector<double> value(theta.size()), d_ln_thickness(theta.size()), d_q(theta.size());
  for (const double ln_t : ln_thickness)
    for (const double u : minus_ln_1_q) {
      const double thickness = std::clamp(std::exp(ln_t), halo.min_thickness(), halo.max_thickness());
      halo.profile(thickness, std::clamp(-std::expm1(-u), 0.0, halo.max_q()), theta, value, d_ln_thickness,
                   d_q);
      for (const double v : value) ln_glow.push_back(std::log(v));
    }
  arrays.write("glow_ln_thickness", {kThicknesses}, ln_thickness);
  arrays.write("glow_minus_ln_1_q", {kQs}, minus_ln_1_q);
  arrays.write("glow_ln", {kThicknesses, kQs, theta.size()}, ln_glow);
}

double cost_at_best(const FitCall& call, const inference::HaloModel& halo) {
  inference::RingData data = call.data;
  data.ln_dimming = call.fit->ln_dimming;
  double cost = 0;
  for (const double r :
       inference::residuals_at(call.scene, halo, data, call.options, call.fit->parameters).value)
    cost += r * r / 2;
  return cost;
}

}  // namespace

void export_fit(const FitCall& call, const Night& night, const std::filesystem::path& folder) {
  const Arrays arrays(folder);
  const auto halo = inference::halo_model(night.options().model);
  write_rings(call, night, arrays);
  write_lamps(call, night, arrays);
  write_glow(*halo, inference::scene_nodes_rad(), arrays);
  std::vector<double> profile;
  for (const auto& point : call.fit->posterior) profile.push_back(point.ln_sigma);
  arrays.write("our_profile_ln_sigma", {profile.size()}, profile);
  arrays.write("our_parameters", {call.fit->parameters.size()}, call.fit->parameters);
  const inference::FitOptions& o = call.options;
  const std::vector<std::pair<std::string, double>> numbers{
      {"our_cost", cost_at_best(call, *halo)},
      {"our_ln_sigma_sigma", call.fit->sigma[inference::Layout::ln_sigma]},
      {"sky_unit", call.data.sky_unit},
      {"core_ln_sigma", call.scene.spread().core_ln_sigma},
      {"max_q", halo->max_q()},
      {"ln_gain_sigma", o.ln_gain_sigma},
      {"gain_known", o.gain_known},
      {"q_mean_fog", o.q_mean_fog},
      {"q_mean_haze", o.q_mean_haze},
      {"q_mean_clear", o.q_mean_clear},
      {"q_sigma", o.q_sigma},
      {"q_sigma_clear", o.q_sigma_clear},
      {"kappa_sigma", o.kappa_sigma},
      {"emission_mean", o.emission_mean},
      {"emission_sigma", o.emission_sigma},
      {"slope_sigma", o.slope_sigma},
      {"prior_tail", o.prior_tail},
      {"ring_tail", o.ring_tail},
      {"ln_sigma_low", std::log(kMorTimesExtinction / o.max_mor_m)},
      {"ln_sigma_high", std::log(kMorTimesExtinction / o.min_mor_m)}};
  std::string json;
  for (const auto& [name, number] : numbers)
    json += fmt::format("{}\"{}\": {}", json.empty() ? "{" : ",\n ", name, number);
  std::ofstream(folder / "problem.json") << json << "}\n";
}

}  // namespace lampglow::bench
