#include "daemon/station/teacher.h"

#include "daemon/replay/reference_log.h"
#include "daemon/station/log.h"
#include "storage/reader.h"

namespace lampglow::daemon {
namespace {

using inference::Relearner;
using storage::ReferenceRecord;

// Observations and fits hold all that teaches; ring profiles do not.
std::vector<FrameResult> stored_frames(storage::Reader& reader, storage::CameraNumber camera, TimePoint from,
                                       TimePoint to) {
  std::vector<FrameResult> frames;
  for (const storage::ObservationRow& row : reader.observations({camera, from, to, 0, {}, 100'000})) {
    FrameResult frame;
    frame.observation = row.observation;
    for (const storage::LampFitRow& fit : reader.fits(camera, row.observation.time_utc))
      frame.lamps.push_back(fit.fit);
    frames.push_back(std::move(frame));
  }
  return frames;
}

void adopt_stored(const std::filesystem::path& database, TimePoint now, Adopted& adopted) {
  storage::Reader reader(database);
  const CameraSetup& fresh = *adopted.setup;
  const auto camera = reader.camera(fresh.name);
  const auto record = camera ? storage::ReferenceReader(database).reference(camera->number) : std::nullopt;
  adopted.to_store = reference_record(*fresh.base, now);
  if (!record) return;
  auto reference = with_record(*fresh.base, *record);
  if (!reference) {
    log(LogLevel::warning, "other clear brackets than before: what was relearned from the old ones is left",
        {{"camera", fresh.name}});
    return;
  }
  adopted.to_store.reset();
  log(LogLevel::info, "clear reference taken over from the database",
      {{"camera", fresh.name},
       {"number", std::to_string(record->number)},
       {"origin", std::string(to_string(record->origin))}});
  auto setup = std::make_shared<CameraSetup>(fresh);
  setup->reference = std::move(reference);
  adopted.setup = setup;
  const std::optional<double> longitude_deg = fresh.site.longitude_deg;
  const TimePoint noon = inference::night_begin(inference::night_number(now, longitude_deg), longitude_deg);
  adopted.tonight = stored_frames(reader, camera->number, std::max(noon, record->valid_from_utc), now);
}

}  // namespace

Adopted adopt_reference(const std::filesystem::path& database,
                        const std::shared_ptr<const CameraSetup>& setup, TimePoint now) {
  Adopted adopted{setup, {}, {}, true};
  if (!setup->base) return adopted;
  try {
    adopt_stored(database, now, adopted);
  } catch (const storage::StorageError& error) {
    log(LogLevel::warning, "the stored reference could not be read",
        {{"camera", setup->name}, {"reason", error.what()}});
    return {setup, {}, {}, false};
  }
  return adopted;
}

void Teacher::take_over(const Adopted& adopted) {
  const CameraSetup& setup = *adopted.setup;
  pupils_.erase(setup.name);
  if (!setup.reference || !setup.relearn) return;
  Pupil pupil{adopted.setup, Relearner(*setup.reference, *setup.relearn, setup.site.longitude_deg), {}};
  for (const FrameResult& frame : adopted.tonight) {
    pupil.relearner.add(frame);
    pupil.latest = frame.observation.time_utc;
  }
  pupils_.emplace(setup.name, std::move(pupil));
}

std::optional<Taught> Teacher::settle(Pupil& pupil) {
  const auto settled = pupil.relearner.settle();
  if (!settled || !settled->learned()) return std::nullopt;
  const ClearReference& reference = pupil.relearner.reference();
  auto setup = std::make_shared<CameraSetup>(*pupil.setup);
  setup->reference = reference;
  pupil.setup = setup;
  return Taught{setup,
                reference_record(reference, *settled),
                {0, settled->valid_from, storage::EventKind::reference_learned, storage::Severity::info,
                 setup->name, lesson_text(reference, *settled)}};
}

std::optional<Taught> Teacher::add(const Done& done) {
  const auto found = pupils_.find(done.setup->name);
  if (found == pupils_.end()) return std::nullopt;
  Pupil& pupil = found->second;
  const TimePoint time = done.result.observation.time_utc;
  std::optional<Taught> taught;
  if (pupil.relearner.is_over(time)) taught = settle(pupil);
  if (done.setup == pupil.setup) {
    pupil.relearner.add(done.result);
    pupil.latest = time;
  }
  return taught;
}

std::vector<Taught> Teacher::tick(TimePoint now) {
  // An archive that is shown as a camera has times of its own: its nights end with its frames.
  constexpr std::chrono::hours kLive{36};
  std::vector<Taught> all;
  for (auto& [name, pupil] : pupils_)
    if (pupil.relearner.is_over(now) && now - pupil.latest < kLive)
      if (auto taught = settle(pupil)) all.push_back(std::move(*taught));
  return all;
}

}  // namespace lampglow::daemon
