// Fixed corotated solid (Stomakhin et al. 2012): Psi = mu |F - R|^2 + lambda/2 (J - 1)^2, F = R S. Stays soft where the
// neo-Hookean solids become infinitely stiff, under strong compression.
#pragma once

#include "mpm_hpc/materials/elastic_constants.hpp"
#include "mpm_hpc/math/polar.hpp"

namespace mpm {

template <int Dim>
struct FixedCorotated {
  static constexpr const char* name = "fixed_corotated";
  static constexpr const char* doc =
      "fixed corotated solid; linear in the stretches, soft under strong compression, can't fracture";

  Real mu = 0;      // [Pa]
  Real lambda = 0;  // [Pa]

  void declare(Parameters& parameters) {
    ElasticConstants elastic;
    elastic.declare(parameters);
    mu = elastic.mu;
    lambda = elastic.lambda;
  }

  // tau = 2 mu (F - R) F^T + lambda (J - 1) J I
  template <class S>
  SymTensor<S, Dim> kirchhoff_stress(const Tensor<S, Dim>& F) const {
    const S J = determinant(F);
    const Tensor<S, Dim> strain = broadcast<S>(2 * mu) * (F - rotation_of(F));
    SymTensor<S, Dim> tau;
    for (int i = 0; i < Dim; ++i)
      for (int j = i; j < Dim; ++j) {
        S sum = strain(i, 0) * F(j, 0);
        for (int k = 1; k < Dim; ++k) sum += strain(i, k) * F(j, k);
        tau(i, j) = sum;
      }
    const S spherical = broadcast<S>(lambda) * (J - broadcast<S>(1.0)) * J;
    for (int i = 0; i < Dim; ++i) tau(i, i) += spherical;
    return tau;
  }

  template <class S>
  S energy_density(const Tensor<S, Dim>& F) const {
    const Tensor<S, Dim> strain = F - rotation_of(F);
    const S volume_change = determinant(F) - broadcast<S>(1.0);
    return broadcast<S>(mu) * inner(strain, strain) + broadcast<S>(0.5 * lambda) * volume_change * volume_change;
  }

  // tau_a = 2 mu s_a (s_a - 1) + lambda (J - 1) J
  template <class S>
  void principal_stress(const S (&s)[Dim], S (&tau)[Dim]) const {
    const S one = broadcast<S>(1.0);
    S J = s[0];
    for (int a = 1; a < Dim; ++a) J *= s[a];
    const S spherical = broadcast<S>(lambda) * (J - one) * J;
    for (int a = 0; a < Dim; ++a) tau[a] = broadcast<S>(2 * mu) * s[a] * (s[a] - one) + spherical;
  }

  // A_ab = 2 mu s_a (2 s_a - 1) delta_ab + lambda J (2 J - 1), and the matrix of ones has the eigenvalues d and 0. The
  // first term grows with s where it is positive.
  template <class S>
  S stiffness_bound(const Tensor<S, Dim>& F) const {
    return shear_bound(F) + broadcast<S>(static_cast<Real>(Dim)) * maximum<S>(volumetric_modulus(F), broadcast<S>(0.0));
  }

  template <class S>
  S wave_modulus(const Tensor<S, Dim>& F) const {
    return shear_bound(F) + volumetric_modulus(F);
  }

  // P = 2 mu (F - R) + lambda (J - 1) J F^-T
  template <class S>
  Tensor<S, Dim> first_piola(const Tensor<S, Dim>& F) const {
    return broadcast<S>(2 * mu) * (F - rotation_of(F)) +
           (broadcast<S>(lambda) * (determinant(F) - broadcast<S>(1.0))) * cofactor(F);
  }

  // With C = J F^-T: dP = 2 mu (dF - dR) + lambda (C : dF) C + lambda (J - 1) dC,
  // dC = ((C : dF) C - C dF^T C) / J, which together is lambda (2J - 1) J^-1 (C : dF) C - lambda (J - 1) J^-1 C dF^T C.
  template <class S>
  Tensor<S, Dim> first_piola_differential(const Tensor<S, Dim>& F, const Tensor<S, Dim>& dF) const {
    const S J = determinant(F), one = broadcast<S>(1.0), per_volume = broadcast<S>(lambda) / J;
    const Tensor<S, Dim> C = cofactor(F);
    return broadcast<S>(2 * mu) * (dF - rotation_differential(F, dF)) +
           (per_volume * (J + J - one) * inner(C, dF)) * C -
           (per_volume * (J - one)) * multiply(multiply(C, transpose(dF)), C);
  }

  // A_ab = d tau_a / d ln s_b in the principal stretches s.
  template <class S>
  SymTensor<S, Dim> principal_moduli(const S (&s)[Dim]) const {
    const S one = broadcast<S>(1.0);
    S J = s[0];
    for (int a = 1; a < Dim; ++a) J *= s[a];
    const S volumetric = broadcast<S>(lambda) * J * (J + J - one);
    SymTensor<S, Dim> A;
    for (int a = 0; a < Dim; ++a)
      for (int b = a; b < Dim; ++b)
        A(a, b) = a == b ? S(broadcast<S>(2 * mu) * s[a] * (s[a] + s[a] - one) + volumetric) : volumetric;
    return A;
  }

 private:
  template <class S>
  S shear_bound(const Tensor<S, Dim>& F) const {
    const S square = largest_eigenvalue_bound(left_cauchy_green(F));
    return broadcast<S>(2 * mu) * maximum<S>(square + square - sqrt_of<S>(square), broadcast<S>(0.0));
  }
  template <class S>
  S volumetric_modulus(const Tensor<S, Dim>& F) const {
    const S J = determinant(F);
    return broadcast<S>(lambda) * J * (J + J - broadcast<S>(1.0));
  }

  // dR = R W, where the skew W solves W S + S W = R^T dF - dF^T R: with the axial vector w of W and the axial vector v of
  // the right-hand side, (tr S I - S) w = v; in 2D tr S w = v.
  template <class S>
  static Tensor<S, Dim> rotation_differential(const Tensor<S, Dim>& F, const Tensor<S, Dim>& dF) {
    const Tensor<S, Dim> R = rotation_of(F), stretch = multiply(transpose(R), F), turned = multiply(transpose(R), dF);
    Tensor<S, Dim> W;
    for (int i = 0; i < Dim; ++i) W(i, i) = broadcast<S>(0.0);
    if constexpr (Dim == 2) {
      W(1, 0) = (turned(1, 0) - turned(0, 1)) / (stretch(0, 0) + stretch(1, 1));
      W(0, 1) = -W(1, 0);
    } else {
      const S v[3] = {turned(2, 1) - turned(1, 2), turned(0, 2) - turned(2, 0), turned(1, 0) - turned(0, 1)};
      const S sum = stretch(0, 0) + stretch(1, 1) + stretch(2, 2);
      Tensor<S, Dim> system = broadcast<S>(-1.0) * stretch;
      for (int i = 0; i < 3; ++i) system(i, i) += sum;
      const Tensor<S, Dim> C = cofactor(system);  // symmetric as the system is
      const S inverse = broadcast<S>(1.0) / determinant(system);
      S w[3];
      for (int i = 0; i < 3; ++i) w[i] = inverse * (C(i, 0) * v[0] + C(i, 1) * v[1] + C(i, 2) * v[2]);
      W(2, 1) = w[0], W(0, 2) = w[1], W(1, 0) = w[2];
      W(1, 2) = -w[0], W(2, 0) = -w[1], W(0, 1) = -w[2];
    }
    return multiply(R, W);
  }
};

}  // namespace mpm
