// Put before the C library (LD_PRELOAD): every read at a place of a file takes 2 ms, as from a worn card.
// SQLite reads its pages so.
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

extern "C" ssize_t pread64(int file, void* buffer, size_t size, off64_t offset) {
  const timespec slow{0, 2'000'000};
  nanosleep(&slow, nullptr);
  return syscall(SYS_pread64, file, buffer, size, offset);
}
