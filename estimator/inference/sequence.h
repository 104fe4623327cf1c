// What only the course of time shows: means of extinction, the class of weather with hysteresis, fog that
// thins, thickens or stands, and the past hour. Observations go in one by one, in order of time; state is
// held for one camera.
#pragma once

#include <deque>
#include <optional>

#include "estimator/observation.h"

namespace lampglow::inference {

struct SequenceOptions {
  double clear_again = 1.2;  // a class is left only this far beyond its limit (FD12P)
  double hold_s = 1200;      // an older class is no reason to hold on to it
  double fog_mor_m = 1000, mist_mor_m = 5000;
  double history_s = 3600;
  double trend_window_s = 1200;  // last 20 minutes of the hour against the first 20
  double trend_change = 0.3;     // of MOR: over 30 % is thinning or thickening
  double shared_error = 0.5;     // part of an observation's error that the next ones share (strengths, drift)
};

// Mean of extinction over a period, never of visibility. Limits count with the value they bound and make the
// mean a limit of the same kind; with both kinds among them there is no mean.
struct ExtinctionMean {
  double extinction_per_m = 0;
  double sigma_per_m = 0;  // one standard deviation, propagated
  Limit limit = Limit::none;
  int count = 0;
};

class Sequence {
 public:
  explicit Sequence(const SequenceOptions& options = {}) : options_(options) {}

  // Sets weather (with hysteresis) and WMO 4680 (with the past hour) of the observation and remembers it. An
  // observation that is older than the last is returned as it is.
  Observation add(Observation observation);

  // Over the `period_s` that end with the newest observation; empty without a value in it.
  std::optional<ExtinctionMean> mean(double period_s) const;

 private:
  Weather with_hysteresis(const Observation& observation) const;
  std::optional<int> present_weather(const Observation& observation) const;
  std::optional<double> mean_between(double from_s_ago, double to_s_ago, int least) const;

  SequenceOptions options_;
  std::deque<Observation> past_;
};

}  // namespace lampglow::inference
