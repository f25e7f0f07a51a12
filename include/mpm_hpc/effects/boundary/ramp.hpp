// When a prescribed motion or load acts.
#pragma once

#include <limits>

#include "mpm_hpc/base/parameters.hpp"
#include "mpm_hpc/base/types.hpp"

namespace mpm {

// A factor that rises linearly from 0 at `start` to 1 at `start + rise`, and falls back to 0 at `stop`; times
// in [s].
struct Ramp {
  Real start = 0, rise = 0;
  Real stop = std::numeric_limits<Real>::infinity();

  // Reads `ramp` (the rise), `start` and `stop`; UserError unless stop > start.
  static Ramp read(Parameters& p);

  Real factor(Real t) const;
  // Its exact integral up to t [s].
  Real progress(Real t) const;
  // Mean over [t, t + dt]; the factor at t for dt = 0.
  Real mean(Real t, Real dt) const;
};

}  // namespace mpm
