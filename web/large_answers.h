// A bound on the memory of answers that are being sent: one whose client reads slowly stays in it for
// minutes.
#pragma once

#include <atomic>
#include <cstddef>
#include <utility>

namespace lampglow::web {

// What all answers of the database that are on their way may hold together. Small ones are always let
// through.
class LargeAnswers {
 public:
  explicit LargeAnswers(std::size_t most_bytes) : most_bytes_(most_bytes) {}
  bool take(std::size_t bytes) {
    if (bytes <= kSmall_bytes) return true;
    if (held_.fetch_add(bytes) + bytes <= most_bytes_) return true;
    held_ -= bytes;
    return false;
  }
  void give_back(std::size_t bytes) {
    if (bytes > kSmall_bytes) held_ -= bytes;
  }

 private:
  static constexpr std::size_t kSmall_bytes = 256 << 10;
  const std::size_t most_bytes_;
  std::atomic<std::size_t> held_{0};
};

// One answer's part of it.
class Place {
 public:
  Place() = default;
  Place(LargeAnswers& all, std::size_t bytes) : all_(all.take(bytes) ? &all : nullptr), bytes_(bytes) {}
  Place(Place&& other) noexcept : all_(std::exchange(other.all_, nullptr)), bytes_(other.bytes_) {}
  Place& operator=(Place&& other) noexcept {
    std::swap(all_, other.all_);
    std::swap(bytes_, other.bytes_);
    return *this;
  }
  ~Place() {
    if (all_) all_->give_back(bytes_);
  }
  bool given() const { return all_ != nullptr; }

 private:
  LargeAnswers* all_ = nullptr;
  std::size_t bytes_ = 0;
};

}  // namespace lampglow::web
