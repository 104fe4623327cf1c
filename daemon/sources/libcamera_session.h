// One camera of libcamera while it is open: its format, its requests, their pictures. Only the two
// libcamera_*.cpp include this: it needs the library's headers.
#pragma once

#include <libcamera/libcamera.h>

#include <chrono>
#include <deque>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

#include "daemon/config/descriptor.h"
#include "daemon/sources/open_source.h"
#include "daemon/sources/raw_frame.h"

namespace lampglow::daemon {

// The library allows one manager per process: all cameras share it, and who comes last lets go of it.
class LibcameraManager {
 public:
  LibcameraManager();  // throws SourceError
  ~LibcameraManager();
  LibcameraManager(const LibcameraManager&) = delete;
  LibcameraManager& operator=(const LibcameraManager&) = delete;
  libcamera::CameraManager* operator->() const;
};

// Controls by name. Releases differ in which they have (AeEnable, then ExposureTimeMode and
// AnalogueGainMode): so what the camera at hand lists is asked for, and not what the headers declared.
// nullptr: the camera has no such control.
const libcamera::ControlId* control_of(const libcamera::Camera& camera, const std::string& name);
libcamera::ControlInfo range_of(const libcamera::Camera& camera, const libcamera::ControlId& control);
// Of a picture's metadata; a none-value where it is not told.
libcamera::ControlValue told(const libcamera::ControlList& metadata, const std::string& name);

// What the camera offers, the first name is the format and the size the largest: "SRGGB12_CSI2P up to
// 4056x3040".
std::vector<std::string> formats_of(libcamera::Camera& camera);

// Every function throws SourceError; the camera's name is in the message.
// Its members stand in the order in which they must end, and behind the mutex that guards them.
class LibcameraSession {  // NOLINT(clang-analyzer-optin.performance.Padding)
 public:
  using Deadline = std::chrono::steady_clock::time_point;

  // Finds and configures the camera. Does not start yet.
  explicit LibcameraSession(const SourceOptions& options);
  ~LibcameraSession();
  LibcameraSession(const LibcameraSession&) = delete;
  LibcameraSession& operator=(const LibcameraSession&) = delete;

  libcamera::Camera& camera() const { return *camera_; }
  int bit_depth() const { return layout_.format->bits; }
  std::string format_text() const;

  // Idempotent. Some of the library's handlers heed what is given at the start, some only what the requests
  // carry.
  void start(const libcamera::ControlList& at_start);
  void stop();
  // The next request carries these, and they hold from then on. Requests on their way still have the old
  // ones: next() passes them over.
  void set(const libcamera::ControlList& settings);

  // The next request that carried the present settings. It may be cancelled: ask its status. nullptr when
  // stopped.
  libcamera::Request* next(Deadline deadline, std::stop_token stop);
  int passed_over() const { return passed_over_; }  // since set()
  void give_back(libcamera::Request* request);      // to be filled again
  // Throws SourceError(torn) where the driver or the bytes say that it is incomplete.
  Exposure picture(const libcamera::Request& request, std::size_t max_pixels) const;

 private:
  void configure(const SourceOptions& options);
  void completed(libcamera::Request* request);  // on the library's thread
  void disconnected();                          // on the library's thread
  void queue(libcamera::Request* request);
  [[noreturn]] void fail(const std::string& what, int error) const;

  const std::string name_;
  LibcameraManager manager_;
  std::shared_ptr<libcamera::Camera> camera_;
  std::unique_ptr<libcamera::CameraConfiguration> configuration_;
  std::unique_ptr<libcamera::FrameBufferAllocator> buffers_;
  std::vector<std::unique_ptr<libcamera::Request>> requests_;
  RawFrame layout_;  // of the chosen format, without bytes
  bool running_ = false;
  libcamera::ControlList settings_;
  int generation_ = 0;  // of the settings
  bool sent_ = false;   // the settings, with a request: they hold until others come, and each costs a USB
                        // camera a transfer
  int passed_over_ = 0;
  std::map<const libcamera::Request*, int> generations_of_;  // that each request carries

  const Descriptor wake_;  // an eventfd: something came
  std::mutex mutex_;       // guards what follows
  std::deque<libcamera::Request*> completed_;
  bool gone_ = false;
};

}  // namespace lampglow::daemon
