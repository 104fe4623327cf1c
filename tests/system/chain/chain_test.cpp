// Simulated night frames in at the far end of each source, the same visibility out of the station's database
// as from replaying the archive: bit for bit where nothing is lost on the way, else within the codec's loss.
#include "tests/system/chain/chain.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/support/temporary_folder.h"
#include "tests/system/cameras/stream_servers.h"
#include "tests/system/cameras/web_servers.h"

namespace lampglow::testing {
namespace {

using namespace std::chrono_literals;

// Made once: the night, with and without the loss of JPEG, and what replays say of both.
class Chain : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    nights_ = new TempFolder;
    make_night(nights_->path());
    png_ = new Night(replay_night(nights_->path() / "png", nights_->path() / "png.db"));
    jpeg_ = new Night(replay_night(nights_->path() / "jpeg", nights_->path() / "jpeg.db"));
  }
  static void TearDownTestSuite() {
    delete png_;
    delete jpeg_;
    delete nights_;
  }
  void SetUp() override {
    ASSERT_EQ(png_->truth.size(), 4u);
    ASSERT_EQ(jpeg_->truth.size(), 4u);
    for (const auto& row : png_->truth) ASSERT_TRUE(row.observation.extinction_per_m) << row.reason;
  }

  // The pictures as FOLDER/0.png, 1.png ...: ffmpeg's image sequences begin there.
  fs::path sequence(const Night& night) const {
    for (std::size_t i = 0; i < night.pictures.size(); ++i) {
      const std::string extension = night.pictures[i].extension();
      fs::copy_file(night.pictures[i], folder_ / (std::to_string(i) + extension));
    }
    return folder_ / ("%d" + night.pictures.front().extension().string());
  }
  static void expect_all_bit_for_bit(const ChainStation& station, const Night& night) {
    for (const auto& row : night.truth) ASSERT_TRUE(station.stores(row.observation));
  }

  // Lossy codecs: the archive's own 95 % bounds hold the live value, so that the codec costs less than the
  // estimate's uncertainty. A value may fade to a limit which those bounds keep. In the clear frame there is
  // only a limit, which the codec may shift by a factor of two.
  static void expect_within_bounds(const Observation& live, const Observation& archived) {
    const double live_m = live.mor_m().value();
    if (archived.limit == Limit::above) {
      EXPECT_NE(live.limit, Limit::below);
      EXPECT_GT(live_m, 0.5 * archived.mor_m().value());
      if (live.limit == Limit::above) {
        EXPECT_LT(live_m, 2 * archived.mor_m().value());
      }
      return;
    }
    EXPECT_LE(live_m, archived.mor_high_m().value());
    if (live.limit == Limit::none) {
      EXPECT_GE(live_m, archived.mor_low_m().value());
    }
    EXPECT_NE(live.limit, Limit::below);
  }

  // Every picture is seen, each near its own frame of the archive (their visibilities lie far apart).
  static void expect_all_within_the_loss(const ChainStation& station, const char* codec) {
    std::vector<double> loss(png_->truth.size(), -1);
    std::vector<std::string> faded(loss.size());  // to a limit
    const auto look = [&] {
      for (const auto& row : station.stored()) {
        if (!row.observation.extinction_per_m) continue;
        const auto distance = [&](const auto& one) { return log_ratio(row.observation, one.observation); };
        const auto nearest = std::ranges::min_element(png_->truth, {}, distance);
        const auto i = static_cast<std::size_t>(nearest - png_->truth.begin());
        expect_within_bounds(row.observation, nearest->observation);
        loss[i] = std::max(loss[i], distance(*nearest));
        if (row.observation.limit != nearest->observation.limit) faded[i] = ", to a limit";
      }
      return std::ranges::min(loss) >= 0;
    };
    const auto look_again = [&] {
      std::this_thread::sleep_for(200ms);  // between two questions to the database
      return look();
    };
    ASSERT_TRUE(eventually(30s, look_again)) << codec << "\n" << station.log();
    for (std::size_t i = 0; i < loss.size(); ++i) {
      const Observation& archived = png_->truth[i].observation;
      std::printf("%s: MOR %s%.0f m: the codec changes it by at most %.2f %%%s\n", codec,
                  archived.limit == Limit::above ? "above " : "", archived.mor_m().value(),
                  100 * std::expm1(loss[i]), faded[i].c_str());
    }
  }

  static TempFolder* nights_;
  static Night* png_;
  static Night* jpeg_;
  TempFolder folder_;
};

TempFolder* Chain::nights_ = nullptr;
Night* Chain::png_ = nullptr;
Night* Chain::jpeg_ = nullptr;

TEST_F(Chain, ArchiveBitForBit) {
  const ChainStation station(folder_.path(), png_->archive,
                             fmt::format("url = \"archive:{}\"", png_->archive.string()));
  expect_all_bit_for_bit(station, *png_);
}

