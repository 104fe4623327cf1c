#include <fmt/format.h>
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <numbers>
#include <numeric>
#include <optional>
#include <string>
#include <vector>

#include "daemon/commands/commands.h"
#include "daemon/commands/threads.h"
#include "daemon/errors.h"
#include "estimator/scattering/glow_model.h"
#include "estimator/scattering/glow_table.h"
#include "estimator/scattering/monte_carlo.h"
#include "estimator/scattering/single_scattering.h"

namespace lampglow::daemon {
namespace {

using scattering::GlowModel;
constexpr double kDegree = std::numbers::pi / 180;
constexpr double kRingInner = 0.97, kRingOuter = 1.03;  // of monte_carlo's rings, over their angle

struct Options {
  double q = 0, thickness = 0, albedo = 1;
  std::string model = "table";
  std::vector<double> theta_deg;
  std::optional<double> medium_radius;  // mean free paths
  std::uint64_t photons = 4'000'000, seed = 1;
  unsigned threads = 0;
};

std::vector<double> radians(const std::vector<double>& degrees) {
  std::vector<double> result;
  result.reserve(degrees.size());
  for (const double degree : degrees) result.push_back(degree * kDegree);
  return result;
}

void print_head(const Options& options) {
  fmt::print("# model {}, q {}, optical thickness {}, albedo {}\n", options.model, options.q,
             options.thickness, options.albedo);
  std::puts("# radiance per unit emitted flux in optical units: times extinction^2 it is W/m2/sr per W");
  std::printf("# direct_irradiance %.9e (exp(-T)/(4 pi T^2), times extinction^2 it is W/m2 per W)\n",
              scattering::direct_irradiance(options.thickness));
}

void print_table(const Options& options) {
  const std::vector<double> theta = radians(options.theta_deg);
  std::vector<double> single(theta.size()), multiple(theta.size());
  scattering::default_glow_table().parts(options.thickness, options.q, options.albedo, theta, single,
                                         multiple);
  std::puts("theta_deg,single,multiple,total");
  for (std::size_t i = 0; i < theta.size(); ++i) {
    // The table's single scattering is within 1e-4 of this; here there is time for the integral itself.
    const double exact =
        scattering::single_scattering(options.thickness, options.q, options.albedo, theta[i]).value;
    std::printf("%.10g,%.9e,%.9e,%.9e\n", options.theta_deg[i], exact, multiple[i], exact + multiple[i]);
  }
}

// Models that do not split the light by its order leave those fields empty.
void print_model(const Options& options, GlowModel model) {
  const std::vector<double> theta = radians(options.theta_deg);
  std::vector<double> total(theta.size()), unused(theta.size());
  scattering::glow_profile(model, options.thickness, options.q, options.albedo, theta, total, unused, unused);
  std::puts("theta_deg,single,multiple,total");
  for (std::size_t i = 0; i < theta.size(); ++i)
    if (model == GlowModel::single)
      std::printf("%.10g,%.9e,0,%.9e\n", options.theta_deg[i], total[i], total[i]);
    else
      std::printf("%.10g,,,%.9e\n", options.theta_deg[i], total[i]);
}

void check_monte_carlo(const Options& options) {
  const auto refuse = [](const char* what, double value, const char* range) {
    throw UsageError(fmt::format("glow: {} = {} is outside monte_carlo's {}", what, value, range));
  };
  if (!(options.thickness >= 0.001 && options.thickness <= 50))
    refuse("optical thickness", options.thickness, "0.001..50");
  if (!(std::abs(options.q) <= 0.98)) refuse("q", options.q, "-0.98..0.98");
  if (!(options.albedo > 0 && options.albedo <= 1)) refuse("albedo", options.albedo, "above 0 to 1");
  for (const double theta : options.theta_deg)
    if (!(theta >= 0.01 && theta <= 170)) refuse("theta [deg]", theta, "0.01..170");
  if (options.medium_radius && !(*options.medium_radius > options.thickness && *options.medium_radius <= 1e4))
    refuse("medium radius", *options.medium_radius, "range, above the optical thickness to 10000");
}

// Angles, by their place in the list, whose rings of ±3 % lie apart: one run counts them all. Those that
// overlap go into further runs.
std::vector<std::vector<std::size_t>> runs_of_apart_rings(const std::vector<double>& theta_deg) {
  std::vector<std::size_t> order(theta_deg.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return theta_deg[a] < theta_deg[b]; });
  std::vector<std::vector<std::size_t>> runs;
  for (const std::size_t i : order) {
    const auto apart = std::find_if(runs.begin(), runs.end(), [&](const std::vector<std::size_t>& run) {
      return theta_deg[run.back()] * kRingOuter < theta_deg[i] * kRingInner;
    });
    if (apart == runs.end())
      runs.push_back({i});
    else
      apart->push_back(i);
  }
  return runs;
}

void print_monte_carlo(const Options& options) {
  std::vector<std::string> values(options.theta_deg.size()), errors(options.theta_deg.size());
  std::uint64_t photons = 0;
  for (const std::vector<std::size_t>& rings : runs_of_apart_rings(options.theta_deg)) {
    scattering::GlowPhotons run;
    run.q = options.q;
    run.albedos = {options.albedo};
    run.thicknesses = {options.thickness};
    for (const std::size_t i : rings)
      for (const double edge : {kRingInner, kRingOuter})
        run.theta_edges_rad.push_back(options.theta_deg[i] * edge * kDegree);
    run.photons = options.photons;
    run.seed = options.seed;
    run.black_radius = options.medium_radius;
    const auto glow = scattering::simulate_glow(run, threads(options.threads));
    photons = glow.photons();
    for (std::size_t k = 0; k < rings.size(); ++k) {
      const auto single = glow.single(0, 0, 2 * k), multiple = glow.multiple(0, 0, 2 * k),
                 total = glow.total(0, 0, 2 * k);
      const double theta_deg = options.theta_deg[rings[k]];
      values[rings[k]] =
          fmt::format("{:.10g},{:.9e},{:.9e},{:.9e}", theta_deg, single.value, multiple.value, total.value);
      errors[rings[k]] =
          fmt::format("# theta_deg {}: standard deviation of single {:.2e}, multiple {:.2e}, total {:.2e}",
                      theta_deg, single.sigma, multiple.sigma, total.sigma);
    }
  }
  std::puts("theta_deg,single,multiple,total");
  for (const std::string& line : values) std::puts(line.c_str());
  for (const std::string& line : errors) std::puts(line.c_str());
  std::printf("# %llu photons, seed %llu; each value is the mean over a ring of +-3 %%\n",
              static_cast<unsigned long long>(photons), static_cast<unsigned long long>(options.seed));
  if (options.medium_radius)
    std::printf("# in a ball of fog of %.10g mean free paths, nothing beyond it\n", *options.medium_radius);
}

void run(const Options& options) {
  if (options.model == "monte_carlo") {
    check_monte_carlo(options);
    print_head(options);
    print_monte_carlo(options);
    return;
  }
  if (options.medium_radius)
    throw UsageError(
        "glow: --medium-radius is for --model monte_carlo; the other models' medium is infinite");
  const GlowModel model = *scattering::parse_glow_model(options.model);
  const std::string outside = scattering::outside_glow_model(model, options.thickness, options.q,
                                                             options.albedo, radians(options.theta_deg));
  if (!outside.empty()) throw UsageError("glow: " + outside + "; nothing is extrapolated");
  print_head(options);
  if (model == GlowModel::table)
    print_table(options);
  else
    print_model(options, model);
}

}  // namespace

