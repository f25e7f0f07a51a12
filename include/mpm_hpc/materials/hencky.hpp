// Hencky's solid (St Venant-Kirchhoff in logarithmic strain): Psi = mu sum_a e_a^2 + lambda/2 (sum_a e_a)^2, e_a = ln s_a
// (Klar et al. 2016, equation 20). Return mappings are straight lines in it, and its moduli never change.
#pragma once

#include "mpm_hpc/materials/elastic_constants.hpp"
#include "mpm_hpc/math/symmetric_log.hpp"

namespace mpm {

template <int Dim>
struct Hencky {
  static constexpr const char* name = "hencky";
  static constexpr const char* doc =
      "St Venant-Kirchhoff solid in logarithmic strain; carries most plasticity, can't fracture";
  static constexpr bool linear_in_logarithmic_strain = true;

  Real mu = 0;      // [Pa]
  Real lambda = 0;  // [Pa]

  void declare(Parameters& parameters) {
    ElasticConstants elastic;
    elastic.declare(parameters);
    mu = elastic.mu;
    lambda = elastic.lambda;
  }
  Real bulk_modulus() const { return ElasticConstants{mu, lambda}.bulk_modulus<Dim>(); }

  // tau = mu ln b + lambda/2 tr ln b I
  template <class S>
  SymTensor<S, Dim> kirchhoff_stress(const Tensor<S, Dim>& F) const {
    const SymTensor<S, Dim> logarithm = symmetric_log(left_cauchy_green(F));
    SymTensor<S, Dim> tau = broadcast<S>(mu) * logarithm;
    const S spherical = broadcast<S>(0.5 * lambda) * trace(logarithm);
    for (int i = 0; i < Dim; ++i) tau(i, i) += spherical;
    return tau;
  }

  template <class S>
  S energy_density(const Tensor<S, Dim>& F) const {
    const SymTensor<S, Dim> logarithm = symmetric_log(left_cauchy_green(F));
    const S length = norm(logarithm), sum = trace(logarithm);
    return broadcast<S>(0.25 * mu) * length * length + broadcast<S>(0.125 * lambda) * sum * sum;
  }

  // A_ab = 2 mu delta_ab + lambda at every F, and the matrix of ones has the eigenvalues d and 0.
  template <class S>
  S stiffness_bound(const Tensor<S, Dim>&) const {
    return broadcast<S>(2 * mu + (lambda > 0 ? Dim * lambda : 0));
  }
  template <class S>
  S wave_modulus(const Tensor<S, Dim>&) const {
    return broadcast<S>(2 * mu + lambda);
  }

  template <class S>
  void principal_stress(const S (&s)[Dim], S (&tau)[Dim]) const {
    S sum = broadcast<S>(0.0);
    for (int a = 0; a < Dim; ++a) {
      tau[a] = log_of<S>(s[a]);
      sum += tau[a];
    }
    for (int a = 0; a < Dim; ++a) tau[a] = broadcast<S>(2 * mu) * tau[a] + broadcast<S>(lambda) * sum;
  }

  // s_a = 2 mu (e_a - mean e)
  template <class S>
  void principal_deviator(const S (&s)[Dim], S (&deviator)[Dim]) const {
    S mean = broadcast<S>(0.0);
    for (int a = 0; a < Dim; ++a) {
      deviator[a] = log_of<S>(s[a]);
      mean += broadcast<S>(1.0 / Dim) * deviator[a];
    }
    for (int a = 0; a < Dim; ++a) deviator[a] = broadcast<S>(2 * mu) * (deviator[a] - mean);
  }
  // d q / d gamma of plastic flow along the deviator is 3 times this.
  template <class S>
  S shear_modulus(const S (&)[Dim]) const {
    return broadcast<S>(mu);
  }
  // ln s_a = ln J / d + s_a / (2 mu)
  template <class S>
  void stretches_with_deviator(const S (&s)[Dim], const S (&deviator)[Dim], S (&returned)[Dim]) const {
    S J = s[0];
    for (int a = 1; a < Dim; ++a) J *= s[a];
    const S mean = broadcast<S>(1.0 / Dim) * log_of<S>(J);
    for (int a = 0; a < Dim; ++a) returned[a] = exp_of<S>(mean + broadcast<S>(0.5 / mu) * deviator[a]);
  }

