// Linear elastic solid for small displacement gradients: Psi = mu eps : eps + lambda/2 (tr eps)^2, eps = sym F - I. For
// comparison with linear theory: it isn't objective, and a rotation strains it.
#pragma once

#include "mpm_hpc/materials/elastic_constants.hpp"
#include "mpm_hpc/math/tensor.hpp"

namespace mpm {

template <int Dim>
struct LinearElastic {
  static constexpr const char* name = "linear_elastic";
  static constexpr const char* doc = "linear elasticity of small strains and rotations; can't fracture";

  Real mu = 0;      // [Pa]
  Real lambda = 0;  // [Pa]

  void declare(Parameters& parameters) {
    ElasticConstants elastic;
    elastic.declare(parameters);
    mu = elastic.mu;
    lambda = elastic.lambda;
  }

  // tau = P = 2 mu eps + lambda tr eps I: the three stresses agree to first order in F - I, and P F^T, whose next order the
  // theory doesn't have, would not be symmetric.
  template <class S>
  SymTensor<S, Dim> kirchhoff_stress(const Tensor<S, Dim>& F) const {
    const SymTensor<S, Dim> eps = strain(F);
    SymTensor<S, Dim> tau = broadcast<S>(2 * mu) * eps;
    const S volumetric = broadcast<S>(lambda) * trace(eps);
    for (int i = 0; i < Dim; ++i) tau(i, i) += volumetric;
    return tau;
  }

  template <class S>
  S energy_density(const Tensor<S, Dim>& F) const {
    const SymTensor<S, Dim> eps = strain(F);
    const S length = norm(eps), sum = trace(eps);
    return broadcast<S>(mu) * length * length + broadcast<S>(0.5 * lambda) * sum * sum;
  }

  // A_ab = (2 mu delta_ab + lambda) s_b, and the matrix of ones has the eigenvalues d and 0.
  template <class S>
  S stiffness_bound(const Tensor<S, Dim>& F) const {
    return broadcast<S>(2 * mu + (lambda > 0 ? Dim * lambda : 0)) * largest_stretch_bound(F);
  }
  template <class S>
  S wave_modulus(const Tensor<S, Dim>& F) const {
    return broadcast<S>(2 * mu + lambda) * largest_stretch_bound(F);
  }

  // P = 2 mu eps + lambda tr eps I
  template <class S>
  Tensor<S, Dim> first_piola(const Tensor<S, Dim>& F) const {
    return full(kirchhoff_stress(F));
  }
  template <class S>
  Tensor<S, Dim> first_piola_differential(const Tensor<S, Dim>&, const Tensor<S, Dim>& dF) const {
    return full(kirchhoff_stress(dF + Tensor<S, Dim>::identity()));
  }

 private:
  template <class S>
  static SymTensor<S, Dim> strain(const Tensor<S, Dim>& F) {
    SymTensor<S, Dim> eps;
    for (int i = 0; i < Dim; ++i) {
      eps(i, i) = F(i, i) - broadcast<S>(1.0);
      for (int j = i + 1; j < Dim; ++j) eps(i, j) = broadcast<S>(0.5) * (F(i, j) + F(j, i));
    }
    return eps;
  }
  template <class S>
  static Tensor<S, Dim> full(const SymTensor<S, Dim>& a) {
    Tensor<S, Dim> t;
    for (int i = 0; i < Dim; ++i)
      for (int j = 0; j < Dim; ++j) t(i, j) = a(i, j);
    return t;
  }
  template <class S>
  static S largest_stretch_bound(const Tensor<S, Dim>& F) {
    return sqrt_of<S>(largest_eigenvalue_bound(left_cauchy_green(F)));
  }
};

}  // namespace mpm
