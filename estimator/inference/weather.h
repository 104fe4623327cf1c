// Weather from q, extinction and (optional) humidity: the lecture's q classes, and what people call it.
#pragma once

#include <array>
#include <optional>

#include "estimator/observation.h"

namespace lampglow::inference {

// The lecture's classes by q alone (after van de Hulst 1957): air 0–0.2 and small aerosol 0.2–0.7 count as
// clear, haze 0.7–0.8, mist 0.8–0.85, fog 0.85–0.9, rain 0.9–1.
Weather lecture_class(double q);

struct AirEstimate {
  double ln_sigma = 0, ln_sigma_sd = 0;                         // posterior, about normal
  std::optional<double> q = std::nullopt, q_sd = std::nullopt;  // empty: q says nothing
  // By how much q reads too high if the lamps send their light down; whether they do is not known.
  double q_excess_of_luminaires = 0;
  std::optional<double> relative_humidity = std::nullopt;  // 0..1
  Limit limit = Limit::none;
};

// By Weather's number; sums to 1. Likelihood of q and ln MOR under each class (METAR's limits: fog below 1000
// m, mist and haze 1000–5000 m, clear above; rain anywhere up to 10 km with q above 0.9), equal priors;
// humidity above 0.95 speaks for mist and fog, below 0.8 for haze.
std::array<double, 6> weather_probabilities(const AirEstimate& air);

// The class if its probability is at least `sure`; else unknown.
Weather decide_weather(const std::array<double, 6>& probability, double sure = 0.5);

// WMO code table 4680 for one moment, without the past hour: 0, 4, 5, 10, 30, 60 (rain, seen only by its q);
// empty if unknown.
std::optional<int> wmo_4680_now(Weather weather, double mor_m);

}  // namespace lampglow::inference
