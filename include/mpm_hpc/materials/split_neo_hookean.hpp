// Neo-Hookean solid whose energy is split into a part that changes shape and a part that changes volume,
// so that cracks are driven by tension and shear but not by compression (CD-MPM, Appendix C).
#pragma once

#include "mpm_hpc/materials/elastic_constants.hpp"
#include "mpm_hpc/math/tensor.hpp"

namespace mpm {

// Psi_dev = mu/2 (J^(-2/d) tr F^T F - d), Psi_vol = kappa/2 ((J^2 - 1)/2 - ln J);
// Psi+ = Psi_dev (+ Psi_vol if J >= 1), Psi- = Psi - Psi+.
template <int Dim>
struct SplitNeoHookean {
  static constexpr const char* name = "split_neo_hookean";
  static constexpr const char* doc = "neo-Hookean solid split into shape and volume change; can fracture";

  static constexpr bool splits_shape_and_volume = true;

  Real mu = 0;     // [Pa]
  Real kappa = 0;  // bulk modulus [Pa]

  void declare(Parameters& parameters) {
    ElasticConstants elastic;
    elastic.declare(parameters);
    mu = elastic.mu;
    kappa = elastic.bulk_modulus<Dim>();
  }

  // tau = mu J^(-2/d) dev(b) + kappa/2 (J^2 - 1) I
  template <class S>
  SymTensor<S, Dim> kirchhoff_stress(const Tensor<S, Dim>& F) const {
    const S J = determinant(F);
    return stress_of_parts<S>(F, broadcast<S>(mu) * isochoric_factor(J), volumetric_stress(J));
  }

  // g tau+ + tau-
  template <class S>
  SymTensor<S, Dim> kirchhoff_stress_degraded(const Tensor<S, Dim>& F, const S& g) const {
    const S J = determinant(F);
    return stress_of_parts<S>(F, g * broadcast<S>(mu) * isochoric_factor(J),
                              volumetric_weight(J, g) * volumetric_stress(J));
  }

  template <class S>
  S energy_density(const Tensor<S, Dim>& F) const {
    const S J = determinant(F);
    return deviatoric_energy(inner(F, F), J) + volumetric_energy(J);
  }

  template <class S>
  S energy_plus(const Tensor<S, Dim>& F) const {
    const S J = determinant(F), one = broadcast<S>(1.0), zero = broadcast<S>(0.0);
    return deviatoric_energy(inner(F, F), J) + select_less<S>(J, one, zero, volumetric_energy(J));
  }

  // g Psi+ + Psi-
  template <class S>
  S energy_degraded(const Tensor<S, Dim>& F, const S& g) const {
    const S J = determinant(F);
    return g * deviatoric_energy(inner(F, F), J) + volumetric_weight(J, g) * volumetric_energy(J);
  }

  // g tau+ + tau- in the principal directions.
  template <class S>
  void principal_stress_degraded(const S (&s)[Dim], const S& g, S (&tau)[Dim]) const {
    const S J = product(s), spherical = volumetric_weight(J, g) * volumetric_stress(J);
    principal_deviator(s, tau);
    for (int a = 0; a < Dim; ++a) tau[a] = g * tau[a] + spherical;
  }
  template <class S>
  void principal_stress(const S (&s)[Dim], S (&tau)[Dim]) const {
    principal_stress_degraded(s, broadcast<S>(1.0), tau);
  }

  // p = -kappa/2 (J^2 - 1)
  template <class S>
  S pressure(const S& J) const {
    return -volumetric_stress(J);
  }

  // s_a = mu J^(-2/d) (b_a - mean b)
  template <class S>
  void principal_deviator(const S (&s)[Dim], S (&deviator)[Dim]) const {
    const S factor = broadcast<S>(mu) * isochoric_factor(product(s)), mean = broadcast<S>(1.0 / Dim) * sum_of_squares(s);
    for (int a = 0; a < Dim; ++a) deviator[a] = factor * (s[a] * s[a] - mean);
  }
  // d q / d gamma of plastic flow along the deviator is 3 times this (Simo 1988): mu J^(-2/d) tr(b) / d.
  template <class S>
  S shear_modulus(const S (&s)[Dim]) const {
    return broadcast<S>(mu / Dim) * isochoric_factor(product(s)) * sum_of_squares(s);
  }
  // The stretches of the same J with this deviator of tau: b_a = D_a + t with D = J^(2/d) / mu times the deviator and the
  // largest root t of prod(D_a + t) = J^2.
  template <class S>
  void stretches_with_deviator(const S (&s)[Dim], const S (&deviator)[Dim], S (&returned)[Dim]) const {
    const S J = product(s), root2 = broadcast<S>(1.0) / isochoric_factor(J), scale = broadcast<S>(1 / mu) * root2;
    S D[Dim];
    for (int a = 0; a < Dim; ++a) D[a] = scale * deviator[a];
    const S t = mean_of_squares(D, S(J * J), root2);
    for (int a = 0; a < Dim; ++a) returned[a] = sqrt_of<S>(D[a] + t);
  }

