// The one registry of quality flags: the single source for the code, the CSV, the database and the HTTP
// answers. A flag's bit and name never change their meaning; new ones are added at the end.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>

namespace lampglow {

enum class Quality : std::uint8_t {
  // The frame itself.
  frame_missing = 0,
  frame_truncated = 1,
  frame_wrong_size = 2,
  frame_wrong_depth = 3,
  frame_undecodable = 4,
  frame_too_large = 5,
  frame_blank = 6,
  frame_frozen = 7,
  // What the camera and the site let us do.
  daylight = 8,
  twilight = 9,
  no_reference = 10,
  no_lights = 11,
  unknown_distance = 12,
  no_angular_scale = 13,
  automatic_exposure = 14,
  saturated = 15,
  not_registered = 16,
  camera_moved = 17,
  // What the fit says.
  few_lights = 18,
  lights_missing = 19,
  stray_lights = 20,
  gain_drift = 21,
  fit_not_converged = 22,
  poor_fit = 23,
  at_bound = 24,
  q_unknown = 25,
  limit_above = 26,
  limit_below = 27,
  no_lamp_visible = 28,
  moving_lights = 29,
  calibrated_distance = 30,
  // 31 was window_dirty, which nothing ever set.
  // By day.
  no_targets = 32,
  sun_in_picture = 33,
  low_sun = 34,
  shadows = 35,
  snow = 36,
  rain_on_window = 37,
  night_mode = 38,
  // The station.
  clock_unsynchronised = 39,
  camera_not_locked = 40,
  internal_error = 41,
};

struct QualityFlag {
  Quality flag;
  std::string_view name;     // as written in CSV, database and JSON
  std::string_view meaning;  // one sentence for the documentation
};

// All flags, in the order of their bits.
std::span<const QualityFlag> quality_registry();

// A set of flags.
class QualityFlags {
 public:
  void set(Quality flag) { bits_ |= bit(flag); }
  void set(QualityFlags other) { bits_ |= other.bits_; }
  void clear(Quality flag) { bits_ &= ~bit(flag); }
  bool has(Quality flag) const { return (bits_ & bit(flag)) != 0; }
  bool empty() const { return bits_ == 0; }
  std::uint64_t bits() const { return bits_; }
  static QualityFlags from_bits(std::uint64_t bits) {
    QualityFlags flags;
    flags.bits_ = bits;
    return flags;
  }
  bool operator==(const QualityFlags&) const = default;

  // "daylight;no_reference", in the order of the registry; empty text for no flag.
  std::string to_string() const;

 private:
  static std::uint64_t bit(Quality flag) { return std::uint64_t{1} << static_cast<unsigned>(flag); }
  std::uint64_t bits_ = 0;
};

}  // namespace lampglow