TEST_F(Chain, HttpPngBitForBit) {
  if (!Lighttpd::available()) GTEST_SKIP() << "lighttpd is not installed";
  const Lighttpd server(folder_ / "camera");
  const ChainStation station(folder_.path(), png_->archive,
                             fmt::format("url = \"{}\"", server.url("/open/now.png")));
  for (std::size_t i = 0; i < png_->pictures.size(); ++i) {
    const std::string bytes = test::read_all(png_->pictures[i]);
    save_picture(folder_ / "camera/www/open/now.png", {bytes.begin(), bytes.end()});
    ASSERT_TRUE(station.stores(png_->truth[i].observation));
  }
}

TEST_F(Chain, WatchedFolderBitForBit) {
  fs::create_directories(folder_ / "incoming");
  const ChainStation station(folder_.path(), png_->archive,
                             "url = \"watch:incoming\"\nframe_timeout_s = 0.5");
  // From the first slot on the folder is watched; that nothing came is a record, too.
  const auto says_so = [](const auto& row) { return row.reason.starts_with("no_new_file"); };
  ASSERT_TRUE(eventually(10s, [&] { return std::ranges::any_of(station.stored(), says_so); }));
  for (std::size_t i = 0; i < png_->pictures.size(); ++i) {
    const std::string bytes = test::read_all(png_->pictures[i]);
    save_picture(folder_ / ("incoming/" + std::to_string(i) + ".png"), {bytes.begin(), bytes.end()});
    ASSERT_TRUE(station.stores(png_->truth[i].observation));
  }
}

TEST_F(Chain, MjpegOfTheArchivesOwnJpegsBitForBit) {
  if (!MjpegServer::available()) GTEST_SKIP() << "ffmpeg is not installed";
  const MjpegServer server(folder_.path(), sequence(*jpeg_).string(), "copy", 7);
  const ChainStation station(
      folder_.path(), jpeg_->archive,
      fmt::format("url = \"mjpeg+http://127.0.0.1:{}/stream\"\nstay_connected = true", server.port()));
  expect_all_bit_for_bit(station, *jpeg_);
}

TEST_F(Chain, MjpegWithinTheCodecsLoss) {
  if (!MjpegServer::available()) GTEST_SKIP() << "ffmpeg is not installed";
  const MjpegServer server(folder_.path(), sequence(*png_).string(),
                           "mjpeg -vf scale=out_range=full -pix_fmt yuvj420p -q:v 2", 7);
  const ChainStation station(
      folder_.path(), png_->archive,
      fmt::format("url = \"mjpeg+http://127.0.0.1:{}/stream\"\nstay_connected = true", server.port()));
  expect_all_within_the_loss(station, "MJPEG, ffmpeg -q:v 2");
}

class RtspChain : public Chain {
 protected:
  void SetUp() override {
    if (!rtsp_available()) GTEST_SKIP() << "gst-rtsp-server or ffmpeg is not installed";
    Chain::SetUp();
  }
  // 24 s, then the camera loop connects anew. Key frames, which alone are taken, fall on all four
  // pictures.
  std::string serve(const std::string& codec, const std::string& encoder) {
    record_movie(sequence(*png_).string(), encoder, 10, 60, folder_ / "night.mp4");
    const int port = free_port();
    server_ = std::make_unique<RtspServer>(folder_.path(), folder_ / "night.mp4", codec, port);
    return fmt::format("url = \"rtsp://127.0.0.1:{}/camera\"\nstay_connected = true", port);
  }
  std::unique_ptr<RtspServer> server_;
};

TEST_F(RtspChain, LosslessH264BitForBit) {
  const std::string source = serve("h264", "-c:v libx264 -preset ultrafast -qp 0 -g 3 -sc_threshold 0");
  const ChainStation station(folder_.path(), png_->archive, source);
  expect_all_bit_for_bit(station, *png_);
}

TEST_F(RtspChain, H264WithinTheCodecsLoss) {
  const std::string source = serve("h264", "-c:v libx264 -preset veryfast -crf 18 -g 3 -sc_threshold 0");
  const ChainStation station(folder_.path(), png_->archive, source);
  expect_all_within_the_loss(station, "H.264, x264 crf 18");
}

TEST_F(RtspChain, H265WithinTheCodecsLoss) {
  const std::string source = serve(
      "h265",
      "-c:v libx265 -preset ultrafast -crf 18 -x265-params log-level=none:keyint=3:scenecut=0 -tag:v hvc1");
  const ChainStation station(folder_.path(), png_->archive, source);
  expect_all_within_the_loss(station, "H.265, x265 crf 18");
}

}  // namespace
}  // namespace lampglow::testing
