// Motion JPEG from ffmpeg, and folders that other programs write to.
#include <fcntl.h>
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <set>

#include "daemon/sources/fault.h"
#include "daemon/sources/live_frame.h"
#include "daemon/sources/open_source.h"
#include "tests/system/cameras/stream_servers.h"

namespace lampglow::testing {
namespace {

using namespace daemon;
using namespace std::chrono_literals;

Fault fault_of(FrameSource& source) {
  try {
    return source.next({}) ? Fault::none : Fault::stopped;
  } catch (const SourceError& error) {
    return error.fault();
  }
}

class MjpegCamera : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!MjpegServer::available()) GTEST_SKIP() << "ffmpeg is not installed";
    for (int i = 0; i < 10; ++i) {
      jpegs_.push_back(jpeg_of(night(i)));
      write_bytes(folder_ / fmt::format("frame{}.jpg", i), jpegs_.back());
    }
    server_ = std::make_unique<MjpegServer>(folder_.path(), (folder_ / "frame%d.jpg").string(), "copy", 10);
    network_ = std::make_unique<BadNetwork>(server_->port());
    options_.url = fmt::format("mjpeg+http://127.0.0.1:{}/stream", network_->port());
    options_.connect_timeout = 1s;
    options_.stall_timeout = 1s;
    options_.frame_timeout = 4s;
  }
  // The server needs a moment between two clients.
  Fault patient_fault_of(FrameSource& source) {
    Fault fault = Fault::none;
    eventually(5s, [&] {
      fault = fault_of(source);
      return fault != Fault::connection_refused && fault != Fault::connection_lost;
    });
    return fault;
  }

  TempFolder folder_;
  std::vector<std::vector<std::uint8_t>> jpegs_;
  std::unique_ptr<MjpegServer> server_;
  std::unique_ptr<BadNetwork> network_;
  SourceOptions options_;
};

TEST_F(MjpegCamera, PicturesAreThoseOfTheFilesBitForBit) {
  options_.stay_connected = true;
  const auto source = open_source(options_);
  ASSERT_EQ(patient_fault_of(*source), Fault::none);
  std::set<std::size_t> seen;
  for (int i = 0; i < 4; ++i) {
    const auto bracket = source->next({});
    ASSERT_TRUE(bracket);
    const auto& pixels = bracket->exposures.at(0).pixels.pixels;
    const auto same = std::ranges::find_if(jpegs_, [&](const auto& jpeg) {
      return decode_live_frame(jpeg, "", 1'000'000).pixels.pixels == pixels;
    });
    ASSERT_NE(same, jpegs_.end());
    seen.insert(static_cast<std::size_t>(same - jpegs_.begin()));
    std::this_thread::sleep_for(130ms);
  }
  EXPECT_GE(seen.size(), 3u) << "stale pictures";
}

TEST_F(MjpegCamera, ConnectsForEveryPictureByDefault) {
  const auto source = open_source(options_);
  for (int i = 0; i < 3; ++i) EXPECT_EQ(patient_fault_of(*source), Fault::none);
}

