#include "estimator/photometry/radiance.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "estimator/photometry/overlay.h"
#include "estimator/photometry/response.h"
#include "estimator/photometry/vignetting.h"

namespace lampglow::photometry {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();

// An exposure on its way into the merge.
struct Layer {
  const Exposure* exposure;
  double effective_s;  // time times gain; 1 where unknown
  NoiseModel noise;
  std::vector<float> code_variance;  // by DN: slope² · code²; empty if it is the same everywhere
};

// What is wrong with one exposure, if anything.
// `overexposed`: every pixel is saturated, as in a bracket's longest exposure of fog by day.
std::string exposure_fault(const Exposure& exposure, const Camera& camera, QualityFlags& quality,
                           bool& overexposed) {
  const auto size = [](int width, int height) {
    return std::to_string(width) + "x" + std::to_string(height);
  };
  const auto& pixels = exposure.pixels;
  if (pixels.width_px != camera.width_px || pixels.height_px != camera.height_px) {
    quality.set(Quality::frame_wrong_size);
    return exposure.name + ": " + size(pixels.width_px, pixels.height_px) + " pixels, expected " +
           size(camera.width_px, camera.height_px);
  }
  std::uint16_t darkest = 0xFFFF, brightest = 0;
  for (const std::uint16_t dn : pixels.pixels) {
    darkest = std::min(darkest, dn);
    brightest = std::max(brightest, dn);
  }
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
    const std::string fault = exposure_fault(exposure, camera, result.quality, overexposed);
    any_overexposed = any_overexposed || overexposed;
    if (!fault.empty()) add_fault(result.fault, fault);
    if (!fault.empty() || overexposed) continue;
    const bool timed = exposure.exposure_s && *exposure.exposure_s > 0;
    const double gain = std::pow(10.0, exposure.gain_db.value_or(0) / 20);
    layers.push_back({&exposure, timed ? *exposure.exposure_s * gain : 0.0, {}, {}});
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

// One row of one exposure: linear signal, trust 0..1, and the part of the variance that is not shot noise.
struct RowBuffer {
  std::vector<float> signal, trust, floor_variance;
};

struct MergeLimits {
  std::uint16_t saturated_dn;  // from here on a pixel is saturated
  float fade_from;             // linear DN where trust begins to fall
  float fade_to;               // and where it is (nearly) zero
};

// Pixels of `row` that lie within `radius` of a saturated pixel lose their trust. `rows_with` tells which
// rows have one.
void spread_bloom(const Exposure& exposure, const std::vector<std::uint8_t>& rows_with,
                  std::uint16_t saturated_dn, int radius, int row, std::vector<float>& trust) {
  const int width = exposure.pixels.width_px, height = exposure.pixels.height_px;
  for (int y = std::max(0, row - radius); y <= std::min(height - 1, row + radius); ++y) {
    if (!rows_with[static_cast<size_t>(y)]) continue;
    const std::uint16_t* dn = &exposure.pixels.at(0, y);
    for (int x = 0; x < width; ++x) {
      if (dn[x] < saturated_dn) continue;
      const int from = std::max(0, x - radius), to = std::min(width - 1, x + radius);
      for (int i = from; i <= to; ++i) trust[static_cast<size_t>(i)] = 0;
    }
  }
}

std::vector<std::uint8_t> rows_with_saturation(const Exposure& exposure, std::uint16_t saturated_dn) {
  std::vector<std::uint8_t> rows(static_cast<size_t>(exposure.pixels.height_px));
  const int width = exposure.pixels.width_px;
  for (int y = 0; y < exposure.pixels.height_px; ++y) {
    const std::uint16_t* dn = &exposure.pixels.at(0, y);
    std::uint16_t highest = 0;
    for (int x = 0; x < width; ++x) highest = std::max(highest, dn[x]);
    rows[static_cast<size_t>(y)] = highest >= saturated_dn;
  }
  return rows;
}

class Merger {
 public:
  Merger(std::vector<Layer> layers, const Camera& camera, const RadianceOptions& options,
         std::span<const float> linear)
      : layers_(std::move(layers)),
        linear_(linear),
        width_(static_cast<size_t>(camera.width_px)),
        is_linear_(camera.response.kind == Response::Kind::linear),
        black_(static_cast<float>(camera.black_level_dn)),
        bloom_radius_px_(options.bloom_radius_px) {
    const double range = camera.saturation_dn - camera.black_level_dn;
    limits_.saturated_dn =
        static_cast<std::uint16_t>(std::ceil(camera.black_level_dn + options.saturation_fraction * range));
    const double top = linear[limits_.saturated_dn];
    limits_.fade_to = static_cast<float>(top);
    limits_.fade_from = static_cast<float>(0.9 * top);
    for (const Layer& layer : layers_) {
      buffers_.push_back(
          {std::vector<float>(width_), std::vector<float>(width_), std::vector<float>(width_)});
      saturated_rows_.push_back(rows_with_saturation(*layer.exposure, limits_.saturated_dn));
    }
  }

  float saturation_radiance() const {
    return limits_.fade_to / static_cast<float>(layers_.back().effective_s);
  }

  void merge_row(int row, RadianceImage& out) {
    for (size_t i = 0; i < layers_.size(); ++i) load_row(i, row);
    if (layers_.size() == 1)
      copy_row(row, out);
    else
      combine_row(row, out);
    mark_row(row, out);
  }

 private:
  // Fills the buffers of layer i.
  void load_row(size_t i, int row) {
    const Layer& layer = layers_[i];
    const std::uint16_t* dn = &layer.exposure->pixels.at(0, row);
    float* signal = buffers_[i].signal.data();
    float* trust = buffers_[i].trust.data();
    float* floor = buffers_[i].floor_variance.data();
    const auto read = static_cast<float>(layer.noise.read_noise_dn * layer.noise.read_noise_dn);
    if (is_linear_) {
      const float constant = read + static_cast<float>(layer.noise.code_noise_dn * layer.noise.code_noise_dn);
      for (size_t x = 0; x < width_; ++x) {
        signal[x] = static_cast<float>(dn[x]) - black_;
        floor[x] = constant;
      }
    } else {
      const float* code = layer.code_variance.data();
      for (size_t x = 0; x < width_; ++x) {
        signal[x] = linear_[dn[x]];
        floor[x] = read + code[dn[x]];
      }
    }
    // A little trust is left up to saturation, for the exposure that has no other beside it.
    const float from = limits_.fade_from, scale = 1.0F / (limits_.fade_to - limits_.fade_from);
    for (size_t x = 0; x < width_; ++x) {
      const float part = 1.0F - (signal[x] - from) * scale;
      trust[x] = std::min(1.0F, std::max(part, 1e-3F));
    }
    spread_bloom(*layer.exposure, saturated_rows_[i], limits_.saturated_dn, bloom_radius_px_, row,
                 buffers_[i].trust);
  }

  void copy_row(int row, RadianceImage& out) {
    const auto per_second = static_cast<float>(1 / layers_[0].effective_s);
    const auto gain = static_cast<float>(layers_[0].noise.gain_dn_per_electron);
    const float* signal = buffers_[0].signal.data();
    const float* floor = buffers_[0].floor_variance.data();
    float* radiance = &out.radiance.at(0, row);
    float* variance = &out.variance.at(0, row);
    for (size_t x = 0; x < width_; ++x) {
      radiance[x] = signal[x] * per_second;
      variance[x] = (gain * std::max(signal[x], 0.0F) + floor[x]) * per_second * per_second;
    }
  }

  void combine_row(int row, RadianceImage& out) {
    float* radiance = &out.radiance.at(0, row);
    float* variance = &out.variance.at(0, row);
    sum_.assign(width_, 0);
    weight_.assign(width_, 0);
    square_.assign(width_, 0);
    pooled_.assign(width_, 0);
    seconds_.assign(width_, 1e-30F);
    float* sum = sum_.data();
    float* weight = weight_.data();
    float* square = square_.data();
    float* pooled = pooled_.data();
    float* seconds = seconds_.data();
    for (size_t i = 0; i < layers_.size(); ++i) {
      const float* signal = buffers_[i].signal.data();
      const float* trust = buffers_[i].trust.data();
      const auto t = static_cast<float>(layers_[i].effective_s);
      for (size_t x = 0; x < width_; ++x) {
        pooled[x] += trust[x] * signal[x];
        seconds[x] += trust[x] * t;
      }
    }
    for (size_t x = 0; x < width_; ++x) pooled[x] = std::max(pooled[x], 0.0F) / seconds[x];
    for (size_t i = 0; i < layers_.size(); ++i) {
      const float* signal = buffers_[i].signal.data();
      const float* trust = buffers_[i].trust.data();
      const float* floor = buffers_[i].floor_variance.data();
      const auto t = static_cast<float>(layers_[i].effective_s);
      const auto gain = static_cast<float>(layers_[i].noise.gain_dn_per_electron);
      for (size_t x = 0; x < width_; ++x) {
        const float noise = gain * pooled[x] * t + floor[x];
        const float w = trust[x] * t / noise;  // times t: the weight of signal/t, multiplied out
        sum[x] += w * signal[x];
        weight[x] += w * t;
        square[x] += w * w * noise;
      }
    }
    for (size_t x = 0; x < width_; ++x) {
      const float inverse = 1.0F / std::max(weight[x], 1e-30F);
      radiance[x] = sum[x] * inverse;
      variance[x] = square[x] * inverse * inverse;
    }
  }

  // Pixels that no exposure is trusted for: bloom where the shortest is not saturated itself, else saturated.
  void mark_row(int row, RadianceImage& out) {
    bool any = true;
    for (size_t i = 0; i < layers_.size(); ++i) any = any && near_saturation(i, row);
    if (!any) return;
    const size_t last = layers_.size() - 1;
    const std::uint16_t* dn = &layers_[last].exposure->pixels.at(0, row);
    const auto per_second = static_cast<float>(1 / layers_[last].effective_s);
    const auto gain = static_cast<float>(layers_[last].noise.gain_dn_per_electron);
    for (size_t x = 0; x < width_; ++x) {
      float trust = 0;
      for (const RowBuffer& buffer : buffers_) trust = std::max(trust, buffer.trust[x]);
      if (trust > 0) continue;
      const bool saturated = dn[x] >= limits_.saturated_dn;
      const float signal = saturated ? limits_.fade_to : buffers_[last].signal[x];
      const auto column = static_cast<int>(x);
      out.radiance.at(column, row) = signal * per_second;
      out.variance.at(column, row) =
          (gain * std::max(signal, 0.0F) + buffers_[last].floor_variance[x]) * per_second * per_second;
      out.mask.at(column, row) = saturated ? kSaturated : kBloom;
    }
  }

  bool near_saturation(size_t i, int row) const {
    const auto& rows = saturated_rows_[i];
    const int from = std::max(0, row - bloom_radius_px_);
    const int to = std::min(static_cast<int>(rows.size()) - 1, row + bloom_radius_px_);
    for (int y = from; y <= to; ++y)
      if (rows[static_cast<size_t>(y)]) return true;
    return false;
  }

  std::vector<Layer> layers_;
  std::span<const float> linear_;
  size_t width_;
  bool is_linear_;
  float black_;
  int bloom_radius_px_;
  MergeLimits limits_{};
  std::vector<RowBuffer> buffers_;
  std::vector<std::vector<std::uint8_t>> saturated_rows_;
  std::vector<float> sum_, weight_, square_, pooled_, seconds_;
};

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
  image.radiance = Image<float>(camera.width_px, camera.height_px);
  image.variance = Image<float>(camera.width_px, camera.height_px);
  image.mask = Image<std::uint8_t>(camera.width_px, camera.height_px);

  const OverlayRows overlay =
      options.find_overlay ? find_overlay(layers.front().exposure->pixels, camera) : OverlayRows{};
  image.compressed_colour = camera.bit_depth <= 8 && !layers.front().exposure->monochrome;
  Merger merger(std::move(layers), camera, options, linear);
  image.saturation_radiance = merger.saturation_radiance();
  for (int row = 0; row < camera.height_px; ++row) merger.merge_row(row, image);
  mark_overlay(overlay, image.mask);
  mark_hot_pixels(options, image);
  if (!options.vignetting.empty())
    divide_vignetting(options.vignetting, image);
  else if (!camera.vignetting.empty())
    divide_vignetting(vignetting_map(camera), image);
  for (size_t i = 0; i < image.mask.pixels.size(); ++i)
    if (image.mask.pixels[i] & (kSaturated | kHot | kInvalid)) image.variance.pixels[i] = kInfinity;
  return image;
}

}  // namespace lampglow::photometry
