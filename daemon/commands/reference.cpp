// `lampglow reference`: the clear references of a station's cameras over time, and the way back.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <memory>
#include <string>

#include "daemon/commands/commands.h"
#include "daemon/commands/database.h"
#include "daemon/errors.h"
#include "storage/references.h"
#include "storage/store.h"

namespace lampglow::daemon {
namespace {

using storage::ReferenceOrigin;
using storage::ReferenceRecord;

struct Arguments {
  std::string database, camera;
  std::int64_t number = 0;
};

std::string percent(double ln_ratio) {
  return fmt::format("{:+.1f} %", 100 * std::expm1(ln_ratio));
}

std::string evidence(const ReferenceRecord& reference) {
  if (reference.origin == ReferenceOrigin::restored)
    return fmt::format("number {} restored by hand", reference.restored_number.value_or(0));
  const std::string above =
      reference.mor_low_m ? fmt::format(", visibility above {:.0f} m", *reference.mor_low_m) : "";
  if (reference.origin == ReferenceOrigin::clear_brackets)
    return fmt::format("{} clear brackets", reference.frames);
  std::string text;
  if (reference.frames > 0)
    text = fmt::format("{} frames over {:.1f} h{}; all lamps together {}", reference.frames, reference.hours,
                       above, percent(reference.ln_common.value_or(0)));
  if (reference.halo_frames == 0) return text;
  return text + fmt::format("{}halos from {} frames of haze and fog", text.empty() ? "" : "; ",
                            reference.halo_frames);
}

void print_line(const ReferenceRecord& reference) {
  fmt::print("{:>6}  {}  {:<14}  {}\n", reference.number, format_time_utc(reference.valid_from_utc),
             to_string(reference.origin), evidence(reference));
}

void list(const Arguments& a) {
  storage::Reader reader(a.database);
  const auto references = storage::ReferenceReader(a.database).references(camera_of(reader, a.camera).number);
  if (references.empty()) fmt::print("no clear reference is stored for this camera\n");
  for (const ReferenceRecord& reference : references) print_line(reference);
}

ReferenceRecord wanted(storage::CameraNumber camera, const Arguments& a) {
  const auto number = a.number > 0 ? std::optional(a.number) : std::nullopt;
  const auto reference = storage::ReferenceReader(a.database).reference(camera, number);
  if (!reference && !number) throw DataError("no clear reference is stored for this camera");
  if (!reference)
    throw UsageError(fmt::format(
        "this camera has no reference of number {}; `lampglow reference list` shows them", a.number));
  return *reference;
}

void show(const Arguments& a) {
  storage::Reader reader(a.database);
  const ReferenceRecord reference = wanted(camera_of(reader, a.camera).number, a);
  print_line(reference);
  const auto when = [](const std::optional<TimePoint>& time) {
    return time ? format_time_utc(*time) : "never";
  };
  constexpr const char* kRow = "{:<12} {:>14} {:>18}  {:<24} {:>14}  {}\n";
  fmt::print("\n");
  fmt::print(fmt::runtime(kRow), "lamp", "strength", "against the first", "last changed", "halo strength",
             "last changed");
  for (const storage::ReferenceLampRecord& lamp : reference.lamps)
    fmt::print(fmt::runtime(kRow), lamp.id, fmt::format("{:.6g}", lamp.strength), percent(lamp.ln_relearned),
               when(lamp.relearned_utc), fmt::format("{:.3f}", std::exp(lamp.ln_halo)), when(lamp.halo_utc));
}

void restore(const Arguments& a) {
  ReferenceRecord reference;
  storage::CameraRecord camera;
  {
    storage::Reader reader(a.database);
    camera = camera_of(reader, a.camera);
    reference = wanted(camera.number, a);
  }
  const TimePoint now = std::chrono::floor<std::chrono::milliseconds>(std::chrono::system_clock::now());
  reference.valid_from_utc = now;
  reference.origin = ReferenceOrigin::restored;
  reference.restored_number = reference.number;
  reference.frames = 0;
  reference.halo_frames = 0;
  reference.hours = 0;
  reference.mor_low_m.reset();
  reference.ln_common.reset();
  storage::Store store(a.database);
  const std::int64_t number = store.put_reference(camera.number, reference);
  const std::string message =
      fmt::format("clear reference {} restored by hand, as number {}", a.number, number);
  store.put_event(
      {0, now, storage::EventKind::reference_learned, storage::Severity::info, camera.name, message});
  fmt::print("{}; a running station takes it over at its next reload (systemctl reload lampglow)\n", message);
}

}  // namespace

void add_reference(CLI::App& program) {
  CLI::App* command = program.add_subcommand(
      "reference", "The clear reference over time, as service relearned it: list, show, restore");
  command->require_subcommand(1);
  auto a = std::make_shared<Arguments>();
  const auto part = [&](const char* name, const char* help, void (*work)(const Arguments&)) {
    CLI::App* sub = command->add_subcommand(name, help);
    sub->add_option("FILE", a->database, "The database")->required();
    sub->add_option("--camera", a->camera, "Which camera; not needed if there is only one")
        ->type_name("NAME");
    sub->callback([a, work] {
      needs_database(a->database);
      with_storage_errors([&] { work(*a); });
    });
    sub->footer(fmt::format("Example:\n  lampglow reference {} /var/lib/lampglow/lampglow.db{}", name,
                            std::string(name) == "list" ? "" : " 3"));
    return sub;
  };
  part("list", "All references of a camera, oldest first, and what taught them", list);
  part("show", "The strength of every lamp and of its halo in one of them", show)
      ->add_option("NUMBER", a->number, "As `list` shows it; the one in force if not given")
      ->check(CLI::Range(std::int64_t{1}, std::int64_t{1} << 60));
  part("restore", "Go back to one of them; nothing is deleted", restore)
      ->add_option("NUMBER", a->number, "As `list` shows it")
      ->required()
      ->check(CLI::Range(std::int64_t{1}, std::int64_t{1} << 60));
  command->footer("Example:\n  lampglow reference list /var/lib/lampglow/lampglow.db");
}

}  // namespace lampglow::daemon
