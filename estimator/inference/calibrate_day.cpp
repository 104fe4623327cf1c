#include "estimator/inference/calibrate_day.h"

#include <ceres/ceres.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <set>

namespace lampglow::inference {
namespace {

// Parameters of a target: ln contrast, ln distance, ln floor over contrast, answers to the two lighting
// factors. Of a frame: ln σ and its two lighting factors.
constexpr int kTarget = 5, kFrame = 3;
using TargetParameters = std::array<double, kTarget>;
using FrameParameters = std::array<double, kFrame>;

struct Model {
  std::vector<TargetParameters> targets;
  std::vector<FrameParameters> frames;
  std::vector<double> scatter;  // of each target's ln contrast
};

// ln of the gradient energy of one target in one frame, against contrast_fit's model.
struct EnergyResidual {
  double log_energy, noise_energy, scatter;
  template <typename T>
  bool operator()(const T* target, const T* frame, T* residual) const {
    const T u = target[0] + target[3] * frame[1] + target[4] * frame[2] - exp(frame[0] + target[1]);
    const T model = log(exp(2.0 * u) + exp(2.0 * (target[0] + target[2])) + noise_energy);
    residual[0] = (log_energy - model) / (2.0 * scatter);
    return true;
  }
};

struct TargetPrior {
  TargetParameters mean, sigma;
  template <typename T>
  bool operator()(const T* target, T* residual) const {
    for (size_t i = 0; i < kTarget; ++i) residual[i] = (target[i] - mean[i]) / sigma[i];
    return true;
  }
};

struct FramePrior {
  FrameParameters mean, sigma;
  template <typename T>
  bool operator()(const T* frame, T* residual) const {
    for (size_t i = 0; i < kFrame; ++i) residual[i] = (frame[i] - mean[i]) / sigma[i];
    return true;
  }
};

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// What learning works on: the targets by index into the samples' views, the frames by index into the samples.
struct Data {
  const std::vector<DaySample>* samples;
  std::vector<size_t> targets, frames;
  std::vector<bool> skyline;  // of `targets`
  const TargetView& at(size_t target, size_t frame) const {
    return (*samples)[frames[frame]].view.targets[targets[target]];
  }
  double ln_sigma(size_t frame) const {
    return std::log(kMorTimesExtinction / (*samples)[frames[frame]].mor_m);
  }
};

TargetPrior target_prior(const Data& data, size_t target, const DayLearningOptions& o) {
  // A sunlit texture follows the light; an edge against the sky hardly does.
  return {{0, std::log(o.distance_m), o.floor_ln, data.skyline[target] ? 0.2 : 1.0, 0},
          {100, o.distance_ln_sigma, o.floor_ln_sigma, o.lighting_sigma, o.lighting_sigma}};
}

double ln_contrast_seen(const TargetView& view) {
  return 0.5 * std::log(std::max(view.gradient_energy - view.noise_energy, 0.02 * view.noise_energy + 1e-12));
}

// Starts at the contrast of the clearer half of the frames.
Model first_guess(const Data& data, const DayLearningOptions& o) {
  Model model;
  std::vector<double> ln_sigmas;
  for (size_t f = 0; f < data.frames.size(); ++f) ln_sigmas.push_back(data.ln_sigma(f));
  const double middle = median(ln_sigmas);
  for (size_t t = 0; t < data.targets.size(); ++t) {
    std::vector<double> clear;
    for (size_t f = 0; f < data.frames.size(); ++f)
      if (ln_sigmas[f] <= middle) clear.push_back(ln_contrast_seen(data.at(t, f)));
    TargetParameters start = target_prior(data, t, o).mean;
    start[0] = median(clear);
    start[1] = std::log(200.0);
    model.targets.push_back(start);
  }
  for (const double ln_sigma : ln_sigmas) model.frames.push_back({ln_sigma, 0, 0});
  model.scatter.assign(data.targets.size(), o.scatter);
  return model;
}

// Maximum a posteriori of all parameters together; the second lighting factor is held where `one_factor`.
bool solve(const Data& data, const DayLearningOptions& o, bool one_factor, Model& model) {
  ceres::Problem problem;
  auto* ordering = new ceres::ParameterBlockOrdering;  // the solver's options take it over
  for (size_t t = 0; t < data.targets.size(); ++t) {
    for (size_t f = 0; f < data.frames.size(); ++f) {
      const TargetView& seen = data.at(t, f);
      if (seen.gradient_energy <= 0) continue;
      problem.AddResidualBlock(
          new ceres::AutoDiffCostFunction<EnergyResidual, 1, kTarget, kFrame>(
              new EnergyResidual{std::log(seen.gradient_energy), seen.noise_energy, model.scatter[t]}),
          new ceres::CauchyLoss(2.0), model.targets[t].data(), model.frames[f].data());
    }
    problem.AddResidualBlock(new ceres::AutoDiffCostFunction<TargetPrior, kTarget, kTarget>(
                                 new TargetPrior(target_prior(data, t, o))),
                             nullptr, model.targets[t].data());
    if (one_factor) problem.SetManifold(model.targets[t].data(), new ceres::SubsetManifold(kTarget, {4}));
    ordering->AddElementToGroup(model.targets[t].data(), 0);
  }
  for (size_t f = 0; f < data.frames.size(); ++f) {
    problem.AddResidualBlock(new ceres::AutoDiffCostFunction<FramePrior, kFrame, kFrame>(
                                 new FramePrior{{data.ln_sigma(f), 0, 0}, {o.truth_sigma, 1, 1}}),
                             nullptr, model.frames[f].data());
    if (one_factor) problem.SetManifold(model.frames[f].data(), new ceres::SubsetManifold(kFrame, {2}));
    ordering->AddElementToGroup(model.frames[f].data(), 1);
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.linear_solver_ordering.reset(ordering);
  options.max_num_iterations = 60;
  options.function_tolerance = 1e-5;
  options.num_threads = 1;  // the same bytes every time
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  return summary.IsSolutionUsable();
}

double residual(const Data& data, const Model& model, size_t t, size_t f) {
  const TargetParameters& p = model.targets[t];
  const FrameParameters& q = model.frames[f];
  const double u = p[0] + p[3] * q[1] + p[4] * q[2] - std::exp(q[0] + p[1]);
  const TargetView& seen = data.at(t, f);
  return 0.5 * (std::log(seen.gradient_energy) -
                log_gradient_energy(u, std::exp(2 * (p[0] + p[2])), seen.noise_energy));
}

// The second lighting factor starts as the strongest pattern that the first left over (power iteration).
void seed_second_factor(const Data& data, Model& model) {
  std::vector<double> pattern(data.targets.size(), 0.0), course(data.frames.size(), 1.0);
  for (size_t f = 0; f < course.size(); ++f) course[f] = f % 2 == 0 ? 1.0 : -0.5;
  for (int round = 0; round < 20; ++round) {
    double norm = 0;
    for (size_t t = 0; t < pattern.size(); ++t) {
      pattern[t] = 0;
      for (size_t f = 0; f < course.size(); ++f)
        pattern[t] += std::clamp(residual(data, model, t, f), -0.5, 0.5) * course[f];
      norm += pattern[t] * pattern[t];
    }
    norm = std::sqrt(norm) + 1e-12;
    for (double& p : pattern) p /= norm;
    for (size_t f = 0; f < course.size(); ++f) {
      course[f] = 0;
      for (size_t t = 0; t < pattern.size(); ++t)
        course[f] += std::clamp(residual(data, model, t, f), -0.5, 0.5) * pattern[t];
    }
  }
  double power = 0;
  for (const double c : course) power += c * c;
  const double scale = std::sqrt(power / static_cast<double>(course.size())) + 1e-12;
  for (size_t t = 0; t < pattern.size(); ++t) model.targets[t][4] = pattern[t] * scale;
  for (size_t f = 0; f < course.size(); ++f) model.frames[f][2] = course[f] / scale;
}

void measure_scatter(const Data& data, const DayLearningOptions& o, Model& model) {
  for (size_t t = 0; t < data.targets.size(); ++t) {
    std::vector<double> off;
    for (size_t f = 0; f < data.frames.size(); ++f) off.push_back(std::abs(residual(data, model, t, f)));
    model.scatter[t] = std::max(1.4826 * median(off), o.least_scatter);
  }
}

std::optional<Model> fit(const Data& data, const DayLearningOptions& o) {
  Model model = first_guess(data, o);
  if (!solve(data, o, true, model)) return std::nullopt;
  seed_second_factor(data, model);
  if (!solve(data, o, false, model)) return std::nullopt;
  measure_scatter(data, o, model);
  return model;
}

// One standard deviation of ln distance with the frames held (their error is common and stands in
// log_extinction_sigma).
double ln_distance_sigma(const Model& model, size_t t, const DayLearningOptions& o) {
  double information = 1 / (o.distance_ln_sigma * o.distance_ln_sigma);
  const TargetParameters& p = model.targets[t];
  for (const FrameParameters& q : model.frames) {
    const double tau = std::exp(q[0] + p[1]);
    const double u = p[3] * q[1] + p[4] * q[2] - tau;
    const double part = std::exp(2 * u) / (std::exp(2 * u) + std::exp(2 * p[2]));
    information += part * part * tau * tau / (model.scatter[t] * model.scatter[t]);
  }
  return 1 / std::sqrt(information);
}

DayLearning learned(const Data& data, const Model& model, const std::vector<Target>& targets,
                    const DayCalibration& day, const DayLearningOptions& o) {
  DayLearning result;
  result.day = day;
  result.day.independent_targets = o.independent_targets;
  result.samples = static_cast<int>(data.frames.size());
  for (size_t t = 0; t < data.targets.size(); ++t) {
    const TargetParameters& p = model.targets[t];
    if (model.scatter[t] > o.most_scatter || p[1] < std::log(o.nearest_m)) continue;
    Target target = targets[data.targets[t]];
    target.distance_m = std::exp(p[1]);
    target.distance_sigma_m = *target.distance_m * ln_distance_sigma(model, t, o);
    target.contrast = TargetContrast{p[0], model.scatter[t], p[2], {p[3], p[4]}};
    result.targets.push_back(target);
  }
  return result;
}

// The views of the learned targets alone, in their order.
DayView view_of(const DaySample& sample, const std::vector<Target>& all, const std::vector<Target>& chosen) {
  DayView view = sample.view;
  view.targets.clear();
  for (const Target& target : chosen)
    for (size_t i = 0; i < all.size(); ++i)
      if (all[i].id == target.id) view.targets.push_back(sample.view.targets[i]);
  return view;
}

using Hour = std::chrono::time_point<std::chrono::system_clock, std::chrono::hours>;
Hour hour_of(TimePoint time) {
  return std::chrono::floor<std::chrono::hours>(time);
}

// Every hour estimated from what the other hours teach.
std::vector<double> cross_validate(const Data& all, const std::vector<Target>& targets,
                                   const DayCalibration& day, const DayLearningOptions& o) {
  std::set<Hour> hours;
  for (const size_t f : all.frames) hours.insert(hour_of((*all.samples)[f].time_utc));
  std::vector<double> errors;
  if (hours.size() < 3) return errors;
  for (const Hour hour : hours) {
    Data rest = all;
    std::erase_if(rest.frames, [&](size_t f) { return hour_of((*all.samples)[f].time_utc) == hour; });
    const std::optional<Model> model = fit(rest, o);
    if (!model) continue;
    const DayLearning learning = learned(rest, *model, targets, day, o);
    Site site;
    site.targets = learning.targets;
    site.day = learning.day;
    for (const DaySample& sample : *all.samples) {
      if (hour_of(sample.time_utc) != hour || sample.mor_m > o.farthest_judged_m) continue;
      const ContrastFit found = fit_contrast(view_of(sample, targets, learning.targets), site);
      if (found.posterior.empty()) continue;
      const SigmaBounds bounds = sigma_bounds(found.posterior, {.widest_ratio = 8.0});
      if (bounds.limit == Limit::none)
        errors.push_back(std::log(bounds.value * sample.mor_m / kMorTimesExtinction));
    }
  }
  return errors;
}

Data all_data(const std::vector<DaySample>& samples, const std::vector<bool>& skyline) {
  Data data{&samples, {}, {}, {}};
  for (size_t f = 0; f < samples.size(); ++f) data.frames.push_back(f);
  for (size_t t = 0; t < skyline.size(); ++t) {
    bool seen = true;
    for (const DaySample& sample : samples) seen = seen && sample.view.targets[t].gradient_energy > 0;
    if (!seen) continue;
    data.targets.push_back(t);
    data.skyline.push_back(skyline[t]);
  }
  return data;
}

}  // namespace

std::optional<DayLearning> learn_day(const std::vector<DaySample>& samples,
                                     const std::vector<Target>& targets, const std::vector<bool>& skyline,
                                     const DayCalibration& day, const DayLearningOptions& options,
                                     std::string& why) {
  if (static_cast<int>(samples.size()) < options.least_samples) {
    why = "too few daylight frames with a known visibility: " + std::to_string(samples.size()) +
          " of at least " + std::to_string(options.least_samples);
    return std::nullopt;
  }
  const auto [least, most] = std::minmax_element(
      samples.begin(), samples.end(), [](const auto& a, const auto& b) { return a.mor_m < b.mor_m; });
  if (most->mor_m < 3 * least->mor_m) {
    why = "the visibility of the daylight frames changes by less than a factor of 3";
    return std::nullopt;
  }
  const Data data = all_data(samples, skyline);
  std::optional<Model> model;
  if (static_cast<int>(data.targets.size()) >= options.least_targets) model = fit(data, options);
  if (!model) {
    why = "too few targets are seen in every frame, or the fit failed";
    return std::nullopt;
  }
  DayLearning result = learned(data, *model, targets, day, options);
  if (static_cast<int>(result.targets.size()) < options.least_targets) {
    why = "too few targets fade with the visibility: " + std::to_string(result.targets.size()) +
          " of at least " + std::to_string(options.least_targets);
    return std::nullopt;
  }
  std::vector<double> errors = cross_validate(data, targets, day, options);
  for (double& error : errors) error = std::abs(error);
  result.cross_validated = static_cast<int>(errors.size());
  result.cross_median_abs_ln = errors.empty() ? 0 : median(errors);
  // Too little to validate with: an assumption, which the report says.
  result.day.log_extinction_sigma = errors.size() < 5 ? options.most_error
                                                      : std::clamp(1.4826 * result.cross_median_abs_ln,
                                                                   options.least_error, options.most_error);
  return result;
}

}  // namespace lampglow::inference