  // A = g 2 mu J^(-2/d) Q diag(s^2) Q + w kappa J^2 1 1^T with the projector Q = I - 1 1^T / d, w = g where J >= 1 and 1
  // elsewhere. The two terms don't couple, and the largest eigenvalue of the first follows from the invariants of b: for g = 1
  // this bound is exact. What is broken and expanded meets the whole kappa once it is closed, for which it counts from the start.
  template <class S>
  S stiffness_bound_degraded(const Tensor<S, Dim>& F, const S& g) const {
    const S J = determinant(F);
    const SymTensor<S, Dim> b = left_cauchy_green(F);
    S shear = broadcast<S>(1.0 / Dim) * trace(b);
    if constexpr (Dim == 3) shear += broadcast<S>(1 / std::sqrt(6.0)) * norm(deviator(b));
    return maximum<S>(g * broadcast<S>(2 * mu) * isochoric_factor(J) * shear,
                      broadcast<S>(Dim) * volumetric_modulus_bound(J, g));
  }
  template <class S>
  S stiffness_bound(const Tensor<S, Dim>& F) const {
    return stiffness_bound_degraded(F, broadcast<S>(1.0));
  }

  // A_aa = g 2 mu J^(-2/d) ((1 - 2/d) s_a^2 + tr(b)/d^2) + w kappa J^2
  template <class S>
  S wave_modulus_degraded(const Tensor<S, Dim>& F, const S& g) const {
    const S J = determinant(F);
    const SymTensor<S, Dim> b = left_cauchy_green(F);
    S shape = broadcast<S>(1.0 / (Dim * Dim)) * trace(b);
    if constexpr (Dim == 3) shape += broadcast<S>(1.0 / 3.0) * largest_eigenvalue_bound(b);
    return g * broadcast<S>(2 * mu) * isochoric_factor(J) * shape + volumetric_modulus_bound(J, g);
  }
  template <class S>
  S wave_modulus(const Tensor<S, Dim>& F) const {
    return wave_modulus_degraded(F, broadcast<S>(1.0));
  }

  template <class S>
  Tensor<S, Dim> first_piola(const Tensor<S, Dim>& F) const {
    const S J = determinant(F);
    const Tensor<S, Dim> inverse_transpose = (broadcast<S>(1.0) / J) * cofactor(F);
    return (broadcast<S>(mu) * isochoric_factor(J)) * deviatoric_direction(F, inverse_transpose) +
           volumetric_stress(J) * inverse_transpose;
  }

  // With D = F - tr(b)/d F^-T and X = F^-T dF^T F^-T:
  // dP = mu J^(-2/d) (dF - 2/d (F : dF) F^-T + tr(b)/d X - 2/d (F^-T : dF) D)
  //      + kappa J^2 (F^-T : dF) F^-T - kappa/2 (J^2 - 1) X
  template <class S>
  Tensor<S, Dim> first_piola_differential(const Tensor<S, Dim>& F, const Tensor<S, Dim>& dF) const {
    const S J = determinant(F);
    const Tensor<S, Dim> inverse_transpose = (broadcast<S>(1.0) / J) * cofactor(F);
    const Tensor<S, Dim> X = multiply(multiply(inverse_transpose, transpose(dF)), inverse_transpose);
    const S shear = broadcast<S>(mu) * isochoric_factor(J);
    const S rate = inner(inverse_transpose, dF);
    const S two_over_d = broadcast<S>(2.0 / Dim);
    const S mean = broadcast<S>(1.0 / Dim) * inner(F, F);
    const S along_inverse = broadcast<S>(kappa) * J * J * rate - shear * two_over_d * inner(F, dF);
    const S along_X = shear * mean - volumetric_stress(J);
    const S along_D = -shear * two_over_d * rate;
    return shear * dF + along_inverse * inverse_transpose + along_X * X +
           along_D * deviatoric_direction(F, inverse_transpose);
  }

