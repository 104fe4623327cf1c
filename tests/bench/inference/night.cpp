#include "tests/bench/inference/night.h"

#include <algorithm>
#include <ctime>
#include <map>
#include <stdexcept>

#include "daemon/config/site_file.h"
#include "daemon/sources/truth.h"
#include "tests/support/run_program.h"

namespace lampglow::bench {
namespace {

std::vector<FitCall>* kept_fits = nullptr;  // where calls are kept; null: they are not

}  // namespace

namespace linked {

using namespace inference;

Modes real_find_modes(const Scene& scene, const HaloModel& halo, const RingData& data,
                      const FitOptions& options) asm("__real_" LAMPGLOW_FIND_MODES);
JointFit real_complete(const Scene& scene, const HaloModel& halo, const FitOptions& options,
                       Modes found) asm("__real_" LAMPGLOW_COMPLETE);

// What every call of find_modes() and complete() in this program comes to.
Modes observed_find_modes(const Scene& scene, const HaloModel& halo, const RingData& data,
                          const FitOptions& options) asm("__wrap_" LAMPGLOW_FIND_MODES);
JointFit observed_complete(const Scene& scene, const HaloModel& halo, const FitOptions& options,
                           Modes found) asm("__wrap_" LAMPGLOW_COMPLETE);

Modes observed_find_modes(const Scene& scene, const HaloModel& halo, const RingData& data,
                          const FitOptions& options) {
  const double begin = cpu_s();
  Modes found = real_find_modes(scene, halo, data, options);
  const double took = cpu_s() - begin;
  if (kept_fits) kept_fits->push_back({scene, data, options, {}, took});
  return found;
}

JointFit observed_complete(const Scene& scene, const HaloModel& halo, const FitOptions& options,
                           Modes found) {
  const double begin = cpu_s();
  JointFit fit = real_complete(scene, halo, options, std::move(found));
  const double took = cpu_s() - begin;
  if (!kept_fits) return fit;
  kept_fits->back().fit = fit;
  kept_fits->back().cpu_s += took;
  return fit;
}

}  // namespace linked

double cpu_s() {
  timespec now{};
  ::clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

double median_cpu_s(int runs, const std::function<void()>& work) {
  std::vector<double> times;
  for (int i = 0; i < runs; ++i) {
    const double begin = cpu_s();
    work();
    times.push_back(cpu_s() - begin);
  }
  return median(std::move(times));
}

void simulate(const std::filesystem::path& folder, const std::vector<std::string>& arguments) {
  std::vector<std::string> all{"simulate", folder.string(), "--photons", "100000", "--workers", "2"};
  all.insert(all.end(), arguments.begin(), arguments.end());
  const test::ProgramRun run = test::run_program(all);
  if (run.exit_code != 0) throw std::runtime_error("lampglow simulate: " + run.err);
}

double Estimated::fit_cpu_s() const {
  double sum = 0;
  for (const FitCall& call : fits) sum += call.cpu_s;
  return sum;
}

Night::Night(const std::filesystem::path& archive, int rings)
    : archive_(archive), site_(daemon::read_site_file(archive / "site.toml")) {
  options_.reference.rings.rings = rings;
  const std::vector<daemon::ArchiveBracket> entries = daemon::read_frames_csv(archive);
  for (const daemon::ArchiveBracket& entry : entries)
    if (entry.role != FrameRole::clear_reference) observations_.push_back(entry);
  std::map<TimePoint, double> truth;
  for (const daemon::Truth& row : daemon::read_truth(archive / "truth.csv"))
    truth[row.time_utc] = row.mor_m.value();
  for (const daemon::ArchiveBracket& entry : observations_) mor_m_.push_back(truth.at(entry.time_utc));
  reference_ = learn_reference(daemon::clear_brackets(archive, entries, site_.camera), site_, options_);
  if (!reference_) throw std::runtime_error(archive.string() + ": no clear reference");
}

Bracket Night::load(const daemon::ArchiveBracket& entry) const {
  return daemon::load_bracket(archive_, entry, site_.camera);
}

FrameResult Night::estimate(const Bracket& bracket) const {
  return lampglow::estimate(bracket, site_, reference_, options_);
}

Estimated Night::estimate_and_keep_fits(const Bracket& bracket) const {
  Estimated estimated;
  kept_fits = &estimated.fits;
  estimated.result = estimate(bracket);
  kept_fits = nullptr;
  return estimated;
}

void fit_again(const FitCall& call) {
  const auto halo = inference::halo_model(inference::HaloKind::table);
  inference::Modes found = linked::real_find_modes(call.scene, *halo, call.data, call.options);
  if (call.fit) linked::real_complete(call.scene, *halo, call.options, std::move(found));
}

}  // namespace lampglow::bench
