// A standing shear wave in a fully periodic box: its period.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

#include "mpm_hpc/time/explicit_integrator.hpp"
#include "support/mpi_test.hpp"
#include "support/scene_world.hpp"

using namespace mpm;

namespace {

constexpr Real pi = 3.14159265358979323846;

// Period of v_y = A sin(2 pi x / L) over that of the continuum, L / sqrt(mu / rho), from the time at which the amplitude first
// passes through zero.
template <int Dim>
Real period_ratio(int cells) {
  const std::string zeros = Dim == 2 ? "[0, 0]" : "[0, 0, 0]";
  const Real h = 1.0 / cells, width = 12 * h;
  const std::string upper = Dim == 2 ? fmt::format("[1, {}]", width) : fmt::format("[1, {0}, {0}]", width);
  test::SceneWorld<Dim> world(fmt::format(
      "dimension = {}\n[domain]\nlower = {}\nupper = {}\nperiodic = {}\n[grid]\nspacing = {}\n[time]\nend = "
      "1\n"
      "[material.m]\nmodel = \"neo_hookean\"\nyoungs_modulus = 260\npoisson_ratio = 0.3\ndensity = 1\n"
      "[[body]]\nmaterial = \"m\"\nshape = {{type = \"box\", lower = {}, upper = {}}}\nparticles_per_cell = "
      "{}\n"
      "velocity = {}\n",
      Dim, zeros, upper, Dim == 2 ? "[\"x\", \"y\"]" : "[\"x\", \"y\", \"z\"]", h, zeros, upper,
      Dim == 2 ? 16 : 8, Dim == 2 ? "[0, \"1e-3*sin(2*pi*x)\"]" : "[0, \"1e-3*sin(2*pi*x)\", 0]"));
  State<Dim>& state = world.state;
  ExplicitIntegrator<Dim> integrator(state, std::move(world.hooks), {});
  integrator.initialise(state);
  state.dt = 0.25 * integrator.stable_step(state);
  auto amplitude = [&] {
    Real sum = 0;
    world.for_particles([&](const Body<Dim>& body, Index p) {
      const FieldSet& f = body.particles;
      sum += f.template data<Real>(core::velocity, 1)[p] *
             std::sin(2 * pi * f.template data<Real>(core::position, 0)[p]);
    });
    return state.communicator().sum(sum);
  };
  Real before = amplitude(), now = before;
  while (now > 0) {
    before = now;
    integrator.step(state);
    now = amplitude();
  }
  // Velocities are half a step behind the places.
  const Real quarter = state.time - state.dt * now / (now - before) - state.dt / 2;
  const Real expected = 0.25 / std::sqrt(260 / (2 * 1.3));
  const Real ratio = quarter / expected;
  if (test::rank() == 0)
    std::printf("%dD, %d cells: period of the shear wave %.5f of the exact one (expected 1 within 0.005)\n",
                Dim, cells, ratio);
  return ratio;
}

TEST(PeriodicWave, HasTheRightPeriod) {
  EXPECT_NEAR(period_ratio<2>(16), 1, 0.02);
  EXPECT_NEAR(period_ratio<2>(32), 1, 0.005);
  EXPECT_NEAR(period_ratio<3>(32), 1, 0.005);
}

}  // namespace
