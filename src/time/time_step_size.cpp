#include "mpm_hpc/time/time_step_size.hpp"

#include <cmath>
#include <limits>

namespace mpm {

StepSize stable_step_size(const StepLimits& limits, Real spacing, const StepSizeOptions& options) {
  StepSize best{std::numeric_limits<Real>::infinity(), "nothing"};
  auto bound = [&best](Real dt, const char* name) {
    if (dt < best.dt) best = {dt, name};
  };
  if (limits.signal_speed > 0) bound(options.cfl * spacing / limits.signal_speed, "wave speed");
  // An isolated particle oscillates in its own cell: dt <= 2 h / sqrt(k lambda_max(A) / rho0).
  if (limits.stiffness_speed > 0)
    bound(options.isolated_safety * 2 * spacing / (std::sqrt(options.isolated_stiffness) * limits.stiffness_speed),
          "isolated particle");
  // In the same cell viscosity takes velocity differences away at the rate 2 k nu / h^2, times dt at most 2.
  if (limits.viscosity > 0)
    bound(options.isolated_safety * spacing * spacing / (options.isolated_stiffness * limits.viscosity), "viscosity");
  if (limits.kinematic.gradient > 0) bound(options.max_strain / limits.kinematic.gradient, "strain per step");
  if (limits.kinematic.acceleration > 0)
    bound(std::sqrt(options.acceleration * spacing / limits.kinematic.acceleration), "acceleration");
  return best;
}

}  // namespace mpm
