// The station's configuration: any text is a configuration or a ConfigError.
#include <cstdint>

#include "daemon/errors.h"
#include "daemon/station/config.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string text(data, data + size);
  try {
    (void)lampglow::daemon::parse_station_config(text, "/nonexistent/lampglow.toml");
  } catch (const lampglow::daemon::CommandError&) {
  }
  return 0;
}
