// The particles of a world of a scene on every rank, and the plain step that moves them all, for comparison.
#pragma once

#include <Eigen/LU>
#include <map>

#include "mpm_hpc/transfer/reference_transfer.hpp"
#include "support/all_ranks.hpp"
#include "support/scene_world.hpp"

namespace mpm::test {

template <int Dim>
struct GatheredParticle {
  GlobalIndex id;
  Real x[Dim], v[Dim], C[Dim * Dim], F[Dim * Dim], mass, volume;
};

// By identity.
template <int Dim>
std::map<GlobalIndex, ModalParticle<Dim>> gather_particles(SceneWorld<Dim>& world) {
  std::vector<GatheredParticle<Dim>> mine;
  world.for_particles([&](Body<Dim>& body, Index p) {
    const FieldSet& f = body.particles;
    GatheredParticle<Dim> r{};
    r.id = f.template data<GlobalIndex>(core::id)[p];
    for (int a = 0; a < Dim; ++a) {
      r.x[a] = f.template data<Real>(core::position, a)[p];
      r.v[a] = f.template data<Real>(core::velocity, a)[p];
    }
    for (int c = 0; c < Dim * Dim; ++c) {
      if (f.has(core::velocity_gradient)) r.C[c] = f.template data<Real>(core::velocity_gradient, c)[p];
      r.F[c] = f.template data<Real>(core::deformation_gradient, c)[p];
    }
    r.mass = f.template data<Real>(core::mass)[p];
    r.volume = f.template data<Real>(core::volume)[p];
    mine.push_back(r);
  });
  std::map<GlobalIndex, ModalParticle<Dim>> all;
  for (const GatheredParticle<Dim>& r : gather_all(mine)) {
    using RowMajor = Eigen::Matrix<Real, Dim, Dim, Eigen::RowMajor>;
    ModalParticle<Dim> p;
    p.x = Eigen::Map<const Vec<Dim>>(r.x);
    p.v = Eigen::Map<const Vec<Dim>>(r.v);
    p.C = Eigen::Map<const RowMajor>(r.C);
    p.F = Eigen::Map<const RowMajor>(r.F);
    p.mass = r.mass;
    p.volume = r.volume;
    all.emplace(r.id, p);
  }
  return all;
}

// The particles of a neo-Hookean material, whose stress has no other columns.
struct PlainMaterial {
  Real youngs_modulus, poisson_ratio;
};

// on_grid(grid) sees mass and momentum of the nodes, with FLIP before the impulse of the forces, which is in `changes`;
// at_end(grid) sees their velocities, and with FLIP the changes.
template <class Kernel, class Form, int Dim, class OnGrid, class AtEnd>
void plain_step(const GridGeometry<Dim>& geometry, const PlainMaterial& material, Real dt, Real flip_blend,
                std::vector<ModalParticle<Dim>>& particles, ReferenceGrid<Dim>& grid, OnGrid&& on_grid,
                AtEnd&& at_end) {
  const Real nu = material.poisson_ratio, mu = material.youngs_modulus / (2 * (1 + nu)),
             lambda = 2 * mu * nu / (1 - 2 * nu);
  for (auto& p : particles)
    p.tau = mu * (p.F * p.F.transpose() - Mat<Dim>::Identity()) +
            lambda * std::log(p.F.determinant()) * Mat<Dim>::Identity();
  grid.clear();
  reference_form_to_grid<Kernel, Form>(geometry, particles, dt, grid);
  on_grid(grid);
  for (std::size_t i = 0; i < grid.mass.size(); ++i) {
    if (grid.mass[i] <= 0) continue;
    grid.momentum[i] += grid.changes[i];
    grid.momentum[i] /= grid.mass[i];
    grid.changes[i] /= grid.mass[i];
  }
  at_end(grid);
  reference_form_to_particle<Kernel, Form>(geometry, grid, dt, particles, flip_blend);
}

}  // namespace mpm::test
