#include "tests/vm/usb_camera.h"

#include <endian.h>
#include <fcntl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstring>
#include <fstream>
#include <stdexcept>

namespace lampglow::testing {
namespace {

using Bytes = std::vector<std::uint8_t>;

constexpr const char* kHost = "/sys/devices/platform/vhci_hcd.0/";
constexpr std::uint32_t kSubmit = 1, kUnlink = 2, kSubmitted = 3, kUnlinked = 4;  // USB/IP commands
constexpr int kStall = -EPIPE;
constexpr std::uint8_t kTerminal = 1, kProcessing = 2, kOutput = 3;          // entities of the video function
constexpr std::uint8_t kAutoExposureMode = 2, kExposureTime = 4, kGain = 4;  // their controls (UVC 1.0, A.9)
constexpr std::uint32_t kPayloadBytes = 16384;
constexpr std::uint32_t kFrameInterval_100ns = 500'000;  // 20 frames per second

[[gnu::noinline]] void put(Bytes& bytes, std::uint32_t value, int size) {
  for (int i = 0; i < size; ++i) bytes.push_back(static_cast<std::uint8_t>(value >> (8 * i)));
}
Bytes little(std::uint32_t value, int size) {
  Bytes bytes;
  put(bytes, value, size);
  return bytes;
}
// Not inlined: g++ 12 then warns falsely of an overflow.
[[gnu::noinline]] void append(Bytes& bytes, const Bytes& more) {
  for (const std::uint8_t byte : more) bytes.push_back(byte);
}

Bytes device_descriptor() {
  // USB 2.0, a device with interface associations, the test vendor of the USB/IP examples.
  return {18, 1, 0x00, 0x02, 0xEF, 2, 1, 64, 0x6B, 0x1D, 0x02, 0x01, 0x00, 0x01, 0, 0, 0, 1};
}

// The first free high-speed port of the virtual bus.
int free_port_of_host() {
  std::ifstream status(std::string(kHost) + "status");
  std::string line;
  std::getline(status, line);
  while (std::getline(status, line)) {
    int port = 0, state = 0;
    char hub[8] = "";
    if (std::sscanf(line.c_str(), "%7s %d %d", hub, &port, &state) == 3 && std::string(hub) == "hs" &&
        state == 4)
      return port;
  }
  throw std::runtime_error("no free port of vhci_hcd");
}

}  // namespace

struct UsbCamera::Request {
  std::uint32_t command = 0, sequence = 0, device = 0, direction = 0,
                endpoint = 0;           // direction 1: to the host
  std::uint32_t flags = 0, length = 0;  // of an unlink, `flags` is the sequence of what is called off
  std::uint32_t start = 0, packets = 0, interval = 0;
  std::uint8_t setup[8] = {};
};

UsbCamera::Bytes UsbCamera::control_interface() const {
  const std::uint8_t terminal_controls = plain_ ? 0 : 0x0A, gain_control = plain_ ? 0 : 0x02;
  Bytes units;
  append(units, {18, 0x24, 2, kTerminal, 0x01, 0x02, 0, 0, 0, 0, 0, 0, 0, 0, 3, terminal_controls, 0,
                 0});  // mode, exposure time
  append(units, {11, 0x24, 5, kProcessing, kTerminal, 0, 0, 2, 0x00, gain_control, 0});  // gain
  append(units, {9, 0x24, 3, kOutput, 0x01, 0x01, 0, kProcessing, 0});
  Bytes all{9, 4, 0, 0, 0, 0x0E, 1, 0, 0};
  Bytes header{13, 0x24, 1, 0x00, 0x01};
  put(header, static_cast<std::uint32_t>(13 + units.size()), 2);
  put(header, 48'000'000, 4);
  append(header, {1, 1});
  append(all, header);
  append(all, units);
  return all;
}

UsbCamera::Bytes UsbCamera::streaming_interface() const {
  // The name of the format, as far as it differs, and bits of a pixel.
  const std::uint8_t code[4] = {'Y', plain_ ? std::uint8_t{'8'} : std::uint8_t{'1'},
                                plain_ ? std::uint8_t{'0'} : std::uint8_t{'2'},
                                plain_ ? std::uint8_t{'0'} : std::uint8_t{' '}};
  const std::uint8_t bits = plain_ ? 8 : 16;
  Bytes format{27, 0x24, 4,    1, 1,    code[0], code[1], code[2], code[3], 0, 0, 0x10, 0, 0x80,
               0,  0,    0xAA, 0, 0x38, 0x9B,    0x71,    bits,    1,       0, 0, 0,    0};
  Bytes frame{30, 0x24, 5, 1, 0};
  put(frame, width_px_, 2);
  put(frame, height_px_, 2);
  put(frame, frame_bytes_ * 8 * 2, 4);
  put(frame, frame_bytes_ * 8 * 20, 4);
  put(frame, frame_bytes_, 4);
  put(frame, kFrameInterval_100ns, 4);
  put(frame, 1, 1);
  put(frame, kFrameInterval_100ns, 4);
  Bytes all{9, 4, 1, 0, 1, 0x0E, 2, 0, 0};
  Bytes header{14, 0x24, 1, 1};
  put(header, static_cast<std::uint32_t>(14 + format.size() + frame.size()), 2);
  append(header, {0x81, 0, kOutput, 0, 0, 0, 1, 0});
  append(all, header);
  append(all, format);
  append(all, frame);
  append(all, {7, 5, 0x81, 2, 0x00, 0x02, 0});  // bulk, 512 bytes
  return all;
}

UsbCamera::Bytes UsbCamera::configuration_descriptor() const {
  Bytes functions{8, 11, 0, 2, 0x0E, 3, 0, 0};
  append(functions, control_interface());
  append(functions, streaming_interface());
  Bytes all{9, 2};
  put(all, static_cast<std::uint32_t>(9 + functions.size()), 2);
  append(all, {2, 1, 0, 0x80, 250});
  append(all, functions);
  return all;
}

UsbCamera::Bytes UsbCamera::probe_control() const {
  Bytes control{1, 0, 1, 1};
  put(control, kFrameInterval_100ns, 4);
  control.resize(18, 0);
  put(control, frame_bytes_, 4);
  put(control, kPayloadBytes, 4);
  return control;
}

UsbCamera::UsbCamera(UsbCameraOptions options)
    : options_(std::move(options)),
      plain_(!options_.picture.empty()),
      width_px_(static_cast<std::uint32_t>(plain_ ? options_.picture.width_px : kWidthPx)),
      height_px_(static_cast<std::uint32_t>(plain_ ? options_.picture.height_px : kHeightPx)),
      frame_bytes_(width_px_ * height_px_ * (plain_ ? 1 : 2)),
      streaming_control_(probe_control()) {
  int ends[2];
  if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0) throw std::runtime_error("socketpair");
  fd_ = ends[0];
  port_ = free_port_of_host();
  thread_ = std::jthread([this](std::stop_token stop) { serve(stop); });
  std::ofstream attach(std::string(kHost) + "attach");
  attach << port_ << " " << ends[1] << " 65538 3" << std::flush;  // bus 1, device 2, high speed
  const bool attached = attach.good();
  ::close(ends[1]);  // the kernel holds it now
  if (!attached) throw std::runtime_error("vhci_hcd refuses the camera");
}

