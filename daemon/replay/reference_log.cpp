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
    record.lamps.push_back({lamp.id, lamp.strength, lamp.ln_relearned, lamp.relearned_utc});
  return record;
}

ReferenceRecord reference_record(const ClearReference& reference, const inference::Lesson& lesson,
                                 TimePoint valid_from) {
  ReferenceRecord record = reference_record(reference, valid_from);
  record.origin = ReferenceOrigin::relearned;
  record.frames = lesson.frames;
  record.hours = lesson.hours;
  record.mor_low_m = lesson.lowest_mor_m;
  record.ln_common = lesson.ln_common;
  return record;
}

std::string lesson_text(const ClearReference& changed, const inference::Lesson& lesson) {
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
  return text;
}

std::optional<ClearReference> with_record(const ClearReference& base, const ReferenceRecord& record) {
  if (record.base_utc != base.learned_utc) return std::nullopt;
  std::vector<double> ln_change(base.lamps.size(), 0.0);
  std::optional<TimePoint> latest;
  for (const ReferenceLampRecord& lamp : record.lamps) {
    const auto found = std::find_if(base.lamps.begin(), base.lamps.end(),
                                    [&](const ReferenceLamp& other) { return other.id == lamp.id; });
    if (found != base.lamps.end())
      ln_change[static_cast<size_t>(found - base.lamps.begin())] = lamp.ln_relearned;
    latest = std::max(latest, lamp.relearned_utc);
  }
  if (!latest) return base;
  ClearReference changed = inference::changed_reference(base, ln_change, *latest);
  for (ReferenceLamp& lamp : changed.lamps)
    for (const ReferenceLampRecord& stored : record.lamps)
      if (stored.id == lamp.id) lamp.relearned_utc = stored.relearned_utc;
  return changed;
}

}  // namespace lampglow::daemon
