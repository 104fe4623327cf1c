// A worker pool with order: one thread takes inputs from a source, N workers work on them, and the caller's
// thread gets the results one by one in the order of the inputs. So one writer sees the same sequence for any
// number of workers.
#pragma once

#include <pthread.h>

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <exception>
#include <functional>
#include <map>
#include <mutex>
#include <optional>
#include <stop_token>
#include <thread>
#include <utility>
#include <vector>

namespace lampglow::daemon {

struct PoolOptions {
  std::size_t workers = 1;   // at least 1
  std::size_t capacity = 0;  // inputs and results in memory at once; 0: twice the workers
};

template <typename Input, typename Result>
class OrderedPool {
 public:
  using Produce = std::function<std::optional<Input>(std::stop_token)>;  // empty: there will be no more
  using Work = std::function<Result(Input&&)>;                           // called from several threads
  using Consume = std::function<void(Result&&)>;  // called from run()'s thread, in order

  OrderedPool(Produce produce, Work work, Consume consume, PoolOptions options)
      : produce_(std::move(produce)),
        work_(std::move(work)),
        consume_(std::move(consume)),
        workers_(options.workers == 0 ? 1 : options.workers),
        capacity_(options.capacity == 0 ? 2 * workers_ : options.capacity) {}

  // Ends when the source has no more or a stop is asked for: then what has been taken from the source is
  // worked on and consumed to its end, so that the results are a prefix without a gap. The first exception
  // of any function ends the run and is thrown here, after all results before it were consumed.
  // Returns the number of results consumed.
  std::size_t run(std::stop_token stop) {
    std::jthread producer([this, stop] { produce_all(stop); });
    std::vector<std::jthread> threads;
    for (std::size_t i = 0; i < workers_; ++i) threads.emplace_back([this] { work_all(); });
    consume_all();
    producer = {};  // joined
    threads.clear();
    if (error_) std::rethrow_exception(error_);
    return consumed_;
  }

 private:
  struct Slot {
    std::optional<Result> result;
    std::exception_ptr error;
  };

  void produce_all(const std::stop_token& stop) {
    std::exception_ptr error;
    std::size_t count = 0;
    try {
      while (!stop.stop_requested()) {
        if (!wait_for_room(count)) break;
        std::optional<Input> input = produce_(stop);
        if (!input) break;
        const std::scoped_lock lock(mutex_);
        inputs_.emplace_back(count++, std::move(*input));
        work_ready_.notify_one();
      }
    } catch (...) {
      error = std::current_exception();
    }
    const std::scoped_lock lock(mutex_);
    if (error) results_[count++].error = error;
    total_ = count;
    work_ready_.notify_all();
    result_ready_.notify_all();
  }

  // False when the run is over because of an error.
  bool wait_for_room(std::size_t count) {
    std::unique_lock lock(mutex_);
    room_.wait(lock, [&] { return aborted_ || count < consumed_ + capacity_; });
    return !aborted_;
  }

  void work_all() {
    pthread_setname_np(pthread_self(), "worker");  // for `top -H`
    for (;;) {
      std::unique_lock lock(mutex_);
      work_ready_.wait(lock, [&] { return aborted_ || !inputs_.empty() || total_; });
      if (aborted_ || inputs_.empty()) return;
      auto [index, input] = std::move(inputs_.front());
      inputs_.pop_front();
      lock.unlock();
      Slot slot;
      try {
        slot.result.emplace(work_(std::move(input)));
      } catch (...) {
        slot.error = std::current_exception();
      }
      lock.lock();
      results_[index] = std::move(slot);
      result_ready_.notify_one();
    }
  }

  void consume_all() {
    for (std::optional<Slot> slot = next_slot(); slot && !error_; slot = next_slot()) {
      error_ = slot->error;
      try {
        if (!error_) consume_(std::move(*slot->result));
      } catch (...) {
        error_ = std::current_exception();
      }
      if (error_) break;
      const std::scoped_lock lock(mutex_);
      ++consumed_;
      room_.notify_one();
    }
    const std::scoped_lock lock(mutex_);
    aborted_ = true;
    room_.notify_all();
    work_ready_.notify_all();
  }

  // The result that comes next in order; empty at the end.
  std::optional<Slot> next_slot() {
    std::unique_lock lock(mutex_);
    result_ready_.wait(lock, [&] { return results_.contains(consumed_) || total_ == consumed_; });
    const auto found = results_.find(consumed_);
    if (found == results_.end()) return std::nullopt;
    std::optional<Slot> slot = std::move(found->second);
    results_.erase(found);
    return slot;
  }

  Produce produce_;
  Work work_;
  Consume consume_;
  const std::size_t workers_;
  const std::size_t capacity_;

  std::mutex mutex_;
  std::condition_variable room_, work_ready_, result_ready_;
  std::deque<std::pair<std::size_t, Input>> inputs_;
  std::map<std::size_t, Slot> results_;
  std::optional<std::size_t> total_;  // known when the source has ended
  std::size_t consumed_ = 0;          // written by run()'s thread alone
  bool aborted_ = false;
  std::exception_ptr error_;  // of run()'s thread alone
};

}  // namespace lampglow::daemon
