#include "daemon/commands/threads.h"

#include <algorithm>
#include <atomic>
#include <exception>
#include <mutex>
#include <thread>
#include <vector>

namespace lampglow::daemon {

scattering::Executor threads(unsigned count) {
  if (count == 0) count = std::max(1u, std::thread::hardware_concurrency());
  return [count](std::size_t tasks, const std::function<void(std::size_t)>& task) {
    std::atomic<std::size_t> next{0};
    std::exception_ptr failure;
    std::mutex failure_mutex;
    const auto work = [&] {
      for (std::size_t index = next++; index < tasks; index = next++) try {
          task(index);
        } catch (...) {
          const std::lock_guard lock(failure_mutex);
          if (!failure) failure = std::current_exception();
        }
    };
    {
      std::vector<std::jthread> workers;
      for (unsigned i = 0; i < count; ++i) workers.emplace_back(work);
    }
    if (failure) std::rethrow_exception(failure);
  };
}

}  // namespace lampglow::daemon
