// Tells whoever watches how far the run is: one line that renews itself on a terminal, plain lines in a log.
#pragma once

#include <chrono>
#include <cstdint>
#include <string>

#include "mpm_hpc/base/types.hpp"

namespace mpm {

class Progress {
 public:
  // Only rank 0 speaks; `end` is the time at which the run ends [s].
  Progress(bool speaks, Real start, Real end);
  ~Progress();
  void report(std::int64_t step, Real time, Real dt, const char* bound_by, const std::string& solved);
  // Every step that is told of gets a line in a log; a terminal shows the last one in its progress line.
  void log(std::int64_t step, Real time, Real dt, const std::string& solved);
  // A line of its own, above the progress line.
  void say(const std::string& line);

 private:
  using Clock = std::chrono::steady_clock;
  bool speaks_, terminal_, open_line_ = false;
  Real start_, end_;
  Clock::time_point began_, last_;
};

// 75 s -> "1m15s".
std::string short_duration(Real seconds);

}  // namespace mpm
