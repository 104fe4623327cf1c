// The merge of a bracket's exposures, row by row.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "estimator/photometry/radiance.h"

namespace lampglow::photometry {

// An exposure on its way into the merge.
struct Layer {
  const Exposure* exposure;
  double effective_s;                           // time times gain; 1 where unknown
  std::vector<std::uint16_t> brightest_of_row;  // DN
  NoiseModel noise;
  std::vector<float> code_variance;  // by DN: slope² · code²; empty if it is the same everywhere
};

class Merger {
 public:
  // `layers`: longest first, at least one; `linear`: signal by DN. Both must outlive this.
  Merger(std::span<const Layer> layers, const Camera& camera, const RadianceOptions& options,
         std::span<const float> linear);

  float saturation_radiance() const;

  // Fills the row's radiance and variance; marks its mask.
  void merge_row(int row, RadianceImage& out);

 private:
  // One row of one exposure: linear signal, trust 0..1, and the part of the variance that is not shot noise.
  struct RowBuffer {
    std::vector<float> signal, trust, floor_variance;
  };
  struct Limits {
    std::uint16_t saturated_dn;  // from here on a pixel is saturated
    float fade_from;             // linear DN where trust begins to fall
    float fade_to;               // and where it is (nearly) zero
  };

  void load_row(size_t i, int row);
  void spread_bloom(size_t i, int row);
  void copy_row(float* radiance, float* variance);
  void combine_row(float* radiance, float* variance);
  void mark_row(int row, RadianceImage& out);
  bool near_saturation(size_t i, int row) const;

  std::span<const Layer> layers_;
  std::span<const float> linear_;
  size_t width_;
  bool is_linear_;
  float black_;
  int bloom_radius_px_;
  Limits limits_{};
  std::vector<RowBuffer> buffers_;
  std::vector<float> weight_, pooled_, seconds_;
};

}  // namespace lampglow::photometry
