#include "daemon/sources/rtsp_camera.h"

#include <fmt/format.h>

#include <algorithm>
#include <cerrno>
#include <mutex>

#include "daemon/sources/credentials.h"
#include "daemon/sources/fault.h"

extern "C" {
#include <libavcodec/avcodec.h>
#include <libavformat/avformat.h>
#include <libavutil/imgutils.h>
#include <libswscale/swscale.h>
}

namespace lampglow::daemon {

using Clock = std::chrono::steady_clock;

namespace {

struct FormatCloser {
  void operator()(AVFormatContext* context) const { avformat_close_input(&context); }
};
struct CodecCloser {
  void operator()(AVCodecContext* context) const { avcodec_free_context(&context); }
};
struct PacketFreer {
  void operator()(AVPacket* packet) const { av_packet_free(&packet); }
};
struct FrameFreer {
  void operator()(AVFrame* frame) const { av_frame_free(&frame); }
};
struct ScalerFreer {
  void operator()(SwsContext* context) const { sws_freeContext(context); }
};
using FramePointer = std::unique_ptr<AVFrame, FrameFreer>;

// libav writes addresses with their passwords to its log: nothing of it is let through.
void silence_once() {
  static std::once_flag once;
  std::call_once(once, [] { av_log_set_callback([](void*, int, const char*, va_list) {}); });
}

std::string percent_encoded(const std::string& text) {
  std::string out;
  for (const unsigned char c : text) {
    const bool plain = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9');
    out += plain ? std::string(1, static_cast<char>(c)) : fmt::format("%{:02X}", c);
  }
  return out;
}

std::string url_with(const std::string& url, const std::optional<Credentials>& credentials) {
  if (!credentials) return url;
  const std::size_t host = url.find("://") + 3;
  return url.substr(0, host) + percent_encoded(credentials->user) + ":" +
         percent_encoded(credentials->password) + "@" + url.substr(host);
}

// A lowpass in chroma would mix colours of neighbours: nearest chroma, exact arithmetic, the same everywhere.
constexpr int kScalerFlags = SWS_POINT | SWS_ACCURATE_RND | SWS_BITEXACT | SWS_FULL_CHR_H_INT;

int bits_of(AVPixelFormat format) {
  const int bits = av_pix_fmt_desc_get(format)->comp[0].depth;
  return bits > 8 ? 16 : 8;
}

}  // namespace

class RtspCamera::Session {
 public:
  Session(const SourceOptions& options, const std::string& name, std::stop_token stop)
      : options_(options), name_(name) {
    silence_once();
    limit(options_.connect_timeout, stop);
    open();
    limit(options_.frame_timeout, stop);
    find_video();
  }

  // The next key frame that begins after now; empty when stopped.
  std::optional<Exposure> key_frame(Clock::time_point deadline, bool first, std::stop_token stop) {
    deadline_ = deadline;
    stop_ = stop;
    if (!first) drop_stale();
    avcodec_flush_buffers(codec_.get());
    return decode_key_frame();
  }

  std::string text() const {
    const AVCodecParameters& parameters = *stream().codecpar;
    return fmt::format("{} {}x{} {}", avcodec_get_name(parameters.codec_id), parameters.width,
                       parameters.height, codec_->pix_fmt >= 0 ? av_get_pix_fmt_name(codec_->pix_fmt) : "");
  }

 private:
  void limit(std::chrono::milliseconds time, std::stop_token stop) {
    deadline_ = Clock::now() + time;
    stop_ = std::move(stop);
  }

  static int interrupted(void* self) {
    const auto* session = static_cast<const Session*>(self);
    return session->stop_.stop_requested() || Clock::now() > session->deadline_ ? 1 : 0;
  }

  void open() {
    AVFormatContext* context = avformat_alloc_context();
    context->interrupt_callback = {&Session::interrupted, this};
    context->flags |= AVFMT_FLAG_NOBUFFER;
    AVDictionary* settings = nullptr;
    av_dict_set(&settings, "rtsp_transport", "tcp", 0);
    av_dict_set(&settings, "allowed_media_types", "video", 0);
    av_dict_set_int(&settings, "stimeout", std::chrono::microseconds(options_.stall_timeout).count(), 0);
    av_dict_set_int(&settings, "timeout", std::chrono::microseconds(options_.stall_timeout).count(), 0);
    const std::string url = url_with(options_.url, read_credentials(options_));
    const int result = avformat_open_input(&context, url.c_str(), nullptr, &settings);
    av_dict_free(&settings);
    if (result < 0) fail(result, "open", Fault::connect_timeout);  // frees the context itself
    format_.reset(context);
  }

