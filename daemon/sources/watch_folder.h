// Pictures that another program puts into a folder, complete ones only.
#pragma once

#include <filesystem>
#include <set>

#include "daemon/config/descriptor.h"
#include "daemon/sources/open_source.h"

namespace lampglow::daemon {

// A file counts when its writer closes it, or when it is renamed or linked into the folder. Names that begin
// with a dot and names without .jpg, .jpeg, .png, .tif or .tiff are left alone. Files that are there already
// when the folder is opened are not taken: nobody knows whether they are complete, or how old.
class WatchFolder : public FrameSource {
 public:
  explicit WatchFolder(SourceOptions options);
  std::string name() const override { return name_; }

  // The newest file that was completed since the last call; waits for one if there is none, at most
  // frame_timeout. Its time is the file's modification time. The folder stays watched between calls, also
  // after a fault (close() does nothing): a file that comes then is taken by the next call.
  std::optional<Bracket> next(std::stop_token stop) override;
  SourceInfo describe(std::stop_token stop) override;

 private:
  void open();
  void read_events();
  bool wait(std::chrono::steady_clock::time_point deadline, std::stop_token stop) const;
  Bracket load(const std::string& file) const;

  const SourceOptions options_;
  const std::string name_;
  const std::filesystem::path folder_;
  Descriptor inotify_;
  std::string newest_;  // completed and not yet taken
};

}  // namespace lampglow::daemon
