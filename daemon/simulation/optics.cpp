#include "daemon/simulation/optics.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <opencv2/core.hpp>

namespace lampglow::simulation {

namespace {

double skirt(double a_px, double r_px) {
  const double square = r_px * r_px + a_px * a_px;
  return a_px / (2 * std::numbers::pi * square * std::sqrt(square));
}

// The part of a Gaussian at `centre` that falls on [low, low+1).
double gaussian_share(double centre, double sigma, int low) {
  const double scale = 1 / (sigma * std::numbers::sqrt2);
  return 0.5 * (std::erf((low + 1 - centre) * scale) - std::erf((low - centre) * scale));
}

}  // namespace

double glare(const PointSpread& spread, double r_px) {
  return spread.glare_share * (spread.near_share * skirt(spread.near_glare_px, r_px) +
                               (1 - spread.near_share) * skirt(spread.far_glare_px, r_px));
}

void add_glare(Image<double>& picture, const PointSpread& spread, double x_px, double y_px, double energy) {
  if (energy <= 0) return;
  for (int row = 0; row < picture.height_px; ++row) {
    for (int column = 0; column < picture.width_px; ++column) {
      picture.at(column, row) += energy * glare(spread, std::hypot(column + 0.5 - x_px, row + 0.5 - y_px));
    }
  }
}

void add_core(Image<double>& picture, const PointSpread& spread, double x_px, double y_px, double energy) {
  const int reach = static_cast<int>(std::ceil(7 * spread.core_sigma_px));
  const int centre_column = static_cast<int>(std::floor(x_px));
  const int centre_row = static_cast<int>(std::floor(y_px));
  const double core_energy = energy * (1 - spread.glare_share);
  for (int row = centre_row - reach; row <= centre_row + reach; ++row) {
    const double share = gaussian_share(y_px, spread.core_sigma_px, row);
    for (int column = centre_column - reach; column <= centre_column + reach; ++column) {
      if (!picture.contains(column, row)) continue;
      picture.at(column, row) += core_energy * share * gaussian_share(x_px, spread.core_sigma_px, column);
    }
  }
}

void add_point(Image<double>& picture, const PointSpread& spread, double x_px, double y_px, double energy) {
  add_core(picture, spread, x_px, y_px, energy);
  add_glare(picture, spread, x_px, y_px, energy);
}

struct Lens::Spectrum {
  cv::Mat kernel;
};

Lens::Lens(const PointSpread& spread, int width_px, int height_px) : spectrum_(std::make_unique<Spectrum>()) {
  cv::Mat kernel(height_px, width_px, CV_64F);
  double core_sum = 0;
  double glare_sum = 0;
  auto core = [&](double r) {
    return std::exp(-0.5 * r * r / (spread.core_sigma_px * spread.core_sigma_px));
  };
  auto radius = [&](int column, int row) {  // the kernel's middle is pixel (0, 0), its left half wraps round
    return std::hypot(std::min(column, width_px - column), std::min(row, height_px - row));
  };
  for (int row = 0; row < height_px; ++row) {
    for (int column = 0; column < width_px; ++column) {
      core_sum += core(radius(column, row));
      glare_sum += glare(spread, radius(column, row));
    }
  }
  const double core_scale =
      (1 - glare_sum) / core_sum;  // the kernel sums to 1: fields stay as bright as they are
  for (int row = 0; row < height_px; ++row) {
    for (int column = 0; column < width_px; ++column) {
      const double r = radius(column, row);
      kernel.at<double>(row, column) = core_scale * core(r) + glare(spread, r);
    }
  }
  cv::dft(kernel, spectrum_->kernel);
}

Lens::~Lens() = default;

void Lens::blur(Image<double>& picture) const {
  cv::Mat pixels(picture.height_px, picture.width_px, CV_64F, picture.pixels.data());
  cv::Mat spectrum;
  cv::dft(pixels, spectrum);
  cv::mulSpectrums(spectrum, spectrum_->kernel, spectrum, 0);
  cv::dft(spectrum, pixels, cv::DFT_INVERSE | cv::DFT_SCALE | cv::DFT_REAL_OUTPUT);
}

}  // namespace lampglow::simulation
