#include "estimator/inference/relearner.h"

namespace lampglow::inference {

bool Relearner::is_over(TimePoint time) const {
  return night_ && night_number(time, longitude_deg_) > *night_;
}

void Relearner::add(const FrameResult& result) {
  const TimePoint time = result.observation.time_utc;
  const std::int64_t night = night_number(time, longitude_deg_);
  if (night != night_.value_or(night)) return;
  night_ = night;
  if (!frames_.empty() && time <= frames_.back().time_utc) return;  // the clock went back
  if (auto frame = night_frame(result, reference_, options_)) frames_.push_back(std::move(*frame));
  if (auto frame = halo_frame(result, reference_, options_.halos)) halos_.push_back(std::move(*frame));
}

std::optional<Relearner::Settled> Relearner::settle() {
  if (!night_) return std::nullopt;
  Settled settled{learn_from_night(frames_, reference_, options_),
                  learn_halos(halos_, reference_, options_.halos), night_begin(*night_ + 1, longitude_deg_)};
  if (settled.lesson.learned())
    reference_ = changed_reference(reference_, settled.lesson.ln_step, settled.valid_from);
  if (settled.halos.learned()) reference_ = with_halos(reference_, settled.halos.ln_step, settled.valid_from);
  night_.reset();
  frames_.clear();
  halos_.clear();
  return settled;
}

}  // namespace lampglow::inference