  // A_ab = d tau_a / d ln s_b in the principal stretches s: 2 mu J^(-2/d) Q diag(s^2) Q + kappa J^2 1 1^T with the projector
  // Q = I - 1 1^T / d, the first term times g, the second as well where J >= 1.
  template <class S>
  SymTensor<S, Dim> principal_moduli_degraded(const S (&s)[Dim], const S& g) const {
    const S J = product(s), shear = g * broadcast<S>(2 * mu) * isochoric_factor(J),
            volumetric = volumetric_weight(J, g) * broadcast<S>(kappa) * J * J;
    const S mean = broadcast<S>(1.0 / (Dim * Dim)) * sum_of_squares(s);
    SymTensor<S, Dim> A;
    for (int a = 0; a < Dim; ++a)
      for (int b = a; b < Dim; ++b) {
        S shape = mean - broadcast<S>(1.0 / Dim) * (s[a] * s[a] + s[b] * s[b]);
        if (a == b) shape += s[a] * s[a];
        A(a, b) = shear * shape + volumetric;
      }
    return A;
  }
  template <class S>
  SymTensor<S, Dim> principal_moduli(const S (&s)[Dim]) const {
    return principal_moduli_degraded(s, broadcast<S>(1.0));
  }

 private:
  // J^(-2/d)
  template <class S>
  static S isochoric_factor(const S& J) {
    if constexpr (Dim == 2) {
      return broadcast<S>(1.0) / J;
    } else {
      const S root = inverse_cube_root<S>(J);
      return root * root;
    }
  }

  template <class S>
  S volumetric_stress(const S& J) const {
    return broadcast<S>(0.5 * kappa) * (J * J - broadcast<S>(1.0));
  }

  template <class S>
  static S volumetric_weight(const S& J, const S& g) {
    const S one = broadcast<S>(1.0);
    return select_less<S>(J, one, one, g);
  }

  // d tau_vol / d ln J: w kappa J^2, and not less than the kappa that waits at J = 1.
  template <class S>
  S volumetric_modulus_bound(const S& J, const S& g) const {
    const S J2 = J * J;
    return broadcast<S>(kappa) * maximum<S>(g * J2, minimum<S>(J2, broadcast<S>(1.0)));
  }

  template <class S>
  static SymTensor<S, Dim> stress_of_parts(const Tensor<S, Dim>& F, const S& shear, const S& volumetric) {
    SymTensor<S, Dim> tau = shear * deviator(left_cauchy_green(F));
    for (int i = 0; i < Dim; ++i) tau(i, i) += volumetric;
    return tau;
  }

  template <class S>
  static S product(const S (&s)[Dim]) {
    S J = s[0];
    for (int a = 1; a < Dim; ++a) J *= s[a];
    return J;
  }
  template <class S>
  static S sum_of_squares(const S (&s)[Dim]) {
    S sum = s[0] * s[0];
    for (int a = 1; a < Dim; ++a) sum += s[a] * s[a];
    return sum;
  }

  // The largest t with prod(D_a + t) = J^2, given J^2 and J^(2/d). The product is convex and rises from there on, so that
  // Newton's iteration falls to t from any larger number, such as J^(2/d) + max |D_a|.
  template <class S>
  static S mean_of_squares(const S (&D)[Dim], const S& J2, const S& root2) {
    if constexpr (Dim == 2) {
      return sqrt_of<S>(J2 - D[0] * D[1]);
    } else {
      const S linear = D[0] * D[1] + D[1] * D[2] + D[2] * D[0], constant = D[0] * D[1] * D[2] - J2;
      S t = root2 + maximum<S>(maximum<S>(abs_of<S>(D[0]), abs_of<S>(D[1])), abs_of<S>(D[2]));
      constexpr int most = 60;  // a step takes a third of the distance at least
      for (int i = 0; i < most; ++i) {
        const S step = ((t * t + linear) * t + constant) / (broadcast<S>(3.0) * t * t + linear);
        t -= step;
        // The next error is of the order of the square.
        if (none_above<S>(abs_of<S>(step), broadcast<S>(1e-9) * t)) break;
      }
      return t;
    }
  }

  template <class S>
  S deviatoric_energy(const S& squares, const S& J) const {
    return broadcast<S>(0.5 * mu) * (isochoric_factor(J) * squares - broadcast<S>(Dim));
  }

  template <class S>
  S volumetric_energy(const S& J) const {
    return broadcast<S>(0.5 * kappa) * (broadcast<S>(0.5) * (J * J - broadcast<S>(1.0)) - log_of<S>(J));
  }

  // F - tr(b)/d F^-T = dev(b) F^-T
  template <class S>
  static Tensor<S, Dim> deviatoric_direction(const Tensor<S, Dim>& F,
                                             const Tensor<S, Dim>& inverse_transpose) {
    return F - (broadcast<S>(1.0 / Dim) * inner(F, F)) * inverse_transpose;
  }
};

}  // namespace mpm
