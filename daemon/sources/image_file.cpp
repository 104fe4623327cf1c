#include "daemon/sources/image_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "daemon/config/descriptor.h"
#include "daemon/errors.h"
#include "daemon/pictures/decode.h"

namespace lampglow::daemon {
namespace {

DecodedImage refuse(Quality flag, const std::string& name, const std::string& what) {
  DecodedImage image;
  image.quality.set(flag);
  image.fault = name + ": " + what;
  return image;
}

// More bytes than this no honest picture of the camera has: 4 samples of 2 bytes, and half a megabyte of
// metadata.
std::uint64_t plausible_bytes(const Camera& camera) {
  return 8ULL * static_cast<std::uint64_t>(camera.width_px) * static_cast<std::uint64_t>(camera.height_px) +
         (1ULL << 19);
}

int container_bits(const Camera& camera) {
  return camera.bit_depth > 8 ? 16 : 8;
}

// What the header says against what the camera gives; a good() image where all is well.
DecodedImage check_header(const ImageHeader& header, const std::string& name, const Camera& camera) {
  const std::int64_t width = camera.width_px, height = camera.height_px;
  const auto size = [](std::int64_t w, std::int64_t h) { return fmt::format("{}x{} pixels", w, h); };
  if (header.width_px == 0 || header.height_px == 0)
    return refuse(Quality::frame_truncated, name, "the file ends before the picture's size is told");
  if (header.width_px > 0 && header.height_px > width * height / header.width_px &&
      (header.width_px != width || header.height_px != height))
    return refuse(Quality::frame_too_large, name,
                  "expected " + size(width, height) + ", the header claims " +
                      size(header.width_px, header.height_px) + "; not decoded");
  if (header.width_px != width || header.height_px != height)
    return refuse(Quality::frame_wrong_size, name,
                  "expected " + size(width, height) + ", got " + size(header.width_px, header.height_px));
  // Palettes and packed bits below 8 become 8 bits when decoded, and are no photographs.
  if (header.bits != container_bits(camera))
    return refuse(Quality::frame_wrong_depth, name,
                  fmt::format("expected {} bits a sample for a camera of {} bits, got {}",
                              container_bits(camera), camera.bit_depth, header.bits));
  if (header.channels != 1 && header.channels != 3)
    return refuse(Quality::frame_wrong_depth, name,
                  fmt::format("expected 1 channel (mono) or 3 (RGB), got {}", header.channels));
  if (!header.complete)
    return refuse(Quality::frame_truncated, name, "the file ends before the picture does");
  return {};
}

// A picture of another shape than its header told.
struct WrongShape : PictureError {
  WrongShape(Quality why, const std::string& text) : PictureError(text), flag(why) {}
  Quality flag;
};

// Takes of a picture what is wanted, row by row: grey or green, and whether there is colour. A colour picture
// in which all channels agree is a monochrome one. A coloured clock in the picture, or a codec's rounding, is
// no colour: a thousandth of the pixels may differ, any pixel by 2 %.
class GreenOrMono : public RowSink {
 public:
  explicit GreenOrMono(const Camera& camera) : camera_(camera) {}

  void begin(const PictureShape& shape) override {
    if (shape.width_px != camera_.width_px || shape.height_px != camera_.height_px)
      throw WrongShape(Quality::frame_wrong_size, "the decoded picture is not of the size its header tells");
    if (shape.bits != container_bits(camera_))
      throw WrongShape(Quality::frame_wrong_depth, "expected whole numbers as samples");
    channels_ = static_cast<std::size_t>(shape.channels);
    tolerance_ = shape.bits == 8 ? 5 : 1310;
    pixels_ = Image<std::uint16_t>::unfilled(shape.width_px, shape.height_px);
  }

  void take(int row, Samples samples) override {
    std::uint16_t* out = &pixels_.at(0, row);
    if (const auto* bytes = std::get_if<std::span<const std::uint8_t>>(&samples))
      take_row(*bytes, out);
    else
      take_row(std::get<std::span<const std::uint16_t>>(samples), out);
  }

  bool monochrome() const { return coloured_ * 1000 <= pixels_.pixels.size(); }
  Image<std::uint16_t>& pixels() { return pixels_; }

 private:
  template <typename T>
  void take_row(std::span<const T> samples, std::uint16_t* out) {
    if (channels_ == 1) {
      std::copy(samples.begin(), samples.end(), out);
      return;
    }
    for (std::size_t i = 0; i < samples.size(); i += channels_) {
      const int red = samples[i], green = samples[i + 1], blue = samples[i + 2];
      *out++ = static_cast<std::uint16_t>(green);
      coloured_ += std::max({red, green, blue}) - std::min({red, green, blue}) > tolerance_ ? 1 : 0;
    }
  }

