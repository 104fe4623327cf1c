#if LAMPGLOW_HAS_LIBCAMERA
#include "daemon/sources/libcamera_session.h"

#include <fmt/format.h>
#include <libcamera/logging.h>
#include <linux/dma-buf.h>
#include <sys/eventfd.h>
#include <sys/ioctl.h>
#include <sys/mman.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>

#include "daemon/sources/fault.h"
#include "daemon/sources/wait.h"

namespace lampglow::daemon {
namespace {

namespace lc = libcamera;

// Enough for a stream without gaps. More would only make a change of exposure take longer.
constexpr std::size_t kRequests = 3;

std::mutex manager_mutex;
std::unique_ptr<lc::CameraManager> the_manager;
int manager_users = 0;

// A raw stream first: one value per pixel, before the image processor changes it.
constexpr lc::StreamRole kRoles[] = {lc::StreamRole::Raw, lc::StreamRole::VideoRecording,
                                     lc::StreamRole::Viewfinder};

std::unique_ptr<lc::CameraConfiguration> configuration_for(lc::Camera& camera, lc::StreamRole role) {
  auto configuration = camera.generateConfiguration({role});
  return configuration && !configuration->empty() ? std::move(configuration) : nullptr;
}

lc::Size largest(const std::vector<lc::Size>& sizes) {
  lc::Size best;
  for (const lc::Size& size : sizes)
    if (std::size_t{size.width} * size.height > std::size_t{best.width} * best.height) best = size;
  return best;
}

// The place in raw_formats(), where the best stands first; its end: can't be read.
std::size_t rank_of(const lc::PixelFormat& format) {
  const RawFormat* found = find_libcamera_format(format.toString());
  return found == nullptr ? raw_formats().size() : static_cast<std::size_t>(found - raw_formats().data());
}

YuvCoding coding_of(const lc::StreamConfiguration& stream) {
  YuvCoding coding;
  if (!stream.colorSpace) return coding;
  if (stream.colorSpace->ycbcrEncoding == lc::ColorSpace::YcbcrEncoding::Rec709) {
    coding.red_weight = 0.2126;
    coding.blue_weight = 0.0722;
  }
  coding.full_range = stream.colorSpace->range == lc::ColorSpace::Range::Full;
  return coding;
}

// The bytes of one plane, mapped while this lives. The processor's caches are told so by the dma-buf's ioctl,
// where there is one.
class MappedPlane {
 public:
  explicit MappedPlane(const lc::FrameBuffer::Plane& plane)
      : fd_(plane.fd.get()), size_(std::size_t{plane.offset} + plane.length) {
    data_ = ::mmap(nullptr, size_, PROT_READ, MAP_SHARED, fd_, 0);
    if (data_ == MAP_FAILED)
      throw SourceError(Fault::device_error, fmt::format("mmap: {}", std::strerror(errno)));
    sync(DMA_BUF_SYNC_START);
    bytes_ = {static_cast<const std::uint8_t*>(data_) + plane.offset, plane.length};
  }
  ~MappedPlane() {
    sync(DMA_BUF_SYNC_END);
    ::munmap(data_, size_);
  }
  MappedPlane(const MappedPlane&) = delete;
  MappedPlane& operator=(const MappedPlane&) = delete;
  std::span<const std::uint8_t> bytes() const { return bytes_; }

