// Ends a search of Ceres' between two of its steps, when its answer is no longer wanted. This folder's .cpp
// files only.
#pragma once

#include <ceres/iteration_callback.h>

#include <functional>

namespace lampglow::inference {

// What the solver then has is to be thrown away: stop_if_given_up() after ceres::Solve().
class SolverStop final : public ceres::IterationCallback {
 public:
  explicit SolverStop(const std::function<bool()>& given_up) : given_up_(given_up) {}
  ceres::CallbackReturnType operator()(const ceres::IterationSummary&) override {
    return given_up_ && given_up_() ? ceres::SOLVER_ABORT : ceres::SOLVER_CONTINUE;
  }

 private:
  const std::function<bool()>& given_up_;
};

}  // namespace lampglow::inference
