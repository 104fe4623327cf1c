#include "estimator/photometry/merge.h"

#include <algorithm>
#include <cmath>

#include "estimator/photometry/vectorized.h"

namespace lampglow::photometry {
namespace {

LAMPGLOW_VECTORIZED void subtract_black(std::span<const std::uint16_t> dn, float black, float* signal) {
  for (size_t x = 0; x < dn.size(); ++x) signal[x] = static_cast<float>(dn[x]) - black;
}

// Falls from 1 to nearly zero between two signals. A little is left up to saturation, for the exposure that
// has no other beside it.
LAMPGLOW_VECTORIZED void trust_of(std::span<const float> signal, float from, float to, float* trust) {
  const float scale = 1.0F / (to - from);
  for (size_t x = 0; x < signal.size(); ++x) {
    const float part = 1.0F - (signal[x] - from) * scale;
    trust[x] = std::min(1.0F, std::max(part, 1e-3F));
  }
}

LAMPGLOW_VECTORIZED void add_pooled(std::span<const float> signal, const float* trust, float exposure_s,
                                    float* pooled, float* seconds) {
  for (size_t x = 0; x < signal.size(); ++x) {
    pooled[x] += trust[x] * signal[x];
    seconds[x] += trust[x] * exposure_s;
  }
}

LAMPGLOW_VECTORIZED void divide_pooled(std::span<float> pooled, const float* seconds) {
  for (size_t x = 0; x < pooled.size(); ++x) pooled[x] = std::max(pooled[x], 0.0F) / seconds[x];
}

// Σ w·signal, Σ w·t, Σ w²·noise of one exposure, with w the inverse of the variance that the pooled radiance
// has in it; times t, that of signal/t multiplied out.
LAMPGLOW_VECTORIZED void add_weighted(std::span<const float> signal, const float* trust, const float* floor,
                                      const float* pooled, float exposure_s, float gain,
                                      float* __restrict sum, float* __restrict weight,
                                      float* __restrict square) {
  for (size_t x = 0; x < signal.size(); ++x) {
    const float noise = gain * pooled[x] * exposure_s + floor[x];
    const float w = trust[x] * exposure_s / noise;
    sum[x] += w * signal[x];
    weight[x] += w * exposure_s;
    square[x] += w * w * noise;
  }
}

LAMPGLOW_VECTORIZED void divide_weighted(std::span<const float> weight, float* __restrict sum,
                                         float* __restrict square) {
  for (size_t x = 0; x < weight.size(); ++x) {
    const float inverse = 1.0F / (weight[x] + 1e-30F);  // a pixel that has none is no division by zero
    sum[x] = sum[x] * inverse;
    square[x] = square[x] * inverse * inverse;
  }
}

LAMPGLOW_VECTORIZED void scale_single(std::span<const float> signal, const float* floor, float per_second,
                                      float gain, float* radiance, float* variance) {
  for (size_t x = 0; x < signal.size(); ++x) {
    radiance[x] = signal[x] * per_second;
    variance[x] = (gain * std::max(signal[x], 0.0F) + floor[x]) * per_second * per_second;
  }
}

}  // namespace

Merger::Merger(std::span<const Layer> layers, const Camera& camera, const RadianceOptions& options,
               std::span<const float> linear)
    : layers_(layers),
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
    const double code_dn = layer.noise.code_noise_dn, read_dn = layer.noise.read_noise_dn;
    const auto floor = static_cast<float>(read_dn * read_dn) + static_cast<float>(code_dn * code_dn);
    buffers_.push_back(
        {std::vector<float>(width_), std::vector<float>(width_), std::vector<float>(width_, floor)});
  }
}

float Merger::saturation_radiance() const {
  return limits_.fade_to / static_cast<float>(layers_.back().effective_s);
}

void Merger::merge_row(int row, RadianceImage& out) {
  for (size_t i = 0; i < layers_.size(); ++i) load_row(i, row);
  if (layers_.size() == 1)
    copy_row(&out.radiance.at(0, row), &out.variance.at(0, row));
  else
    combine_row(&out.radiance.at(0, row), &out.variance.at(0, row));
  mark_row(row, out);
}

