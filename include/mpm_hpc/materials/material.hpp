// What a material law must offer, as concepts: the loops and the effects ask for no more than these.
#pragma once

#include <concepts>

#include "mpm_hpc/math/tensor.hpp"

namespace mpm {

class Parameters;

// A hyperelastic law: one small struct, its functions templates on the scalar S (a number or a pack).
template <class Law, int Dim, class S = double>
concept MaterialLaw = std::copyable<Law> && std::default_initializable<Law> &&
    requires(const Law law, Law fresh, Parameters& parameters, const Tensor<S, Dim>& F) {
  { Law::name } -> std::convertible_to<const char*>;               // value of the scene's key `model`
  { Law::doc } -> std::convertible_to<const char*>;                // one sentence for the manual
  fresh.declare(parameters);                                       // reads its keys
  { law.kirchhoff_stress(F) } -> std::same_as<SymTensor<S, Dim>>;  // tau = P F^T [Pa]
  { law.energy_density(F) } -> std::same_as<S>;                    // Psi [J/m^3]
  {
    law.stiffness_bound(F)
    } -> std::same_as<S>;  // >= lambda_max(A), A_ab = d tau_a / d ln s_b, equal at F = I [Pa]
  { law.wave_modulus(F) } -> std::same_as<S>;  // >= max_a A_aa, equal at F = I [Pa]
};

// Psi = Psi+ + Psi-, of which g in [0, 1] scales Psi+ (the part that drives cracks).
template <class Law, int Dim, class S = double>
concept SplitsEnergy = MaterialLaw<Law, Dim, S> &&
    requires(const Law law, const Tensor<S, Dim>& F, const S& g) {
  { law.energy_plus(F) } -> std::same_as<S>;
  { law.energy_degraded(F, g) } -> std::same_as<S>;
  { law.kirchhoff_stress_degraded(F, g) } -> std::same_as<SymTensor<S, Dim>>;
};

// First Piola-Kirchhoff stress and its derivative in closed form, for the implicit integrator.
template <class Law, int Dim, class S = double>
concept HasTangent = MaterialLaw<Law, Dim, S> && requires(const Law law, const Tensor<S, Dim>& F) {
  { law.first_piola(F) } -> std::same_as<Tensor<S, Dim>>;
  { law.first_piola_differential(F, F) } -> std::same_as<Tensor<S, Dim>>;  // dP/dF : dF
};

}  // namespace mpm
