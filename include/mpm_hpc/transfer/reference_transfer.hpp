// The plain twins of the transfer kernels: one particle at a time, Eigen, a dense grid, double precision. The production
// kernels are held equal to them by tests and measured against them by the benchmarks.
#pragma once

#include <vector>

#include "mpm_hpc/fields/body.hpp"
#include "mpm_hpc/fields/grid_geometry.hpp"
#include "mpm_hpc/transfer/transfer_form.hpp"

namespace mpm {

template <int Dim>
struct ReferenceParticle {
  Vec<Dim> x, v;
  Mat<Dim> C, F, tau;  // velocity gradient, deformation gradient, Kirchhoff stress
  Real mass = 0, volume = 0;
};

// For PolyPIC: v of the mode prod_{a in set} (x_i - x_p)_a / h for each set of two or more directions (bit a: direction a).
// Apart, so that the plain step that benchmarks measure against carries what it needs and no more.
template <int Dim>
struct ModalParticle : ReferenceParticle<Dim> {
  Vec<Dim> modes[1 << Dim];

  ModalParticle() {
    for (Vec<Dim>& mode : modes) mode.setZero();
  }
};

// Nodes of a box of the grid; node n has its momentum (then velocity) and mass.
template <int Dim>
struct ReferenceGrid {
  IntVec<Dim> size;
  std::vector<Vec<Dim>> momentum;
  std::vector<Real> mass;
  std::vector<Vec<Dim>> changes;  // only with_changes; FLIP: the forces' impulse, then the change of the velocity