TEST_F(MjpegCamera, StreamThatStallsBreaksAndReturns) {
  options_.stay_connected = true;
  const auto source = open_source(options_);
  ASSERT_EQ(patient_fault_of(*source), Fault::none);
  network_->set({.stall_after_bytes = 0});
  EXPECT_EQ(fault_of(*source), Fault::stalled);
  source->close();
  network_->set({.cut_after_bytes = 5'000});
  EXPECT_EQ(fault_of(*source), Fault::connection_lost);
  source->close();
  network_->heal();
  EXPECT_EQ(patient_fault_of(*source), Fault::none);
}

TEST(MjpegSource, SomethingElseThanAStream) {
  if (find_program("ffmpeg").empty()) GTEST_SKIP() << "ffmpeg is not installed";
  TempFolder folder;
  const int port = free_port();
  write_bytes(folder / "a.jpg", jpeg_of(night(1)));
  Program server(
      {find_program("ffmpeg"), "-loglevel", "error", "-loop", "1", "-re", "-i", (folder / "a.jpg").string(),
       "-c", "copy", "-f", "mjpeg", "-listen", "1", fmt::format("http://127.0.0.1:{}/stream", port)},
      folder / "log");
  SourceOptions options;
  options.url = fmt::format("mjpeg+http://127.0.0.1:{}/stream", port);
  options.frame_timeout = 3s;
  const auto source = open_source(options);
  Fault fault = Fault::connection_refused;
  eventually(5s, [&] { return (fault = fault_of(*source)) != Fault::connection_refused; });
  EXPECT_EQ(fault, Fault::protocol_error);
}

class WatchedFolder : public ::testing::Test {
 protected:
  void SetUp() override {
    options_.url = "watch:" + folder_.path().string();
    options_.frame_timeout = 400ms;
    source_ = open_source(options_);
    EXPECT_EQ(fault_of(*source_), Fault::no_new_file);  // opens the watch
  }
  TempFolder folder_;
  SourceOptions options_;
  std::unique_ptr<FrameSource> source_;
};

TEST_F(WatchedFolder, RenamedFileArrivesBitForBit) {
  const auto picture = night(5, 320, 240, 12);
  save_picture(folder_ / "a.png", png_of(picture, 12));
  const auto bracket = source_->next({});
  ASSERT_TRUE(bracket);
  EXPECT_EQ(bracket->exposures.at(0).pixels.pixels, picture.pixels);
  EXPECT_EQ(fault_of(*source_), Fault::no_new_file);  // taken once
}

TEST_F(WatchedFolder, FileBeingWrittenIsNotTouched) {
  const auto bytes = jpeg_of(night(1));
  const int fd = ::open((folder_ / "slow.jpg").c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0600);
  ASSERT_EQ(::write(fd, bytes.data(), bytes.size() / 2), static_cast<ssize_t>(bytes.size() / 2));
  EXPECT_EQ(fault_of(*source_), Fault::no_new_file);
  ASSERT_GT(::write(fd, bytes.data() + bytes.size() / 2, bytes.size() - bytes.size() / 2), 0);
  ::close(fd);
  EXPECT_EQ(fault_of(*source_), Fault::none);
}

TEST_F(WatchedFolder, NewestOfSeveralAndWakesWhileWaiting) {
  save_picture(folder_ / "a.png", png_of(night(1), 8));
  save_picture(folder_ / "b.png", png_of(night(2), 8));
  write_file(folder_ / "notes.txt", "no picture");
  write_file(folder_ / ".hidden.jpg", "no picture");
  EXPECT_EQ(source_->next({})->exposures.at(0).pixels.pixels, night(2).pixels);
  std::jthread writer([this] {
    std::this_thread::sleep_for(100ms);
    save_picture(folder_ / "c.png", png_of(night(3), 8));
  });
  EXPECT_EQ(source_->next({})->exposures.at(0).pixels.pixels, night(3).pixels);
}

TEST_F(WatchedFolder, FileThatComesBetweenTwoTriesIsTaken) {
  source_->close();  // as the schedule does after every fault
  save_picture(folder_ / "a.png", png_of(night(1), 8));
  EXPECT_EQ(source_->next({})->exposures.at(0).pixels.pixels, night(1).pixels);
}

TEST_F(WatchedFolder, HardLinkCounts) {
  save_picture(folder_ / ".spool", png_of(night(1), 8));
  fs::create_hard_link(folder_ / ".spool", folder_ / "linked.png");
  EXPECT_EQ(fault_of(*source_), Fault::none);
}

TEST_F(WatchedFolder, TornFileFolderGoneAndBack) {
  auto bytes = jpeg_of(night(1));
  bytes.resize(bytes.size() / 3);
  save_picture(folder_ / "torn.jpg", bytes);
  EXPECT_EQ(fault_of(*source_), Fault::torn);
  fs::remove_all(folder_.path());
  EXPECT_EQ(fault_of(*source_), Fault::file_unreadable);
  source_->close();
  EXPECT_EQ(fault_of(*source_), Fault::file_unreadable);
  fs::create_directory(folder_.path());
  EXPECT_EQ(fault_of(*source_), Fault::no_new_file);
  save_picture(folder_ / "a.png", png_of(night(1), 8));
  EXPECT_EQ(fault_of(*source_), Fault::none);
}

TEST_F(WatchedFolder, LinksOutOfTheFolderAreNotFollowed) {
  TempFolder elsewhere;
  save_picture(elsewhere / "a.png", png_of(night(1), 8));
  fs::create_symlink(elsewhere / "a.png", folder_ / ".link");
  fs::rename(folder_ / ".link", folder_ / "link.png");
  EXPECT_EQ(fault_of(*source_), Fault::file_unreadable);
}

}  // namespace
}  // namespace lampglow::testing
