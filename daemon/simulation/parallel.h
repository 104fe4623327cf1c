// The same work for every index, in threads. What is computed must not depend on which thread does it.
#pragma once

#include <functional>

namespace lampglow::simulation {

// Calls work(0) … work(count-1), `workers` at a time; the first exception is thrown on.
void for_each_index(int count, int workers, const std::function<void(int)>& work);

}  // namespace lampglow::simulation
