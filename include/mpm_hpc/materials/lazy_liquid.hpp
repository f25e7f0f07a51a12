// The "lazy" liquid (physics.md section 3): a fixed corotated solid with mu = 0, Psi = K/2 (J - 1)^2, whose deformation is
// reset to J^(1/d) I after each step. The same pressure as linear_fluid, with J from F.
#pragma once

#include "mpm_hpc/base/parameters.hpp"
#include "mpm_hpc/math/tensor.hpp"

namespace mpm {

template <int Dim>
struct LazyLiquid {
  static constexpr const char* name = "lazy_liquid";
  static constexpr const char* doc = "fixed corotated solid without shear stiffness that forgets its shape";

  Real bulk_modulus = 0;  // K [Pa]

  void declare(Parameters& parameters) {
    parameters.real(
        "bulk_modulus", bulk_modulus,
        {.unit = "Pa", .min = 0, .min_exclusive = true, .required = true, .doc = "bulk modulus at rest"});
  }

  // J^(1/d) I, and F itself where it is inverted, so that the fault is found.
  template <class S>
  Tensor<S, Dim> relaxed(const Tensor<S, Dim>& F) const {
    const S zero = broadcast<S>(0.0), J = determinant(F);
    S root;
    if constexpr (Dim == 2) {
      root = sqrt_of<S>(J);
    } else {
      root = broadcast<S>(1.0) / inverse_cube_root<S>(J);
    }
    Tensor<S, Dim> result;
    for (int i = 0; i < Dim; ++i)
      for (int j = 0; j < Dim; ++j) result(i, j) = select_less<S>(zero, J, i == j ? root : zero, F(i, j));
    return result;
  }

  // tau = K (J - 1) J I
  template <class S>
  SymTensor<S, Dim> kirchhoff_stress(const Tensor<S, Dim>& F) const {
    const S J = determinant(F), spherical = broadcast<S>(bulk_modulus) * (J - broadcast<S>(1.0)) * J;
    SymTensor<S, Dim> tau;
    for (int i = 0; i < Dim; ++i)
      for (int j = i; j < Dim; ++j) tau(i, j) = i == j ? spherical : broadcast<S>(0.0);
    return tau;
  }
  template <class S>
  S energy_density(const Tensor<S, Dim>& F) const {
    const S change = determinant(F) - broadcast<S>(1.0);
    return broadcast<S>(0.5 * bulk_modulus) * change * change;
  }
  // A = K J (2J - 1) times the matrix of ones, whose eigenvalues are d and 0; where J < 1 sound is faster,
  // c^2 = K J^2 / rho0.
  template <class S>
  S stiffness_bound(const Tensor<S, Dim>& F) const {
    return broadcast<S>(static_cast<Real>(Dim)) * wave_modulus(F);
  }
  template <class S>
  S wave_modulus(const Tensor<S, Dim>& F) const {
    const S J = determinant(F);
    return broadcast<S>(bulk_modulus) * J * maximum<S>(J, J + J - broadcast<S>(1.0));
  }
};

}  // namespace mpm
