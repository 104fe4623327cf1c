// Readers for the server's threads, opened when needed and reopened when the database is another file than
// before.
#pragma once

#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <vector>

#include "storage/file_id.h"
#include "storage/reader.h"

namespace lampglow::web {

class ReaderPool {
 public:
  explicit ReaderPool(std::filesystem::path file) : file_(std::move(file)) {}

  // Reads no other file than this from now on: one that was put into its place is not in use yet, and beside
  // it still lies the old one's WAL. Empty: whatever is there.
  void use_only(std::optional<storage::FileId> file);

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
    storage::FileId file{};
  };
  Held take();
  void give_back(Held held);

  std::filesystem::path file_;
  std::mutex mutex_;
  std::optional<storage::FileId> only_;
  std::vector<Held> idle_;
};

}  // namespace lampglow::web
