#include "daemon/replay/reference_log.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace lampglow::daemon {

using storage::ReferenceLampRecord;
using storage::ReferenceOrigin;
using storage::ReferenceRecord;

ReferenceRecord reference_record(const ClearReference& reference, TimePoint valid_from) {
  ReferenceRecord record;
  record.valid_from_utc = valid_from;
  record.base_utc = reference.learned_utc;
  record.frames = reference.frames;
  record.mor_low_m = reference.mor_m;
  for (const ReferenceLamp& lamp : reference.lamps)
    record.lamps.push_back(
        {lamp.id, lamp.strength, lamp.ln_relearned, lamp.relearned_utc, lamp.ln_halo, lamp.halo_utc});
  return record;
}

ReferenceRecord reference_record(const ClearReference& reference,
                                 const inference::Relearner::Settled& settled) {
  ReferenceRecord record = reference_record(reference, settled.valid_from);
  const inference::Lesson& lesson = settled.lesson;
  record.origin = ReferenceOrigin::relearned;
  record.frames = 0;
  record.mor_low_m.reset();
  if (settled.halos.learned()) record.halo_frames = settled.halos.frames;
  if (!lesson.learned()) return record;
  record.frames = lesson.frames;
  record.hours = lesson.hours;
  record.mor_low_m = lesson.lowest_mor_m;
  record.ln_common = lesson.ln_common;
  return record;
}

namespace {

std::string strengths_text(const ClearReference& changed, const inference::Lesson& lesson) {
  std::string text = fmt::format(
      "clear reference relearned from {} frames over {:.1f} h, visibility above {:.0f} m in each, {} lamps "
      "agree;",
      lesson.frames, lesson.hours, lesson.lowest_mor_m, lesson.lamps);
  for (size_t j = 0; j < changed.lamps.size(); ++j)
    text += fmt::format(" {} {:.4g} to {:.4g},", changed.lamps[j].id,
                        changed.lamps[j].strength * std::exp(-lesson.ln_step[j]), changed.lamps[j].strength);
  text.back() = '.';
  if (lesson.left_out.empty()) return text;
  text += " Not in line with the others:";
  for (const std::string& id : lesson.left_out) text += " " + id;
  return text + ".";
}

std::string halos_text(const ClearReference& changed, const inference::HaloLesson& lesson) {
  std::string text = fmt::format("halo strengths relearned from {} frames of haze and fog;", lesson.frames);
  for (size_t j = 0; j < changed.lamps.size(); ++j)
    if (lesson.ln_step[j] != 0)
      text += fmt::format(" {} {:.3f} to {:.3f},", changed.lamps[j].id,
                          std::exp(changed.lamps[j].ln_halo - lesson.ln_step[j]),
                          std::exp(changed.lamps[j].ln_halo));
  text.back() = '.';
  return text;
}

}  // namespace

std::string lesson_text(const ClearReference& changed, const inference::Relearner::Settled& settled) {
  std::string text;
  if (settled.lesson.learned()) text = strengths_text(changed, settled.lesson);
  if (!settled.halos.learned()) return text;
  return (text.empty() ? "" : text + " ") + halos_text(changed, settled.halos);
}

namespace {

// Of each lamp of `base`, what its record says; 0 where it says nothing.
template <typename Value>
std::vector<double> recorded(const ClearReference& base, const ReferenceRecord& record, Value&& value) {
  std::vector<double> all(base.lamps.size(), 0.0);
  for (size_t j = 0; j < base.lamps.size(); ++j)
    for (const ReferenceLampRecord& lamp : record.lamps)
      if (lamp.id == base.lamps[j].id) all[j] = value(lamp);
  return all;
}

}  // namespace

std::optional<ClearReference> with_record(const ClearReference& base, const ReferenceRecord& record) {
  if (record.base_utc != base.learned_utc) return std::nullopt;
  const auto strengths = recorded(base, record, [](const auto& lamp) { return lamp.ln_relearned; });
  const auto halos = recorded(base, record, [](const auto& lamp) { return lamp.ln_halo; });
  const TimePoint now = record.valid_from_utc;
  ClearReference changed =
      inference::with_halos(inference::changed_reference(base, strengths, now), halos, now);
  for (ReferenceLamp& lamp : changed.lamps)
    for (const ReferenceLampRecord& stored : record.lamps)
      if (stored.id == lamp.id) {
        lamp.relearned_utc = stored.relearned_utc;
        lamp.halo_utc = stored.halo_utc;
      }
  return changed;
}

}  // namespace lampglow::daemon
