// The tangent of a hyperelastic law as a sum of squares, for packs of particles, so that what Newton's directions need of it
// can be made semi-definite term by term: in the principal frame d^2 Psi / dF dF falls into one Dim x Dim block and one 2x2
// block per pair of axes (Teran et al. 2005; slides, Appendix B).
#pragma once

#include "mpm_hpc/math/symmetric_eigen.hpp"

namespace mpm {

// An isotropic law given through its principal stretches s: tau_a and A_ab = d tau_a / d ln s_b.
template <class Law, int Dim, class S = double>
concept HasPrincipalModuli = requires(const Law law, const S (&s)[Dim], S (&tau)[Dim]) {
  law.principal_stress(s, tau);
  { law.principal_moduli(s) } -> std::same_as<SymTensor<S, Dim>>;
};

// The same of a law whose part that drives cracks is scaled by g.
template <class Law, class S>
struct DegradedLaw {
  const Law& law;
  S g;

  template <int Dim>
  void principal_stress(const S (&s)[Dim], S (&tau)[Dim]) const {
    law.principal_stress_degraded(s, g, tau);
  }
  template <int Dim>
  SymTensor<S, Dim> principal_moduli(const S (&s)[Dim]) const {
    return law.principal_moduli_degraded(s, g);
  }
};

// d^2 Psi : (L F^n, L F^n) = sum_m value[m] (direction[m] : L)^2 for F = (I + L') F^n and a change L of L', with F^n = before.
template <class S, int Dim>
struct TangentModes {
  static constexpr int count = Dim * Dim;
  S value[count];
  Tensor<S, Dim> direction[count];

  template <class Law>
  TangentModes(const Law& law, const Tensor<S, Dim>& F, const Tensor<S, Dim>& before) {
    const S half_root = broadcast<S>(std::sqrt(0.5));
    const SymmetricEigen<S, Dim> right = symmetric_eigen(left_cauchy_green(transpose(F)));
    S s[Dim], tau[Dim], P[Dim];
    for (int a = 0; a < Dim; ++a) s[a] = sqrt_of<S>(right.values[a]);
    // F = U diag(s) V^T, and the frame of the directions is u_a (before v_b)^T.
    Tensor<S, Dim> U = multiply(F, right.vectors);
    const Tensor<S, Dim> M = multiply(before, right.vectors);
    for (int a = 0; a < Dim; ++a)
      for (int i = 0; i < Dim; ++i) U(i, a) = U(i, a) / s[a];
    law.principal_stress(s, tau);
    for (int a = 0; a < Dim; ++a) P[a] = tau[a] / s[a];
    const SymmetricEigen<S, Dim> block = symmetric_eigen(hessian(law.principal_moduli(s), s, tau));

    for (int m = 0; m < Dim; ++m) {
      value[m] = block.values[m];
      for (int i = 0; i < Dim; ++i)
        for (int k = 0; k < Dim; ++k) {
          S sum = block.vectors(0, m) * U(i, 0) * M(k, 0);
          for (int a = 1; a < Dim; ++a) sum += block.vectors(a, m) * U(i, a) * M(k, a);
          direction[m](i, k) = sum;
        }
    }
    int m = Dim;
    for (int a = 0; a < Dim; ++a)
      for (int b = a + 1; b < Dim; ++b, m += 2) {
        value[m] = stress_slope(law, s, P, a, b);
        value[m + 1] = (P[a] + P[b]) / (s[a] + s[b]);
        for (int i = 0; i < Dim; ++i)
          for (int k = 0; k < Dim; ++k) {
            const S ab = half_root * U(i, a) * M(k, b), ba = half_root * U(i, b) * M(k, a);
            direction[m](i, k) = ab + ba;
            direction[m + 1](i, k) = ab - ba;
          }
      }
  }

  void project() {
    const S zero = broadcast<S>(0.0);
    for (S& v : value) v = maximum<S>(zero, v);
  }

 private:
  // d^2 Psi / d s_a d s_b = (A_ab - delta_ab tau_a) / (s_a s_b)
  static SymTensor<S, Dim> hessian(SymTensor<S, Dim> A, const S (&s)[Dim], const S (&tau)[Dim]) {
    for (int a = 0; a < Dim; ++a) A(a, a) -= tau[a];
    for (int a = 0; a < Dim; ++a)
      for (int b = a; b < Dim; ++b) A(a, b) = A(a, b) / (s[a] * s[b]);
    return A;
  }

  // (P_a - P_b) / (s_a - s_b). Below a gap of 1e-5 the quotient would lose more digits than its value at the middle,
  // H_aa - H_ab, which is right to the square of the gap.
  template <class Law>
  static S stress_slope(const Law& law, const S (&s)[Dim], const S (&P)[Dim], int a, int b) {
    const S gap = s[a] - s[b], size = abs_of<S>(gap), limit = broadcast<S>(1e-5) * maximum<S>(s[a], s[b]);
    S middle[Dim], tau[Dim];
    for (int c = 0; c < Dim; ++c) middle[c] = s[c];
    middle[a] = middle[b] = broadcast<S>(0.5) * (s[a] + s[b]);
    law.principal_stress(middle, tau);
    const SymTensor<S, Dim> H = hessian(law.principal_moduli(middle), middle, tau);
    const S quotient = (P[a] - P[b]) / select_less<S>(limit, size, gap, broadcast<S>(1.0));
    return select_less<S>(limit, size, quotient, S(H(a, a) - H(a, b)));
  }
};

}  // namespace mpm
