// How a law answers to a trial step: what loops over particles need of it, made once per law.
#pragma once

#include "mpm_hpc/materials/material.hpp"
#include "mpm_hpc/materials/material_columns.hpp"
#include "mpm_hpc/materials/tangent_modes.hpp"
#include "mpm_hpc/materials/trial_columns.hpp"

namespace mpm {

// How the law's energy depends on L. The law may be a DegradedLaw, which has principal stresses alone.
template <class S, int Dim, class Law>
inline Tensor<S, Dim> trial_stress(const Law& law, const SymTensor<S, Dim>& tau, const Tensor<S, Dim>& F,
                                   const Tensor<S, Dim>& before) {
  if constexpr (HasPrincipalModuli<Law, Dim, S>) {
    // P F^nT = tau F^-T F^nT
    const S inverse_J = broadcast<S>(1.0) / determinant(F);
    const Tensor<S, Dim> turned = inverse_J * multiply(cofactor(F), transpose(before));
    Tensor<S, Dim> full;
    for (int i = 0; i < Dim; ++i)
      for (int j = 0; j < Dim; ++j) full(i, j) = tau(i, j);
    return multiply(full, turned);
  } else {
    return multiply(law.first_piola(F), transpose(before));
  }
}

template <class S, int Dim, class Law>
[[gnu::noinline]] SymTensor<S, Dim * Dim> trial_tangent(const Law& law, const Tensor<S, Dim>& F,
                                                        const Tensor<S, Dim>& before, bool project) {
  constexpr int size = Dim * Dim;
  SymTensor<S, size> A;
  if constexpr (HasPrincipalModuli<Law, Dim, S>) {
    TangentModes<S, Dim> modes(law, F, before);
    if (project) modes.project();
    for (int n = 0; n < size; ++n)
      for (int m = n; m < size; ++m) {
        S sum = modes.value[0] * modes.direction[0].m[n] * modes.direction[0].m[m];
        for (int k = 1; k < modes.count; ++k)
          sum += modes.value[k] * modes.direction[k].m[n] * modes.direction[k].m[m];
        A(n, m) = sum;
      }
  } else {
    // A law that isn't one of the principal stretches is convex in F.
    for (int m = 0; m < size; ++m) {
      Tensor<S, Dim> L;
      for (int n = 0; n < size; ++n) L.m[n] = broadcast<S>(n == m ? 1.0 : 0.0);
      const Tensor<S, Dim> dS =
          multiply(law.first_piola_differential(F, multiply(L, before)), transpose(before));
      for (int n = 0; n <= m; ++n) A(n, m) = dS.m[n];
    }
  }
  return A;
}

// Particles [begin, end) of the columns, whose energies count weight[p - begin] times; the gradients and the outputs of
// particle p are at [p - first].
template <class Law, int Dim>
TrialSums trial_run(const Law& law, const MaterialColumns<Dim, double>& columns, const double* weight,
                    const double* const* gradient, Real dt, Index begin, Index end, Index first,
                    const TrialColumns<Dim>& out) {
  using S = Pack<double>;
  TrialSums sums;
  S energy = broadcast<S>(0.0), magnitude = energy,
    min_J = broadcast<S>(std::numeric_limits<double>::infinity());
  for (Index p = begin; p < end; p += pack_width<double>) {
    const Index at = p - first;
    const Tensor<S, Dim> before = load_tensor<S, Dim>(columns.F, p);
    const Tensor<S, Dim> F = before + multiply(broadcast<S>(dt) * load_tensor<S, Dim>(gradient, at), before);
    const S factor = load<S>(weight + (p - begin));
    const S modulus = factor * law.wave_modulus(F);
    magnitude += modulus;
    S stiffness = modulus;
    auto respond = [&](const auto& any_law, const SymTensor<S, Dim>& tau, const S& density) {
      if (out.stress[0]) store_tensor(out.stress, at, factor * trial_stress(any_law, tau, F, before));
      if (out.tangent[0])
        store_tensor(out.tangent, at, factor * trial_tangent(any_law, F, before, out.project));
      energy += factor * density;
    };
    bool degraded = false;
    if constexpr (SplitsEnergy<Law, Dim>) {
      degraded = columns.phase != nullptr;
      if (degraded) {
        const S g = degradation<S>(columns, p);
        stiffness *= g;
        respond(DegradedLaw<Law, S>{law, g}, law.kirchhoff_stress_degraded(F, g), law.energy_degraded(F, g));
      }
    }
    if (out.modulus) store(out.modulus + at, stiffness);
    if (!degraded) respond(law, law.kirchhoff_stress(F), law.energy_density(F));
    min_J = minimum<S>(min_J, determinant(F));
  }
  return {energy.sum(), magnitude.sum(), min_J.minCoeff()};
}

}  // namespace mpm
