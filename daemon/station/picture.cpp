#include "daemon/station/picture.h"

#include <vector>

#include "daemon/annotate.h"

namespace lampglow::daemon {
namespace {

std::shared_ptr<const std::string> shared(const std::vector<std::uint8_t>& jpeg) {
  return jpeg.empty() ? nullptr : std::make_shared<const std::string>(jpeg.begin(), jpeg.end());
}

}  // namespace

Pictures render_pictures(const Bracket& bracket, const Site& site, const FrameResult& result,
                         int jpeg_quality) {
  const Exposure* exposure = exposure_to_show(bracket, site.camera);
  if (!exposure) return {};
  const JpegOptions options{exposure->pixels.width_px, jpeg_quality};
  return {shared(plain_jpeg(exposure->pixels, site.camera, options)),
          shared(annotated_jpeg(exposure->pixels, site.camera, result.lamps, site.targets, options))};
}

}  // namespace lampglow::daemon