// Fills the buffers of layer i. The floor of a linear camera is the same in every row.
void Merger::load_row(size_t i, int row) {
  const Layer& layer = layers_[i];
  const std::uint16_t* dn = &layer.exposure->pixels.at(0, row);
  RowBuffer& buffer = buffers_[i];
  if (is_linear_) {
    subtract_black({dn, width_}, black_, buffer.signal.data());
  } else {
    const auto read = static_cast<float>(layer.noise.read_noise_dn * layer.noise.read_noise_dn);
    for (size_t x = 0; x < width_; ++x) {
      buffer.signal[x] = linear_[dn[x]];
      buffer.floor_variance[x] = read + layer.code_variance[dn[x]];
    }
  }
  trust_of(buffer.signal, limits_.fade_from, limits_.fade_to, buffer.trust.data());
  spread_bloom(i, row);
}

// Pixels that lie within the bloom's radius of a saturated pixel lose their trust.
void Merger::spread_bloom(size_t i, int row) {
  const Layer& layer = layers_[i];
  const auto width = static_cast<int>(width_), height = layer.exposure->pixels.height_px;
  const int from_row = std::max(0, row - bloom_radius_px_);
  const int to_row = std::min(height - 1, row + bloom_radius_px_);
  for (int y = from_row; y <= to_row; ++y) {
    if (layer.brightest_of_row[static_cast<size_t>(y)] < limits_.saturated_dn) continue;
    const std::uint16_t* dn = &layer.exposure->pixels.at(0, y);
    for (int x = 0; x < width; ++x) {
      if (dn[x] < limits_.saturated_dn) continue;
      const int from = std::max(0, x - bloom_radius_px_), to = std::min(width - 1, x + bloom_radius_px_);
      for (int k = from; k <= to; ++k) buffers_[i].trust[static_cast<size_t>(k)] = 0;
    }
  }
}

void Merger::copy_row(float* radiance, float* variance) {
  const RowBuffer& buffer = buffers_[0];
  scale_single(buffer.signal, buffer.floor_variance.data(), static_cast<float>(1 / layers_[0].effective_s),
               static_cast<float>(layers_[0].noise.gain_dn_per_electron), radiance, variance);
}

void Merger::combine_row(float* radiance, float* variance) {
  pooled_.assign(width_, 0);
  seconds_.assign(width_, 1e-30F);
  for (size_t i = 0; i < layers_.size(); ++i)
    add_pooled(buffers_[i].signal, buffers_[i].trust.data(), static_cast<float>(layers_[i].effective_s),
               pooled_.data(), seconds_.data());
  divide_pooled(pooled_, seconds_.data());
  std::fill_n(radiance, width_, 0.0F);
  std::fill_n(variance, width_, 0.0F);
  weight_.assign(width_, 0);
  for (size_t i = 0; i < layers_.size(); ++i)
    add_weighted(buffers_[i].signal, buffers_[i].trust.data(), buffers_[i].floor_variance.data(),
                 pooled_.data(), static_cast<float>(layers_[i].effective_s),
                 static_cast<float>(layers_[i].noise.gain_dn_per_electron), radiance, weight_.data(),
                 variance);
  divide_weighted(weight_, radiance, variance);
}

// Pixels that no exposure is trusted for: bloom where the shortest is not saturated itself, else saturated.
void Merger::mark_row(int row, RadianceImage& out) {
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
    const auto column = static_cast<int>(x);
    const float signal = saturated ? limits_.fade_to : buffers_[last].signal[x];
    out.radiance.at(column, row) = signal * per_second;
    out.variance.at(column, row) =
        (gain * std::max(signal, 0.0F) + buffers_[last].floor_variance[x]) * per_second * per_second;
    out.mask.at(column, row) = saturated ? kSaturated : kBloom;
  }
}

bool Merger::near_saturation(size_t i, int row) const {
  const auto& brightest = layers_[i].brightest_of_row;
  const int from = std::max(0, row - bloom_radius_px_);
  const int to = std::min(static_cast<int>(brightest.size()) - 1, row + bloom_radius_px_);
  for (int y = from; y <= to; ++y)
    if (brightest[static_cast<size_t>(y)] >= limits_.saturated_dn) return true;
  return false;
}

}  // namespace lampglow::photometry