UsbCamera::~UsbCamera() {
  thread_.request_stop();
  ::shutdown(fd_, SHUT_RDWR);  // the cable is pulled
  thread_.join();
  ::close(fd_);
}

void UsbCamera::show(const Image<std::uint16_t>& picture) {
  const std::scoped_lock lock(light_);
  options_.picture = picture;
}

void UsbCamera::set_light(double lamp_electrons_per_s, double sky_electrons_per_s) {
  const std::scoped_lock lock(light_);
  options_.lamp_electrons_per_s = lamp_electrons_per_s;
  options_.sky_electrons_per_s = sky_electrons_per_s;
}

bool UsbCamera::read_exactly(void* data, std::size_t size) {
  return size == 0 || ::recv(fd_, data, size, MSG_WAITALL) == static_cast<ssize_t>(size);
}

void UsbCamera::serve(std::stop_token stop) {
  std::array<std::uint32_t, 12> words{};
  while (!stop.stop_requested() && read_exactly(words.data(), sizeof words)) {
    Request request;
    std::memcpy(request.setup, &words[10], 8);
    for (auto& word : words) word = be32toh(word);
    request.command = words[0];
    request.sequence = words[1];
    request.device = words[2];
    request.direction = words[3];
    request.endpoint = words[4];
    request.flags = words[5];
    request.length = words[6];
    Bytes out(request.command == kSubmit && request.direction == 0 ? request.length : 0);
    if (!read_exactly(out.data(), out.size())) return;
    if (request.command == kUnlink)
      answer_unlink(request);
    else if (request.endpoint == 0)
      control(request, out);
    else
      give_payload(request);
  }
}

