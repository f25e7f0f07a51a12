// Snow (Stomakhin et al. 2013): a fixed corotated solid that brings its plasticity with it.
#pragma once

#include "mpm_hpc/materials/fixed_corotated.hpp"
#include "mpm_hpc/materials/plasticity/clamped_stretches.hpp"

namespace mpm {

template <int Dim>
struct Snow : FixedCorotated<Dim> {
  static constexpr const char* name = "snow";
  static constexpr const char* doc = "fixed corotated solid with clamped_stretches plasticity";
  using Plasticity = ClampedStretches<Dim>;  // its keys stand beside those of the law
};

}  // namespace mpm
