// The plain twins of the transfer kernels: one particle at a time, Eigen, a dense grid, double precision. The production
// kernels are held equal to them by tests and measured against them by the benchmarks.
#pragma once

#include <vector>

#include "mpm_hpc/fields/body.hpp"
#include "mpm_hpc/fields/grid_geometry.hpp"
#include "mpm_hpc/math/bspline.hpp"

namespace mpm {

template <int Dim>
struct ReferenceParticle {
  Vec<Dim> x, v;
  Mat<Dim> C, F, tau;  // velocity gradient, deformation gradient, Kirchhoff stress
  Real mass = 0, volume = 0;
};

// Nodes of a box of the grid; node n has its momentum (then velocity) and mass.
template <int Dim>
struct ReferenceGrid {
  IntVec<Dim> size;
  std::vector<Vec<Dim>> momentum;
  std::vector<Real> mass;

  explicit ReferenceGrid(const GridGeometry<Dim>& geometry) : size(block_side * geometry.blocks()) {
    std::size_t count = 1;
    for (int a = 0; a < Dim; ++a) count *= static_cast<std::size_t>(size[a]);
    momentum.resize(count);
    mass.resize(count);
    clear();
  }
  void clear() {
    std::fill(momentum.begin(), momentum.end(), Vec<Dim>::Zero());
    std::fill(mass.begin(), mass.end(), 0.0);
  }
  std::size_t index(const IntVec<Dim>& node) const {
    std::size_t n = 0;
    for (int a = 0; a < Dim; ++a) n = n * static_cast<std::size_t>(size[a]) + static_cast<std::size_t>(node[a]);
    return n;
  }
};

// Calls f(node, w_ip, x_i - x_p) for each node of the particle's stencil.
template <class Kernel, int Dim, class F>
void for_each_node(const GridGeometry<Dim>& geometry, const Vec<Dim>& x, F&& f) {
  IntVec<Dim> base;
  Real w[Dim][Kernel::support];
  for (int a = 0; a < Dim; ++a) {
    const Real xi = (x[a] - geometry.origin()[a]) * geometry.inverse_spacing();
    base[a] = static_cast<std::int32_t>(std::floor(xi - Kernel::shift));
    Kernel::weights(xi - base[a], w[a]);
  }
  int count = 1;
  for (int a = 0; a < Dim; ++a) count *= Kernel::support;
  for (int n = 0; n < count; ++n) {
    IntVec<Dim> node = base;
    Real weight = 1;
    for (int a = Dim - 1, rest = n; a >= 0; --a, rest /= Kernel::support) {
      node[a] += rest % Kernel::support;
      weight *= w[a][rest % Kernel::support];
    }
    f(node, weight, Vec<Dim>(geometry.node_position(node) - x));
  }
}

template <class Kernel, int Dim>
void reference_particle_to_grid(const GridGeometry<Dim>& geometry, const std::vector<ReferenceParticle<Dim>>& particles,
                                Real dt, ReferenceGrid<Dim>& grid) {
  const Real inverse_inertia = Kernel::inverse_inertia * geometry.inverse_spacing() * geometry.inverse_spacing();
  for (const ReferenceParticle<Dim>& p : particles) {
    const Mat<Dim> A = p.mass * p.C - dt * inverse_inertia * p.volume * p.tau;
    for_each_node<Kernel>(geometry, p.x, [&](const IntVec<Dim>& node, Real weight, const Vec<Dim>& distance) {
      const std::size_t i = grid.index(node);
      grid.mass[i] += weight * p.mass;
      grid.momentum[i] += weight * (p.mass * p.v + A * distance);
    });
  }
}

// grid.momentum holds velocities here.
template <class Kernel, int Dim>
void reference_grid_to_particle(const GridGeometry<Dim>& geometry, const ReferenceGrid<Dim>& grid, Real dt,
                                std::vector<ReferenceParticle<Dim>>& particles) {
  const Real inverse_inertia = Kernel::inverse_inertia * geometry.inverse_spacing() * geometry.inverse_spacing();
  for (ReferenceParticle<Dim>& p : particles) {
    p.v.setZero();
    p.C.setZero();
    for_each_node<Kernel>(geometry, p.x, [&](const IntVec<Dim>& node, Real weight, const Vec<Dim>& distance) {
      const Vec<Dim>& v = grid.momentum[grid.index(node)];
      p.v += weight * v;
      p.C += weight * inverse_inertia * v * distance.transpose();
    });
    p.F += dt * p.C * p.F;
    p.x += dt * p.v;
  }
}

}  // namespace mpm
