// A plain line plot on logarithmic axes, as inline SVG for a self-contained report.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace lampglow::daemon {

struct Line {
  enum class Style { line, dashed, points };
  std::string name;          // for the legend; empty: not in it
  std::vector<double> x, y;  // points with x or y <= 0 are left out
  Style style = Style::line;
  std::size_t colour = 0;
};

// Colours of lines in one plot: 0 to 6, then again from the first.
std::string svg_plot(const std::string& title, const std::string& x_label, const std::string& y_label,
                     const std::vector<Line>& lines);

}  // namespace lampglow::daemon