  explicit ReferenceGrid(const GridGeometry<Dim>& geometry, bool with_changes = false) : size(block_side * geometry.blocks()) {
    std::size_t count = 1;
    for (int a = 0; a < Dim; ++a) count *= static_cast<std::size_t>(size[a]);
    momentum.resize(count);
    mass.resize(count);
    if (with_changes) changes.resize(count);
    clear();
  }
  void clear() {
    std::fill(momentum.begin(), momentum.end(), Vec<Dim>::Zero());
    std::fill(mass.begin(), mass.end(), 0.0);
    std::fill(changes.begin(), changes.end(), Vec<Dim>::Zero());
  }
  std::size_t index(const IntVec<Dim>& node) const {
    std::size_t n = 0;
    for (int a = 0; a < Dim; ++a) n = n * static_cast<std::size_t>(size[a]) + static_cast<std::size_t>(node[a]);
    return n;
  }
};

// Calls f(node, w_ip, x_i - x_p, grad w_ip) for each node of the particle's stencil.
template <class Kernel, int Dim, class F>
void for_each_node_with_gradient(const GridGeometry<Dim>& geometry, const Vec<Dim>& x, F&& f) {
  IntVec<Dim> base;
  Real w[Dim][Kernel::support], g[Dim][Kernel::support];
  for (int a = 0; a < Dim; ++a) {
    const Real xi = (x[a] - geometry.origin()[a]) * geometry.inverse_spacing();
    base[a] = static_cast<std::int32_t>(std::floor(xi - Kernel::shift));
    Kernel::weights(xi - base[a], w[a]);
    Kernel::gradients(xi - base[a], g[a]);
  }
  int count = 1;
  for (int a = 0; a < Dim; ++a) count *= Kernel::support;
  for (int n = 0; n < count; ++n) {
    IntVec<Dim> node = base, place;
    for (int a = Dim - 1, rest = n; a >= 0; --a, rest /= Kernel::support) place[a] = rest % Kernel::support;
    node += place;
    Real weight = 1;
    Vec<Dim> gradient = Vec<Dim>::Constant(geometry.inverse_spacing());
    for (int a = 0; a < Dim; ++a) {
      weight *= w[a][place[a]];
      for (int b = 0; b < Dim; ++b) gradient[b] *= a == b ? g[a][place[a]] : w[a][place[a]];
    }
    f(node, weight, Vec<Dim>(geometry.node_position(node) - x), gradient);
  }
}

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

namespace reference {

// D_p^-1, or nothing that is used for the linear kernel.
template <class Kernel, int Dim>
Real inverse_inertia(const GridGeometry<Dim>& geometry) {
  if constexpr (Kernel::has_inertia) return Kernel::inverse_inertia * geometry.inverse_spacing() * geometry.inverse_spacing();
  return 0;
}

// prod_{a in set} z_a
template <int Dim>
Real product(const Vec<Dim>& z, int set) {
  Real result = 1;
  for (int a = 0; a < Dim; ++a)
    if (set >> a & 1) result *= z[a];
  return result;
}
inline int directions(int set) { return __builtin_popcount(static_cast<unsigned>(set)); }

}  // namespace reference

// APIC and MLS forces: what the benchmarks measure against.
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

// Any form.
template <class Kernel, class Form, int Dim>
void reference_form_to_grid(const GridGeometry<Dim>& geometry, const std::vector<ModalParticle<Dim>>& particles,
                            Real dt, ReferenceGrid<Dim>& grid) {
  const Real inverse_inertia = reference::inverse_inertia<Kernel>(geometry);
  for (const ModalParticle<Dim>& p : particles) {
    Mat<Dim> C = Mat<Dim>::Zero();
    if (Form::affine) C = p.C;
    if (Form::scheme == Scheme::rpic) C = 0.5 * (p.C - p.C.transpose());
    for_each_node_with_gradient<Kernel>(
        geometry, p.x,
        [&](const IntVec<Dim>& node, Real weight, const Vec<Dim>& distance, const Vec<Dim>& gradient) {
          const std::size_t i = grid.index(node);
          Vec<Dim> v = p.v + C * distance;
          if (Form::modes)
            for (int set = 0; set < 1 << Dim; ++set)
              if (reference::directions(set) > 1)
                v += reference::product<Dim>(distance * geometry.inverse_spacing(), set) * p.modes[set];
          const Vec<Dim> impulse =
              -dt * p.volume * p.tau * (Form::mls ? Vec<Dim>(inverse_inertia * weight * distance) : gradient);
          grid.mass[i] += weight * p.mass;
          grid.momentum[i] += weight * p.mass * v;
          (Form::increments ? grid.changes : grid.momentum)[i] += impulse;
        });
  }
}

// grid.momentum holds velocities here, and grid.changes their changes.
template <class Kernel, class Form, int Dim>
void reference_form_to_particle(const GridGeometry<Dim>& geometry, const ReferenceGrid<Dim>& grid, Real dt,
                                std::vector<ModalParticle<Dim>>& particles, Real flip_blend = 0) {
  const Real inverse_inertia = reference::inverse_inertia<Kernel>(geometry);
  for (ModalParticle<Dim>& p : particles) {
    Vec<Dim> v = Vec<Dim>::Zero(), change = v;
    Mat<Dim> least_squares = Mat<Dim>::Zero(), classical = least_squares;
    for (Vec<Dim>& mode : p.modes) mode.setZero();
    for_each_node_with_gradient<Kernel>(
        geometry, p.x,
        [&](const IntVec<Dim>& node, Real weight, const Vec<Dim>& distance, const Vec<Dim>& gradient) {
          const Vec<Dim>& at_node = grid.momentum[grid.index(node)];
          v += weight * at_node;
          if (Form::increments) change += weight * grid.changes[grid.index(node)];
          least_squares += weight * inverse_inertia * at_node * distance.transpose();
          classical += at_node * gradient.transpose();
          for (int set = 0; Form::modes && set < 1 << Dim; ++set) {
            const Vec<Dim> z = distance * geometry.inverse_spacing();
            const Real moments = std::pow(inverse_inertia * geometry.spacing() * geometry.spacing(),
                                          reference::directions(set));
            p.modes[set] += weight * moments * reference::product<Dim>(z, set) * at_node;
          }
        });
    p.v = Form::increments ? Vec<Dim>(flip_blend * (p.v + change) + (1 - flip_blend) * v) : v;
    p.C = Kernel::has_inertia && (Form::mls || Form::affine) ? least_squares : classical;
    p.F += dt * (Form::mls ? least_squares : classical) * p.F;
    p.x += dt * v;
  }
}

}  // namespace mpm
