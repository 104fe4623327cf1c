#include "estimator/photometry/radiance.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "estimator/photometry/merge.h"
#include "estimator/photometry/overlay.h"
#include "estimator/photometry/response.h"
#include "estimator/photometry/vectorized.h"
#include "estimator/photometry/vignetting.h"

namespace lampglow::photometry {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();

// The range of one exposure, DN.
struct Extremes {
  std::uint16_t darkest = 0xFFFF;
  std::vector<std::uint16_t> brightest_of_row;
};

LAMPGLOW_VECTORIZED void extremes_of_row(std::span<const std::uint16_t> dn, std::uint16_t& darkest,
                                         std::uint16_t& brightest) {
  std::uint16_t low = darkest, high = brightest;
  for (const std::uint16_t value : dn) {
    low = std::min(low, value);
    high = std::max(high, value);
  }
  darkest = low, brightest = high;
}

Extremes extremes_of(const Image<std::uint16_t>& pixels) {
  Extremes extremes;
  const auto width = static_cast<size_t>(pixels.width_px);
  extremes.brightest_of_row.resize(static_cast<size_t>(pixels.height_px));
  for (size_t row = 0; row < extremes.brightest_of_row.size(); ++row)
    extremes_of_row(std::span(pixels.pixels).subspan(row * width, width), extremes.darkest,
                    extremes.brightest_of_row[row]);
  return extremes;
}

// What is wrong with one exposure, if anything.
// `overexposed`: every pixel is saturated, as in a bracket's longest exposure of fog by day.
std::string exposure_fault(const Exposure& exposure, const Camera& camera, QualityFlags& quality,
                           Extremes& extremes, bool& overexposed) {
  const auto size = [](int width, int height) {
    return std::to_string(width) + "x" + std::to_string(height);
  };
  const auto& pixels = exposure.pixels;
  if (pixels.width_px != camera.width_px || pixels.height_px != camera.height_px) {
    quality.set(Quality::frame_wrong_size);
    return exposure.name + ": " + size(pixels.width_px, pixels.height_px) + " pixels, expected " +
           size(camera.width_px, camera.height_px);
  }
  extremes = extremes_of(pixels);
  const std::uint16_t darkest = extremes.darkest;
  const std::uint16_t brightest = *std::ranges::max_element(extremes.brightest_of_row);
  if (brightest >= 1U << static_cast<unsigned>(camera.bit_depth)) {
    quality.set(Quality::frame_wrong_depth);
    return exposure.name + ": value " + std::to_string(brightest) + ", expected at most " +
           std::to_string((1U << static_cast<unsigned>(camera.bit_depth)) - 1);
  }
  overexposed = darkest >= camera.saturation_dn;
  if (darkest == brightest && !overexposed) {
    quality.set(Quality::frame_blank);
    return exposure.name + ": every pixel is " + std::to_string(darkest);
  }
  return "";
}

void add_fault(std::string& fault, const std::string& what) {
  if (!fault.empty()) fault += "; ";
  fault += what;
}

// The exposures that can be used, longest first. Without times, exposures can't be put together: then the
// first alone.
std::vector<Layer> usable_layers(const Bracket& bracket, const Camera& camera, RadianceImage& result) {
  std::vector<Layer> layers;
  bool any_overexposed = false;
  for (const Exposure& exposure : bracket.exposures) {
    bool overexposed = false;
    Extremes extremes;
    const std::string fault = exposure_fault(exposure, camera, result.quality, extremes, overexposed);
    any_overexposed = any_overexposed || overexposed;
    if (!fault.empty()) add_fault(result.fault, fault);
    if (!fault.empty() || overexposed) continue;
    const bool timed = exposure.exposure_s && *exposure.exposure_s > 0;
    const double gain = std::pow(10.0, exposure.gain_db.value_or(0) / 20);
    layers.push_back(
        {&exposure, timed ? *exposure.exposure_s * gain : 0.0, std::move(extremes.brightest_of_row), {}, {}});
  }
  if (layers.empty() && any_overexposed) {
    result.quality.set(Quality::frame_blank);
    add_fault(result.fault, "every pixel is saturated");
  }
  if (std::any_of(layers.begin(), layers.end(), [](const Layer& layer) { return layer.effective_s > 0; })) {
    std::erase_if(layers, [](const Layer& layer) { return layer.effective_s <= 0; });
  } else if (!layers.empty()) {
    layers.resize(1);
    layers.front().effective_s = 1;
    result.relative = true;
    result.quality.set(Quality::automatic_exposure);
  }
  std::stable_sort(layers.begin(), layers.end(),
                   [](const Layer& a, const Layer& b) { return a.effective_s > b.effective_s; });
  return layers;
}

// Variance that one DN step of noise before the curve makes after it.
std::vector<float> code_variance(std::span<const float> linear, double code_noise_dn) {
  std::vector<float> variance(linear.size());
  for (size_t dn = 0; dn < linear.size(); ++dn) {
    const size_t below = dn > 0 ? dn - 1 : dn, above = dn + 1 < linear.size() ? dn + 1 : dn;
    const double slope = (linear[above] - linear[below]) / static_cast<double>(above - below);
    variance[dn] = static_cast<float>(slope * slope * code_noise_dn * code_noise_dn);
  }
  return variance;
}

void divide_vignetting(const Image<float>& map, RadianceImage& image) {
  for (size_t i = 0; i < map.pixels.size(); ++i) {
    const float transmission = map.pixels[i];
    if (!(transmission > 0)) {
      image.mask.pixels[i] |= kInvalid;
      continue;
    }
    image.radiance.pixels[i] /= transmission;
    image.variance.pixels[i] /= transmission * transmission;
  }
}

void mark_overlay(const OverlayRows& rows, Image<std::uint8_t>& mask) {
  for (int row = 0; row < mask.height_px; ++row) {
    if (row >= rows.top && row < mask.height_px - rows.bottom) continue;
    for (int column = 0; column < mask.width_px; ++column) mask.at(column, row) |= kInvalid;
  }
}

void mark_hot_pixels(const RadianceOptions& options, RadianceImage& image) {
  const auto mark = [&image](const std::vector<PixelIndex>& hot) {
    for (const PixelIndex& pixel : hot)
      if (image.mask.contains(pixel.column, pixel.row)) image.mask.at(pixel.column, pixel.row) |= kHot;
  };
  mark(options.hot_pixels);
  if (options.find_hot_pixels) image.hot_pixels = find_hot_pixels(image.radiance, image.variance);
  mark(image.hot_pixels);
}

// What is masked has no variance to speak of.
void forget_masked(RadianceImage& image) {
  const auto width = static_cast<size_t>(image.mask.width_px);
  for (size_t first = 0; first < image.mask.pixels.size(); first += width) {
    if (!any_masked(std::span(image.mask.pixels).subspan(first, width))) continue;
    for (size_t i = first; i < first + width; ++i)
      if (image.mask.pixels[i] & (kSaturated | kHot | kInvalid)) image.variance.pixels[i] = kInfinity;
  }
}

void check_options(const Camera& camera, const RadianceOptions& options) {
  if (const std::string fault = camera_fault(camera); !fault.empty()) throw std::invalid_argument(fault);
  if (!(options.saturation_fraction > 0.5 && options.saturation_fraction <= 1))
    throw std::invalid_argument("saturation_fraction = " + std::to_string(options.saturation_fraction) +
                                ": must be above 0.5 and at most 1");
  if (options.bloom_radius_px < 0)
    throw std::invalid_argument("bloom_radius_px = " + std::to_string(options.bloom_radius_px) +
                                ": must be at least 0");
  const Image<float>& map = options.vignetting;
  if (!map.empty() && (map.width_px != camera.width_px || map.height_px != camera.height_px))
    throw std::invalid_argument("vignetting map: " + std::to_string(map.width_px) + "x" +
                                std::to_string(map.height_px) + " pixels, must be of the camera's size");
}

}  // namespace

