#include "daemon/replay/chart.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <functional>

namespace lampglow::daemon {
namespace {

// A log axis from data to pixels.
struct LogAxis {
  double low = 1, high = 10;         // values
  double low_px = 0, high_px = 100;  // where they stand

  double px(double value) const {
    const double share = std::log(std::clamp(value, low, high) / low) / std::log(high / low);
    return low_px + share * (high_px - low_px);
  }

  // 1, 2, 5 times powers of ten within the axis; powers of ten alone where those would be many.
  std::vector<double> ticks() const {
    std::vector<double> found;
    const bool few = high / low < 3000;
    const int first = static_cast<int>(std::floor(std::log10(low))),
              last = static_cast<int>(std::floor(std::log10(high)));
    for (int exponent = first; exponent <= last; ++exponent)
      for (const double step : {1.0, 2.0, 5.0}) {
        const double tick = step * std::pow(10, exponent);
        if ((few || step == 1.0) && tick >= low * 0.999 && tick <= high * 1.001) found.push_back(tick);
      }
    return found;
  }
};

struct Size {
  double width, height, left, right, top, bottom;  // the last four: margins
};

std::string metres_label(double metres) {
  return metres >= 1000 ? fmt::format("{:g} km", metres / 1000) : fmt::format("{:g} m", metres);
}

std::string open_svg(const Size& s, const std::string& title) {
  return fmt::format(
      "<svg viewBox=\"0 0 {:.0f} {:.0f}\" role=\"img\" aria-label=\"{}\" "
      "xmlns=\"http://www.w3.org/2000/svg\">\n",
      s.width, s.height, html_text(title));
}

std::string grid_y(const Size& s, const LogAxis& y, const std::function<std::string(double)>& label) {
  std::string out;
  for (const double tick : y.ticks())
    out += fmt::format(
        "<line class=\"grid\" x1=\"{:.1f}\" x2=\"{:.1f}\" y1=\"{:.1f}\" y2=\"{:.1f}\"/>"
        "<text class=\"tick\" x=\"{:.1f}\" y=\"{:.1f}\" text-anchor=\"end\">{}</text>\n",
        s.left, s.width - s.right, y.px(tick), y.px(tick), s.left - 6, y.px(tick) + 4, label(tick));
  return out;
}

std::string points_text(const std::vector<std::pair<double, double>>& points) {
  std::string out;
  for (const auto& [x, y] : points) out += fmt::format("{:.1f},{:.1f} ", x, y);
  return out;
}

// ---- visibility against time

struct TimeAxis {
  TimePoint first, last;
  double low_px, high_px;