  const Camera& camera_;
  Image<std::uint16_t> pixels_;
  std::size_t channels_ = 1, coloured_ = 0;
  int tolerance_ = 0;
};

DecodedImage decode_pixels(ImageFormat format, std::span<const std::uint8_t> bytes, const std::string& name,
                           const Camera& camera) {
  GreenOrMono sink(camera);
  const std::string damaged = "the picture's data are damaged";
  try {
    decode_picture(format, bytes, sink);
  } catch (const PictureError& error) {
    // A JPEG that is cut within its data is whole by its structure.
    if (format == ImageFormat::jpeg)
      return refuse(Quality::frame_truncated, name, damaged + ": " + error.what());
    if (const auto* shape = dynamic_cast<const WrongShape*>(&error))
      return refuse(shape->flag, name, shape->what());
    return refuse(Quality::frame_undecodable, name, damaged);
  }
  DecodedImage image;
  image.monochrome = sink.monochrome();
  image.pixels = std::move(sink.pixels());
  return image;
}

struct FileBytes {
  Pixels<std::uint8_t> data;
  std::string fault;
  bool too_large = false;
};

FileBytes read_bytes(const std::filesystem::path& path, std::uint64_t max_bytes) {
  // No link is followed, and a FIFO is not waited for.
  const Descriptor fd(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOFOLLOW));
  if (!fd.good()) return {{}, std::strerror(errno)};
  struct stat status {};
  if (::fstat(fd.get(), &status) != 0) return {{}, std::strerror(errno)};
  if (!S_ISREG(status.st_mode)) return {{}, "expected a regular file"};
  const auto size = static_cast<std::uint64_t>(status.st_size);
  if (size > max_bytes) return {{}, fmt::format("expected at most {} bytes, got {}", max_bytes, size), true};
  Pixels<std::uint8_t> data(size);  // not filled before it is read
  std::size_t filled = 0;
  while (filled < data.size()) {
    const ssize_t count = ::read(fd.get(), data.data() + filled, data.size() - filled);
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) return {{}, std::strerror(errno)};
    if (count == 0) break;
    filled += static_cast<std::size_t>(count);
  }
  data.resize(filled);
  return {std::move(data), ""};
}

}  // namespace

DecodedImage decode_image(std::span<const std::uint8_t> bytes, const std::string& name,
                          const Camera& camera) {
  if (bytes.empty()) return refuse(Quality::frame_truncated, name, "expected a picture, the file is empty");
  if (bytes.size() > plausible_bytes(camera))
    return refuse(Quality::frame_too_large, name,
                  fmt::format("expected at most {} bytes for such a camera, got {}", plausible_bytes(camera),
                              bytes.size()));
  const auto header = read_image_header(bytes);
  if (!header) return refuse(Quality::frame_undecodable, name, "expected a PNG, JPEG or TIFF picture");
  if (DecodedImage refused = check_header(*header, name, camera); !refused.good()) return refused;
  DecodedImage image = decode_pixels(header->format, bytes, name, camera);
  if (!image.good()) return image;
  const int highest = *std::max_element(image.pixels.pixels.begin(), image.pixels.pixels.end());
  if (highest >= 1 << camera.bit_depth)
    return refuse(Quality::frame_wrong_depth, name,
                  fmt::format("expected digital numbers below {}, got {}", 1 << camera.bit_depth, highest));
  return image;
}

std::string refuse_path(const std::filesystem::path& folder, const std::string& relative) {
  const std::filesystem::path path(relative);
  if (path.empty() || relative.find('\0') != std::string::npos) return "expected a file's path";
  if (path.is_absolute()) return "expected a path relative to the archive, got an absolute one";
  std::filesystem::path so_far = folder;
  for (const auto& part : path) {
    if (part == "..") return "expected a path within the archive, got one with '..'";
    so_far /= part;
    std::error_code ignored;  // what is not there is no link; it shows when the file is read
    if (std::filesystem::is_symlink(so_far, ignored)) return "expected no symbolic link in the path";
  }
  return "";
}

DecodedImage load_image(const std::filesystem::path& folder, const std::string& relative,
                        const Camera& camera) {
  if (const std::string why = refuse_path(folder, relative); !why.empty())
    return refuse(Quality::frame_missing, relative, why);
  const FileBytes bytes = read_bytes(folder / relative, plausible_bytes(camera));
  if (!bytes.fault.empty())
    return refuse(bytes.too_large ? Quality::frame_too_large : Quality::frame_missing, relative, bytes.fault);
  return decode_image(bytes.data, relative, camera);
}

PlainImage load_plain_image(const std::filesystem::path& path, std::int64_t max_pixels) {
  const FileBytes bytes = read_bytes(path, 8ULL * static_cast<std::uint64_t>(max_pixels));
  if (!bytes.fault.empty()) throw IoError(path.string() + ": " + bytes.fault);
  const auto header = read_image_header(bytes.data);
  if (!header) throw DataError(path.string() + ": expected a PNG, JPEG or TIFF picture");
  if (header->width_px < 1 || header->height_px < 1 || header->height_px > max_pixels / header->width_px)
    throw DataError(fmt::format("{}: expected at most {} pixels, the header claims {}x{}", path.string(),
                                max_pixels, header->width_px, header->height_px));
  Camera camera;
  camera.width_px = static_cast<int>(header->width_px);
  camera.height_px = static_cast<int>(header->height_px);
  camera.bit_depth = header->bits == 16 ? 16 : 8;
  DecodedImage image = decode_image(bytes.data, path.string(), camera);
  if (!image.good()) throw DataError(image.fault);
  return {std::move(image.pixels), camera.bit_depth, image.monochrome};
}

}  // namespace lampglow::daemon
