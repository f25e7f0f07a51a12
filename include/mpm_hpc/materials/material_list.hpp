// The one list of material laws: a new law is one new file and one line here.
#pragma once

#include "mpm_hpc/materials/fixed_corotated.hpp"
#include "mpm_hpc/materials/neo_hookean.hpp"
#include "mpm_hpc/materials/split_neo_hookean.hpp"

namespace mpm {

template <class... Laws>
struct LawList {};

template <int Dim>
using MaterialList = LawList<  //
    NeoHookean<Dim>,           //
    SplitNeoHookean<Dim>,      //
    FixedCorotated<Dim>>;

}  // namespace mpm