  // P = tau F^-T
  template <class S>
  Tensor<S, Dim> first_piola(const Tensor<S, Dim>& F) const {
    return times(kirchhoff_stress(F), inverse_transposed(F));
  }

  // dP = dtau F^-T - tau F^-T dF^T F^-T, dtau = mu d(ln b) + lambda (F^-T : dF) I; in the frame of b the entries of d(ln b)
  // are those of db = dF F^T + F dF^T times (ln b_a - ln b_c) / (b_a - b_c).
  template <class S>
  Tensor<S, Dim> first_piola_differential(const Tensor<S, Dim>& F, const Tensor<S, Dim>& dF) const {
    const Tensor<S, Dim> inverse = inverse_transposed(F), half = multiply(dF, transpose(F));
    const SymmetricEigen<S, Dim> eigen = symmetric_eigen(left_cauchy_green(F));
    const Tensor<S, Dim>& Q = eigen.vectors;
    Tensor<S, Dim> change = multiply(multiply(transpose(Q), half + transpose(half)), Q);
    for (int a = 0; a < Dim; ++a)
      for (int c = 0; c < Dim; ++c)
        change(a, c) *= broadcast<S>(mu) * logarithmic_slope(eigen.values[a], eigen.values[c]);
    Tensor<S, Dim> dtau = multiply(multiply(Q, change), transpose(Q));
    const S volumetric = broadcast<S>(lambda) * inner(inverse, dF);
    for (int i = 0; i < Dim; ++i) dtau(i, i) += volumetric;
    return multiply(dtau, inverse) -
           times(kirchhoff_stress(F), multiply(multiply(inverse, transpose(dF)), inverse));
  }

  // A_ab = d tau_a / d ln s_b in the principal stretches.
  template <class S>
  SymTensor<S, Dim> principal_moduli(const S (&)[Dim]) const {
    SymTensor<S, Dim> A;
    for (int a = 0; a < Dim; ++a)
      for (int b = a; b < Dim; ++b) A(a, b) = broadcast<S>(a == b ? 2 * mu + lambda : lambda);
    return A;
  }

 private:
  template <class S>
  static Tensor<S, Dim> inverse_transposed(const Tensor<S, Dim>& F) {
    return S(broadcast<S>(1.0) / determinant(F)) * cofactor(F);
  }
  template <class S>
  static Tensor<S, Dim> times(const SymTensor<S, Dim>& a, const Tensor<S, Dim>& b) {
    Tensor<S, Dim> full;
    for (int i = 0; i < Dim; ++i)
      for (int j = 0; j < Dim; ++j) full(i, j) = a(i, j);
    return multiply(full, b);
  }

  // (ln x - ln y) / (x - y) = atanh(r) / r / m with r = (x - y) / (x + y) and the mean m; by its series where the quotient
  // would lose digits.
  template <class S>
  static S logarithmic_slope(const S& x, const S& y) {
    const S one = broadcast<S>(1.0), sum = x + y, difference = x - y, r = difference / sum, r2 = r * r;
    S series = broadcast<S>(0.0);
    for (int n = 15; n >= 1; n -= 2) series = series * r2 + broadcast<S>(1.0 / n);
    const S size = abs_of<S>(r), limit = broadcast<S>(0.1);
    const S quotient = (log_of<S>(x) - log_of<S>(y)) / select_less<S>(size, limit, one, difference);
    return select_less<S>(size, limit, S(broadcast<S>(2.0) * series / sum), quotient);
  }
};

}  // namespace mpm
