// The one list of material laws: a new law is one new file and one line here.
#pragma once

#include "mpm_hpc/materials/fixed_corotated.hpp"
#include "mpm_hpc/materials/hencky.hpp"
#include "mpm_hpc/materials/lazy_liquid.hpp"
#include "mpm_hpc/materials/linear_elastic.hpp"
#include "mpm_hpc/materials/linear_fluid.hpp"
#include "mpm_hpc/materials/neo_hookean.hpp"
#include "mpm_hpc/materials/snow.hpp"
#include "mpm_hpc/materials/split_neo_hookean.hpp"
#include "mpm_hpc/materials/tait_fluid.hpp"

namespace mpm {

template <class... Laws>
struct LawList {};

template <int Dim>
using MaterialList = LawList<  //
    NeoHookean<Dim>,           //
    SplitNeoHookean<Dim>,      //
    FixedCorotated<Dim>,       //
    Hencky<Dim>,               //
    LinearElastic<Dim>,        //
    Snow<Dim>,                 //
    LinearFluid,               //
    TaitFluid,                 //
    LazyLiquid<Dim>>;

}  // namespace mpm
