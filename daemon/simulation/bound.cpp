#include "daemon/simulation/bound.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <opencv2/core.hpp>

#include "daemon/simulation/render.h"

namespace lampglow::simulation {

namespace {

constexpr int kRings = 24;
constexpr double kInnerDeg = 0.15;
constexpr double kOuterDeg = 8;
constexpr int kAzimuths = 24;
constexpr double kUsableRange = 0.9;      // of the way to saturation
constexpr double kCountSmoothing = 0.61;  // (1, 2, 1)/4 leaves √(6/16) of a bin's scatter
constexpr double kGainPrior = 0.12;
constexpr double kUnknownGainPrior = 1.5;
constexpr double kLampPrior = 0.06;
constexpr double kStep = 0.05;  // of ln σ

double radians(double degrees) {
  return degrees * std::numbers::pi / 180;
}
double ring_deg(double edge) {
  return kInnerDeg * std::pow(kOuterDeg / kInnerDeg, edge / kRings);
}

// Where one measurement's light comes from, at the true parameters: electrons per second of a pixel (rings)
// or of all pixels (cores).
struct Measurement {
  double sky = 0;            // share that scales with the sky
  std::vector<double> lamp;  // of each lamp
  double slope_ln_extinction = 0;
  double slope_q = 0;
  double fixed_variance = 0;  // of the photon count, electrons²/s²
  double pixels = 0;          // that are averaged; 0: a sum over kCorePixels
  double total() const {
    double sum = sky;
    for (const double part : lamp) sum += part;
    return sum;
  }
};

constexpr double kCorePixels = 30;

// d ln(halo)/dq on the rings' angles, from the two outermost counted q near this one.
std::vector<double> slope_in_q(const HaloLibrary& halos, double q, double thickness) {
  const std::vector<double> near = halos.counted_q(q - 0.07, q + 0.07, thickness);
  std::vector<double> slope(kRings, 0.0);
  if (near.size() < 2) return slope;
  const HaloProfile low = halos.profile(near.front(), thickness);
  const HaloProfile high = halos.profile(near.back(), thickness);
  cv::Mat powers(kRings, 4, CV_64F);
  cv::Mat differences(kRings, 1, CV_64F);
  for (int r = 0; r < kRings; ++r) {
    const double ln_theta = std::log(radians(ring_deg(r + 0.5)));
    differences.at<double>(r) =
        std::log(high.radiance(ln_theta) / low.radiance(ln_theta)) / (near.back() - near.front());
    for (int p = 0; p < 4; ++p) powers.at<double>(r, p) = std::pow(2.0 * r / kRings - 1, p);
  }
  cv::Mat coefficients;
  cv::solve(powers, differences, coefficients, cv::DECOMP_SVD);
  const cv::Mat smooth = powers * coefficients;
  for (int r = 0; r < kRings; ++r) slope[static_cast<size_t>(r)] = smooth.at<double>(r);
  return slope;
}

// One lamp as the bound sees it.
struct Source {
  PixelPosition at;
  double electrons_per_s = 0;  // without air
  double thickness = 0;
  HaloProfile halo, halo_thicker, halo_thinner;
  std::vector<double> slope_q;
};

Source make_source(const Night& night, const Frame& frame, size_t lamp, const HaloLibrary& halos) {
  Source source;
  source.at = shaken(frame, night.lamps[lamp].x_px, night.lamps[lamp].y_px);
  source.electrons_per_s = lamp_electrons_per_s(night, frame, lamp);
  source.thickness = frame.extinction_per_m * night.lamps[lamp].distance_m;
  source.halo = halos.profile(frame.q, source.thickness);
  source.halo_thicker = halos.profile(frame.q, source.thickness * std::exp(kStep));
  source.halo_thinner = halos.profile(frame.q, source.thickness * std::exp(-kStep));
  source.slope_q = slope_in_q(halos, frame.q, source.thickness);
  return source;
}

double slope_q_at(const Source& source, double theta_deg) {
  const double ring = kRings * std::log(theta_deg / kInnerDeg) / std::log(kOuterDeg / kInnerDeg);
  return source.slope_q[static_cast<size_t>(std::clamp(ring, 0.0, kRings - 1.0))];
}

// Adds a source's light at a distance of r_px from it, as one of `count` points whose mean is taken.
void add_light(Measurement& m, const Source& source, size_t lamp, double r_px, double count) {
  const double theta = std::max(r_px, 0.3) / kFocalLengthPx;
  const double ln_theta = std::log(theta);
  const double per_pixel = source.electrons_per_s / (kFocalLengthPx * kFocalLengthPx) / count;
  const double halo = per_pixel * source.halo.radiance(ln_theta);
  const double direct =
      source.electrons_per_s * std::exp(-source.thickness) * glare(PointSpread{}, r_px) / count;
  m.lamp[lamp] += halo + direct;
  m.slope_ln_extinction -= source.thickness * direct;
  if (halo > 0 && !source.halo_thicker.dark()) {
    m.slope_ln_extinction +=
        per_pixel * (source.halo_thicker.radiance(ln_theta) - source.halo_thinner.radiance(ln_theta)) /
        (2 * kStep);
    m.slope_q += halo * slope_q_at(source, theta * 180 / std::numbers::pi);
  }
}

bool nearest_is(const Night& night, const std::vector<Source>& sources, size_t lamp, double x_px,
                double y_px) {
  const double own = std::hypot(x_px - sources[lamp].at.x_px, y_px - sources[lamp].at.y_px);
  for (size_t l = 0; l < sources.size(); ++l) {
    if (!night.lamps[l].in_catalogue || l == lamp) continue;
    if (std::hypot(x_px - sources[l].at.x_px, y_px - sources[l].at.y_px) < own) return false;
  }
  return true;
}

Measurement measure_ring(const Night& night, const Frame& frame, const std::vector<Source>& sources,
                         size_t lamp, int ring) {
  Measurement m;
  m.lamp.assign(sources.size(), 0);
  const double r_px = kFocalLengthPx * std::tan(radians(ring_deg(ring + 0.5)));
  std::vector<PixelPosition> points;
  for (int k = 0; k < kAzimuths; ++k) {
    const double angle = 2 * std::numbers::pi * (k + 0.5) / kAzimuths;
    const double x_px = sources[lamp].at.x_px + r_px * std::cos(angle);
    const double y_px = sources[lamp].at.y_px + r_px * std::sin(angle);
    const bool inside = x_px > 0 && y_px > 0 && x_px < kWidthPx && y_px < kHeightPx;
    if (inside && nearest_is(night, sources, lamp, x_px, y_px)) points.push_back({x_px, y_px});
  }
  if (points.empty()) return m;
  const auto count = static_cast<double>(points.size());
  const double outer_px = kFocalLengthPx * std::tan(radians(ring_deg(ring + 1)));
  const double inner_px = kFocalLengthPx * std::tan(radians(ring_deg(ring)));
  m.pixels = std::numbers::pi * (outer_px * outer_px - inner_px * inner_px) * count / kAzimuths;
  m.sky = frame.sky_electrons_per_s * frame.gain;
  for (const PixelPosition& point : points) {
    for (size_t l = 0; l < sources.size(); ++l) {
      add_light(m, sources[l], l,
                std::hypot(point.x_px - sources[l].at.x_px, point.y_px - sources[l].at.y_px), count);
    }
  }
  const double ln_theta = std::log(radians(ring_deg(ring + 0.5)));
  const double halo = sources[lamp].electrons_per_s * sources[lamp].halo.radiance(ln_theta) /
                      (kFocalLengthPx * kFocalLengthPx);
  m.fixed_variance = std::pow(kCountSmoothing * halo * sources[lamp].halo.relative_error(ln_theta), 2);
  return m;
}

// The lamp's own light within 0.15°: its direct beam. (The little halo in there is left out.)
Measurement measure_core(const std::vector<Source>& sources, size_t lamp) {
  Measurement m;
  m.lamp.assign(sources.size(), 0);
  m.lamp[lamp] = sources[lamp].electrons_per_s * std::exp(-sources[lamp].thickness);
  m.slope_ln_extinction = -sources[lamp].thickness * m.lamp[lamp];
  return m;
}

// 1/variance of the measured electrons per second, from all exposures that do not saturate.
double information(const Measurement& m, const Sensor& sensor, std::span<const double> exposures_s,
                   double background) {
  const bool core = m.pixels == 0;
  const double peak = core ? 0.16 * m.total() + background : m.total();
  double sum = 0;
  for (const double exposure_s : exposures_s) {
    if (peak * exposure_s > kUsableRange * saturation_electrons(sensor)) continue;
    const double per_pixel = (core ? m.total() / kCorePixels + background : m.total()) * exposure_s;
    const double variance = noise_variance(sensor, per_pixel);
    sum += exposure_s * exposure_s / (core ? variance * kCorePixels : variance / m.pixels);
  }
  return sum > 0 ? 1 / (1 / sum + m.fixed_variance) : 0;
}

// Parameters: ln σ, q, ln sky, ln gain, then ln strength of each lamp.
void add_information(cv::Mat& fisher, const Measurement& m, double weight) {
  cv::Mat slope(fisher.rows, 1, CV_64F, cv::Scalar(0));
  slope.at<double>(0) = m.slope_ln_extinction;
  slope.at<double>(1) = m.slope_q;
  slope.at<double>(2) = m.sky;
  for (size_t l = 0; l < m.lamp.size(); ++l) {
    slope.at<double>(3) += m.lamp[l];
    slope.at<double>(4 + static_cast<int>(l)) = m.lamp[l];
  }
  fisher += weight * slope * slope.t();
}

cv::Mat prior_information(const Night& night) {
  const int size = 4 + static_cast<int>(night.lamps.size());
  cv::Mat fisher = cv::Mat::zeros(size, size, CV_64F);
  fisher.at<double>(1, 1) = 1 / (0.3 * 0.3);  // q is within 0 to 1
  fisher.at<double>(2, 2) = 1e-4;             // the sky is free
  const double gain = night.options.style == Style::webcam ? kUnknownGainPrior : kGainPrior;
  fisher.at<double>(3, 3) = 1 / (gain * gain);
  for (size_t l = 0; l < night.lamps.size(); ++l) {
    const int i = 4 + static_cast<int>(l);
    const double prior = night.lamps[l].in_catalogue ? kLampPrior : 1e-3;
    fisher.at<double>(i, i) = 1 / (prior * prior);
  }
  return fisher;
}

}  // namespace

std::optional<double> bound_of_ln_extinction(const Night& night, const Frame& frame, const HaloLibrary& halos,
                                             const Sensor& sensor, std::span<const double> exposures_s) {
  std::vector<Source> sources;
  for (size_t l = 0; l < night.lamps.size(); ++l) sources.push_back(make_source(night, frame, l, halos));
  cv::Mat fisher = prior_information(night);
  bool any = false;
  for (size_t l = 0; l < night.lamps.size(); ++l) {
    if (!night.lamps[l].in_catalogue || sources[l].electrons_per_s <= 0) continue;
    any = true;
    double background = 0;
    for (int ring = 0; ring < kRings; ++ring) {
      const Measurement m = measure_ring(night, frame, sources, l, ring);
      if (ring == 0) background = m.total();
      if (m.pixels > 0) add_information(fisher, m, information(m, sensor, exposures_s, 0));
    }
    const Measurement core = measure_core(sources, l);
    add_information(fisher, core, information(core, sensor, exposures_s, background));
  }
  if (!any) return std::nullopt;
  cv::Mat covariance;
  cv::invert(fisher, covariance, cv::DECOMP_CHOLESKY);
  const double variance = covariance.at<double>(0, 0);
  return variance > 0 && std::isfinite(variance) ? std::optional(std::sqrt(variance)) : std::nullopt;
}

}  // namespace lampglow::simulation