LAMPGLOW_VECTORIZED bool any_masked(std::span<const std::uint8_t> mask) {
  std::uint8_t any = 0;
  for (const std::uint8_t bits : mask) any |= bits;
  return any != 0;
}

RadianceImage to_radiance(const Bracket& bracket, const Camera& camera, const RadianceOptions& options) {
  check_options(camera, options);
  RadianceImage image;
  std::vector<Layer> layers = usable_layers(bracket, camera, image);
  if (layers.empty()) return image;

  const std::vector<float> linear = linear_table(camera);
  for (Layer& layer : layers) {
    layer.noise = noise_model(*layer.exposure, camera, linear);
    if (camera.response.kind != Response::Kind::linear)
      layer.code_variance = code_variance(linear, layer.noise.code_noise_dn);
    image.noise.push_back(layer.noise);
  }
  image.longest_s = layers.front().effective_s;
  image.shortest_s = layers.back().effective_s;
  image.mask = Image<std::uint8_t>(camera.width_px, camera.height_px);
  image.radiance = Image<float>::unfilled(camera.width_px, camera.height_px);
  image.variance = Image<float>::unfilled(camera.width_px, camera.height_px);

  const OverlayRows overlay =
      options.find_overlay ? find_overlay(layers.front().exposure->pixels, camera) : OverlayRows{};
  image.compressed_colour = camera.bit_depth <= 8 && !layers.front().exposure->monochrome;
  Merger merger(layers, camera, options, linear);
  image.saturation_radiance = merger.saturation_radiance();
  for (int row = 0; row < camera.height_px; ++row) merger.merge_row(row, image);
  mark_overlay(overlay, image.mask);
  mark_hot_pixels(options, image);
  if (!options.vignetting.empty())
    divide_vignetting(options.vignetting, image);
  else if (!camera.vignetting.empty())
    divide_vignetting(vignetting_map(camera), image);
  forget_masked(image);
  return image;
}

}  // namespace lampglow::photometry
