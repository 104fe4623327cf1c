// How the caller lends threads to a long computation: the estimator starts none itself.
#pragma once

#include <cstddef>
#include <functional>

namespace lampglow::scattering {

// Runs task(0) .. task(count - 1), each once, in any order and on any number of threads, and returns when all
// are done. Tasks write to places of their own, so the result does not depend on the executor.
using Executor = std::function<void(std::size_t count, const std::function<void(std::size_t)>& task)>;

inline void run_serially(std::size_t count, const std::function<void(std::size_t)>& task) {
  for (std::size_t index = 0; index < count; ++index) task(index);
}

}  // namespace lampglow::scattering
