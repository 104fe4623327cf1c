// A USB camera (USB Video Class 1.0, 12 bit grey) that is a program: the kernel's vhci_hcd speaks USB/IP with
// it over a socket, and its uvcvideo makes a /dev/video of it, as of any webcam. It counts photons.
#pragma once

#include <array>
#include <cstdint>
#include <mutex>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "estimator/photometry/image.h"

namespace lampglow::testing {

// What the camera does when it is told to leave automatic exposure: it does so; it answers with an error; or
// it says yes and goes on as before, which reading back does not show (uvcvideo remembers what it wrote).
enum class UsbLock { keeps, refuses, ignores };

struct UsbCameraOptions {
  UsbLock lock = UsbLock::keeps;
  double lamp_electrons_per_s = 4e6;  // a pixel's, in the lamp's core
  double sky_electrons_per_s = 4e3;
  // Not empty: a camera without any control that shows this, 8 bits of grey, and counts nothing.
  Image<std::uint16_t> picture{};
};

class UsbCamera {
 public:
  static constexpr int kWidthPx = 96, kHeightPx = 64;
  static constexpr double kBlack_dn = 64, kFull_dn = 4095, kElectronsPerDn = 4, kReadNoise_dn = 2;
  static constexpr std::uint32_t kExposureMin = 1, kExposureMax = 5000;  // of 100 us

  // Plugs the camera in. Throws std::runtime_error where the kernel has no vhci_hcd.
  explicit UsbCamera(UsbCameraOptions options = {});
  ~UsbCamera();  // pulls it out
  UsbCamera(const UsbCamera&) = delete;
  UsbCamera& operator=(const UsbCamera&) = delete;

  void show(const Image<std::uint16_t>& picture);  // of the first one's size
  void set_light(double lamp_electrons_per_s, double sky_electrons_per_s);

 private:
  struct Request;
  using Bytes = std::vector<std::uint8_t>;
  void serve(std::stop_token stop);
  bool read_exactly(void* data, std::size_t size);
  void answer(const Request& request, int status, const Bytes& data, std::uint32_t accepted);
  void answer_unlink(const Request& request);
  void control(const Request& request, const Bytes& out);
  void standard(const Request& request);
  void video_control(const Request& request, const Bytes& out);
  void set_control(std::uint8_t entity, std::uint8_t selector, const Bytes& out);
  Bytes get_control(std::uint8_t entity, std::uint8_t selector, std::uint8_t what) const;
  Bytes streaming_interface() const;
  Bytes control_interface() const;
  Bytes configuration_descriptor() const;
  Bytes probe_control() const;
  void give_payload(const Request& request);
  void expose();

  UsbCameraOptions options_;
  const bool plain_;  // shows pictures, has no control
  const std::uint32_t width_px_, height_px_, frame_bytes_;
  int fd_ = -1;            // our end; the kernel has the other
  int port_ = -1;          // of vhci_hcd
  std::mutex light_;       // guards light and picture in options_
  std::uint8_t mode_ = 8;  // aperture priority: automatic, as webcams come
  std::uint32_t exposure_ = 100;
  std::uint16_t gain_ = 10;
  Bytes streaming_control_;
  std::mt19937_64 random_{1};
  Bytes frame_;
  std::size_t sent_ = 0;  // of the frame
  std::uint8_t frame_id_ = 0;
  std::jthread thread_;
};

}  // namespace lampglow::testing
