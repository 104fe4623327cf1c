#include "daemon/pictures/exr.h"

#include <OpenEXR/IexBaseExc.h>
#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfIO.h>
#include <OpenEXR/ImfInputFile.h>
#include <OpenEXR/ImfOutputFile.h>

#include <algorithm>
#include <array>
#include <string>

namespace lampglow::daemon {
namespace {

constexpr std::array<std::uint8_t, 4> kSignature{0x76, 0x2F, 0x31, 0x01};

class ReadStream : public Imf::IStream {
 public:
  explicit ReadStream(std::span<const std::uint8_t> bytes) : Imf::IStream("picture"), bytes_(bytes) {}
  bool read(char to[], int count) override {
    const auto length = static_cast<std::uint64_t>(count);
    if (at_ > bytes_.size() || length > bytes_.size() - at_)
      throw PictureError("the file ends before the picture does");
    std::copy_n(bytes_.begin() + static_cast<std::ptrdiff_t>(at_), length, to);
    at_ += length;
    return at_ < bytes_.size();
  }
  std::uint64_t tellg() override { return at_; }
  void seekg(std::uint64_t at) override { at_ = at; }

 private:
  std::span<const std::uint8_t> bytes_;
  std::uint64_t at_ = 0;
};

class WriteStream : public Imf::OStream {
 public:
  explicit WriteStream(Bytes& bytes) : Imf::OStream("picture"), bytes_(bytes) {}
  void write(const char from[], int count) override {
    const auto length = static_cast<std::size_t>(count);
    if (at_ + length > bytes_.size()) bytes_.resize(at_ + length);
    std::copy_n(from, length, bytes_.begin() + static_cast<std::ptrdiff_t>(at_));
    at_ += length;
  }
  std::uint64_t tellp() override { return at_; }
  void seekp(std::uint64_t at) override { at_ = at; }

 private:
  Bytes& bytes_;
  std::uint64_t at_ = 0;
};

std::vector<std::string> wanted_channels(const Imf::ChannelList& channels) {
  if (channels.findChannel("R") && channels.findChannel("G") && channels.findChannel("B"))
    return {"R", "G", "B"};
  if (channels.findChannel("Y")) return {"Y"};
  if (auto only = channels.begin(); only != channels.end()) {
    const std::string name = only.name();
    if (++only == channels.end()) return {name};
  }
  throw PictureError("neither R, G, B nor Y nor a single channel");
}

void read_rows(Imf::InputFile& file, RowSink& sink) {
  const auto window = file.header().dataWindow();
  const auto names = wanted_channels(file.header().channels());
  for (const std::string& name : names) {
    const Imf::Channel& channel = file.header().channels()[name];
    if (channel.xSampling != 1 || channel.ySampling != 1) throw PictureError("a channel without all pixels");
  }
  const PictureShape shape{window.max.x - window.min.x + 1, window.max.y - window.min.y + 1,
                           static_cast<int>(names.size()), 32};
  sink.begin(shape);
  std::vector<float> samples(static_cast<std::size_t>(shape.width_px) * names.size());
  const std::size_t stride = names.size() * sizeof(float);
  for (int y = window.min.y; y <= window.max.y; ++y) {
    // Where the library is to look for pixel (0, 0), so that this row begins at the buffer's start.
    char* start = reinterpret_cast<char*>(samples.data());
    Imf::FrameBuffer frame;
    for (std::size_t i = 0; i < names.size(); ++i)
      frame.insert(names[i],
                   Imf::Slice::Make(Imf::FLOAT, start + i * sizeof(float), {window.min.x, y}, shape.width_px,
                                    1, stride, stride * static_cast<std::size_t>(shape.width_px)));
    file.setFrameBuffer(frame);
    file.readPixels(y);
    sink.take(y - window.min.y, std::span<const float>(samples));
  }
}

}  // namespace

bool is_exr(std::span<const std::uint8_t> bytes) {
  return bytes.size() >= kSignature.size() && std::equal(kSignature.begin(), kSignature.end(), bytes.begin());
}

void decode_exr(std::span<const std::uint8_t> bytes, RowSink& sink) {
  try {
    Imf::Header::setMaxImageSize(1 << 16, 1 << 16);
    ReadStream stream(bytes);
    Imf::InputFile file(stream, 0);
    read_rows(file, sink);
  } catch (const Iex::BaseExc& error) {
    throw PictureError(error.what());
  }
}

Bytes encode_exr(const PictureView& picture) {
  const PictureShape& shape = picture.shape;
  if ((shape.channels != 1 && shape.channels != 3) || shape.bits != 32)
    throw PictureError("an EXR is written as float, grey or in colours");
  const auto samples = std::get<std::span<const float>>(picture.samples);
  const std::size_t pixel = static_cast<std::size_t>(shape.channels) * sizeof(float);
  Imf::Header header(shape.width_px, shape.height_px);
  Imf::FrameBuffer frame;
  for (int i = 0; i < shape.channels; ++i) {
    const std::string name = shape.channels == 1 ? "Y" : std::string(1, "RGB"[i]);
    header.channels().insert(name, Imf::Channel(Imf::FLOAT));
    // The library only reads the samples; its slices know no const.
    char* start = reinterpret_cast<char*>(const_cast<float*>(samples.data() + i));
    frame.insert(name,
                 Imf::Slice(Imf::FLOAT, start, pixel, pixel * static_cast<std::size_t>(shape.width_px)));
  }
  Bytes bytes;
  {
    WriteStream stream(bytes);
    Imf::OutputFile file(stream, header, 0);
    file.setFrameBuffer(frame);
    file.writePixels(shape.height_px);
  }  // the table of rows is written last
  return bytes;
}

}  // namespace lampglow::daemon
