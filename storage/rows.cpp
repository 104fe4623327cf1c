#include "storage/rows.h"

#include <algorithm>
#include <bit>
#include <cstring>

namespace lampglow::storage {
namespace {

static_assert(std::endian::native == std::endian::little, "ring profiles are stored little-endian");

Limit limit(int number) {
  return number == 1 || number == 2 ? static_cast<Limit>(number) : Limit::none;
}
Method method(int number) {
  return number == 1 || number == 2 ? static_cast<Method>(number) : Method::none;
}
Weather weather(int number) {
  return number >= 0 && number <= 5 ? static_cast<Weather>(number) : Weather::unknown;
}

bool known(const std::array<double, 6>& probability) {
  return std::any_of(probability.begin(), probability.end(), [](double p) { return p != 0; });
}

void append(std::string& blob, const std::vector<double>& column) {
  for (const double value : column) {
    const auto narrow = static_cast<float>(value);
    char bytes[sizeof narrow];
    std::memcpy(bytes, &narrow, sizeof narrow);
    blob.append(bytes, sizeof narrow);
  }
}

std::vector<double> take(std::string_view& blob, size_t count) {
  std::vector<double> column(count);
  for (double& value : column) {
    float narrow = 0;
    std::memcpy(&narrow, blob.data(), sizeof narrow);
    blob.remove_prefix(sizeof narrow);
    value = static_cast<double>(narrow);
  }
  return column;
}

}  // namespace

LampState lamp_state(int number) {
  return number >= 0 && number <= 5 ? static_cast<LampState>(number) : LampState::unknown;
}

void bind_observation(Binder& binder, const Observation& o) {
  binder << o.extinction_per_m << o.extinction_low_per_m << o.extinction_high_per_m
         << static_cast<int>(o.limit) << o.q << o.q_low << o.q_high << static_cast<int>(o.weather);
  for (const double p : o.weather_probability)
    binder << (known(o.weather_probability) ? std::optional<double>(p) : std::nullopt);
  binder << (o.lecture_class ? std::optional<int>(static_cast<int>(*o.lecture_class)) : std::nullopt)
         << o.wmo_4680 << o.relative_humidity << static_cast<int>(o.method) << o.lights_used
         << static_cast<std::int64_t>(o.quality.bits());
}

Observation read_observation(RowReader& row) {
  Observation o;
  o.extinction_per_m = row.maybe_real();
  o.extinction_low_per_m = row.maybe_real();
  o.extinction_high_per_m = row.maybe_real();
  o.limit = limit(row.small());
  o.q = row.maybe_real();
  o.q_low = row.maybe_real();
  o.q_high = row.maybe_real();
  o.weather = weather(row.small());
  for (double& p : o.weather_probability) p = row.maybe_real().value_or(0);
  if (const auto lecture = row.maybe_small()) o.lecture_class = weather(*lecture);
  o.wmo_4680 = row.maybe_small();
  o.relative_humidity = row.maybe_real();
  o.method = method(row.small());
  o.lights_used = row.small();
  o.quality = QualityFlags::from_bits(static_cast<std::uint64_t>(row.integer()));
  return o;
}

void bind_mean(Binder& binder, const ObservationRow& mean) {
  const Observation& o = mean.observation;
  binder << mean.frames << mean.values << o.extinction_per_m << o.extinction_low_per_m
         << o.extinction_high_per_m << static_cast<int>(o.limit) << o.q << o.q_low << o.q_high
         << static_cast<int>(o.weather) << o.relative_humidity << static_cast<int>(o.method) << o.lights_used
         << static_cast<std::int64_t>(o.quality.bits());
}

ObservationRow read_mean(RowReader& row) {
  ObservationRow mean;
  Observation& o = mean.observation;
  mean.frames = row.small();
  mean.values = row.small();
  o.extinction_per_m = row.maybe_real();
  o.extinction_low_per_m = row.maybe_real();
  o.extinction_high_per_m = row.maybe_real();
  o.limit = limit(row.small());
  o.q = row.maybe_real();
  o.q_low = row.maybe_real();
  o.q_high = row.maybe_real();
  o.weather = weather(row.small());
  o.relative_humidity = row.maybe_real();
  o.method = method(row.small());
  o.lights_used = row.small();
  o.quality = QualityFlags::from_bits(static_cast<std::uint64_t>(row.integer()));
  return mean;
}

std::string pack_rings(const RingProfile& profile) {
  std::string blob;
  blob.reserve(std::size_t{16} * profile.theta_deg.size());
  append(blob, profile.theta_deg);
  append(blob, profile.radiance);
  append(blob, profile.radiance_sigma);
  append(blob, profile.model);
  return blob;
}

RingProfile unpack_rings(std::string_view blob, std::int64_t ring_count) {
  RingProfile profile;
  const size_t columns = ring_count > 0 ? blob.size() / 4 / static_cast<size_t>(ring_count) : 0;
  if (ring_count <= 0 || ring_count > 100000 || (columns != 3 && columns != 4) ||
      blob.size() != columns * 4 * static_cast<size_t>(ring_count))
    return profile;
  const auto count = static_cast<size_t>(ring_count);
  profile.theta_deg = take(blob, count);
  profile.radiance = take(blob, count);
  profile.radiance_sigma = take(blob, count);
  if (columns == 4) profile.model = take(blob, count);
  return profile;
}

}  // namespace lampglow::storage