  double px(TimePoint time) const {
    const double whole = std::max(1.0, static_cast<double>((last - first).count()));
    return low_px + static_cast<double>((time - first).count()) / whole * (high_px - low_px);
  }
};

std::string grid_x(const Size& s, const TimeAxis& x) {
  using namespace std::chrono;
  constexpr std::array<minutes, 11> kSteps{10min,  30min,   60min,   120min,   180min,  360min,
                                           720min, 1440min, 2880min, 10080min, 43200min};
  minutes step = kSteps.back();
  for (const minutes candidate : kSteps)
    if ((x.last - x.first) / candidate <= 10) {
      step = candidate;
      break;
    }
  std::string out;
  const auto begin = ceil<minutes>(x.first.time_since_epoch()) / step * step;
  for (auto at = begin; TimePoint{at} <= x.last; at += step) {
    if (TimePoint{at} < x.first) continue;
    const std::string text = format_time_utc(TimePoint{at});
    const std::string label = step < 1440min ? text.substr(11, 5) : text.substr(5, 5);
    out += fmt::format("<text class=\"tick\" x=\"{:.1f}\" y=\"{:.1f}\" text-anchor=\"middle\">{}</text>\n",
                       x.px(TimePoint{at}), s.height - s.bottom + 18, label);
  }
  return out;
}

LogAxis mor_axis(const std::vector<Observation>& observations, const std::vector<Truth>& truths,
                 const Size& s) {
  double low = 500, high = 2000;
  const auto take = [&](const std::optional<double>& value) {
    if (!value) return;
    low = std::min(low, *value);
    high = std::max(high, *value);
  };
  for (const Observation& o : observations) take(o.mor_m());
  for (const Truth& truth : truths) take(truth.mor_m);
  return {std::max(10.0, low / 1.3), std::min(200e3, high * 1.3), s.height - s.bottom, s.top};
}

// Runs of values that follow each other without a gap of three usual steps.
std::vector<std::vector<const Observation*>> runs_of_values(const std::vector<Observation>& observations) {
  std::vector<std::vector<const Observation*>> runs;
  const Observation* before = nullptr;
  std::vector<std::chrono::milliseconds> steps{std::chrono::milliseconds::max()};
  for (std::size_t i = 1; i < observations.size(); ++i)
    steps.push_back(observations[i].time_utc - observations[i - 1].time_utc);
  std::nth_element(steps.begin(), steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2), steps.end());
  const auto usual = steps[steps.size() / 2];
  for (const Observation& o : observations) {
    if (!o.mor_m() || o.limit != Limit::none) {
      before = nullptr;
      continue;
    }
    if (!before || (o.time_utc - before->time_utc) / 3 > usual) runs.emplace_back();
    runs.back().push_back(&o);
    before = &o;
  }
  return runs;
}

std::string band(const std::vector<const Observation*>& run, const TimeAxis& x, const LogAxis& y) {
  std::vector<std::pair<double, double>> upper, lower;
  for (const Observation* o : run) {
    upper.emplace_back(x.px(o->time_utc), y.px(o->mor_high_m().value_or(y.high)));
    lower.emplace_back(x.px(o->time_utc), y.px(o->mor_low_m().value_or(y.low)));
  }
  if (run.size() == 1)
    return fmt::format(
        "<line class=\"bandline\" x1=\"{0:.1f}\" x2=\"{0:.1f}\" y1=\"{1:.1f}\" y2=\"{2:.1f}\"/>\n",
        upper[0].first, upper[0].second, lower[0].second);
  upper.insert(upper.end(), lower.rbegin(), lower.rend());
  return "<polygon class=\"band\" points=\"" + points_text(upper) + "\"/>\n";
}

std::string limit_mark(const Observation& o, const TimeAxis& x, const LogAxis& y) {
  const double cx = x.px(o.time_utc), cy = y.px(*o.mor_m());
  const double direction = o.limit == Limit::above ? -1 : 1;
  return fmt::format(
      "<polygon class=\"limit\" points=\"{:.1f},{:.1f} {:.1f},{:.1f} {:.1f},{:.1f}\"><title>{} {} "
      "{}</title></polygon>"
      "\n",
      cx - 4, cy, cx + 4, cy, cx, cy + 9 * direction, format_time_utc(o.time_utc),
      o.limit == Limit::above ? "at least" : "at most", metres_label(std::round(*o.mor_m())));
}

std::string estimate_marks(const std::vector<Observation>& observations, const TimeAxis& x,
                           const LogAxis& y) {
  std::string bands, lines, dots;
  for (const auto& run : runs_of_values(observations)) {
    bands += band(run, x, y);
    std::vector<std::pair<double, double>> points;
    for (const Observation* o : run) {
      points.emplace_back(x.px(o->time_utc), y.px(*o->mor_m()));
      dots += fmt::format(
          "<circle class=\"dot {}\" cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"2.6\"><title>{} {}</title></circle>\n",
          to_string(o->method), points.back().first, points.back().second, format_time_utc(o->time_utc),
          metres_label(std::round(*o->mor_m())));
    }
    lines += "<polyline class=\"estimate\" points=\"" + points_text(points) + "\"/>\n";
  }
  std::string limits;
  for (const Observation& o : observations)
    if (o.limit != Limit::none && o.mor_m()) limits += limit_mark(o, x, y);
  return bands + lines + limits + dots;
}

// A gap of more than three of the usual steps is not bridged by a line.
std::chrono::duration<double> longest_step(const std::vector<Truth>& truths) {
  std::vector<std::chrono::duration<double>> steps;
  for (size_t i = 1; i < truths.size(); ++i) steps.emplace_back(truths[i].time_utc - truths[i - 1].time_utc);
  if (steps.empty()) return {};
  const auto middle = steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2);
  std::nth_element(steps.begin(), middle, steps.end());
  return 3 * *middle;
}

std::string truth_line(const std::vector<Truth>& truths, const TimeAxis& x, const LogAxis& y) {
  std::string out;
  std::vector<std::pair<double, double>> points;
  const auto finish = [&] {
    if (points.size() > 1) out += "<polyline class=\"truth\" points=\"" + points_text(points) + "\"/>\n";
    points.clear();
  };
  std::string dots;
  const auto longest = longest_step(truths);
  TimePoint previous{};
  for (const Truth& truth : truths) {
    if (truth.time_utc < x.first || truth.time_utc > x.last) continue;
    if (!truth.mor_m) {
      finish();
      continue;
    }
    if (truth.time_utc - previous > longest) finish();
    previous = truth.time_utc;
    points.emplace_back(x.px(truth.time_utc), y.px(*truth.mor_m));
    dots += fmt::format("<circle class=\"truthdot\" cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"1.8\"/>\n",
                        points.back().first, points.back().second);
  }
  finish();
  return out + dots;
}

}  // namespace

