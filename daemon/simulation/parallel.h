// The same work for every index, in threads. What is computed must not depend on which thread does it.
#pragma once

#include <functional>
#include <stop_token>

namespace lampglow::simulation {

// Calls work(0) … work(count-1), `workers` at a time; the first exception is thrown on. After a stop no
// further one is begun. Returns how many were done: the first so many, without a gap.
int for_each_index(int count, int workers, const std::function<void(int)>& work,
                   const std::stop_token& stop = {});

}  // namespace lampglow::simulation
