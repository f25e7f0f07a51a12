// The one list of plasticity rules: a new rule is one new file and one line here.
#pragma once

#include "mpm_hpc/materials/plasticity/clamped_stretches.hpp"
#include "mpm_hpc/materials/plasticity/drucker_prager.hpp"
#include "mpm_hpc/materials/plasticity/modified_cam_clay.hpp"
#include "mpm_hpc/materials/plasticity/nacc.hpp"
#include "mpm_hpc/materials/plasticity/tresca.hpp"
#include "mpm_hpc/materials/plasticity/von_mises.hpp"

namespace mpm {

template <class... Rules>
struct RuleList {};

template <int Dim>
using PlasticityList = RuleList<  //
    ClampedStretches<Dim>,        //
    Tresca<Dim>,                  //
    VonMises<Dim>,                //
    DruckerPrager<Dim>,           //
    ModifiedCamClay<Dim>,         //
    Nacc<Dim>>;

}  // namespace mpm
