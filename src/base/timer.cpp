#include "mpm_hpc/base/timer.hpp"

#include <algorithm>

namespace mpm {

int Timers::stage(std::string_view name) {
  const auto found = std::find(names_.begin(), names_.end(), name);
  if (found != names_.end()) return static_cast<int>(found - names_.begin());
  names_.emplace_back(name);
  seconds_.push_back(0.0);
  calls_.push_back(0);
  return size() - 1;
}

void Timers::reset() {
  std::fill(seconds_.begin(), seconds_.end(), 0.0);
  std::fill(calls_.begin(), calls_.end(), 0);
}

}  // namespace mpm
