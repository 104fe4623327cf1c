// A simulated night, its clear reference, and the fits that the program asks for when it estimates a frame.
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "daemon/sources/archive.h"
#include "estimator/estimate.h"
#include "estimator/inference/modes.h"

namespace lampglow::bench {

// Processor time of this process, s: what other programs do meanwhile does not count.
double cpu_s();

// Median over an odd number of runs of the time that `work` takes, s.
double median_cpu_s(int runs, const std::function<void()>& work);

double median(std::vector<double> values);

// `lampglow simulate` to `folder`; throws std::runtime_error with what it complained about.
void simulate(const std::filesystem::path& folder, const std::vector<std::string>& arguments);

// What one search for a frame's modes was given, and the fit it led to: the last search of a frame alone.
struct FitCall {
  inference::Scene scene;
  inference::RingData data;
  inference::FitOptions options;
  std::optional<inference::JointFit> fit;
  double cpu_s = 0;
};

struct Estimated {
  FrameResult result;
  std::vector<FitCall> fits;  // more than one where lamps may be off

  double fit_cpu_s() const;
};

// An archive whose pictures are read when they are wanted.
class Night {
 public:
  Night(const std::filesystem::path& archive, int rings);

  // Oldest first, and the true visibility of each, m.
  const std::vector<daemon::ArchiveBracket>& observations() const { return observations_; }
  const std::vector<double>& mor_m() const { return mor_m_; }

  const Site& site() const { return site_; }
  const ClearReference& reference() const { return *reference_; }
  const EstimatorOptions& options() const { return options_; }

  Bracket load(const daemon::ArchiveBracket& entry) const;
  FrameResult estimate(const Bracket& bracket) const;
  Estimated estimate_and_keep_fits(const Bracket& bracket) const;

 private:
  std::filesystem::path archive_;
  Site site_;
  EstimatorOptions options_;
  std::optional<ClearReference> reference_;
  std::vector<daemon::ArchiveBracket> observations_;
  std::vector<double> mor_m_;
};

// The fit alone, once more, of the same data.
void fit_again(const FitCall& call);

}  // namespace lampglow::bench
