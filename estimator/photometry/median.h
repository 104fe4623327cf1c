// The median, of an even count the upper of the two in the middle: one of the values themselves.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace lampglow::photometry {

// Puts `values`, which must not be empty, into another order.
template <typename T>
T median_of(std::vector<T>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

template <typename T>
T median_of(std::vector<T>&& values) {
  return median_of(values);
}

}  // namespace lampglow::photometry
