// A plain line plot on logarithmic axes, as inline SVG for a self-contained report.
#pragma once

#include <string>
#include <vector>

namespace lampglow::daemon {

struct Line {
  std::string name;
  std::vector<double> x, y;  // points with x or y <= 0 are left out
  bool points = false;       // marks instead of a line
};

// Colours follow the lines' order.
std::string svg_plot(const std::string& title, const std::string& x_label, const std::string& y_label,
                     const std::vector<Line>& lines);

}  // namespace lampglow::daemon
