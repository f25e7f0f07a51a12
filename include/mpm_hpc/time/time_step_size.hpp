// The step-size rules of the explicit integrator (physics.md section 6).
#pragma once

#include "mpm_hpc/effects/state.hpp"

namespace mpm {

struct StepSizeOptions {
  Real cfl = 0.4;              // share of h that signal (|v| + c) may travel
  Real isolated_safety = 0.8;  // share of the bound of an isolated particle
  Real max_strain = 0.2;       // |dt C|, which keeps det(I + dt C) >= 0.5
  Real acceleration = 0.2;     // dt <= sqrt(acceleration h / |a|)
  Real isolated_stiffness = 4; // k of the isolated particle's bound (transfer_form.hpp)
};

struct StepSize {
  Real dt;
  const char* bound_by;  // the rule that decides, for messages and the progress line
};

// Each rule's bound; infinite where nothing moves. The limits are those of all ranks.
StepSize stable_step_size(const StepLimits& limits, Real spacing, const StepSizeOptions& options);

}  // namespace mpm
