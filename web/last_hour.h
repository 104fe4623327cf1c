// The last hour of one camera, for running means and the trend.
#pragma once

#include <deque>
#include <string>

#include "estimator/observation.h"
#include "storage/records.h"

namespace lampglow::web {

class LastHour {
 public:
  // Frames of later times than this one (the clock was set back) are forgotten.
  void add(const Observation& observation);
  // The mean of (end - period, end], end being the latest frame's time. There must be one.
  storage::ObservationRow running_mean(int period_s) const;
  // "improving", "steady", "worsening"; empty: not known.
  std::string trend() const;

 private:
  // Of the period that ended `until_s` before the latest frame.
  storage::ObservationRow mean_of_period(int period_s, int until_s) const;

  std::deque<Observation> frames_;
};

}  // namespace lampglow::web
