// The headers of image files: size and depth are known before a decoder sees the file.
#include <cstdint>
#include <span>

#include "daemon/pictures/image_header.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  (void)lampglow::daemon::read_image_header({data, size});
  return 0;
}
