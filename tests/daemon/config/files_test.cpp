#include "daemon/config/files.h"

#include <gmock/gmock.h>
#include <sys/stat.h>

#include "daemon/config/pending_file.h"
#include "tests/support/messages.h"
#include "tests/support/temporary_folder.h"

namespace lampglow::daemon {
namespace {

using test::complaint_of;
using test::read_all;
using test::TemporaryFolder;

int files_in(const std::filesystem::path& folder) {
  int count = 0;
  for ([[maybe_unused]] const auto& entry : std::filesystem::directory_iterator(folder)) ++count;
  return count;
}

TEST(Files, AFileIsReplacedAsAWhole) {
  const TemporaryFolder folder;
  const auto path = folder.write("a.txt", "old");
  PendingFile pending(path);
  pending.write("new ");
  pending.write(std::string(200'000, 'x'));
  EXPECT_EQ(read_all(path), "old") << "nothing shows before it is complete";
  pending.publish();
  EXPECT_EQ(read_all(path), "new " + std::string(200'000, 'x'));
  EXPECT_EQ(files_in(folder.path()), 1);
}

TEST(Files, WhatIsNotPublishedLeavesNothing) {
  const TemporaryFolder folder;
  {
    PendingFile pending(folder.path() / "a.txt");
    pending.write(std::string(200'000, 'x'));
  }
  EXPECT_EQ(files_in(folder.path()), 0);
}

TEST(Files, SaysWhatCannotBeReadOrWritten) {
  const TemporaryFolder folder;
  ASSERT_EQ(::mkfifo((folder.path() / "fifo").c_str(), 0600), 0);
  EXPECT_THAT(complaint_of([&] { read_text_file(folder.path() / "fifo"); }).text,
              testing::EndsWith("fifo: expected a regular file"));
  folder.write("big", "123456");
  EXPECT_THAT(complaint_of([&] { read_text_file(folder.path() / "big", 5); }).text,
              testing::EndsWith("big: larger than the 5 bytes allowed"));
  const auto no_folder = complaint_of([&] { write_file_atomically(folder.path() / "no/file", "x"); });
  EXPECT_EQ(no_folder.exit_code, kExitIo);
  EXPECT_THAT(no_folder.text, testing::EndsWith("no/file: cannot be written: No such file or directory"));
}

}  // namespace
}  // namespace lampglow::daemon
