#include "estimator/photometry/profiles.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "estimator/photometry/median.h"
#include "estimator/photometry/radiance.h"

namespace lampglow::photometry {
namespace {

struct Sample {
  std::int32_t ring;
  float value, variance, weight;
};

// std::floor, which is a call into the library without SSE 4.1; x above −1e6.
int floored(double x) {
  constexpr int kOffset = 1'000'000;
  return static_cast<int>(x + kOffset) - kOffset;
}

// Reference position to frame position, and the inverse for whole pixels.
struct Motion {
  Motion(const FrameView& frame, const RingMap& map)
      : cos_r(std::cos(frame.rotation_rad)),
        sin_r(std::sin(frame.rotation_rad)),
        cx(map.ring_of_pixel.width_px / 2.0),
        cy(map.ring_of_pixel.height_px / 2.0),
        dx(frame.shift_x_px),
        dy(frame.shift_y_px) {}
  RingCentre to_frame(const RingCentre& p) const {
    const double x = p.x_px - cx, y = p.y_px - cy;
    return {cx + cos_r * x - sin_r * y + dx, cy + sin_r * x + cos_r * y + dy, p.weight};
  }
  void to_reference(double x, double y, int& column, int& row) const {
    const double u = x - dx - cx, v = y - dy - cy;
    column = floored(cx + cos_r * u + sin_r * v);
    row = floored(cy - sin_r * u + cos_r * v);
  }
  double cos_r, sin_r, cx, cy, dx, dy;
};

struct Gathered {
  std::vector<std::vector<Sample>> by_ring;  // of inner rings
  std::vector<double> saturated, total;
};

std::vector<char> inner_rings(const RingMap& map) {
  std::vector<char> inner(map.rings.size());
  for (size_t r = 0; r < map.rings.size(); ++r) inner[r] = map.rings[r].theta_high_rad <= map.inner_zone_rad;
  return inner;
}

// Pixels side by side in a row that count for the same outer ring.
struct Run {
  std::int32_t ring;
  std::uint32_t first, count;  // pixels of the picture, row by row
};

// What each outer ring has of the frame, row by row: neither masked nor saturated, which is counted.
class OuterRuns {
 public:
  OuterRuns(const FrameView& frame, const RingMap& map, const Motion& motion, Gathered& out)
      : frame_(frame), map_(map), motion_(motion), inner_(inner_rings(map)), out_(out) {}

  std::vector<Run> gather() {
    for (row_ = 0; row_ < frame_.radiance.height_px; ++row_) gather_row();
    std::erase_if(runs_, [&](const Run& run) { return inner_[static_cast<size_t>(run.ring)] != 0; });
    out_.total = out_.saturated;
    for (const Run& run : runs_) out_.total[static_cast<size_t>(run.ring)] += run.count;
    return std::move(runs_);
  }

 private:
  struct Place {
    int x, y;
  };
  Place reference_of(int column) const {
    Place place{};
    motion_.to_reference(column + 0.5, row_ + 0.5, place.x, place.y);
    return place;
  }

  // The camera turns so little that over many pixels the same whole shift serves; where it changes each pixel
  // is looked up by itself.
  void gather_row() {
    constexpr int kBlock = 16;
    const int width = frame_.radiance.width_px;
    masked_ = any_masked({&frame_.mask.at(0, row_), static_cast<size_t>(width)});
    for (int first = 0; first < width;) {
      const Place begin = reference_of(first);
      const auto straight_to = [&](int column) {
        const Place end = reference_of(column);
        return end.y == begin.y && end.x - begin.x == column - first;
      };
      int last = first;
      while (last + 1 < width && straight_to(std::min(last + kBlock, width - 1)))
        last = std::min(last + kBlock, width - 1);
      add_straight(first, last, begin);
      first = last + 1;
    }
  }

  // Pixels first..last of the row, which lie side by side in the reference as well.
  void add_straight(int first, int last, Place begin) {
    if (begin.y < 0 || begin.y >= map_.ring_of_pixel.height_px) return;
    const auto y = static_cast<size_t>(begin.y);
    const int shift = begin.x - first;
    const auto row_begin = map_.runs.begin() + static_cast<std::ptrdiff_t>(map_.first_run[y]);
    const auto row_end = map_.runs.begin() + static_cast<std::ptrdiff_t>(map_.first_run[y + 1]);
    auto run = std::partition_point(row_begin, row_end,
                                    [&](const RingRun& r) { return r.last_column < first + shift; });
    for (; run != row_end && run->first_column <= last + shift; ++run)
      add(run->ring, std::max(first, run->first_column - shift), std::min(last, run->last_column - shift));
  }

