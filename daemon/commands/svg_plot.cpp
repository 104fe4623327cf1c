#include "daemon/commands/svg_plot.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace lampglow::daemon {
namespace {

constexpr double kWidth = 550, kHeight = 340, kLeft = 64, kRight = 86, kTop = 34, kBottom = 48;
constexpr std::array<const char*, 7> kColours = {"#000000", "#0072b2", "#d55e00", "#009e73",
                                                 "#cc79a7", "#e69f00", "#56b4e9"};

struct LogAxis {
  double low = 1e300, high = -1e300, from = 0, to = 1;

  void include(double value) {
    low = std::min(low, std::log10(value));
    high = std::max(high, std::log10(value));
  }
  double place(double value) const {
    return from + (to - from) * (std::log10(value) - low) / std::max(high - low, 1e-9);
  }
};

std::string tick_label(double value) {
  if (value >= 0.0009 && value < 10001) return fmt::format("{:g}", value);
  const double exponent = std::floor(std::log10(value) + 1e-9);
  return fmt::format("{:.0f}e{:.0f}", value / std::pow(10, exponent), exponent);
}

std::string grid(const LogAxis& axis, bool horizontal) {
  std::string out;
  const bool fine = axis.high - axis.low < 2.2;
  const int stride = std::max(1, static_cast<int>((axis.high - axis.low) / 7));
  for (int decade = static_cast<int>(std::floor(axis.low)); decade <= axis.high; decade += stride)
    for (const double factor : {1.0, 2.0, 5.0}) {
      const double value = factor * std::pow(10, decade);
      if ((!fine && factor != 1) || std::log10(value) < axis.low - 1e-9 ||
          std::log10(value) > axis.high + 1e-9)
        continue;
      const double at = axis.place(value);
      if (horizontal)
        out += fmt::format(
            "<path class='grid' d='M{:.1f} {}V{}'/><text x='{:.1f}' y='{}' text-anchor='middle'>{}</text>\n",
            at, kTop, kHeight - kBottom, at, kHeight - kBottom + 16, tick_label(value));
      else
        out += fmt::format(
            "<path class='grid' d='M{} {:.1f}H{}'/><text x='{}' y='{:.1f}' text-anchor='end'>{}</text>\n",
            kLeft, at, kWidth - kRight, kLeft - 5, at + 4, tick_label(value));
    }
  return out;
}

std::string draw(const Line& line, const LogAxis& x, const LogAxis& y) {
  const char* colour = kColours[line.colour % kColours.size()];
  std::string path, marks;
  for (std::size_t i = 0; i < line.x.size(); ++i) {
    if (!(line.x[i] > 0 && line.y[i] > 0)) continue;
    const double px = x.place(line.x[i]), py = y.place(line.y[i]);
    path += fmt::format("{}{:.1f} {:.1f}", path.empty() ? "M" : "L", px, py);
    marks += fmt::format("<circle cx='{:.1f}' cy='{:.1f}' r='2.6' fill='{}'/>", px, py, colour);
  }
  if (line.style == Line::Style::points) return marks + "\n";
  const bool dashed = line.style == Line::Style::dashed;
  return fmt::format("<path d='{}' fill='none' stroke='{}' stroke-width='{}'{}/>\n", path, colour,
                     dashed ? 1.1 : 1.6, dashed ? " stroke-dasharray='4 3'" : "");
}

// Beside the plot, so that it never lies upon a line.
std::string legend(const std::vector<Line>& lines) {
  std::string out;
  double at = kTop + 10;
  for (const Line& line : lines) {
    if (line.name.empty()) continue;
    out += fmt::format("<text x='{}' y='{}' fill='{}'>{}</text>\n", kWidth - kRight + 8, at,
                       kColours[line.colour % kColours.size()], line.name);
    at += 15;
  }
  return out;
}

}  // namespace

std::string svg_plot(const std::string& title, const std::string& x_label, const std::string& y_label,
                     const std::vector<Line>& lines) {
  LogAxis x, y;
  for (const Line& line : lines)
    for (std::size_t i = 0; i < line.x.size(); ++i)
      if (line.x[i] > 0 && line.y[i] > 0) {
        x.include(line.x[i]);
        y.include(line.y[i]);
      }
  x.from = kLeft;
  x.to = kWidth - kRight;
  y.from = kHeight - kBottom;
  y.to = kTop;
  std::string out =
      fmt::format("<svg viewBox='0 0 {} {}' role='img'><title>{}</title>\n", kWidth, kHeight, title);
  out += fmt::format("<text class='title' x='{}' y='16'>{}</text>\n", kLeft, title);
  out += grid(x, true) + grid(y, false);
  for (const Line& line : lines) out += draw(line, x, y);
  out += legend(lines);
  out += fmt::format("<text x='{}' y='{}' text-anchor='middle'>{}</text>\n", (kLeft + kWidth - kRight) / 2,
                     kHeight - 8, x_label);
  out +=
      fmt::format("<text transform='translate(14 {}) rotate(-90)' text-anchor='middle'>{}</text>\n</svg>\n",
                  (kTop + kHeight - kBottom) / 2, y_label);
  return out;
}

}  // namespace lampglow::daemon
