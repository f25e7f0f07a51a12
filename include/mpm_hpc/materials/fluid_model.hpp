// A fluid as the loops see it: J - 1 in a column of its own, no deformation gradient.
#pragma once

#include "mpm_hpc/materials/material.hpp"
#include "mpm_hpc/materials/material_update.hpp"

namespace mpm {

template <class Law, int Dim>
struct FluidModel {
  Law law;

  static constexpr bool has_deformation_gradient = false;
  template <class T>
  using AdvanceScalar = T;

  template <class S>
  struct Point {
    S volume_change;  // J - 1
    Tensor<S, Dim> velocity_gradient;
  };

  std::vector<OwnColumn> own_columns() const { return {{"volume_change", "1"}}; }
  std::vector<const char*> guards() const { return {}; }

  template <class S, class T>
  Point<S> load_point(const MaterialColumns<Dim, T>& columns, Index p) const {
    Point<S> point{load<S>(columns.own[0] + p), {}};
    if (law.viscosity > 0 && columns.velocity_gradient[0])
      point.velocity_gradient = load_tensor<S, Dim>(columns.velocity_gradient, p);
    return point;
  }

  template <class S>
  S jacobian(const Point<S>& point) const {
    return broadcast<S>(1.0) + point.volume_change;
  }

  // tau = -p J I + J eta (grad v + grad v^T)
  template <class S>
  SymTensor<S, Dim> stress(const Point<S>& point) const {
    const S spherical = law.spherical_stress(point.volume_change);
    SymTensor<S, Dim> tau;
    for (int c = 0; c < tau.size; ++c) tau.m[c] = broadcast<S>(0.0);
    if (law.viscosity > 0) {
      const S factor = broadcast<S>(law.viscosity) * jacobian(point);
      const Tensor<S, Dim>& G = point.velocity_gradient;
      for (int i = 0; i < Dim; ++i)
        for (int j = i; j < Dim; ++j) tau(i, j) = factor * (G(i, j) + G(j, i));
    }
    for (int i = 0; i < Dim; ++i) tau(i, i) += spherical;
    return tau;
  }

  template <class S>
  S energy(const Point<S>& point) const {
    return law.energy_density(point.volume_change);
  }
  // A is the wave modulus times the matrix of ones, whose eigenvalues are d and 0.
  template <class S>
  S stiffness_bound(const Point<S>& point) const {
    return broadcast<S>(static_cast<Real>(Dim)) * law.wave_modulus(point.volume_change);
  }
  template <class S>
  S wave_modulus(const Point<S>& point) const {
    return law.wave_modulus(point.volume_change);
  }
  Real viscosity() const { return law.viscosity; }

  // J <- J (1 + dt tr grad v) (physics.md section 3), never from det F, which loses J in shear.
  template <class S, class T, class Tally>
  Point<S> advance(const MaterialColumns<Dim, T>& columns, const T* const* gradient,
                   const DeformationStep& step, Index p, Index begin, Tally&) const {
    S trace = load<S>(gradient[0] + (p - begin));
    for (int i = 1; i < Dim; ++i) trace += load<S>(gradient[i * (Dim + 1)] + (p - begin));
    const S growth = volume_growth<S>(step.update, broadcast<S>(step.dt) * trace);
    const S old = load<S>(columns.own[0] + p), updated = old + (broadcast<S>(1.0) + old) * growth;
    store(columns.own[0] + p, updated);
    return {updated, {}};
  }
};

}  // namespace mpm
