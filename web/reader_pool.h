// Readers for the server's threads, opened when needed and reopened when the database is another file than
// before.
#pragma once

#include <sys/types.h>

#include <filesystem>
#include <memory>
#include <mutex>
#include <vector>

#include "storage/reader.h"

namespace lampglow::web {

class ReaderPool {
 public:
  explicit ReaderPool(std::filesystem::path file) : file_(std::move(file)) {}

  // Runs `work(Reader&)` with a reader of its own. Throws what opening or `work` throws.
  template <typename Work>
  auto use(Work&& work) {
    Held held = take();
    auto result = work(*held.reader);
    give_back(std::move(held));
    return result;
  }

 private:
  struct Held {
    std::unique_ptr<storage::Reader> reader;
    dev_t device = 0;
    ino_t inode = 0;
  };
  Held take();
  void give_back(Held held);

  std::filesystem::path file_;
  std::mutex mutex_;
  std::vector<Held> idle_;
};

}  // namespace lampglow::web
