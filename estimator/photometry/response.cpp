#include "estimator/photometry/response.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace lampglow::photometry {

double srgb_to_linear(double code) {
  if (code <= 0.04045) return code / 12.92;
  return std::pow((code + 0.055) / 1.055, 2.4);
}

double linear_to_srgb(double light) {
  if (light <= 0.0031308) return light * 12.92;
  return 1.055 * std::pow(light, 1 / 2.4) - 0.055;
}

std::string camera_fault(const Camera& camera) {
  if (camera.bit_depth < 8 || camera.bit_depth > 16)
    return "camera.bit_depth = " + std::to_string(camera.bit_depth) + ": must be 8 to 16";
  const double highest = std::exp2(camera.bit_depth) - 1;
  if (!(camera.saturation_dn <= highest))
    return "camera.saturation_dn = " + std::to_string(camera.saturation_dn) + ": must be at most " +
           std::to_string(highest);
  if (!(camera.black_level_dn >= 0 && camera.black_level_dn < camera.saturation_dn))
    return "camera.black_level_dn = " + std::to_string(camera.black_level_dn) +
           ": must be at least 0 and below saturation_dn";
  if (camera.response.kind != Response::Kind::curve) return "";
  const std::vector<double>& curve = camera.response.curve;
  if (curve.size() != static_cast<size_t>(highest) + 1)
    return "camera.response: the curve has " + std::to_string(curve.size()) + " rows, must have " +
           std::to_string(static_cast<size_t>(highest) + 1);
  if (!std::is_sorted(curve.begin(), curve.end())) return "camera.response: the curve must not decrease";
  if (!(curve[static_cast<size_t>(camera.saturation_dn)] > curve[static_cast<size_t>(camera.black_level_dn)]))
    return "camera.response: the curve must rise from black_level_dn to saturation_dn";
  return "";
}

std::vector<float> linear_table(const Camera& camera) {
  if (const std::string fault = camera_fault(camera); !fault.empty()) throw std::invalid_argument(fault);
  const double black = camera.black_level_dn;
  const double range = camera.saturation_dn - black;
  const auto& curve = camera.response.curve;
  std::vector<float> table(size_t{1} << camera.bit_depth);
  for (size_t dn = 0; dn < table.size(); ++dn) {
    const double above = static_cast<double>(dn) - black;
    double linear = above;
    if (camera.response.kind == Response::Kind::srgb) {
      linear = range * srgb_to_linear(above / range);
    } else if (camera.response.kind == Response::Kind::curve) {
      const double dark = curve[static_cast<size_t>(black)];
      linear = range * (curve[dn] - dark) / (curve[static_cast<size_t>(camera.saturation_dn)] - dark);
    }
    table[dn] = static_cast<float>(linear);
  }
  return table;
}

}  // namespace lampglow::photometry
