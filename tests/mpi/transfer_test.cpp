// Whole steps with every transfer, on all ranks together, against the plain step that each rank does for all particles:
// sorts, migration and both halo exchanges included.
#include <gtest/gtest.h>

#include <cstdio>

#include "mpm_hpc/time/explicit_integrator.hpp"
#include "support/mpi_test.hpp"
#include "support/plain_steps.hpp"

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

template <class Kernel, Scheme scheme, Forces forces, int Dim>
void check() {
  const TransferOptions options{.scheme = scheme, .forces = forces};
  const Names names{Kernel::name, options.scheme_name().c_str(), options.forces_name().c_str(), youngs_modulus<Kernel>};
  test::SceneWorld<Dim> world(scene_text<Dim>(names));
  State<Dim>& state = world.state;
  auto start = test::gather_particles(world);
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
    const auto nothing = [](const ReferenceGrid<Dim>&) {};
    test::plain_step<Kernel, TransferForm<scheme, forces>>(state.geometry(), {youngs_modulus<Kernel>, poisson_ratio}, dt,
                                                           flip_blend, plain, grid, nothing, nothing);
  }
  const auto moved = test::gather_particles(world);
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
