// A Video4Linux capture device: formats, controls, mmap streaming. One object is one open device.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <span>
#include <stop_token>
#include <string>
#include <vector>

#include "daemon/config/descriptor.h"
#include "daemon/sources/raw_frame.h"

namespace lampglow::daemon {

struct V4l2Control {
  std::uint32_t id = 0;
  std::string name;
  std::int64_t minimum = 0, maximum = 0, step = 1, value = 0;
};

// Every function throws SourceError; the device's name is in the message.
class V4l2Device {
 public:
  explicit V4l2Device(const std::string& path);
  V4l2Device(const V4l2Device&) = delete;
  V4l2Device& operator=(const V4l2Device&) = delete;
  ~V4l2Device();

  const std::string& driver() const { return driver_; }  // "uvcvideo: HD Webcam (usb-...)"
  std::vector<std::string> list_formats() const;         // "YUYV 1280x720", all that the device offers
  std::vector<V4l2Control> list_controls() const;

  // The best format that we can read, or `fourcc` if not empty; the size asked for, or the largest.
  void choose_format(const std::string& fourcc, int width_px, int height_px);
  std::string format_text() const;
  int bit_depth() const { return layout_.format->bits; }
  std::optional<double> frame_rate_hz() const;
  // Makes room for long exposures where the device lets us.
  void set_frame_interval(double at_least_s);

  std::optional<V4l2Control> control(std::uint32_t id) const;  // empty: the device has none
  // Sets and reads back; the value that the device then has. Empty: no such control, or it refuses.
  std::optional<std::int64_t> set_control(std::uint32_t id, std::int64_t value);

  void start();  // idempotent
  void stop();
  // The next good frame; `frame.bytes` is valid until the next call. False when stopped.
  bool next_frame(RawFrame& frame, std::chrono::steady_clock::time_point deadline, std::stop_token stop);

 private:
  struct Buffer {
    void* data = nullptr;
    std::size_t size = 0;
  };
  std::vector<std::string> offered_formats() const;
  std::pair<int, int> largest_size(std::uint32_t fourcc) const;
  void map_buffers();
  void unmap_buffers();
  void queue(std::uint32_t index);
  int call(unsigned long request, void* argument) const;
  [[noreturn]] void fail(const std::string& what) const;

  const std::string path_;
  Descriptor fd_;
  std::string driver_;
  RawFrame layout_;  // of the chosen format, without bytes
  std::vector<Buffer> buffers_;
  bool streaming_ = false;
  std::optional<std::uint32_t> held_;  // the buffer whose bytes the caller has
};

}  // namespace lampglow::daemon
