// The measurement of one light: windowed centroid, aperture flux.
#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "estimator/photometry/lamps.h"

namespace lampglow::photometry {
namespace {

// A plane background: level at (x0, y0) and its slopes.
struct Plane {
  double level = 0, slope_x = 0, slope_y = 0;
  double x0 = 0, y0 = 0;
  double level_variance = 0;
  double scatter_variance = 0;  // of the ring's pixels about the plane: noise, and what structure there is
  bool known = false;
  double at(double x, double y) const { return level + slope_x * (x - x0) + slope_y * (y - y0); }
};

struct Sample {
  double dx, dy, value;
};

bool usable(const RadianceImage& image, int column, int row) {
  return image.radiance.contains(column, row) && !(image.mask.at(column, row) & (kHot | kInvalid));
}

// Saturated pixels have infinite variance; here they count as what they are clipped at, with its shot noise.
double finite_variance(const RadianceImage& image, int column, int row) {
  const float variance = image.variance.at(column, row);
  if (std::isfinite(variance)) return variance;
  return image.noise.empty()
             ? 1.0
             : image.noise.back().gain_dn_per_electron * image.saturation_radiance / image.shortest_s;
}

// Least squares by the normal equations of (1, dx, dy); false where the samples don't span a plane.
bool solve_plane(const std::vector<Sample>& samples, Plane& plane) {
  std::array<double, 6> a{};  // n, x, y, xx, xy, yy
  std::array<double, 3> b{};
  for (const Sample& s : samples) {
    a[0] += 1, a[1] += s.dx, a[2] += s.dy, a[3] += s.dx * s.dx, a[4] += s.dx * s.dy, a[5] += s.dy * s.dy;
    b[0] += s.value, b[1] += s.dx * s.value, b[2] += s.dy * s.value;
  }
  const double c00 = a[3] * a[5] - a[4] * a[4], c01 = a[2] * a[4] - a[1] * a[5],
               c02 = a[1] * a[4] - a[2] * a[3];
  const double c11 = a[0] * a[5] - a[2] * a[2], c12 = a[1] * a[2] - a[0] * a[4],
               c22 = a[0] * a[3] - a[1] * a[1];
  const double determinant = a[0] * c00 + a[1] * c01 + a[2] * c02;
  if (samples.size() < 8 || !(std::abs(determinant) > 1e-9 * std::abs(a[0] * a[3] * a[5]))) return false;
  plane.level = (c00 * b[0] + c01 * b[1] + c02 * b[2]) / determinant;
  plane.slope_x = (c01 * b[0] + c11 * b[1] + c12 * b[2]) / determinant;
  plane.slope_y = (c02 * b[0] + c12 * b[1] + c22 * b[2]) / determinant;
  return true;
}

// The plane through the ring between two radii; pixels that stand out (other lights) are dropped, twice.
Plane ring_background(const RadianceImage& image, double x, double y, double inner_px, double outer_px) {
  Plane plane;
  plane.x0 = x, plane.y0 = y;
  std::vector<Sample> samples;
  for (int row = static_cast<int>(std::floor(y - outer_px)); row <= static_cast<int>(y + outer_px); ++row) {
    for (int column = static_cast<int>(std::floor(x - outer_px)); column <= static_cast<int>(x + outer_px);
         ++column) {
      if (!usable(image, column, row)) continue;
      const double dx = column + 0.5 - x, dy = row + 0.5 - y, r2 = dx * dx + dy * dy;
      if (r2 >= inner_px * inner_px && r2 < outer_px * outer_px)
        samples.push_back({dx, dy, image.radiance.at(column, row)});
    }
  }
  double rms = 0;
  for (int pass = 0; pass < 3; ++pass) {
    if (!solve_plane(samples, plane)) return plane;
    std::vector<double> residual;
    residual.reserve(samples.size());
    for (const Sample& s : samples) residual.push_back(std::abs(s.value - plane.at(x + s.dx, y + s.dy)));
    const auto middle = residual.begin() + static_cast<std::ptrdiff_t>(residual.size() / 2);
    std::nth_element(residual.begin(), middle, residual.end());
    rms = 1.4826 * *middle;
    const size_t before = samples.size();
    std::erase_if(
        samples, [&](const Sample& s) { return std::abs(s.value - plane.at(x + s.dx, y + s.dy)) > 3 * rms; });
    if (samples.size() == before) break;
  }
  plane.known = true;
  plane.scatter_variance = rms * rms;
  plane.level_variance = rms * rms / static_cast<double>(std::max<size_t>(samples.size(), 1));
  return plane;
}

// Sums over the Gaussian window about (x, y).
struct Moments {
  double weight_sum = 0;            // Σ w I
  double first_x = 0, first_y = 0;  // Σ w I d
  double xx = 0, xy = 0, yy = 0;    // Σ w I d d
  double noise = 0;                 // Σ w² max(var, scatter of the ring)
  double noise_x = 0, noise_y = 0;  // Σ w² d² var
  double norm = 0;                  // Σ w²
};

Moments window_moments(const RadianceImage& image, const Plane& plane, double x, double y, double sigma_px) {
  Moments m;
  const double reach = 3.5 * sigma_px, scale = -0.5 / (sigma_px * sigma_px);
  const int left = static_cast<int>(std::floor(x - reach)), right = static_cast<int>(x + reach);
  std::vector<double> along_x;  // the Gaussian is one of x times one of y
  for (int column = left; column <= right; ++column) {
    const double dx = column + 0.5 - x;
    along_x.push_back(std::exp(scale * dx * dx));
  }
  for (int row = static_cast<int>(std::floor(y - reach)); row <= static_cast<int>(y + reach); ++row) {
    const double dy = row + 0.5 - y, along_y = std::exp(scale * dy * dy);
    for (int column = left; column <= right; ++column) {
      if (!usable(image, column, row)) continue;
      const double dx = column + 0.5 - x;
      const double w = along_x[static_cast<size_t>(column - left)] * along_y;
      const double value = w * (image.radiance.at(column, row) - plane.at(column + 0.5, row + 0.5));
      const double variance = w * w * std::max(finite_variance(image, column, row), 1e-30);
      m.weight_sum += value;
      m.first_x += value * dx, m.first_y += value * dy;
      m.xx += value * dx * dx, m.xy += value * dx * dy, m.yy += value * dy * dy;
      m.noise += std::max(variance, w * w * plane.scatter_variance);
      m.noise_x += variance * dx * dx, m.noise_y += variance * dy * dy;
      m.norm += w * w;
    }
  }
  return m;
}

// How wide the saturated patch about (x, y) is: the radius of the circle of its area, 0 for none.
double saturated_radius_px(const RadianceImage& image, double x, double y, int& count) {
  count = 0;
  constexpr int kReach = 10;
  const int column = static_cast<int>(std::floor(x)), row = static_cast<int>(std::floor(y));
  for (int j = row - kReach; j <= row + kReach; ++j)
    for (int i = column - kReach; i <= column + kReach; ++i)
      if (image.mask.contains(i, j) && (image.mask.at(i, j) & kSaturated)) ++count;
  return std::sqrt(count / 3.141592653589793);
}

// Walks the window to the light. False where there is nothing to hold on to.
bool walk(const RadianceImage& image, const Plane& plane, double sigma_px, double search_px, int iterations,
          std::array<double, 2> start, double& x, double& y) {
  for (int i = 0; i < iterations; ++i) {
    const Moments m = window_moments(image, plane, x, y, sigma_px);
    if (!(m.weight_sum > 0)) return false;
    // Between 1 (light much narrower than the window) and 2 (as wide as the window).
    const double step_x = 1.5 * m.first_x / m.weight_sum, step_y = 1.5 * m.first_y / m.weight_sum;
    x += std::clamp(step_x, -1.0, 1.0);
    y += std::clamp(step_y, -1.0, 1.0);
    if (std::hypot(x - start[0], y - start[1]) > search_px) return false;
    if (std::hypot(step_x, step_y) < 1e-3) break;
  }
  return true;
}

// Shape from the windowed second moments, freed of the window: 1/σ² = 1/σ_w'² - 1/σ_window².
void set_shape(const Moments& m, double window_px, DetectedLight& light) {
  const double xx = m.xx / m.weight_sum, yy = m.yy / m.weight_sum, xy = m.xy / m.weight_sum;
  const double mean = 0.5 * (xx + yy), spread = std::hypot(0.5 * (xx - yy), xy);
  const auto free_of_window = [window_px](double moment) {
    const double limited = std::clamp(moment, 0.04, 0.95 * window_px * window_px);
    return 1 / (1 / limited - 1 / (window_px * window_px));
  };
  const double long_axis = free_of_window(mean + spread), short_axis = free_of_window(mean - spread);
  light.fwhm_px = 2.3548 * std::sqrt(std::sqrt(long_axis * short_axis));
  light.elongation = std::sqrt(long_axis / short_axis);
}

void set_position_sigma(const Moments& m, double window_px, DetectedLight& light) {
  // d(centroid) = Σ w n d / (Σ w I (1 - d²/σ_w²)), by differentiating Σ w I d = 0.
  const double slope_x = m.weight_sum - m.xx / (window_px * window_px);
  const double slope_y = m.weight_sum - m.yy / (window_px * window_px);
  const double sigma_x = std::sqrt(m.noise_x) / std::abs(slope_x),
               sigma_y = std::sqrt(m.noise_y) / std::abs(slope_y);
  // 0.01 px: pixels that are not even, window that is cut into pixels.
  light.position_sigma_px = std::hypot(std::sqrt(0.5 * (sigma_x * sigma_x + sigma_y * sigma_y)), 0.01);
}

}  // namespace

void measure_flux(const RadianceImage& image, double x_px, double y_px, double aperture_px,
                  double ring_width_px, DetectedLight& light) {
  const Plane plane = ring_background(image, x_px, y_px, aperture_px + 1, aperture_px + 1 + ring_width_px);
  light.flux = light.peak = 0;
  light.saturated_pixels = 0;
  light.background = plane.level;
  double variance = 0, area = 0;
  const double reach = aperture_px + 1;
  for (int row = static_cast<int>(std::floor(y_px - reach)); row <= static_cast<int>(y_px + reach); ++row) {
    for (int column = static_cast<int>(std::floor(x_px - reach)); column <= static_cast<int>(x_px + reach);
         ++column) {
      if (!usable(image, column, row)) continue;
      const double dx = column + 0.5 - x_px, dy = row + 0.5 - y_px;
      const double part = std::clamp(aperture_px + 0.5 - std::hypot(dx, dy), 0.0, 1.0);
      if (part <= 0) continue;
      const double value = image.radiance.at(column, row) - plane.at(column + 0.5, row + 0.5);
      light.flux += part * value;
      light.peak = std::max(light.peak, value);
      variance += part * part * finite_variance(image, column, row);
      area += part;
      if (image.mask.at(column, row) & kSaturated) ++light.saturated_pixels;
    }
  }
  light.flux_sigma = std::sqrt(variance + area * area * plane.level_variance);
}

DetectedLight measure_light(const RadianceImage& image, double x_px, double y_px,
                            const CentroidOptions& options) {
  DetectedLight light;
  light.x_px = x_px, light.y_px = y_px;
  light.position_sigma_px = 1e3;
  int saturated = 0;
  // A saturated core is a plateau: its middle may be as far from the start as it is wide.
  const double saturated_px = saturated_radius_px(image, x_px, y_px, saturated);
  double window = std::max(options.window_sigma_px, 0.9 * saturated_px);
  const double search_px = options.search_px + 1.5 * saturated_px;
  double x = x_px, y = y_px;
  for (int pass = 0; pass < 2; ++pass) {
    const Plane plane = ring_background(image, x, y, 3 * window + 1, 3 * window + 4);
    if (!plane.known || !walk(image, plane, window, search_px, options.iterations, {x_px, y_px}, x, y))
      return light;
    const Moments m = window_moments(image, plane, x, y, window);
    if (!(m.weight_sum > 0)) return light;
    light.x_px = x, light.y_px = y;
    light.snr = m.weight_sum / std::sqrt(m.noise + m.norm * m.norm * plane.level_variance);
    set_shape(m, window, light);
    set_position_sigma(m, window, light);
    // The second pass has a window as wide as the light.
    window = std::clamp(1.1 * light.fwhm_px / 2.3548, options.window_sigma_px,
                        3 * options.window_sigma_px + window);
  }
  measure_flux(image, x, y, std::max(options.aperture_px, 2 * window), 3, light);
  return light;
}

}  // namespace lampglow::photometry
