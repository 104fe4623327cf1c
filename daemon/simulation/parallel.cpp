#include "daemon/simulation/parallel.h"

#include <algorithm>
#include <atomic>
#include <exception>
#include <mutex>
#include <thread>
#include <vector>

namespace lampglow::simulation {

int for_each_index(int count, int workers, const std::function<void(int)>& work,
                   const std::stop_token& stop) {
  std::atomic<int> next = 0;
  std::exception_ptr failure;
  std::mutex failure_mutex;
  auto run = [&] {
    while (!stop.stop_requested()) {
      const int i = next++;
      if (i >= count) return;
      try {
        work(i);
      } catch (...) {
        const std::lock_guard lock(failure_mutex);
        if (!failure) failure = std::current_exception();
        next = count;
      }
    }
  };
  {
    std::vector<std::jthread> threads;
    for (int i = 1; i < workers; ++i) threads.emplace_back(run);
    run();
  }
  if (failure) std::rethrow_exception(failure);
  return std::min(next.load(), count);
}

}  // namespace lampglow::simulation
