#include "mpm_hpc/effects/boundary/ramp.hpp"

#include <algorithm>

namespace mpm {

Ramp Ramp::read(Parameters& p) {
  Ramp ramp;
  p.real("ramp", ramp.rise, {.unit = "s", .min = 0, .doc = "Time in which it rises linearly from 0."});
  p.real("start", ramp.start, {.unit = "s", .doc = "Nothing before this time."});
  std::optional<Real> stop;
  p.optional_real("stop", stop, {.unit = "s", .doc = "Nothing from this time on; default: never."});
  if (stop) {
    ramp.stop = *stop;
    if (ramp.stop <= ramp.start)
      p.error_at("stop", "stop must be later than start; raise it or leave it out.");
  }
  return ramp;
}

Real Ramp::factor(Real t) const {
  if (t < start || t >= stop) return 0;
  return t - start < rise ? (t - start) / rise : 1;
}

Real Ramp::progress(Real t) const {
  const Real passed = std::max(0.0, std::min(t, stop) - start);
  return passed < rise ? passed * passed / (2 * rise) : passed - rise / 2;
}

Real Ramp::mean(Real t, Real dt) const {
  // Between the kinks it is the factor half-way, free of the cancellation in the difference of two late
  // times.
  const bool constant = t >= start + rise && t + dt <= stop;
  if (dt <= 0 || constant) return factor(t);
  return (progress(t + dt) - progress(t)) / dt;
}

}  // namespace mpm