// To an OUT request: how many bytes were taken; to an IN request the data themselves.
void UsbCamera::answer(const Request& request, int status, const Bytes& data, std::uint32_t accepted) {
  std::array<std::uint32_t, 12> words{};
  words[0] = htobe32(kSubmitted);
  words[1] = htobe32(request.sequence);
  words[5] = htobe32(static_cast<std::uint32_t>(status));
  words[6] = htobe32(request.direction == 1 ? static_cast<std::uint32_t>(data.size()) : accepted);
  Bytes bytes(sizeof words);
  std::memcpy(bytes.data(), words.data(), sizeof words);
  append(bytes, data);
  ::send(fd_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
}

// Every request was answered before the next is read: there is nothing left to call off.
void UsbCamera::answer_unlink(const Request& request) {
  std::array<std::uint32_t, 12> words{};
  words[0] = htobe32(kUnlinked);
  words[1] = htobe32(request.sequence);
  ::send(fd_, words.data(), sizeof words, MSG_NOSIGNAL);
}

void UsbCamera::control(const Request& request, const Bytes& out) {
  const bool to_class = (request.setup[0] & 0x60) == 0x20;
  if (to_class)
    video_control(request, out);
  else
    standard(request);
}

void UsbCamera::standard(const Request& request) {
  constexpr std::uint8_t kGetStatus = 0, kClearFeature = 1, kGetDescriptor = 6, kSetConfiguration = 9,
                         kSetInterface = 11;
  const std::uint8_t what = request.setup[1], kind = request.setup[3];
  Bytes data;
  if (what == kGetDescriptor && kind == 1) data = device_descriptor();
  if (what == kGetDescriptor && kind == 2) data = configuration_descriptor();
  if (what == kGetStatus) data = {0, 0};
  const bool known =
      !data.empty() || what == kClearFeature || what == kSetConfiguration || what == kSetInterface;
  data.resize(std::min<std::size_t>(data.size(), request.length));
  answer(request, known ? 0 : kStall, data, 0);
}

void UsbCamera::video_control(const Request& request, const Bytes& out) {
  const std::uint8_t what = request.setup[1], selector = request.setup[3];
  const std::uint8_t interface = request.setup[4], entity = request.setup[5];
  if (what == 1) {  // SET_CUR
    if (interface == 1) {
      streaming_control_ = probe_control();
    } else {
      if (entity == kTerminal && selector == kAutoExposureMode && options_.lock == UsbLock::refuses) {
        answer(request, kStall, {}, 0);
        return;
      }
      set_control(entity, selector, out);
    }
    answer(request, 0, {}, static_cast<std::uint32_t>(out.size()));
    return;
  }
  Bytes data = interface == 1 ? streaming_control_ : get_control(entity, selector, what);
  if (interface == 1 && what == 0x85) data = little(static_cast<std::uint32_t>(streaming_control_.size()), 2);
  if (interface == 1 && what == 0x86) data = {3};
  const bool known = !data.empty();
  data.resize(std::min<std::size_t>(data.size(), request.length));
  answer(request, known ? 0 : kStall, data, 0);
}

void UsbCamera::set_control(std::uint8_t entity, std::uint8_t selector, const Bytes& out) {
  if (out.empty()) return;
  if (entity == kTerminal && selector == kAutoExposureMode && options_.lock == UsbLock::keeps) mode_ = out[0];
  if (entity == kTerminal && selector == kExposureTime && out.size() == 4 && mode_ == 1) {
    std::uint32_t wanted = 0;
    std::memcpy(&wanted, out.data(), 4);
    exposure_ = std::clamp(le32toh(wanted), kExposureMin, kExposureMax);
  }
  if (entity == kProcessing && selector == kGain && out.size() == 2)
    gain_ = static_cast<std::uint16_t>(out[0] | out[1] << 8);
}

// `what`: GET_CUR 81, MIN 82, MAX 83, RES 84, LEN 85, INFO 86, DEF 87. Empty: there is no such control.
UsbCamera::Bytes UsbCamera::get_control(std::uint8_t entity, std::uint8_t selector, std::uint8_t what) const {
  struct Values {
    std::uint32_t now, low, high, step, usual;
    int size;
  } values{};
  if (plain_) return {};
  if (entity == kTerminal && selector == kAutoExposureMode)
    values = {mode_, 0, 0, 1 | 8, 8, 1};
  else if (entity == kTerminal && selector == kExposureTime)
    values = {exposure_, kExposureMin, kExposureMax, 1, 100, 4};
  else if (entity == kProcessing && selector == kGain)
    values = {gain_, 0, 100, 1, 10, 2};
  else
    return {};
  switch (what) {
    case 0x81:
      return little(values.now, values.size);
    case 0x82:
      return little(values.low, values.size);
    case 0x83:
      return little(values.high, values.size);
    case 0x84:
      return little(values.step, values.size);
    case 0x85:
      return little(static_cast<std::uint32_t>(values.size), 2);
    case 0x86:
      return {3};
    case 0x87:
      return little(values.usual, values.size);
    default:
      return {};
  }
}

// One lamp before an even sky, in counted photons, through a sensor of 12 bits.
void UsbCamera::expose() {
  double lamp = 0, sky = 0;
  {
    const std::scoped_lock lock(light_);
    if (plain_) {
      frame_.assign(options_.picture.pixels.begin(), options_.picture.pixels.end());
      return;
    }
    lamp = options_.lamp_electrons_per_s;
    sky = options_.sky_electrons_per_s;
  }
  const double exposure_s = exposure_ * 1e-4;
  std::normal_distribution<double> read_noise_dn(0, kReadNoise_dn);
  frame_.clear();
  for (int row = 0; row < kHeightPx; ++row) {
    for (int column = 0; column < kWidthPx; ++column) {
      const double distance2_px = std::pow(column - kWidthPx / 2, 2) + std::pow(row - kHeightPx / 2, 2);
      const double electrons =
          exposure_s * (sky + lamp * (distance2_px < 10 ? 1 : 0.01 / (1 + distance2_px / 50)));
      std::poisson_distribution<long> photons(std::max(electrons, 1e-9));
      const double dn =
          kBlack_dn + static_cast<double>(photons(random_)) / kElectronsPerDn + read_noise_dn(random_);
      put(frame_, static_cast<std::uint32_t>(std::clamp(std::lround(dn), 0L, std::lround(kFull_dn))), 2);
    }
  }
}

// A bulk transfer holds one payload: two bytes of header, then a part of the frame. A new frame takes its
// time.
void UsbCamera::give_payload(const Request& request) {
  if (sent_ >= frame_.size()) {
    std::this_thread::sleep_for(std::chrono::microseconds(std::max(50'000U, exposure_ * 100)));
    expose();
    sent_ = 0;
    frame_id_ ^= 1;
  }
  const std::size_t room = std::min(request.length, kPayloadBytes) - 2;
  const std::size_t part = std::min(room, frame_.size() - sent_);
  const bool last = sent_ + part == frame_.size();
  Bytes payload{2, static_cast<std::uint8_t>(0x80 | (last ? 2 : 0) | frame_id_)};
  payload.insert(payload.end(), frame_.begin() + static_cast<std::ptrdiff_t>(sent_),
                 frame_.begin() + static_cast<std::ptrdiff_t>(sent_ + part));
  sent_ += part;
  answer(request, 0, payload, 0);
}

}  // namespace lampglow::testing