std::string html_text(std::string_view text) {
  std::string out;
  for (const char c : text) {
    if (c == '&')
      out += "&amp;";
    else if (c == '<')
      out += "&lt;";
    else if (c == '>')
      out += "&gt;";
    else if (c == '"')
      out += "&quot;";
    else if (c == '\'')
      out += "&#39;";
    else
      out += c;
  }
  return out;
}

std::string visibility_chart(const std::vector<Observation>& observations, const std::vector<Truth>& truths) {
  if (observations.empty()) return "<p>No frame was estimated.</p>\n";
  const Size s{960, 420, 64, 12, 12, 30};
  const TimeAxis x{observations.front().time_utc, observations.back().time_utc, s.left, s.width - s.right};
  const LogAxis y = mor_axis(observations, truths, s);
  std::string out = open_svg(s, "Visibility against time") + grid_y(s, y, metres_label) + grid_x(s, x);
  if (y.low < 1000 && y.high > 1000)
    out += fmt::format("<line class=\"fog\" x1=\"{:.1f}\" x2=\"{:.1f}\" y1=\"{:.1f}\" y2=\"{:.1f}\"/>\n",
                       s.left, s.width - s.right, y.px(1000), y.px(1000));
  return out + truth_line(truths, x, y) + estimate_marks(observations, x, y) + "</svg>\n";
}

std::string profile_chart(const LampFit& lamp) {
  const RingProfile& p = lamp.profile;
  double theta_low = 1e9, theta_high = 0, low = 1e300, high = 0;
  for (std::size_t i = 0; i < p.theta_deg.size(); ++i) {
    if (!(p.radiance[i] > 0) || !(p.theta_deg[i] > 0)) continue;
    theta_low = std::min(theta_low, p.theta_deg[i]);
    theta_high = std::max(theta_high, p.theta_deg[i]);
    low = std::min(low, p.radiance[i]);
    high = std::max(high, p.radiance[i]);
    if (i < p.model.size() && p.model[i] > 0) {
      low = std::min(low, p.model[i]);
      high = std::max(high, p.model[i]);
    }
  }
  if (high <= 0 || theta_high <= theta_low) return "";
  const Size s{300, 210, 54, 8, 10, 30};
  const LogAxis x{theta_low / 1.05, theta_high * 1.05, s.left, s.width - s.right};
  // A factor of six at least, so that a tick is seen and noise alone does not look like a halo.
  const double spare = std::max(1.2, std::sqrt(6 * low / high));
  const LogAxis y{low / spare, high * spare, s.height - s.bottom, s.top};
  std::string out = open_svg(s, "Ring profile of lamp " + lamp.id) +
                    grid_y(s, y, [](double v) { return fmt::format("{:g}", v); });
  for (const double tick : x.ticks())
    out += fmt::format("<text class=\"tick\" x=\"{:.1f}\" y=\"{:.1f}\" text-anchor=\"middle\">{:g}°</text>\n",
                       x.px(tick), s.height - s.bottom + 18, tick);
  std::vector<std::pair<double, double>> model;
  for (std::size_t i = 0; i < p.theta_deg.size(); ++i) {
    if (i < p.model.size() && p.model[i] > 0) model.emplace_back(x.px(p.theta_deg[i]), y.px(p.model[i]));
    if (!(p.radiance[i] > 0)) continue;
    const double sigma = i < p.radiance_sigma.size() ? p.radiance_sigma[i] : 0;
    const double cx = x.px(p.theta_deg[i]);
    out += fmt::format("<line class=\"bar\" x1=\"{0:.1f}\" x2=\"{0:.1f}\" y1=\"{1:.1f}\" y2=\"{2:.1f}\"/>",
                       cx, y.px(p.radiance[i] + sigma), y.px(std::max(p.radiance[i] - sigma, y.low)));
    out += fmt::format("<circle class=\"ring\" cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"2\"/>\n", cx,
                       y.px(p.radiance[i]));
  }
  if (model.size() > 1) out += "<polyline class=\"fit\" points=\"" + points_text(model) + "\"/>\n";
  return out + "</svg>\n";
}

}  // namespace lampglow::daemon