  void find_video() {
    int result = avformat_find_stream_info(format_.get(), nullptr);
    if (result < 0) fail(result, "stream information", Fault::stalled);
    const AVCodec* codec = nullptr;
    video_ = av_find_best_stream(format_.get(), AVMEDIA_TYPE_VIDEO, -1, -1, &codec, 0);
    if (video_ < 0 || codec == nullptr) {
      throw SourceError(Fault::format_unsupported, name_ + ": no video stream that can be decoded");
    }
    codec_.reset(avcodec_alloc_context3(codec));
    avcodec_parameters_to_context(codec_.get(), stream().codecpar);
    codec_->err_recognition = AV_EF_CAREFUL;
    codec_->thread_count = 1;
    codec_->flags |= AV_CODEC_FLAG_LOW_DELAY;
    if (avcodec_open2(codec_.get(), codec, nullptr) < 0) {
      throw SourceError(Fault::format_unsupported, name_ + ": the decoder does not open");
    }
  }

  const AVStream& stream() const { return *format_->streams[video_]; }

  // What has come since the last picture: packets that are there without waiting. A packet that took some
  // time to come is of the present.
  void drop_stale() {
    const std::unique_ptr<AVPacket, PacketFreer> packet(av_packet_alloc());
    for (;;) {
      const auto began = Clock::now();
      read(*packet);
      av_packet_unref(packet.get());
      if (Clock::now() - began > std::chrono::milliseconds(5)) return;
    }
  }

  void read(AVPacket& packet) {
    for (;;) {
      const int result = av_read_frame(format_.get(), &packet);
      if (result == AVERROR(EAGAIN)) continue;
      if (result < 0) fail(result, "read", seen_packet_ ? Fault::no_key_frame : Fault::stalled);
      seen_packet_ = true;
      if (packet.stream_index == video_) return;
      av_packet_unref(&packet);
    }
  }

  std::optional<Exposure> decode_key_frame() {
    const std::unique_ptr<AVPacket, PacketFreer> packet(av_packet_alloc());
    const FramePointer frame(av_frame_alloc());
    seen_packet_ = false;
    bool sent = false;
    while (!stop_.stop_requested()) {
      read(*packet);
      const bool key = (packet->flags & AV_PKT_FLAG_KEY) != 0;
      const bool damaged = (packet->flags & AV_PKT_FLAG_CORRUPT) != 0;
      if (key && damaged) sent = false;
      if ((key && !damaged) || sent) sent = avcodec_send_packet(codec_.get(), packet.get()) >= 0;
      av_packet_unref(packet.get());
      if (!sent) continue;
      if (avcodec_receive_frame(codec_.get(), frame.get()) != 0) continue;
      if (is_clean(*frame)) return exposure_of(*frame);
      av_frame_unref(frame.get());
      avcodec_flush_buffers(codec_.get());
      sent = false;
    }
    return std::nullopt;
  }

  static bool is_clean(const AVFrame& frame) {
    return frame.key_frame != 0 && (frame.flags & AV_FRAME_FLAG_CORRUPT) == 0 &&
           frame.decode_error_flags == 0;
  }

  Exposure exposure_of(const AVFrame& frame) {
    const auto format = static_cast<AVPixelFormat>(frame.format);
    const std::size_t pixels = static_cast<std::size_t>(frame.width) * static_cast<std::size_t>(frame.height);
    if (pixels > options_.max_pixels) {
      throw SourceError(Fault::too_large, fmt::format("{}: {}x{} pixels", name_, frame.width, frame.height));
    }
    Exposure exposure{name_, {}, {}, Image<std::uint16_t>(frame.width, frame.height), true};
    if (bits_of(format) == 8) {
      take_green<std::uint8_t>(frame, format, AV_PIX_FMT_RGB24, exposure);
    } else {
      take_green<std::uint16_t>(frame, format, AV_PIX_FMT_RGB48, exposure);
    }
    return exposure;
  }

