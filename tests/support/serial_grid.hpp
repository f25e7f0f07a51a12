// One process's bodies, blocks and nodes without any other rank: what the serial tests of the transfer need.
#pragma once

#include <algorithm>
#include <Eigen/Geometry>
#include <random>

#include "mpm_hpc/fields/grid_fields.hpp"
#include "mpm_hpc/fields/particle_order.hpp"
#include "mpm_hpc/math/bspline.hpp"
#include "mpm_hpc/transfer/grid_to_particle.hpp"
#include "mpm_hpc/transfer/reference_transfer.hpp"

namespace mpm::test {

// Sorts the body and activates every block around its particles.
template <int Dim>
BlockTopology<Dim> order_and_activate(Body<Dim>& body, const GridGeometry<Dim>& geometry, Precision precision,
                                      Real shift = QuadraticKernel::shift) {
  const auto occupied = order_particles(body, geometry, shift, padding_width(precision),
                                        OrderWithinCell::stable);
  std::vector<BlockKey> active;
  for (BlockKey key : occupied)
    for (int n = 0; n < block_neighbours<Dim>; ++n) {
      IntVec<Dim> block = block_of_key<Dim>(key);
      for (int a = Dim - 1, rest = n; a >= 0; --a, rest /= 3) block[a] += rest % 3 - 1;
      active.push_back(block_key<Dim>(block));
    }
  std::sort(active.begin(), active.end());
  active.erase(std::unique(active.begin(), active.end()), active.end());
  BlockTopology<Dim> topology;
  topology.rebuild(active, {});
  for (BlockRange& range : body.ranges) range.slot = topology.find(occupied[range.slot]);
  return topology;
}

template <int Dim>
std::vector<int> all_ranges(const Body<Dim>& body) {
  std::vector<int> numbers(body.ranges.size());
  for (std::size_t i = 0; i < numbers.size(); ++i) numbers[i] = static_cast<int>(i);
  return numbers;
}

// The directions of each of the production kernels' products, as a set of bits.
template <int Dim>
inline constexpr int product_sets[4] = {3, 5, 6, 7};

template <int Dim, class T>
void write_particle(Body<Dim>& body, Index p, GlobalIndex id, const ModalParticle<Dim>& particle) {
  FieldSet& f = body.particles;
  f.data<GlobalIndex>(core::id)[p] = id;
  for (int a = 0; a < Dim; ++a) {
    f.data<Real>(core::position, a)[p] = particle.x[a];
    f.data<T>(core::velocity, a)[p] = static_cast<T>(particle.v[a]);
    for (int b = 0; b < Dim; ++b) {
      if (f.has(core::velocity_gradient))
        f.data<T>(core::velocity_gradient, a * Dim + b)[p] = static_cast<T>(particle.C(a, b));
      f.data<T>(core::deformation_gradient, a * Dim + b)[p] = static_cast<T>(particle.F(a, b));
    }
  }
  if (body.velocity_modes != no_field)
    for (int k = 0; k < product_modes<Dim>; ++k)
      for (int a = 0; a < Dim; ++a)
        f.data<T>(body.velocity_modes, k * Dim + a)[p] = static_cast<T>(particle.modes[product_sets<Dim>[k]][a]);
  f.data<T>(core::mass)[p] = static_cast<T>(particle.mass);
  f.data<T>(core::volume)[p] = static_cast<T>(particle.volume);
}

template <int Dim, class T>
ModalParticle<Dim> read_particle(const Body<Dim>& body, Index p) {
  const FieldSet& f = body.particles;
  ModalParticle<Dim> particle;
  for (int a = 0; a < Dim; ++a) {
    particle.x[a] = f.data<Real>(core::position, a)[p];
    particle.v[a] = f.data<T>(core::velocity, a)[p];
    for (int b = 0; b < Dim; ++b) {
      particle.C(a, b) =
          f.has(core::velocity_gradient) ? f.data<T>(core::velocity_gradient, a * Dim + b)[p] : Real(0);
      particle.F(a, b) = f.data<T>(core::deformation_gradient, a * Dim + b)[p];
    }
  }
  if (body.velocity_modes != no_field)
    for (int k = 0; k < product_modes<Dim>; ++k)
      for (int a = 0; a < Dim; ++a)
        particle.modes[product_sets<Dim>[k]][a] = f.data<T>(body.velocity_modes, k * Dim + a)[p];
  particle.mass = f.data<T>(core::mass)[p];
  particle.volume = f.data<T>(core::volume)[p];
  return particle;
}

// Random particles, some of them exactly on nodes and on cell faces.
template <int Dim>
std::vector<ModalParticle<Dim>> random_particles(const GridGeometry<Dim>& geometry, int count, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<Real> unit(0, 1), both(-1, 1);
  std::vector<ModalParticle<Dim>> particles(count);
  for (int n = 0; n < count; ++n) {
    ModalParticle<Dim>& p = particles[n];
    for (int a = 0; a < Dim; ++a) {
      p.x[a] = geometry.lower()[a] + unit(random) * (geometry.upper()[a] - geometry.lower()[a]);
      const Real cell = std::floor((p.x[a] - geometry.lower()[a]) / geometry.spacing());
      if (n % 5 == 1) p.x[a] = geometry.lower()[a] + cell * geometry.spacing();
      if (n % 5 == 2) p.x[a] = geometry.lower()[a] + (cell + 0.5) * geometry.spacing();
      p.v[a] = both(random);
    }
    p.C = Mat<Dim>::NullaryExpr([&] { return both(random); });
    for (Vec<Dim>& mode : p.modes) mode = Vec<Dim>::NullaryExpr([&] { return both(random); });
    p.F = Mat<Dim>::Identity() + 0.2 * Mat<Dim>::NullaryExpr([&] { return both(random); });
    p.tau = Mat<Dim>::NullaryExpr([&] { return both(random); });
    p.tau = (0.5 * (p.tau + p.tau.transpose())).eval();
    p.mass = 0.5 + unit(random);
    p.volume = 0.5 + unit(random);
  }
  return particles;
}

template <int Dim, class T>
Body<Dim> make_body(const std::vector<ModalParticle<Dim>>& particles, Precision precision,
                    Scheme scheme = Scheme::apic) {
  Body<Dim> body("test", 0, precision, {.velocity_gradient = is_affine(scheme)});
  if (scheme == Scheme::polypic)
    body.velocity_modes = body.particles.add({.name = "velocity_modes",
                                              .units = "m/s",
                                              .type = real_type(precision),
                                              .components = product_modes<Dim> * Dim});
  body.particles.resize(static_cast<Index>(particles.size()));
  for (std::size_t p = 0; p < particles.size(); ++p)
    write_particle<Dim, T>(body, static_cast<Index>(p), static_cast<GlobalIndex>(p), particles[p]);
  return body;
}

}  // namespace mpm::test