  void add(RingIndex ring, int first, int last) {
    const auto start =
        static_cast<std::uint32_t>(row_) * static_cast<std::uint32_t>(frame_.radiance.width_px);
    if (!masked_) {
      append(ring, start + static_cast<std::uint32_t>(first), static_cast<std::uint32_t>(last - first + 1));
      return;
    }
    for (int column = first; column <= last; ++column) {
      const std::uint8_t mask = frame_.mask.at(column, row_);
      if (!inner_[static_cast<size_t>(ring)] && !(mask & frame_.bad_bits) && (mask & frame_.saturated_bits))
        out_.saturated[static_cast<size_t>(ring)] += 1;
      if (!(mask & (frame_.bad_bits | frame_.saturated_bits)))
        append(ring, start + static_cast<std::uint32_t>(column), 1);
    }
  }

  void append(RingIndex ring, std::uint32_t first, std::uint32_t count) {
    if (!runs_.empty() && runs_.back().ring == ring && runs_.back().first + runs_.back().count == first)
      runs_.back().count += count;
    else
      runs_.push_back({ring, first, count});
  }

  const FrameView& frame_;
  const RingMap& map_;
  const Motion& motion_;
  std::vector<char> inner_;
  Gathered& out_;
  int row_ = 0;
  bool masked_ = false;
  std::vector<Run> runs_;
};

// Within a few pixels of a lamp: rings with soft edges, so that the sub-pixel phase does not matter.
void gather_inner(const FrameView& frame, const RingMap& map, const Motion& motion, double focal_px,
                  Gathered& out) {
  const int per_lamp = map.options.rings;
  int inner_rings = 0;
  while (inner_rings < per_lamp && map.edges_rad[static_cast<size_t>(inner_rings) + 1] <= map.inner_zone_rad)
    ++inner_rings;
  const double reach = map.edges_rad[static_cast<size_t>(inner_rings)] * focal_px + 1.0;
  for (size_t lamp = 0; lamp < map.centres.size(); ++lamp) {
    const RingCentre c = motion.to_frame(map.centres[lamp]);
    for (int row = static_cast<int>(c.y_px - reach); row <= static_cast<int>(c.y_px + reach); ++row)
      for (int column = static_cast<int>(c.x_px - reach); column <= static_cast<int>(c.x_px + reach);
           ++column) {
        if (!frame.radiance.contains(column, row)) continue;
        const std::uint8_t mask = frame.mask.at(column, row);
        if (mask & frame.bad_bits) continue;
        const double radius = std::hypot(column + 0.5 - c.x_px, row + 0.5 - c.y_px);
        for (int k = 0; k < inner_rings; ++k) {
          const double low = map.edges_rad[static_cast<size_t>(k)] * focal_px;
          const double high = map.edges_rad[static_cast<size_t>(k) + 1] * focal_px;
          const double inside = std::clamp(high - radius + 0.5, 0.0, 1.0);
          const double hole = k == 0 ? 0.0 : std::clamp(low - radius + 0.5, 0.0, 1.0);
          const double weight = inside - hole;
          if (weight <= 0) continue;
          const size_t r = lamp * static_cast<size_t>(per_lamp) + static_cast<size_t>(k);
          out.total[r] += weight;
          if (mask & frame.saturated_bits) {
            out.saturated[r] += weight;
            continue;
          }
          out.by_ring[r].push_back({static_cast<std::int32_t>(r), frame.radiance.at(column, row),
                                    frame.variance.at(column, row), static_cast<float>(weight)});
        }
      }
  }
}

RingMean mean_of(const std::vector<Sample>& samples) {
  double w = 0, w2v = 0, sum = 0;
  for (const Sample& s : samples) {
    w += s.weight;
    w2v += s.weight * s.weight * s.variance;
    sum += s.weight * s.value;
  }
  if (w <= 0) return {};
  return {.mean = sum / w, .variance = w2v / (w * w), .pixels = static_cast<int>(samples.size())};
}

struct ClipRange {
  float low = -std::numeric_limits<float>::infinity(), high = std::numeric_limits<float>::infinity();
};

// Where each ring's outliers begin, from its median and median deviation. Of wide rings a part of the pixels,
// evenly strided, tells that as well.
std::vector<ClipRange> clip_ranges(const FrameView& frame, std::span<const Run> runs,
                                   const std::vector<double>& counts, double clip_sigma) {
  constexpr std::uint32_t kEnough = 500;
  const size_t count = counts.size();
  std::vector<std::uint32_t> skip(count, 0);  // pixels until the next one that is taken
  std::vector<std::vector<float>> values(count);
  std::vector<double> variance(count, 0);
  for (const Run& run : runs) {
    const auto r = static_cast<size_t>(run.ring);
    const std::uint32_t stride = std::max(1U, static_cast<std::uint32_t>(counts[r]) / kEnough);
    std::uint32_t i = skip[r];
    for (; i < run.count; i += stride) {
      values[r].push_back(frame.radiance.pixels[run.first + i]);
      variance[r] += frame.variance.pixels[run.first + i];
    }
    skip[r] = i - run.count;
  }
  std::vector<ClipRange> ranges(count);
  for (size_t r = 0; r < count; ++r) {
    if (values[r].empty()) continue;
    const double noise = std::sqrt(variance[r] / static_cast<double>(values[r].size()));
    const double middle = median_of(values[r]);
    for (float& value : values[r]) value = static_cast<float>(std::abs(value - middle));
    const double reach = clip_sigma * std::max(1.4826 * median_of(values[r]), noise);
    ranges[r] = {static_cast<float>(middle - reach), static_cast<float>(middle + reach)};
  }
  return ranges;
}

std::vector<RingMean> outer_means(const FrameView& frame, std::span<const Run> runs,
                                  const std::vector<double>& counts, double clip_sigma) {
  const std::vector<ClipRange> ranges = clip_ranges(frame, runs, counts, clip_sigma);
  struct Sums {
    double value = 0, square = 0, variance = 0;
    int pixels = 0;
  };
  std::vector<Sums> sums(counts.size());
  for (const Run& run : runs) {
    const ClipRange range = ranges[static_cast<size_t>(run.ring)];
    Sums sum = sums[static_cast<size_t>(run.ring)];
    for (std::uint32_t i = run.first; i < run.first + run.count; ++i) {
      const float value = frame.radiance.pixels[i];
      if (value < range.low || value > range.high) continue;
      sum.value += value;
      sum.square += static_cast<double>(value) * value;
      sum.variance += frame.variance.pixels[i];
      ++sum.pixels;
    }
    sums[static_cast<size_t>(run.ring)] = sum;
  }
  std::vector<RingMean> means(counts.size());
  for (size_t r = 0; r < counts.size(); ++r) {
    const double n = sums[r].pixels;
    if (sums[r].pixels == 0) continue;
    means[r].pixels = sums[r].pixels;
    means[r].mean = sums[r].value / n;
    const double scatter = std::max(0.0, sums[r].square / n - means[r].mean * means[r].mean) / n;
    means[r].variance = std::max(sums[r].variance / (n * n), scatter);
  }
  return means;
}

}  // namespace

std::vector<RingMean> measure_rings(const FrameView& frame, const RingMap& map) {
  const Motion motion(frame, map);
  const size_t count = map.rings.size();
  Gathered gathered{std::vector<std::vector<Sample>>(count), std::vector<double>(count, 0.0),
                    std::vector<double>(count, 0.0)};
  const std::vector<Run> runs = OuterRuns(frame, map, motion, gathered).gather();
  std::vector<RingMean> means = outer_means(frame, runs, gathered.total, map.options.clip_sigma);
  const double focal_px = map.options.core_radius_px / map.edges_rad[1];
  gather_inner(frame, map, motion, focal_px, gathered);
  const std::vector<char> inner = inner_rings(map);
  for (size_t r = 0; r < count; ++r) {
    const double fraction = gathered.total[r] > 0 ? gathered.saturated[r] / gathered.total[r] : 0.0;
    const double usable = inner[r] ? static_cast<double>(gathered.by_ring[r].size())
                                   : gathered.total[r] - gathered.saturated[r];
    if (inner[r]) means[r] = mean_of(gathered.by_ring[r]);
    if (usable < map.options.min_pixels || fraction > 0.01) means[r] = {};
    means[r].saturated_fraction = fraction;
  }
  return means;
}

}  // namespace lampglow::photometry
