#include "web/reader_pool.h"

#include <sys/stat.h>

namespace lampglow::web {

ReaderPool::Held ReaderPool::take() {
  struct stat now {};
  if (::stat(file_.c_str(), &now) != 0)
    throw storage::StorageError(storage::StorageError::Kind::io, file_.string() + ": there is no such file");
  {
    const std::lock_guard lock(mutex_);
    while (!idle_.empty()) {
      Held held = std::move(idle_.back());
      idle_.pop_back();
      if (held.device == now.st_dev && held.inode == now.st_ino) return held;
    }
  }
  return {std::make_unique<storage::Reader>(file_), now.st_dev, now.st_ino};
}

void ReaderPool::give_back(Held held) {
  const std::lock_guard lock(mutex_);
  idle_.push_back(std::move(held));
}

}  // namespace lampglow::web
