#include "daemon/sources/watch_folder.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/inotify.h>
#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>

#include "daemon/sources/fault.h"
#include "daemon/sources/live_frame.h"
#include "daemon/sources/wait.h"

namespace lampglow::daemon {
namespace {

bool is_picture_name(std::string_view name) {
  constexpr std::array<std::string_view, 5> kEndings{".jpg", ".jpeg", ".png", ".tif", ".tiff"};
  if (name.starts_with('.')) return false;
  std::string lower(name);
  std::ranges::transform(lower, lower.begin(),
                         [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return std::ranges::any_of(kEndings, [&](std::string_view ending) { return lower.ends_with(ending); });
}

[[noreturn]] void fail(Fault fault, const std::string& name, const std::string& what) {
  throw SourceError(fault, name + ": " + what);
}

TimePoint modified(const struct stat& status) {
  return TimePoint(std::chrono::seconds(status.st_mtim.tv_sec) +
                   std::chrono::milliseconds(status.st_mtim.tv_nsec / 1'000'000));
}

std::vector<std::uint8_t> read_all(const Descriptor& file, std::size_t size, const std::string& name) {
  std::vector<std::uint8_t> bytes(size);
  std::size_t filled = 0;
  while (filled < size) {
    const ssize_t count = ::read(file.get(), bytes.data() + filled, size - filled);
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) fail(Fault::file_unreadable, name, std::strerror(errno));
    if (count == 0) fail(Fault::torn, name, "the file shrank while it was read");
    filled += static_cast<std::size_t>(count);
  }
  return bytes;
}

}  // namespace

WatchFolder::WatchFolder(SourceOptions options)
    : options_(std::move(options)),
      name_(options_.url),
      folder_(options_.url.substr(options_.url.find(':') + 1)) {}

void WatchFolder::open() {
  if (inotify_.good()) return;
  Descriptor watch(inotify_init1(IN_CLOEXEC | IN_NONBLOCK));
  if (!watch.good()) fail(Fault::internal, name_, std::string("inotify: ") + std::strerror(errno));
  const std::uint32_t mask =
      IN_CLOSE_WRITE | IN_MOVED_TO | IN_CREATE | IN_DELETE_SELF | IN_MOVE_SELF | IN_ONLYDIR;
  if (inotify_add_watch(watch.get(), folder_.c_str(), mask) < 0) {
    fail(Fault::file_unreadable, name_, std::strerror(errno));
  }
  inotify_ = std::move(watch);
}

void WatchFolder::read_events() {
  alignas(inotify_event) std::array<char, 16384> buffer;
  for (;;) {
    const ssize_t count = ::read(inotify_.get(), buffer.data(), buffer.size());
    if (count <= 0) return;
    for (ssize_t at = 0; at < count;) {
      const auto* event = reinterpret_cast<const inotify_event*>(buffer.data() + at);
      at += static_cast<ssize_t>(sizeof(inotify_event) + event->len);
      if ((event->mask & (IN_IGNORED | IN_DELETE_SELF | IN_MOVE_SELF)) != 0) {
        inotify_ = Descriptor();
        newest_.clear();
        fail(Fault::file_unreadable, name_, "the folder was removed or renamed");
      }
      if (event->len == 0 || !is_picture_name(event->name)) continue;
      // A created file is complete only if it is a hard link, which is never open for writing at first.
      struct stat status {};
      const bool linked = (event->mask & IN_CREATE) != 0 &&
                          ::lstat((folder_ / event->name).c_str(), &status) == 0 && status.st_nlink > 1;
      if ((event->mask & IN_CREATE) == 0 || linked) newest_ = event->name;
    }
  }
}

bool WatchFolder::wait(std::chrono::steady_clock::time_point deadline, std::stop_token stop) const {
  switch (wait_readable(inotify_.get(), deadline, stop)) {
    case Wait::ready:
      return true;
    case Wait::stopped:
      return false;
    case Wait::timeout:
      break;
  }
  fail(Fault::no_new_file, name_,
       fmt::format("no new picture for {:.3g} s", static_cast<double>(options_.frame_timeout.count()) / 1e3));
}

Bracket WatchFolder::load(const std::string& file) const {
  const std::string path = (folder_ / file).string();
  const Descriptor descriptor(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK));
  struct stat status {};
  if (!descriptor.good() || ::fstat(descriptor.get(), &status) != 0) {
    fail(Fault::file_unreadable, path, std::strerror(errno));
  }
  if (!S_ISREG(status.st_mode)) fail(Fault::file_unreadable, path, "expected a regular file");
  const auto size = static_cast<std::size_t>(status.st_size);
  if (size > options_.max_bytes) {
    fail(Fault::too_large, path, fmt::format("{} bytes, more than the {} allowed", size, options_.max_bytes));
  }
  Bracket bracket;
  bracket.time_utc = modified(status);
  bracket.exposures.push_back(decode_live_frame(read_all(descriptor, size, path), path, options_.max_pixels));
  return bracket;
}

std::optional<Bracket> WatchFolder::next(std::stop_token stop) {
  open();
  const auto deadline = std::chrono::steady_clock::now() + options_.frame_timeout;
  read_events();
  while (newest_.empty()) {
    if (!wait(deadline, stop)) return std::nullopt;
    read_events();
  }
  return load(std::exchange(newest_, {}));
}

SourceInfo WatchFolder::describe(std::stop_token) {
  open();
  SourceInfo info;
  info.driver = "folder " + folder_.string();
  info.notes.push_back("Exposure and gain of the files are not known: lock both in the camera.");
  return info;
}

}  // namespace lampglow::daemon
