#include "daemon/commands/planes.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <utility>

#include "daemon/config/files.h"
#include "daemon/errors.h"
#include "daemon/pictures/decode.h"
#include "daemon/pictures/exr.h"
#include "daemon/pictures/jpeg.h"
#include "daemon/pictures/png.h"
#include "daemon/pictures/tiff.h"

namespace lampglow::daemon {
namespace {

// Large pictures pass; bombs do not.
constexpr std::size_t kMaxFileBytes = std::size_t{4} << 30;
constexpr int kJpegQuality = 95;
constexpr std::int64_t kMaxPixels = 400'000'000;

// Leaves out transparency.
class PlaneSink : public RowSink {
 public:
  explicit PlaneSink(Planes& picture) : picture_(picture) {}

  void begin(const PictureShape& shape) override {
    if (shape.width_px < 1 || shape.height_px < 1 || shape.height_px > kMaxPixels / shape.width_px)
      throw PictureError(fmt::format("expected at most {} pixels, the header claims {}x{}", kMaxPixels,
                                     shape.width_px, shape.height_px));
    channels_ = static_cast<std::size_t>(shape.channels);
    const std::size_t pixels =
        static_cast<std::size_t>(shape.width_px) * static_cast<std::size_t>(shape.height_px);
    picture_ = {shape.width_px, shape.height_px, shape.bits,
                std::vector(std::min<std::size_t>(channels_, 3), std::vector<float>(pixels))};
  }

  void take(int row, Samples samples) override {
    const std::size_t start = static_cast<std::size_t>(row) * static_cast<std::size_t>(picture_.width_px);
    std::visit(
        [&](auto values) {
          for (std::size_t c = 0; c < picture_.planes.size(); ++c)
            for (std::size_t i = c, to = start; i < values.size(); i += channels_)
              picture_.planes[c][to++] = static_cast<float>(values[i]);
        },
        samples);
  }

 private:
  Planes& picture_;
  std::size_t channels_ = 1;
};

void decode(const std::string& text, RowSink& sink) {
  const std::span bytes(reinterpret_cast<const std::uint8_t*>(text.data()), text.size());
  if (is_exr(bytes)) return decode_exr(bytes, sink);
  const auto header = read_image_header(bytes);
  if (!header) throw PictureError("expected an EXR, TIFF, PNG or JPEG picture");
  if (!header->complete) throw PictureError("the file ends before the picture does");
  decode_picture(header->format, bytes, sink);
}

void to_srgb(Planes& picture) {
  for (auto& plane : picture.planes)
    for (float& value : plane) {
      const float x = std::max(value, 0.0f) / 255;
      value = 255 * (x <= 0.0031308f ? 12.92f * x : 1.055f * std::pow(x, 1 / 2.4f) - 0.055f);
    }
}

std::string extension_of(const std::string& path) {
  return std::filesystem::path(path).extension().string();
}

bool is_tiff(const std::string& extension) {
  return extension == ".tif" || extension == ".tiff";
}

bool is_jpeg(const std::string& extension) {
  return extension == ".jpg" || extension == ".jpeg";
}

// One sample after the other, rounded and clipped at full scale. The planes are given up.
template <typename T>
std::vector<T> interleaved(std::vector<std::vector<float>> planes) {
  std::vector<T> samples(planes.size() * planes.front().size());
  for (std::size_t c = 0; c < planes.size(); ++c) {
    for (std::size_t i = 0, to = c; i < planes[c].size(); ++i, to += planes.size())
      if constexpr (std::is_floating_point_v<T>)
        samples[to] = planes[c][i];
      else
        samples[to] = static_cast<T>(
            std::lrint(std::clamp(planes[c][i], 0.0f, static_cast<float>(std::numeric_limits<T>::max()))));
    planes[c] = {};
  }
  return samples;
}

Bytes encode(const std::string& extension, const PictureView& view) {
  if (extension == ".exr") return encode_exr(view);
  if (is_tiff(extension)) return encode_tiff(view);
  return extension == ".png" ? encode_png(view) : encode_jpeg(view, kJpegQuality);
}

template <typename T>
void write_samples(const std::string& path, Planes picture) {
  const int channels = static_cast<int>(picture.planes.size());
  const std::vector<T> samples = interleaved<T>(std::move(picture.planes));
  const PictureView view{{picture.width_px, picture.height_px, channels, static_cast<int>(8 * sizeof(T))},
                         std::span<const T>(samples)};
  const Bytes bytes = encode(extension_of(path), view);
  write_file_atomically(path, {reinterpret_cast<const char*>(bytes.data()), bytes.size()});
}

}  // namespace

Planes read_planes(const std::string& path) {
  const std::string bytes = read_text_file(path, kMaxFileBytes);
  Planes picture;
  PlaneSink sink(picture);
  try {
    decode(bytes, sink);
  } catch (const PictureError& error) {
    throw DataError(fmt::format("render: {}: {}", path, error.what()));
  }
  return picture;
}

void to_linear(Planes& picture) {
  if (picture.bits != 8) return;
  for (auto& plane : picture.planes)
    for (float& value : plane) {
      const float x = value / 255;
      value = 255 * (x <= 0.04045f ? x / 12.92f : std::pow((x + 0.055f) / 1.055f, 2.4f));
    }
}

void refuse_unwritable(const std::string& out, const Planes& picture) {
  const std::string extension = extension_of(out);
  if (extension == ".exr" || is_tiff(extension)) return;
  if (picture.real())
    throw UsageError(fmt::format("render: {}: a float picture is written as .exr or .tiff", out));
  if (extension == ".png" || (is_jpeg(extension) && picture.bits == 8)) return;
  throw UsageError(
      fmt::format("render: {}: expected a name that ends in .exr, .tiff, .png, or .jpg for 8 bits", out));
}

void write_planes(const std::string& path, Planes picture) {
  if (picture.real() || extension_of(path) == ".exr") return write_samples<float>(path, std::move(picture));
  if (picture.bits == 16) return write_samples<std::uint16_t>(path, std::move(picture));
  to_srgb(picture);
  write_samples<std::uint8_t>(path, std::move(picture));
}

}  // namespace lampglow::daemon