  // To RGB by the stream's own matrix and range; then green.
  template <typename Sample>
  void take_green(const AVFrame& frame, AVPixelFormat from, AVPixelFormat to, Exposure& exposure) {
    const int width = frame.width, height = frame.height;
    const std::unique_ptr<SwsContext, ScalerFreer> scaler(
        sws_getContext(width, height, from, width, height, to, kScalerFlags, nullptr, nullptr, nullptr));
    if (!scaler) throw SourceError(Fault::format_unsupported, name_ + ": pixel format can't be converted");
    const bool full = frame.color_range == AVCOL_RANGE_JPEG || codec_->color_range == AVCOL_RANGE_JPEG;
    const int* matrix =
        sws_getCoefficients(frame.colorspace == AVCOL_SPC_UNSPECIFIED ? SWS_CS_DEFAULT : frame.colorspace);
    sws_setColorspaceDetails(scaler.get(), matrix, full ? 1 : 0, matrix, 1, 0, 1 << 16, 1 << 16);
    std::vector<Sample> rgb(3 * exposure.pixels.pixels.size());
    std::uint8_t* planes[1]{reinterpret_cast<std::uint8_t*>(rgb.data())};
    const int strides[1]{width * 3 * static_cast<int>(sizeof(Sample))};
    sws_scale(scaler.get(), frame.data, frame.linesize, 0, height, planes, strides);
    std::size_t coloured = 0;  // a codec's rounding is no colour, nor is a thousandth of the pixels
    const int tolerance = sizeof(Sample) == 1 ? 5 : 1310;
    for (std::size_t i = 0; i < exposure.pixels.pixels.size(); ++i) {
      const Sample* pixel = rgb.data() + 3 * i;
      const auto [low, high] = std::minmax({pixel[0], pixel[1], pixel[2]});
      coloured += high - low > tolerance;
      exposure.pixels.pixels[i] = pixel[1];
    }
    exposure.monochrome = coloured * 1000 <= exposure.pixels.pixels.size();
  }

  [[noreturn]] void fail(int result, const char* what, Fault on_timeout) const {
    char text[AV_ERROR_MAX_STRING_SIZE] = "";
    av_strerror(result, text, sizeof text);
    throw SourceError(fault_of(result, on_timeout), fmt::format("{}: {}: {}", name_, what, text));
  }

  Fault fault_of(int result, Fault on_timeout) const {
    if (stop_.stop_requested()) return Fault::stopped;
    if (result == AVERROR_EXIT || result == AVERROR(ETIMEDOUT)) return on_timeout;
    if (result == AVERROR_HTTP_UNAUTHORIZED || result == AVERROR_HTTP_FORBIDDEN) return Fault::unauthorised;
    if (result == AVERROR_HTTP_NOT_FOUND || result == AVERROR_HTTP_BAD_REQUEST ||
        result == AVERROR_HTTP_OTHER_4XX || result == AVERROR_HTTP_SERVER_ERROR) {
      return Fault::http_error;
    }
    if (result == AVERROR(ECONNREFUSED)) return Fault::connection_refused;
    if (result == AVERROR(EHOSTUNREACH) || result == AVERROR(ENETUNREACH)) return Fault::unreachable;
    if (result == AVERROR(ECONNRESET) || result == AVERROR(EPIPE)) return Fault::connection_lost;
    if (result == AVERROR_EOF) return Fault::stream_ended;
    // libavformat reports an unknown name as EIO while opening, and a lost peer as EIO while reading.
    if (result == AVERROR(EIO)) return format_ ? Fault::connection_lost : Fault::name_not_found;
    return Fault::protocol_error;
  }

  const SourceOptions& options_;
  const std::string& name_;
  Clock::time_point deadline_;
  std::stop_token stop_;
  std::unique_ptr<AVFormatContext, FormatCloser> format_;
  std::unique_ptr<AVCodecContext, CodecCloser> codec_;
  int video_ = -1;
  bool seen_packet_ = false;
};

RtspCamera::RtspCamera(SourceOptions options)
    : options_(std::move(options)), name_(redacted_url(options_.url)) {}
RtspCamera::~RtspCamera() = default;

void RtspCamera::close() {
  session_.reset();
}

std::optional<Bracket> RtspCamera::take_picture(std::stop_token stop) {
  const auto deadline = Clock::now() + options_.frame_timeout;
  const bool first = session_ == nullptr;
  if (first) session_ = std::make_unique<Session>(options_, name_, stop);
  auto exposure = session_->key_frame(deadline, first, stop);
  if (!exposure) return std::nullopt;
  Bracket bracket;
  bracket.time_utc = utc_now();
  bracket.exposures.push_back(std::move(*exposure));
  return bracket;
}

std::optional<Bracket> RtspCamera::next(std::stop_token stop) {
  try {
    auto bracket = take_picture(stop);
    if (!options_.stay_connected || !bracket) close();
    return bracket;
  } catch (const SourceError& error) {
    close();
    if (error.fault() == Fault::stopped) return std::nullopt;
    throw;
  } catch (...) {
    close();
    throw;
  }
}

SourceInfo RtspCamera::describe(std::stop_token stop) {
  SourceInfo info;
  info.driver = "RTSP over TCP";
  if (!session_) session_ = std::make_unique<Session>(options_, name_, stop);
  info.formats.push_back(session_->text());
  close();
  info.notes.push_back("A stream does not tell exposure and gain: lock both in the camera's own pages.");
  return info;
}

}  // namespace lampglow::daemon
