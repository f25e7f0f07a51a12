// Compressible neo-Hookean solid: Psi = mu/2 (tr F^T F - d) - mu ln J + lambda/2 ln^2 J.
#pragma once

#include "mpm_hpc/materials/elastic_constants.hpp"
#include "mpm_hpc/math/tensor.hpp"

namespace mpm {

template <int Dim>
struct NeoHookean {
  static constexpr const char* name = "neo_hookean";
  static constexpr const char* doc =
      "compressible neo-Hookean solid; resists any compression, can't fracture";

  Real mu = 0;      // [Pa]
  Real lambda = 0;  // [Pa]

  void declare(Parameters& parameters) {
    ElasticConstants elastic;
    elastic.declare(parameters);
    mu = elastic.mu;
    lambda = elastic.lambda;
  }

  // tau = mu (b - I) + lambda ln J I
  template <class S>
  SymTensor<S, Dim> kirchhoff_stress(const Tensor<S, Dim>& F) const {
    const S spherical = broadcast<S>(lambda) * log_of<S>(determinant(F)) - broadcast<S>(mu);
    SymTensor<S, Dim> tau = broadcast<S>(mu) * left_cauchy_green(F);
    for (int i = 0; i < Dim; ++i) tau(i, i) += spherical;
    return tau;
  }

  template <class S>
  S energy_density(const Tensor<S, Dim>& F) const {
    const S log_J = log_of<S>(determinant(F));
    return broadcast<S>(0.5 * mu) * (inner(F, F) - broadcast<S>(Dim)) +
           log_J * (broadcast<S>(0.5 * lambda) * log_J - broadcast<S>(mu));
  }

  // A_ab = 2 mu s_a^2 delta_ab + lambda, and the matrix of ones has the eigenvalues d and 0.
  template <class S>
  S stiffness_bound(const Tensor<S, Dim>& F) const {
    return broadcast<S>(2 * mu) * largest_eigenvalue_bound(left_cauchy_green(F)) +
           broadcast<S>(lambda > 0 ? Dim * lambda : 0);
  }

  template <class S>
  S wave_modulus(const Tensor<S, Dim>& F) const {
    return broadcast<S>(2 * mu) * largest_eigenvalue_bound(left_cauchy_green(F)) + broadcast<S>(lambda);
  }

  // P = mu (F - F^-T) + lambda ln J F^-T
  template <class S>
  Tensor<S, Dim> first_piola(const Tensor<S, Dim>& F) const {
    const S J = determinant(F);
    const Tensor<S, Dim> inverse_transpose = (broadcast<S>(1.0) / J) * cofactor(F);
    return broadcast<S>(mu) * F +
           (broadcast<S>(lambda) * log_of<S>(J) - broadcast<S>(mu)) * inverse_transpose;
  }

  // dP = mu dF + (mu - lambda ln J) F^-T dF^T F^-T + lambda (F^-T : dF) F^-T
  template <class S>
  Tensor<S, Dim> first_piola_differential(const Tensor<S, Dim>& F, const Tensor<S, Dim>& dF) const {
    const S J = determinant(F);
    const Tensor<S, Dim> inverse_transpose = (broadcast<S>(1.0) / J) * cofactor(F);
    return broadcast<S>(mu) * dF +
           (broadcast<S>(mu) - broadcast<S>(lambda) * log_of<S>(J)) *
               multiply(multiply(inverse_transpose, transpose(dF)), inverse_transpose) +
           (broadcast<S>(lambda) * inner(inverse_transpose, dF)) * inverse_transpose;
  }

  // tau_a and A_ab = d tau_a / d ln s_b in the principal stretches s.
  template <class S>
  void principal_stress(const S (&s)[Dim], S (&tau)[Dim]) const {
    S J = s[0];
    for (int a = 1; a < Dim; ++a) J *= s[a];
    const S spherical = broadcast<S>(lambda) * log_of<S>(J) - broadcast<S>(mu);
    for (int a = 0; a < Dim; ++a) tau[a] = broadcast<S>(mu) * s[a] * s[a] + spherical;
  }
  template <class S>
  SymTensor<S, Dim> principal_moduli(const S (&s)[Dim]) const {
    SymTensor<S, Dim> A;
    for (int a = 0; a < Dim; ++a)
      for (int b = a; b < Dim; ++b)
        A(a, b) = a == b ? S(broadcast<S>(2 * mu) * s[a] * s[a] + broadcast<S>(lambda)) : broadcast<S>(lambda);
    return A;
  }
};

}  // namespace mpm
