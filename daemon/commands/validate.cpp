#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <memory>
#include <numbers>
#include <string>
#include <vector>

#include "daemon/commands/commands.h"
#include "daemon/commands/svg_plot.h"
#include "daemon/commands/threads.h"
#include "daemon/commands/validation.h"
#include "daemon/commands/validation_scene.h"
#include "daemon/config/pending_file.h"
#include "estimator/scattering/camera_monte_carlo.h"

namespace lampglow::daemon {
namespace {

using scattering::GlowModel;
constexpr double kDegree = std::numbers::pi / 180;
constexpr GlowModel kModels[] = {GlowModel::table, GlowModel::apsf_series, GlowModel::single,
                                 GlowModel::diffusion};

struct Options {
  std::string out;
  ValidationOptions checks;
  unsigned threads = 0;
};

std::string percent(const std::optional<ModelError>& error) {
  return error ? fmt::format("{:.1f}", 100 * (std::exp(error->error) - 1)) : "–";
}

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values.empty() ? NAN : values[values.size() / 2];
}

struct Errors {
  std::vector<double> given, fitted;
};

std::string range(const std::vector<double>& values) {
  if (values.empty()) return "–";
  const auto [low, high] = std::minmax_element(values.begin(), values.end());
  return fmt::format("{:.1f} (from {:.1f} to {:.1f})", median(values), *low, *high);
}

std::string concentrations(const Options& options) {
  const std::vector<PhotonProfile> photons = count_photons(options.checks, threads(options.threads));
  std::map<GlowModel, Errors> summary;
  std::string rows;
  std::vector<Line> lines;
  for (const GlowModel model : kModels) lines.push_back({std::string(to_string(model)), {}, {}, true});
  for (const PhotonProfile& profile : photons) {
    rows += fmt::format("<tr><td>{:.2f}</td><td>{:.2f}</td>", profile.q, profile.thickness);
    for (std::size_t m = 0; m < std::size(kModels); ++m) {
      const auto given = error_as_given(kModels[m], profile), fitted = error_when_fitted(kModels[m], profile);
      rows += fmt::format("<td>{}</td><td>{}</td>", percent(given), percent(fitted));
      if (given) summary[kModels[m]].given.push_back(100 * (std::exp(given->error) - 1));
      if (fitted) {
        summary[kModels[m]].fitted.push_back(100 * (std::exp(fitted->error) - 1));
        rows += fmt::format("<td class='fit'>{:.2f}, {:.2f}</td>", fitted->thickness, fitted->q);
        lines[m].x.push_back(profile.thickness);
        lines[m].y.push_back(std::max(0.05, 100 * (std::exp(fitted->error) - 1)));
      } else {
        rows += "<td class='fit'>–</td>";
      }
    }
    rows += "</tr>\n";
  }
  std::string html =
      "<h2>Fifteen concentrations at three q</h2>\n<p>Error of each model against photons, rms over rings "
      "from 0.25° to "
      "12°, in per cent; the photons' noise is taken out. Given: T and q as they are. Fitted: T, q and "
      "brightness free; "
      "then the T and q that the fit arrived at. The lecture claims 1–3 % for its model (the APSF series) "
      "and 20–50 % "
      "for diffusion.</p>\n<table><tr><th>model</th><th>given: median (range)</th><th>fitted: median "
      "(range)</th></tr>\n";
  for (const GlowModel model : kModels)
    html += fmt::format("<tr><td>{}</td><td>{} %</td><td>{} %</td></tr>\n", to_string(model),
                        range(summary[model].given), range(summary[model].fitted));
  html += "</table>\n" + svg_plot("Error when fitted", "optical thickness T", "error [%]", lines);
  html += "<details><summary>All numbers</summary><table><tr><th>q</th><th>T</th>";
  for (const GlowModel model : kModels)
    html += fmt::format("<th>{} given %</th><th>fitted %</th><th class='fit'>T, q</th>", to_string(model));
  return html + "</tr>\n" + rows + "</table></details>\n";
}

std::string weather(double thickness, const char* name) {
  constexpr double q = 0.9;
  std::vector<Line> lines;
  std::vector<double> theta, unused(60), unused_too(60);
  for (int i = 0; i < 60; ++i) theta.push_back(0.05 * std::pow(1000, i / 59.0) * kDegree);
  for (const GlowModel model : kModels) {
    Line line{std::string(to_string(model)), {}, std::vector<double>(60), false};
    scattering::glow_profile(model, thickness, q, 1, theta, line.y, unused, unused_too);
    for (const double value : theta) line.x.push_back(value / kDegree);
    lines.push_back(std::move(line));
  }
  return svg_plot(fmt::format("{} weather, T = {}, q = {}", name, thickness, q), "angle from the lamp [deg]",
                  "radiance per unit flux, optical units", lines);
}

// A lamp of which a part is hidden, relative to the direct beam. A cone is open about the line to the camera,
// a sector about straight up in the picture; per unit of intensity, so that the direct beam is the same for
// all.
std::string source_visibility(const Options& options, scattering::LampEmission::Kind kind, double thickness) {
  scattering::LampScene scene;
  scene.distance_m = 100;
  scene.medium = {thickness / scene.distance_m, 1, 0.9};
  scattering::CameraRays rays;
  rays.theta_edges_rad = scattering::log_spaced_edges_rad(0.2, 20, 10);
  rays.paths_per_bin = options.checks.paths;
  rays.seed = options.checks.seed;
  std::vector<Line> lines;
  for (const double opening : {360.0, 315.0, 240.0, 180.0, 90.0, 30.0}) {
    scene.emission = {kind, opening, 0, 0};
    const auto seen = scattering::simulate_camera(scene, rays, threads(options.threads));
    Line line{fmt::format("{:.0f}°", opening), {}, {}, false};
    for (std::size_t ring = 0; ring < seen.rings; ++ring) {
      line.x.push_back(std::sqrt(rays.theta_edges_rad[ring] * rays.theta_edges_rad[ring + 1]) / kDegree);
      line.y.push_back(seen.radiance(ring, 0).value / seen.direct_irradiance);
    }
    lines.push_back(std::move(line));
  }
  const char* what = kind == scattering::LampEmission::Kind::sector ? "Part hidden" : "Cone";
  return svg_plot(fmt::format("{}, T = {}, q = 0.9", what, thickness), "angle from the lamp [deg]",
                  "radiance over direct irradiance [1/sr]", lines);
}

// Where the light of a lamp with a hidden part is seen: the glow in twelve directions round it, as shares of
// the whole lamp's.
std::string hidden_part_table(const Options& options, double thickness) {
  constexpr std::size_t kSectors = 12;
  scattering::LampScene scene;
  scene.distance_m = 100;
  scene.medium = {thickness / scene.distance_m, 1, 0.9};
  scattering::CameraRays rays;
  rays.theta_edges_rad = {1.0 * kDegree, 2.0 * kDegree};
  rays.azimuth_bins = kSectors;
  rays.paths_per_bin = options.checks.paths;
  rays.seed = options.checks.seed;
  std::string html = fmt::format(
      "<p>T = {}: the ring of 1° to 2°, glow relative to the whole lamp's at the same place, in per cent.</p>"
      "<table><tr><th>open</th>",
      thickness);
  for (std::size_t sector = 0; sector < kSectors; ++sector)
    html += fmt::format("<th>{}°</th>", sector * 360 / kSectors);
  html += "</tr>\n";
  const auto whole = scattering::simulate_camera(scene, rays, threads(options.threads));
  for (const double opening : {315.0, 240.0, 180.0, 90.0, 30.0}) {
    scene.emission = {scattering::LampEmission::Kind::sector, opening, 0, 0};
    const auto part = scattering::simulate_camera(scene, rays, threads(options.threads));
    html += fmt::format("<tr><td>{:.0f}°</td>", opening);
    for (std::size_t sector = 0; sector < kSectors; ++sector)
      html += fmt::format("<td>{:.0f}</td>", 100 * part.radiance(0, sector).value / part.direct_irradiance /
                                                 (whole.radiance(0, sector).value / whole.direct_irradiance));
    html += "</tr>\n";
  }
  return html + "</table>\n";
}

constexpr const char* kHead =
    "<!doctype html><html lang='en'><head><meta charset='utf-8'><title>lampglow: the scattering "
    "models</title>"
    "<style>body{font:15px sans-serif;max-width:1120px;margin:1em auto;padding:0 1em}"
    "svg{width:520px;max-width:100%}svg text{font:11px sans-serif}.title{font-weight:bold!important}"
    ".grid{stroke:#ddd}table{border-collapse:collapse}"
    "td,th{border:1px solid #ccc;padding:2px 7px;text-align:right}.fit{color:#777}"
    "figure{display:inline-block;margin:4px}img{width:520px;max-width:100%;image-rendering:pixelated}"
    "</style></head><body>\n<h1>The scattering models against photons</h1>\n";

std::string hidden_parts(const Options& options) {
  using Kind = scattering::LampEmission::Kind;
  return fmt::format(
             "<h2>Source visibility</h2>\n<p>A part of the lamp is hidden, as the lecture has it: light "
             "leaves only into the sector of this opening, centred on straight up as the camera sees it; "
             "mean "
             "over whole rings. All have the same direct beam. Path-traced, {} paths a ring.</p>\n",
             options.checks.paths) +
         source_visibility(options, Kind::sector, 1.2) + source_visibility(options, Kind::sector, 4) +
         "<p>Round the lamp, clockwise from straight up, the glow sits where the light goes; the thicker the "
         "fog, the less so.</p>\n" +
         hidden_part_table(options, 1.2) + hidden_part_table(options, 4) +
         "<p>The lamp's light leaves a cone about the line to the camera, of this full angle.</p>\n" +
         source_visibility(options, Kind::cone, 1.2) + source_visibility(options, Kind::cone, 4);
}

void run(const Options& options) {
  PendingFile file(options.out);  // told now if it cannot be written, not after minutes
  file.write(kHead);
  file.write(fmt::format(
      "<p>{} photons for each q, seed {}; an even lamp in an infinite homogeneous medium, Henyey-Greenstein, "
      "no absorption. The same options give the same report.</p>\n",
      options.checks.photons, options.checks.seed));
  std::fputs("photons and fits...\n", stderr);
  file.write(concentrations(options));
  file.write("<h2>Mild and dense weather</h2>\n" + weather(1.2, "Mild") + weather(4, "Dense"));
  std::fputs("source visibility...\n", stderr);
  file.write(hidden_parts(options));
  std::fputs("pictures...\n", stderr);
  file.write(rendered_scene() + "</body></html>\n");
  file.publish();
  fmt::print("{}\n", options.out);
}

}  // namespace

void add_validate(CLI::App& program) {
  auto options = std::make_shared<Options>();
  CLI::App* command =
      program.add_subcommand("validate", "Write the report on the scattering models: each against photons");
  command->add_option("OUT", options->out, "HTML file to write, self-contained")->required();
  command->add_option("--photons", options->checks.photons, "Photons for each of three q")
      ->check(CLI::Range(std::uint64_t{6'400}, std::uint64_t{1'000'000'000'000}))
      ->capture_default_str();
  command
      ->add_option("--paths", options->checks.paths, "Paths for each ring of the source visibility figures")
      ->check(CLI::Range(std::uint64_t{20}, std::uint64_t{1'000'000'000}))
      ->capture_default_str();
  command->add_option("--seed", options->checks.seed, "Seed")->capture_default_str();
  command->add_option("--threads", options->threads, "Threads; 0 for one per core")->capture_default_str();
  command->footer("Example:\n  lampglow validate scattering.html");
  command->callback([options] { run(*options); });
}

}  // namespace lampglow::daemon
