// Memory for pictures. A frame's pictures are made and gone within a tenth of a second; most of what their
// memory costs are page faults, one for 4 KiB. Large blocks therefore ask for pages of 2 MiB, where the
// system has such (transparent huge pages, `madvise` or `always`), and are not filled with zeros unless told
// to.
#pragma once

#include <sys/mman.h>

#include <cstddef>
#include <cstdlib>
#include <memory>
#include <new>
#include <utility>

namespace lampglow {

template <typename T>
struct PixelAllocator {
  using value_type = T;

  PixelAllocator() = default;
  template <typename U>
  PixelAllocator(const PixelAllocator<U>&) {}  // NOLINT(google-explicit-constructor): as std::allocator

  T* allocate(std::size_t count) {
    if (count * sizeof(T) < kWorthIt) return std::allocator<T>().allocate(count);
    const std::size_t size = size_of(count);
    void* block = nullptr;
    if (posix_memalign(&block, kHugePage, size) != 0) throw std::bad_alloc();
    madvise(block, size, MADV_HUGEPAGE);  // where it can't be had, small pages do
    return static_cast<T*>(block);
  }

  void deallocate(T* block, std::size_t count) {
    if (count * sizeof(T) < kWorthIt)
      std::allocator<T>().deallocate(block, count);
    else
      std::free(block);
  }

  // What is made without a value is left as it is.
  template <typename U>
  void construct(U* at) {
    ::new (static_cast<void*>(at)) U;
  }
  template <typename U, typename... Arguments>
  void construct(U* at, Arguments&&... arguments) {
    ::new (static_cast<void*>(at)) U(std::forward<Arguments>(arguments)...);
  }

  bool operator==(const PixelAllocator&) const = default;

 private:
  static constexpr std::size_t kHugePage = 2 << 20, kWorthIt = 1 << 20;

  // The last page is a huge one if more than half of it is wanted.
  static std::size_t size_of(std::size_t count) {
    const std::size_t size = count * sizeof(T), rest = size % kHugePage;
    return rest > kHugePage / 2 ? size - rest + kHugePage : size;
  }
};

}  // namespace lampglow
