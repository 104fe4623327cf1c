#include "daemon/sources/archive.h"

#include <fmt/format.h>

#include "daemon/config/csv.h"
#include "daemon/config/files.h"
#include "daemon/config/problems.h"
#include "daemon/errors.h"
#include "daemon/sources/image_file.h"

namespace lampglow::daemon {
namespace {

constexpr double kMaxExposure_s = 3600;

// One row's fields by name, and where to say that one is wrong.
class Row {
 public:
  Row(const std::vector<CsvCell>& cells, const std::vector<std::optional<std::size_t>>& places,
      Problems& problems)
      : cells_(cells), places_(places), problems_(problems) {}

  enum Field { time_utc, file, exposure_s, gain_db, role, reference_mor_m };
  static inline const std::vector<std::string_view> kNames{"time_utc", "file", "exposure_s",
                                                           "gain_db",  "role", "reference_mor_m"};

  const std::string& text(Field field) const { return cell(field).text; }

  void problem(Field field, const std::string& message) {
    problems_.add(cell(field).line, cell(field).column, std::string(kNames[field]), message);
  }

  std::optional<double> number(Field field, double low, double high) {
    if (text(field).empty()) return std::nullopt;
    const auto value = parse_number(text(field));
    if (value && *value >= low && *value <= high) return value;
    problem(field,
            fmt::format("expected nothing or a number from {} to {}, got \"{}\"", low, high, text(field)));
    return std::nullopt;
  }

 private:
  const CsvCell& cell(Field field) const { return cells_[*places_[field]]; }
  const std::vector<CsvCell>& cells_;
  const std::vector<std::optional<std::size_t>>& places_;
  Problems& problems_;
};

std::optional<TimePoint> read_time(Row& row, const std::vector<ArchiveBracket>& before) {
  const auto time = parse_time_utc(row.text(Row::time_utc));
  if (!time)
    row.problem(Row::time_utc,
                "expected a time such as 2015-10-09T00:04:00Z, got \"" + row.text(Row::time_utc) + "\"");
  else if (!before.empty() && *time < before.back().time_utc)
    row.problem(Row::time_utc, fmt::format("expected rows in the order of time, {} comes after {}",
                                           row.text(Row::time_utc), format_time_utc(before.back().time_utc)));
  return time;
}

FrameRole read_role(Row& row) {
  if (row.text(Row::role) == "clear_reference") return FrameRole::clear_reference;
  if (row.text(Row::role) != "observation")
    row.problem(Row::role, "expected observation or clear_reference, got \"" + row.text(Row::role) + "\"");
  return FrameRole::observation;
}

// The row's bracket: the last one, if it is of the same time, or a new one.
void add_row(Row& row, const std::filesystem::path& archive, std::vector<ArchiveBracket>& brackets) {
  const auto time = read_time(row, brackets);
  const FrameRole role = read_role(row);
  ArchiveFrame frame{row.text(Row::file), row.number(Row::exposure_s, 1e-7, kMaxExposure_s),
                     row.number(Row::gain_db, -60, 120)};
  const auto reference_mor_m = row.number(Row::reference_mor_m, 1, 1e6);
  if (const std::string why = refuse_path(archive, frame.file); !why.empty())
    row.problem(Row::file, why + " (\"" + frame.file + "\")");
  if (reference_mor_m && role == FrameRole::observation)
    row.problem(Row::reference_mor_m, "expected nothing for an observation");
  if (!time) return;
  if (brackets.empty() || brackets.back().time_utc != *time)
    brackets.push_back({*time, role, reference_mor_m, {}});
  else if (brackets.back().role != role)
    row.problem(Row::role, "expected the role of the rows above that share its time");
  if (reference_mor_m) brackets.back().reference_mor_m = reference_mor_m;
  brackets.back().frames.push_back(std::move(frame));
}

}  // namespace

std::vector<ArchiveBracket> read_frames_csv(const std::filesystem::path& archive) {
  const std::filesystem::path path = archive / "frames.csv";
  Problems problems(path.string());
  const CsvTable table = parse_csv(read_text_file(path), problems);
  const auto places = find_columns(table, Row::kNames, problems);
  std::vector<ArchiveBracket> brackets;
  for (const auto& place : places)
    if (!place) problems.throw_data_error();
  for (const auto& cells : table.rows) {
    Row row(cells, places, problems);
    add_row(row, archive, brackets);
  }
  if (table.rows.empty() && problems.empty()) problems.add(1, 1, "", "expected at least one frame");
  problems.throw_data_error();
  return brackets;
}

Bracket load_bracket(const std::filesystem::path& archive, const ArchiveBracket& entry,
                     const Camera& camera) {
  Bracket bracket;
  bracket.time_utc = entry.time_utc;
  bracket.role = entry.role;
  bracket.reference_mor_m = entry.reference_mor_m;
  for (const ArchiveFrame& frame : entry.frames) {
    DecodedImage image = load_image(archive, frame.file, camera);
    bracket.quality.set(image.quality);
    if (image.good())
      bracket.exposures.push_back(
          {frame.file, frame.exposure_s, frame.gain_db, std::move(image.pixels), image.monochrome});
    else
      bracket.fault += (bracket.fault.empty() ? "" : "; ") + image.fault;
  }
  return bracket;
}

ClearBrackets clear_brackets(const std::filesystem::path& archive, std::vector<ArchiveBracket> brackets,
                             const Camera& camera) {
  std::erase_if(brackets,
                [](const ArchiveBracket& entry) { return entry.role != FrameRole::clear_reference; });
  const std::size_t count = brackets.size();
  return {count, [archive, camera, brackets = std::move(brackets)](std::size_t i) {
            return load_bracket(archive, brackets[i], camera);
          }};
}

ArchiveSource::ArchiveSource(std::filesystem::path archive, Camera camera)
    : archive_(std::move(archive)), camera_(std::move(camera)), brackets_(read_frames_csv(archive_)) {}

std::optional<Bracket> ArchiveSource::next(std::stop_token stop) {
  if (at_ == brackets_.size() || stop.stop_requested()) return std::nullopt;
  return load_bracket(archive_, brackets_[at_++], camera_);
}

}  // namespace lampglow::daemon
