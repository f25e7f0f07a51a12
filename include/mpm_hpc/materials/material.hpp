// What a material law must offer, as concepts: the loops and the effects ask for no more than these.
#pragma once

#include <concepts>

#include "mpm_hpc/base/types.hpp"
#include "mpm_hpc/math/tensor.hpp"

namespace mpm {

class Parameters;

// What every law has: it is one small struct, its functions templates on the scalar S (a number or a pack).
template <class Law>
concept NamedLaw = std::copyable<Law> && std::default_initializable<Law> &&
    requires(Law fresh, Parameters& parameters) {
  { Law::name } -> std::convertible_to<const char*>;  // value of the scene's key `model`
  { Law::doc } -> std::convertible_to<const char*>;   // one sentence for the manual
  fresh.declare(parameters);                          // reads its keys
};

// A hyperelastic law of the deformation gradient.
template <class Law, int Dim, class S = double>
concept SolidLaw = NamedLaw<Law> && requires(const Law law, const Tensor<S, Dim>& F) {
  { law.kirchhoff_stress(F) } -> std::same_as<SymTensor<S, Dim>>;  // tau = P F^T [Pa]
  { law.energy_density(F) } -> std::same_as<S>;                    // Psi [J/m^3]
  {
    law.stiffness_bound(F)
    } -> std::same_as<S>;  // >= lambda_max(A), A_ab = d tau_a / d ln s_b, equal at F = I [Pa]
  { law.wave_modulus(F) } -> std::same_as<S>;  // >= max_a A_aa, equal at F = I [Pa]
};

// A fluid, which knows its volume alone: J - 1 is a column of its own, since a J near 1 would lose the digits
// of the pressure in single precision, and det F those of J in shear.
template <class Law, class S = double>
concept FluidLaw = NamedLaw<Law> && requires(const Law law, const S& volume_change) {
  { law.viscosity } -> std::convertible_to<Real>;                      // of shear [Pa s]
  { law.spherical_stress(volume_change) } -> std::same_as<S>;          // tau = -p J [Pa]
  { law.energy_density(volume_change) } -> std::same_as<S>;            // Psi [J/m^3]
  { law.wave_modulus(volume_change) } -> std::same_as<S>;              // >= d tau / d ln J, equal at J = 1 [Pa]
};

template <class Law, int Dim>
concept MaterialLaw = SolidLaw<Law, Dim> || FluidLaw<Law>;

// Psi = Psi+ + Psi-, of which g in [0, 1] scales Psi+ (the part that drives cracks).
template <class Law, int Dim, class S = double>
concept SplitsEnergy = SolidLaw<Law, Dim, S> &&
    requires(const Law law, const Tensor<S, Dim>& F, const S& g) {
  { law.energy_plus(F) } -> std::same_as<S>;
  { law.energy_degraded(F, g) } -> std::same_as<S>;
  { law.kirchhoff_stress_degraded(F, g) } -> std::same_as<SymTensor<S, Dim>>;
  // The bounds of the degraded stress, and of what it may become within one step.
  { law.stiffness_bound_degraded(F, g) } -> std::same_as<S>;
  { law.wave_modulus_degraded(F, g) } -> std::same_as<S>;
};

// First Piola-Kirchhoff stress and its derivative in closed form, for the implicit integrator.
template <class Law, int Dim, class S = double>
concept HasTangent = SolidLaw<Law, Dim, S> && requires(const Law law, const Tensor<S, Dim>& F) {
  { law.first_piola(F) } -> std::same_as<Tensor<S, Dim>>;
  { law.first_piola_differential(F, F) } -> std::same_as<Tensor<S, Dim>>;  // dP/dF : dF
};

// A law whose particles forget part of their deformation after each step.
template <class Law, int Dim, class S = double>
concept Relaxes = SolidLaw<Law, Dim, S> && requires(const Law law, const Tensor<S, Dim>& F) {
  { law.relaxed(F) } -> std::same_as<Tensor<S, Dim>>;
};

}  // namespace mpm
