#include "web/reader_pool.h"

namespace lampglow::web {

using storage::FileId;
using storage::StorageError;

void ReaderPool::use_only(std::optional<FileId> file) {
  const std::lock_guard lock(mutex_);
  only_ = file;
}

ReaderPool::Held ReaderPool::take() {
  const std::optional<FileId> now = storage::file_id(file_);
  if (!now) throw StorageError(StorageError::Kind::io, file_.string() + ": there is no such file");
  {
    const std::lock_guard lock(mutex_);
    if (only_ && *only_ != *now)
      throw StorageError(StorageError::Kind::io, file_.string() + ": another file, not in use yet");
    while (!idle_.empty()) {
      Held held = std::move(idle_.back());
      idle_.pop_back();
      if (held.file == *now) return held;
    }
  }
  auto reader = std::make_unique<storage::Reader>(file_);
  return {std::move(reader), *now};
}

void ReaderPool::give_back(Held held) {
  const std::lock_guard lock(mutex_);
  idle_.push_back(std::move(held));
}

}  // namespace lampglow::web
