#include "daemon/sources/multipart.h"

#include <gtest/gtest.h>

#include "daemon/sources/fault.h"

namespace lampglow::daemon {
namespace {

std::span<const std::uint8_t> bytes_of(const std::string& text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

std::vector<std::string> parts_of(const std::string& stream, std::size_t piece) {
  MultipartReader reader("frame", 1000);
  std::vector<std::string> parts;
  for (std::size_t at = 0; at < stream.size(); at += piece) {
    const std::string bytes = stream.substr(at, piece);
    reader.feed(bytes_of(bytes));
    while (const auto part = reader.take()) parts.emplace_back(part->begin(), part->end());
  }
  return parts;
}

TEST(Multipart, Boundary) {
  EXPECT_EQ(multipart_boundary("multipart/x-mixed-replace;boundary=frame"), "frame");
  EXPECT_EQ(multipart_boundary("Multipart/X-Mixed-Replace; boundary=\"--frame\"; x=1"), "frame");
  EXPECT_EQ(multipart_boundary("image/jpeg"), "");
  EXPECT_EQ(multipart_boundary(""), "");
  EXPECT_EQ(multipart_boundary("multipart/x-mixed-replace"), "");
}

TEST(Multipart, AnyCutOfTheStreamGivesTheSameParts) {
  const std::string with_length =
      "--frame\r\nContent-Type: image/jpeg\r\ncontent-length: 5\r\n\r\nab\n-c\r\n--frame\r\nContent-Length: "
      "2\r\n\r\nde\r\n--frame\r\n";
  const std::string without = "junk--frame\nX: y\n\nab\n-c\r\n--frame\r\nX: y\r\n\r\nde\r\n--frame\r\n";
  const std::vector<std::string> expected{"ab\n-c", "de"};
  for (std::size_t piece = 1; piece < 60; ++piece) {
    EXPECT_EQ(parts_of(with_length, piece), expected) << piece;
    EXPECT_EQ(parts_of(without, piece), expected) << piece;
  }
}

TEST(Multipart, LimitsHold) {
  MultipartReader announced("frame", 1000);
  announced.feed(bytes_of("--frame\r\nContent-Length: 500000000\r\n\r\n"));
  EXPECT_THROW(announced.take(), SourceError);
  MultipartReader endless("frame", 1000);
  endless.feed(bytes_of("--frame\r\nX: y\r\n\r\n" + std::string(2000, 'x')));
  EXPECT_THROW(endless.take(), SourceError);
  MultipartReader headers("frame", 1000);
  headers.feed(bytes_of("--frame\r\n" + std::string(20'000, 'x')));
  EXPECT_THROW(headers.take(), SourceError);
}

TEST(Multipart, SkipWaitsForTheNextWholePart) {
  MultipartReader reader("frame", 1000);
  reader.feed(bytes_of("--frame\r\n\r\nol"));
  EXPECT_FALSE(reader.take());
  reader.skip();
  reader.feed(bytes_of("d\r\n--frame\r\nX: y\r\n\r\nnew\r\n--frame"));
  const auto part = reader.take();
  ASSERT_TRUE(part);
  EXPECT_EQ(std::string(part->begin(), part->end()), "new");
}

}  // namespace
}  // namespace lampglow::daemon
