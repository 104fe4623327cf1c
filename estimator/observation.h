// What one frame says about the air: the type that storage keeps and web serves.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "estimator/quality.h"
#include "estimator/time.h"

namespace lampglow {

// Stored numbers: they never change their meaning.
enum class Limit : int { none = 0, above = 1, below = 2 };
enum class Method : int { none = 0, glow = 1, contrast = 2 };
enum class Weather : int { unknown = 0, clear = 1, haze = 2, mist = 3, fog = 4, rain = 5 };
enum class LampState : int { unknown = 0, seen = 1, faded = 2, off = 3, hidden = 4, saturated = 5 };

std::string_view to_string(Limit value);  // "", "above", "below"
std::string_view to_string(Method value);
std::string_view to_string(Weather value);
std::string_view to_string(LampState value);
std::optional<Weather> parse_weather(std::string_view text);

// MOR is the 5 % definition of WMO and CIE: ln(1/0.05)/σ = 2.996/σ. The lecture's meteorological visibility
// is 3.912/σ.
inline constexpr double kMorTimesExtinction = 2.995732273553991;
inline constexpr double kTwoPercentVisibilityTimesExtinction = 3.912023005428146;

// Unknown is an empty optional, never 0. With limit `above`, extinction_per_m is the highest that the data
// allow (95 %), so that mor_m() is "at least"; with `below`, the lowest, so that mor_m() is "at most".
struct Observation {
  TimePoint time_utc{};
  std::optional<double> extinction_per_m;      // σ, > 0
  std::optional<double> extinction_low_per_m;  // 95 % bounds of σ
  std::optional<double> extinction_high_per_m;
  Limit limit = Limit::none;
  std::optional<double> q;  // Henyey-Greenstein asymmetry, 0..1
  std::optional<double> q_low;
  std::optional<double> q_high;
  Weather weather = Weather::unknown;
  std::array<double, 6>
      weather_probability{};                // by Weather's number; sums to 1, or all 0 where nothing is known
  std::optional<Weather> lecture_class;     // by the lecture's q classes alone
  std::optional<int> wmo_4680;              // present weather, automatic station, code table 4680
  std::optional<double> relative_humidity;  // 0..1, if the station has a hygrometer
  Method method = Method::none;
  int lights_used = 0;  // lamps, or targets by day
  QualityFlags quality;

  std::optional<double> mor_m() const;
  std::optional<double> mor_low_m() const;   // from extinction_high_per_m
  std::optional<double> mor_high_m() const;  // from extinction_low_per_m
};

// The ring profile of one lamp and its fit, for people to look at. All vectors have the same length.
struct RingProfile {
  std::vector<double> theta_deg;       // ring's mean angle from the lamp
  std::vector<double> radiance;        // linear units of the camera, background included
  std::vector<double> radiance_sigma;  // one standard deviation
  std::vector<double> model;           // the fit's value for the same ring; empty if not fitted
};

// What became of one lamp in one frame.
struct LampFit {
  std::string id;
  LampState state = LampState::unknown;
  double x_px = 0, y_px = 0;  // where it was looked for in this frame
  std::optional<double> distance_m;
  std::optional<double> strength_ratio;     // fitted strength over the reference's
  std::optional<double> optical_thickness;  // σR
  std::optional<double> residual_rms;       // of the fit, in standard deviations
  // ln of its halo's strength in fog over the reference's, as this frame's picture alone says: without the
  // fit's prior. Empty where the picture tells nothing of it.
  std::optional<double> ln_halo, ln_halo_sigma;
  RingProfile profile;
};

// A frame's whole result.
struct FrameResult {
  Observation observation;
  std::vector<LampFit> lamps;
  double shift_x_px = 0, shift_y_px = 0, rotation_rad = 0;  // registration to the reference
  std::string reason;  // why there is no value, in words; empty if there is one
};

}  // namespace lampglow
