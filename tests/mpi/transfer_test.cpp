// Whole steps with every transfer, on all ranks together, against the plain step that each rank does for all particles:
// sorts, migration and both halo exchanges included.
#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cstdio>
#include <map>

#include "mpm_hpc/time/explicit_integrator.hpp"
#include "mpm_hpc/transfer/reference_transfer.hpp"
#include "support/all_ranks.hpp"
#include "support/mpi_test.hpp"
#include "support/scene_world.hpp"

using namespace mpm;

namespace {

constexpr Real spacing = 0.05, poisson_ratio = 0.3, dt = 0.002, flip_blend = 0.9;
constexpr int steps = 60;

// The linear kernel can't stand more: next to a node its forces have no bound.
template <class Kernel>
constexpr Real youngs_modulus = Kernel::has_inertia ? 100 : 0.1;

struct Names {
  const char *kernel, *scheme, *forces;
  Real youngs_modulus;
};

// Two bodies that meet off-centre.
template <int Dim>
std::string scene_text(const Names& names) {
  const char* side = Dim == 2 ? "" : ", 0.4";
  const char* far_side = Dim == 2 ? "" : ", 0.6";
  return fmt::format(
             "dimension = {}\nseed = 5\n[domain]\nlower = {}\nupper = {}\n[grid]\nspacing = {}\nkernel = \"{}\"\n"
             "[transfer]\nscheme = \"{}\"\nforces = \"{}\"\n{}[time]\nend = 1\n"
             "[material.soft]\nmodel = \"neo_hookean\"\nyoungs_modulus = {}\npoisson_ratio = {}\ndensity = 1\n",
             Dim, Dim == 2 ? "[0, 0]" : "[0, 0, 0]", Dim == 2 ? "[1, 1]" : "[1, 1, 1]", spacing, names.kernel,
             names.scheme, names.forces,
             std::string(names.scheme) == "flip" ? fmt::format("flip_blend = {}\n", flip_blend) : "", names.youngs_modulus,
             poisson_ratio) +
         fmt::format(
             "[[body]]\nmaterial = \"soft\"\njitter = 0.2\nshape = {{type = \"box\", lower = [0.2, 0.3{}], upper = [0.48, "
             "0.6{}]}}\nvelocity = [1.4, 0.2{}]\nangular_velocity = {}\n"
             "[[body]]\nmaterial = \"soft\"\njitter = 0.2\nshape = {{type = \"box\", lower = [0.55, 0.4{}], upper = [0.8, "
             "0.7{}]}}\nvelocity = [-1.2, -0.3{}]\n",
             side, far_side, Dim == 2 ? "" : ", 0.1", Dim == 2 ? "0.5" : "[0, 0, 0.5]", side, far_side,
             Dim == 2 ? "" : ", 0");
}

template <int Dim>
struct Record {
  GlobalIndex id;
  Real x[Dim], v[Dim], C[Dim * Dim], F[Dim * Dim], mass, volume;
};

template <int Dim>
std::map<GlobalIndex, ModalParticle<Dim>> gather(test::SceneWorld<Dim>& world) {
  std::vector<Record<Dim>> mine;
  world.for_particles([&](Body<Dim>& body, Index p) {
    const FieldSet& f = body.particles;
    Record<Dim> r{};
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
  for (const Record<Dim>& r : test::gather_all(mine)) {
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

template <class Kernel, class Form, int Dim>
void plain_step(const GridGeometry<Dim>& geometry, std::vector<ModalParticle<Dim>>& particles,
                ReferenceGrid<Dim>& grid) {
  const Real E = youngs_modulus<Kernel>, mu = E / (2 * (1 + poisson_ratio)), lambda = E * poisson_ratio / ((1 + poisson_ratio) * (1 - 2 * poisson_ratio));
  for (auto& p : particles)
    p.tau = mu * (p.F * p.F.transpose() - Mat<Dim>::Identity()) +
            lambda * std::log(p.F.determinant()) * Mat<Dim>::Identity();
  grid.clear();
  reference_form_to_grid<Kernel, Form>(geometry, particles, dt, grid);
  for (std::size_t i = 0; i < grid.mass.size(); ++i) {
    if (grid.mass[i] <= 0) continue;
    grid.momentum[i] += grid.changes[i];  // FLIP's impulse
    grid.momentum[i] /= grid.mass[i];
    grid.changes[i] /= grid.mass[i];
  }
  reference_form_to_particle<Kernel, Form>(geometry, grid, dt, particles, flip_blend);
}

template <class Kernel, Scheme scheme, Forces forces, int Dim>
void check() {
  const TransferOptions options{.scheme = scheme, .forces = forces};
  const Names names{Kernel::name, options.scheme_name().c_str(), options.forces_name().c_str(), youngs_modulus<Kernel>};
  test::SceneWorld<Dim> world(scene_text<Dim>(names));
  State<Dim>& state = world.state;
  auto start = gather(world);
  std::vector<ModalParticle<Dim>> plain;
  for (const auto& entry : start) plain.push_back(entry.second);
  ExplicitIntegrator<Dim> integrator(state, {}, {});
  integrator.initialise(state);
  ReferenceGrid<Dim> grid(state.geometry(), true);
  int sorts = 0;
  for (int step = 0; step < steps; ++step) {
    state.dt = dt;
    const Real drift = state.drift;
    integrator.step(state);
    sorts += state.drift < drift;
    plain_step<Kernel, TransferForm<scheme, forces>>(state.geometry(), plain, grid);
  }
  const auto moved = gather(world);
  ASSERT_EQ(moved.size(), plain.size());
  Real place = 0, deformation = 0, way = 0, strain = 0;
  std::size_t n = 0;
  for (const auto& [id, p] : moved) {
    place = std::max(place, (p.x - plain[n].x).norm() / spacing);
    deformation = std::max(deformation, (p.F - plain[n].F).norm());
    way = std::max(way, (p.x - start.at(id).x).norm() / spacing);
    strain = std::max(strain, (p.F - Mat<Dim>::Identity()).norm());
    ++n;
  }
  if (test::rank() == 0)
    std::printf("%dD %s %s %s: places differ by %.1e cells and F by %.1e (expected <= 1e-9) after %.1f cells, strain %.2f\n",
                Dim, names.kernel, names.scheme, names.forces, place, deformation, way, strain);
  // Rounding grows by the material's own instability, not by more.
  EXPECT_LT(place, 1e-9) << names.kernel << " " << names.scheme << " " << names.forces;
  EXPECT_LT(deformation, 1e-9) << names.kernel << " " << names.scheme << " " << names.forces;
  EXPECT_GE(sorts, 2);
  EXPECT_GT(strain, 0.05);
}

template <class Kernel, Forces forces, Scheme... schemes>
void check_both() {
  (check<Kernel, schemes, forces, 2>(), ...);
  (check<Kernel, schemes, forces, 3>(), ...);
}

TEST(Transfers, LinearKernel) {
  check_both<LinearKernel, Forces::classical, Scheme::pic, Scheme::rpic, Scheme::flip, Scheme::apic>();
}
TEST(Transfers, QuadraticKernelWithMls) {
  check_both<QuadraticKernel, Forces::mls, Scheme::pic, Scheme::rpic, Scheme::flip, Scheme::apic, Scheme::polypic>();
}
TEST(Transfers, QuadraticKernelWithGradients) {
  check_both<QuadraticKernel, Forces::classical, Scheme::pic, Scheme::rpic, Scheme::flip, Scheme::apic,
             Scheme::polypic>();
}
TEST(Transfers, CubicKernelWithMls) {
  check_both<CubicKernel, Forces::mls, Scheme::pic, Scheme::rpic, Scheme::flip, Scheme::apic, Scheme::polypic>();
}
TEST(Transfers, CubicKernelWithGradients) {
  check_both<CubicKernel, Forces::classical, Scheme::pic, Scheme::rpic, Scheme::flip, Scheme::apic, Scheme::polypic>();
}

}  // namespace
