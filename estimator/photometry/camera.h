// The camera as its site file describes it.
#pragma once

#include <optional>
#include <vector>

namespace lampglow {

// From digital number to light: linear, the sRGB curve, or a measured curve.
struct Response {
  enum class Kind { linear, srgb, curve };
  Kind kind = Kind::linear;
  std::vector<double>
      curve;  // for Kind::curve: relative linear value for each DN, 2^bit_depth entries, non-decreasing
};

struct Camera {
  int width_px = 0;
  int height_px = 0;
  std::optional<double> focal_length_px;  // pinhole
  double principal_x_px = 0;              // the picture's middle unless the site file says otherwise
  double principal_y_px = 0;
  int bit_depth = 8;  // 8..16
  double black_level_dn = 0;
  double saturation_dn = 255;
  Response response;
  // The lens lets through 1 + Σ_k v_k ρ^(2k), k from 1, of what it does in the middle; ρ: distance from the
  // principal point over half the picture's diagonal. Empty: even.
  std::vector<double> vignetting;
  std::optional<double> read_noise_dn;
  std::optional<double> gain_dn_per_electron;
};

}  // namespace lampglow
