#include "daemon/sources/v4l2_device.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <linux/videodev2.h>
#include <sys/ioctl.h>
#include <sys/mman.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "daemon/sources/fault.h"
#include "daemon/sources/wait.h"

namespace lampglow::daemon {
namespace {

std::uint32_t code_of(std::string_view fourcc) {
  const auto byte = [&](std::size_t i) {
    return static_cast<std::uint32_t>(static_cast<unsigned char>(fourcc[i]));
  };
  return byte(0) | byte(1) << 8 | byte(2) << 16 | byte(3) << 24;
}

std::string text_of(std::uint32_t code) {
  std::string text(4, ' ');
  for (unsigned i = 0; i < 4; ++i) text[i] = static_cast<char>(code >> (8 * i) & 0xFF);
  return text;
}

// For people: the big-endian bit is no character.
std::string readable(std::string fourcc) {
  const bool big_endian = (static_cast<unsigned char>(fourcc[3]) & 0x80) != 0;
  fourcc[3] = static_cast<char>(fourcc[3] & 0x7F);
  return big_endian ? fourcc + "-BE" : fourcc;
}

template <std::size_t N>
std::string text_of(const unsigned char (&bytes)[N]) {
  return {bytes, std::find(bytes, bytes + N, 0)};
}

Fault fault_of_open(int error) {
  if (error == ENOENT || error == ENODEV || error == ENXIO) return Fault::device_missing;
  if (error == EACCES || error == EPERM) return Fault::device_denied;
  return error == EBUSY ? Fault::device_busy : Fault::device_error;
}

Fault fault_of_use(int error) {
  if (error == ENODEV || error == ENXIO) return Fault::device_unplugged;
  return error == EBUSY ? Fault::device_busy : Fault::device_error;
}

YuvCoding coding_of(const v4l2_pix_format& pix) {
  YuvCoding coding;
  auto encoding = pix.ycbcr_enc;
  if (encoding == V4L2_YCBCR_ENC_DEFAULT) encoding = V4L2_MAP_YCBCR_ENC_DEFAULT(pix.colorspace);
  if (encoding == V4L2_YCBCR_ENC_709 || encoding == V4L2_YCBCR_ENC_XV709) {
    coding.red_weight = 0.2126;
    coding.blue_weight = 0.0722;
  }
  // By default YUV has limited range, but not that of JPEG.
  coding.full_range =
      pix.quantization == V4L2_QUANTIZATION_FULL_RANGE ||
      (pix.quantization == V4L2_QUANTIZATION_DEFAULT && pix.colorspace == V4L2_COLORSPACE_JPEG);
  return coding;
}

}  // namespace

V4l2Device::V4l2Device(const std::string& path)
    : path_(path), fd_(::open(path.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC)) {
  if (!fd_.good())
    throw SourceError(fault_of_open(errno), fmt::format("{}: {}", path_, std::strerror(errno)));
  v4l2_capability capability{};
  if (call(VIDIOC_QUERYCAP, &capability) != 0) {
    throw SourceError(Fault::device_error, path_ + ": not a Video4Linux device");
  }
  const auto can = (capability.capabilities & V4L2_CAP_DEVICE_CAPS) != 0 ? capability.device_caps
                                                                         : capability.capabilities;
  if ((can & V4L2_CAP_VIDEO_CAPTURE) == 0 || (can & V4L2_CAP_STREAMING) == 0) {
    throw SourceError(Fault::format_unsupported, path_ +
                                                     ": the device gives no pictures by streaming (another "
                                                     "node of the same camera may)");
  }
  driver_ = fmt::format("{}: {} ({})", text_of(capability.driver), text_of(capability.card),
                        text_of(capability.bus_info));
}

V4l2Device::~V4l2Device() {
  if (streaming_) {
    int type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    call(VIDIOC_STREAMOFF, &type);
  }
  unmap_buffers();
}

int V4l2Device::call(unsigned long request, void* argument) const {
  int result;
  do {
    result = ::ioctl(fd_.get(), request, argument);
  } while (result == -1 && errno == EINTR);
  return result;
}

void V4l2Device::fail(const std::string& what) const {
  const int error = errno;
  throw SourceError(fault_of_use(error), fmt::format("{}: {}: {}", path_, what, std::strerror(error)));
}

std::vector<std::string> V4l2Device::offered_formats() const {
  std::vector<std::string> formats;
  v4l2_fmtdesc description{};
  description.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  for (; call(VIDIOC_ENUM_FMT, &description) == 0; ++description.index)
    formats.push_back(text_of(description.pixelformat));
  return formats;
}

std::pair<int, int> V4l2Device::largest_size(std::uint32_t fourcc) const {
  std::pair<int, int> largest{0, 0};
  v4l2_frmsizeenum size{};
  size.pixel_format = fourcc;
  for (; call(VIDIOC_ENUM_FRAMESIZES, &size) == 0; ++size.index) {
    if (size.type != V4L2_FRMSIZE_TYPE_DISCRETE)
      return {0, 0};  // any size: the driver's present one is meant
    const std::pair<int, int> one(size.discrete.width, size.discrete.height);
    if (1L * one.first * one.second > 1L * largest.first * largest.second) largest = one;
  }
  return largest;
}

std::vector<std::string> V4l2Device::list_formats() const {
  std::vector<std::string> list;
  for (const std::string& fourcc : offered_formats()) {
    const auto [width, height] = largest_size(code_of(fourcc));
    list.push_back(readable(fourcc) + (width > 0 ? fmt::format(" up to {}x{}", width, height) : "") +
                   (find_raw_format(fourcc) == nullptr ? " (can't be read)" : ""));
  }
  return list;
}

std::vector<V4l2Control> V4l2Device::list_controls() const {
  std::vector<V4l2Control> list;
  v4l2_queryctrl query{};
  query.id = V4L2_CTRL_FLAG_NEXT_CTRL;
  while (call(VIDIOC_QUERYCTRL, &query) == 0) {
    if (query.type != V4L2_CTRL_TYPE_CTRL_CLASS) {
      if (auto one = control(query.id)) list.push_back(*one);
    }
    query.id |= V4L2_CTRL_FLAG_NEXT_CTRL;
  }
  return list;
}

void V4l2Device::choose_format(const std::string& fourcc, int width_px, int height_px) {
  const std::vector<std::string> offered = offered_formats();
  const auto is_offered = [&](std::string_view one) {
    return std::ranges::find(offered, one) != offered.end();
  };
  const RawFormat* chosen = nullptr;
  if (!fourcc.empty()) {
    chosen = is_offered(fourcc) ? find_raw_format(fourcc) : nullptr;
  } else {
    const auto formats = raw_formats();
    const auto found = std::ranges::find_if(formats, is_offered, &RawFormat::fourcc);
    if (found != formats.end()) chosen = &*found;
  }
  if (chosen == nullptr) {
    std::string list;
    for (const std::string& one : offered) list += " " + readable(one);
    throw SourceError(Fault::format_unsupported,
                      fmt::format("{}: expected {}, the device offers{}", path_,
                                  fourcc.empty() ? "a format that we can read" : "format " + fourcc,
                                  list.empty() ? " none" : list));
  }

  stop();
  unmap_buffers();
  v4l2_format format{};
  format.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  if (call(VIDIOC_G_FMT, &format) != 0) fail("VIDIOC_G_FMT");
  auto& pix = format.fmt.pix;
  pix.pixelformat = code_of(chosen->fourcc);
  const auto [width, height] = width_px > 0 ? std::pair(width_px, height_px) : largest_size(pix.pixelformat);
  if (width > 0) pix.width = static_cast<std::uint32_t>(width);
  if (height > 0) pix.height = static_cast<std::uint32_t>(height);
  pix.field = V4L2_FIELD_NONE;
  pix.bytesperline = pix.sizeimage = 0;
  if (call(VIDIOC_S_FMT, &format) != 0) fail("VIDIOC_S_FMT");
  if (pix.pixelformat != code_of(chosen->fourcc)) {
    throw SourceError(Fault::format_unsupported,
                      fmt::format("{}: the device changed format {} to {}", path_, chosen->fourcc,
                                  readable(text_of(pix.pixelformat))));
  }
  layout_ = {
      chosen, static_cast<int>(pix.width), static_cast<int>(pix.height), pix.bytesperline, coding_of(pix),
      {}};
}

std::string V4l2Device::format_text() const {
  return fmt::format("{} {}x{}", readable(std::string(layout_.format->fourcc)), layout_.width_px,
                     layout_.height_px);
}

std::optional<double> V4l2Device::frame_rate_hz() const {
  v4l2_streamparm parameters{};
  parameters.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  if (call(VIDIOC_G_PARM, &parameters) != 0) return std::nullopt;
  const auto& interval = parameters.parm.capture.timeperframe;
  if (interval.numerator == 0) return std::nullopt;
  return static_cast<double>(interval.denominator) / interval.numerator;
}

void V4l2Device::set_frame_interval(double at_least_s) {
  const auto rate_hz = frame_rate_hz();
  if (!rate_hz || 1 / *rate_hz >= at_least_s) return;
  v4l2_streamparm parameters{};
  parameters.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  parameters.parm.capture.timeperframe = {static_cast<std::uint32_t>(at_least_s * 1000 + 1), 1000};
  call(VIDIOC_S_PARM, &parameters);  // a wish: some drivers stretch the interval by themselves
}

std::optional<V4l2Control> V4l2Device::control(std::uint32_t id) const {
  v4l2_queryctrl query{};
  query.id = id;
  if (call(VIDIOC_QUERYCTRL, &query) != 0 || (query.flags & V4L2_CTRL_FLAG_DISABLED) != 0)
    return std::nullopt;
  if (query.type == V4L2_CTRL_TYPE_BUTTON || query.type == V4L2_CTRL_TYPE_STRING) return std::nullopt;
  v4l2_control now{};
  now.id = query.id;
  if (call(VIDIOC_G_CTRL, &now) != 0) return std::nullopt;
  return V4l2Control{query.id, text_of(query.name), query.minimum, query.maximum, query.step, now.value};
}

std::optional<std::int64_t> V4l2Device::set_control(std::uint32_t id, std::int64_t value) {
  v4l2_control wanted{};
  wanted.id = id;
  wanted.value = static_cast<std::int32_t>(value);
  if (call(VIDIOC_S_CTRL, &wanted) != 0) {
    if (errno == ENODEV) fail("VIDIOC_S_CTRL");
    return std::nullopt;
  }
  const auto now = control(id);
  return now ? std::optional(now->value) : std::nullopt;
}

void V4l2Device::map_buffers() {
  v4l2_requestbuffers request{};
  request.count = 4;
  request.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  request.memory = V4L2_MEMORY_MMAP;
  if (call(VIDIOC_REQBUFS, &request) != 0) fail("VIDIOC_REQBUFS");
  for (std::uint32_t index = 0; index < request.count; ++index) {
    v4l2_buffer buffer{};
    buffer.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    buffer.memory = V4L2_MEMORY_MMAP;
    buffer.index = index;
    if (call(VIDIOC_QUERYBUF, &buffer) != 0) fail("VIDIOC_QUERYBUF");
    void* data = ::mmap(nullptr, buffer.length, PROT_READ, MAP_SHARED, fd_.get(), buffer.m.offset);
    if (data == MAP_FAILED) fail("mmap");
    buffers_.push_back({data, buffer.length});
  }
}

void V4l2Device::unmap_buffers() {
  for (const Buffer& buffer : buffers_) ::munmap(buffer.data, buffer.size);
  if (!buffers_.empty()) {
    v4l2_requestbuffers request{};
    request.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    request.memory = V4L2_MEMORY_MMAP;
    call(VIDIOC_REQBUFS, &request);
  }
  buffers_.clear();
}

void V4l2Device::queue(std::uint32_t index) {
  v4l2_buffer buffer{};
  buffer.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  buffer.memory = V4L2_MEMORY_MMAP;
  buffer.index = index;
  if (call(VIDIOC_QBUF, &buffer) != 0) fail("VIDIOC_QBUF");
}

void V4l2Device::start() {
  if (streaming_) return;
  if (buffers_.empty()) map_buffers();
  held_.reset();
  for (std::uint32_t index = 0; index < buffers_.size(); ++index) queue(index);
  int type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  if (call(VIDIOC_STREAMON, &type) != 0) fail("VIDIOC_STREAMON");
  streaming_ = true;
}

void V4l2Device::stop() {
  if (!streaming_) return;
  int type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  streaming_ = false;
  held_.reset();
  if (call(VIDIOC_STREAMOFF, &type) != 0) fail("VIDIOC_STREAMOFF");
}

bool V4l2Device::next_frame(RawFrame& frame, std::chrono::steady_clock::time_point deadline,
                            std::stop_token stop) {
  if (held_) queue(*std::exchange(held_, std::nullopt));
  for (;;) {
    const Wait wait = wait_readable(fd_.get(), deadline, stop);
    if (wait == Wait::stopped) return false;
    if (wait == Wait::timeout)
      throw SourceError(Fault::device_timeout, path_ + ": the device gave no frame in time");
    v4l2_buffer buffer{};
    buffer.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    buffer.memory = V4L2_MEMORY_MMAP;
    if (call(VIDIOC_DQBUF, &buffer) != 0) {
      if (errno == EAGAIN) continue;
      fail("VIDIOC_DQBUF");
    }
    if ((buffer.flags & V4L2_BUF_FLAG_ERROR) != 0) {  // the driver knows that data are missing
      queue(buffer.index);
      continue;
    }
    held_ = buffer.index;
    frame = layout_;
    frame.bytes = {static_cast<const std::uint8_t*>(buffers_.at(buffer.index).data),
                   std::min<std::size_t>(buffer.bytesused, buffers_.at(buffer.index).size)};
    return true;
  }
}

}  // namespace lampglow::daemon