 private:
  void sync(std::uint64_t when) const {
    dma_buf_sync what{when | DMA_BUF_SYNC_READ};
    ::ioctl(fd_, DMA_BUF_IOCTL_SYNC, &what);
  }
  const int fd_;
  const std::size_t size_;
  void* data_ = nullptr;
  std::span<const std::uint8_t> bytes_;
};

}  // namespace

LibcameraManager::LibcameraManager() {
  const std::scoped_lock lock(manager_mutex);
  if (!the_manager) {
    auto manager = std::make_unique<lc::CameraManager>();
    if (const int error = manager->start(); error != 0)
      throw SourceError(Fault::device_error,
                        fmt::format("libcamera does not start: {}", std::strerror(-error)));
    // Their news once, not with every connection.
    for (const char* category : {"Camera", "V4L2"}) lc::logSetLevel(category, "WARN");
    the_manager = std::move(manager);
  }
  ++manager_users;
}

LibcameraManager::~LibcameraManager() {
  const std::scoped_lock lock(manager_mutex);
  if (--manager_users > 0) return;
  the_manager->stop();
  the_manager.reset();
}

lc::CameraManager* LibcameraManager::operator->() const {
  return the_manager.get();
}

const lc::ControlId* control_of(const lc::Camera& camera, const std::string& name) {
  for (const auto& [id, info] : camera.controls())
    if (id->name() == name) return id;
  return nullptr;
}

lc::ControlInfo range_of(const lc::Camera& camera, const lc::ControlId& control) {
  return camera.controls().at(control.id());
}

lc::ControlValue told(const lc::ControlList& metadata, const std::string& name) {
  for (const auto& [number, id] : lc::controls::controls)
    if (id->name() == name) return metadata.contains(number) ? metadata.get(number) : lc::ControlValue{};
  return {};
}

std::vector<std::string> formats_of(lc::Camera& camera) {
  std::vector<std::string> list;
  for (const lc::StreamRole role : kRoles) {
    const auto configuration = configuration_for(camera, role);
    if (!configuration) continue;
    const lc::StreamFormats& formats = configuration->at(0).formats();
    for (const lc::PixelFormat& format : formats.pixelformats()) {
      const bool readable = rank_of(format) < raw_formats().size();
      std::string text =
          fmt::format("{} up to {}{}", format.toString(), largest(formats.sizes(format)).toString(),
                      readable ? "" : " (can't be read)");
      if (std::ranges::find(list, text) == list.end()) list.push_back(std::move(text));
    }
  }
  return list;
}

LibcameraSession::LibcameraSession(const SourceOptions& options)
    : name_(options.url), wake_(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
  if (!wake_.good()) fail("eventfd", errno);
  const std::string id = name_.substr(name_.find(':') + 1);
  camera_ = manager_->get(id);
  if (!camera_) {
    std::string there;
    for (const auto& camera : manager_->cameras()) there += " " + camera->id();
    throw SourceError(Fault::device_missing, fmt::format("{}: libcamera finds{}", name_,
                                                         there.empty() ? " no camera" : " only" + there));
  }
  if (const int error = camera_->acquire(); error != 0) {
    camera_.reset();
    fail("acquire", -error);
  }
  try {
    configure(options);
  } catch (...) {
    camera_->release();
    throw;
  }
  camera_->requestCompleted.connect(this, &LibcameraSession::completed);
  camera_->disconnected.connect(this, &LibcameraSession::disconnected);
}

LibcameraSession::~LibcameraSession() {
  stop();
  camera_->requestCompleted.disconnect(this);
  camera_->disconnected.disconnect(this);
  requests_.clear();
  buffers_.reset();
  camera_->release();
}

void LibcameraSession::fail(const std::string& what, int error) const {
  const Fault fault = error == EBUSY                      ? Fault::device_busy
                      : error == ENODEV || error == ENXIO ? Fault::device_unplugged
                      : error == EACCES || error == EPERM ? Fault::device_denied
                                                          : Fault::device_error;
  throw SourceError(fault, fmt::format("{}: {}: {}", name_, what, std::strerror(error)));
}

// The best format of the best role, or the one asked for; the size asked for, or the largest.
void LibcameraSession::configure(const SourceOptions& options) {
  lc::PixelFormat chosen;
  std::size_t best = raw_formats().size();
  for (const lc::StreamRole role : kRoles) {
    auto configuration = configuration_for(*camera_, role);
    if (!configuration) continue;
    for (const lc::PixelFormat& format : configuration->at(0).formats().pixelformats()) {
      const std::size_t rank = rank_of(format);
      if (!options.pixel_format.empty() && format.toString() != options.pixel_format) continue;
      if (rank >= best) continue;
      best = rank;
      chosen = format;
      configuration_ = configuration_for(*camera_, role);
    }
  }
  if (!configuration_) {
    throw SourceError(
        Fault::format_unsupported,
        fmt::format("{}: expected {}, the camera offers {}", name_,
                    options.pixel_format.empty() ? "a format that we can read" : options.pixel_format,
                    fmt::join(formats_of(*camera_), ", ")));
  }
  lc::StreamConfiguration& stream = configuration_->at(0);
  stream.pixelFormat = chosen;
  stream.size = largest(stream.formats().sizes(chosen));
  if (options.width_px > 0 && options.height_px > 0)
    stream.size = {static_cast<unsigned>(options.width_px), static_cast<unsigned>(options.height_px)};
  if (configuration_->validate() == lc::CameraConfiguration::Invalid || stream.pixelFormat != chosen)
    throw SourceError(Fault::format_unsupported,
                      fmt::format("{}: the camera does not do {}", name_, chosen.toString()));
  if (const int error = camera_->configure(configuration_.get()); error != 0) fail("configure", -error);
  layout_ = {&raw_formats()[best],
             static_cast<int>(stream.size.width),
             static_cast<int>(stream.size.height),
             stream.stride,
             coding_of(stream),
             {}};
  buffers_ = std::make_unique<lc::FrameBufferAllocator>(camera_);
  if (const int count = buffers_->allocate(stream.stream()); count <= 0)
    fail("no buffers", count < 0 ? -count : ENOMEM);
  for (const auto& buffer : buffers_->buffers(stream.stream())) {
    if (requests_.size() == kRequests) break;
    requests_.push_back(camera_->createRequest());
    if (!requests_.back()) fail("no request", ENOMEM);
    if (const int error = requests_.back()->addBuffer(stream.stream(), buffer.get()); error != 0)
      fail("addBuffer", -error);
  }
}

std::string LibcameraSession::format_text() const {
  return configuration_->at(0).toString();
}

void LibcameraSession::start(const lc::ControlList& at_start) {
  if (running_) return;
  if (const int error = camera_->start(&at_start); error != 0) fail("start", -error);
  running_ = true;
  for (const auto& request : requests_) queue(request.get());
}

void LibcameraSession::stop() {
  if (!running_) return;
  running_ = false;
  camera_->stop();  // gives all requests back, cancelled
  const std::scoped_lock lock(mutex_);
  completed_.clear();
  for (const auto& request : requests_) request->reuse(lc::Request::ReuseBuffers);
}

void LibcameraSession::set(const lc::ControlList& settings) {
  settings_ = settings;
  ++generation_;
  passed_over_ = 0;
  sent_ = false;
}

void LibcameraSession::queue(lc::Request* request) {
  if (!std::exchange(sent_, true))
    for (const auto& [id, value] : settings_) request->controls().set(id, value);
  generations_of_[request] = generation_;
  if (const int error = camera_->queueRequest(request); error != 0) fail("queueRequest", -error);
}

void LibcameraSession::give_back(lc::Request* request) {
  request->reuse(lc::Request::ReuseBuffers);
  queue(request);
}

void LibcameraSession::completed(lc::Request* request) {
  const std::scoped_lock lock(mutex_);
  completed_.push_back(request);
  ::eventfd_write(wake_.get(), 1);
}

void LibcameraSession::disconnected() {
  const std::scoped_lock lock(mutex_);
  gone_ = true;
  ::eventfd_write(wake_.get(), 1);
}

lc::Request* LibcameraSession::next(Deadline deadline, std::stop_token stop) {
  for (;;) {
    lc::Request* request = nullptr;
    {
      const std::scoped_lock lock(mutex_);
      if (gone_) throw SourceError(Fault::device_unplugged, name_ + ": the camera went away");
      if (!completed_.empty()) {
        request = completed_.front();
        completed_.pop_front();
      }
    }
    if (request != nullptr) {
      if (request->status() == lc::Request::RequestCancelled || generations_of_[request] == generation_)
        return request;
      ++passed_over_;
      give_back(request);
      continue;
    }
    const Wait wait = wait_readable(wake_.get(), deadline, stop);
    if (wait == Wait::stopped) return nullptr;
    if (wait == Wait::timeout)
      throw SourceError(Fault::device_timeout, name_ + ": the camera gave no picture in time");
    eventfd_t ignored = 0;
    ::eventfd_read(wake_.get(), &ignored);
  }
}

Exposure LibcameraSession::picture(const lc::Request& request, std::size_t max_pixels) const {
  const lc::FrameBuffer& buffer = *request.buffers().begin()->second;
  const lc::FrameMetadata& metadata = buffer.metadata();
  if (metadata.status != lc::FrameMetadata::FrameSuccess)
    throw SourceError(Fault::torn, name_ + ": the driver says that data are missing");
  // The planes one after the other, as in one buffer: what pads the luma is left out.
  std::vector<std::uint8_t> bytes;
  for (std::size_t i = 0; i < buffer.planes().size(); ++i) {
    const MappedPlane plane(buffer.planes()[i]);
    std::size_t count = std::min<std::size_t>(plane.bytes().size(), metadata.planes()[i].bytesused);
    if (i + 1 < buffer.planes().size())
      count = std::min(count, layout_.stride_bytes * static_cast<std::size_t>(layout_.height_px));
    bytes.insert(bytes.end(), plane.bytes().begin(),
                 plane.bytes().begin() + static_cast<std::ptrdiff_t>(count));
  }
  RawFrame frame = layout_;
  frame.bytes = bytes;
  return decode_raw_frame(frame, name_, max_pixels);
}

}  // namespace lampglow::daemon
#endif