void add_glow(CLI::App& program) {
  auto options = std::make_shared<Options>();
  CLI::App* command =
      program.add_subcommand("glow", "Print the glow of a lamp in fog, by any of the scattering models");
  command->add_option("--q", options->q, "Henyey-Greenstein asymmetry")->required();
  command->add_option("--thickness", options->thickness, "Optical thickness T between lamp and camera")
      ->required();
  command->add_option("--albedo", options->albedo, "Single scattering albedo")->capture_default_str();
  command->add_option("--model", options->model, "Scattering model")
      ->check(CLI::IsMember({"table", "apsf_series", "single", "diffusion", "monte_carlo"}))
      ->capture_default_str();
  command->add_option("--theta-deg", options->theta_deg, "Angles from the lamp, separated by commas")
      ->delimiter(',')
      ->required();
  command->add_option("--photons", options->photons, "monte_carlo: photons to count")
      ->check(CLI::Range(std::uint64_t{64}, std::uint64_t{1'000'000'000'000}))
      ->capture_default_str();
  command->add_option(
      "--medium-radius", options->medium_radius,
      "monte_carlo: photons are lost this many mean free paths from the lamp; infinite by default");
  command->add_option("--seed", options->seed, "monte_carlo: seed")->capture_default_str();
  command->add_option("--threads", options->threads, "monte_carlo: threads; 0 for one per core")
      ->capture_default_str();
  command->footer(
      "Prints CSV: radiance per unit emitted flux in optical units (times extinction squared it is W/m2/sr "
      "per W);\n"
      "the direct beam's irradiance stands in a comment. Fields a model does not know are empty.\n"
      "Example:\n  lampglow glow --q 0.85 --thickness 2 --theta-deg 0.2,1,5,20");
  command->callback([options] { run(*options); });
}

}  // namespace lampglow::daemon
