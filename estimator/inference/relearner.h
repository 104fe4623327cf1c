// The clear reference of one camera over the nights: what relearn.h teaches, held from frame to frame. The
// reference changes at noon only, so that all frames of a night are measured against the same.
#pragma once

#include <optional>
#include <vector>

#include "estimator/inference/relearn.h"

namespace lampglow::inference {

class Relearner {
 public:
  Relearner(ClearReference reference, const RelearnOptions& options, std::optional<double> longitude_deg)
      : options_(options), longitude_deg_(longitude_deg), reference_(std::move(reference)) {}

  const ClearReference& reference() const { return reference_; }

  // A frame's result, measured against reference(); in the order of time. One of another night than those
  // before it is not taken before settle().
  void add(const FrameResult& result);

  // Does this time belong to a later night than what was added?
  bool is_over(TimePoint time) const;

  // The night is over: what it taught, and from when on. Empty if nothing was added.
  struct Settled {
    Lesson lesson;
    HaloLesson halos;
    TimePoint valid_from{};  // the noon after the night
    bool learned() const { return lesson.learned() || halos.learned(); }
  };
  std::optional<Settled> settle();

 private:
  RelearnOptions options_;
  std::optional<double> longitude_deg_;
  ClearReference reference_;
  std::optional<std::int64_t> night_;
  std::vector<NightFrame> frames_;
  std::vector<HaloFrame> halos_;
};

}  // namespace lampglow::inference
