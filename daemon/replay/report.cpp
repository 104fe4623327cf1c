#include "daemon/replay/report.h"

namespace lampglow::daemon {
std::string format_report(const ReplayOptions&, const ReplayResult&, const std::vector<Truth>&) {
  return "";
}
}  // namespace lampglow::daemon
