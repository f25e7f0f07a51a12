// A standing shear wave in a fully periodic box: its period.
#include <cmath>

#include "mpm_hpc/time/explicit_integrator.hpp"
#include "support/scene_world.hpp"
#include "support/verification.hpp"

using namespace mpm;

namespace {

constexpr Real pi = 3.14159265358979323846;

// v_y = A sin(2 pi x / L) against the continuum, whose period is L / sqrt(mu / rho), by the time at which the amplitude first
// passes through zero.
template <int Dim>
void shear_wave(int cells, Real tolerance) {
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
  test::verify("3 elastodynamics",
               fmt::format("shear wave in a periodic box, {}D, {} cells: quarter of its period", Dim, cells),
               quarter, test::within(expected, tolerance), "s");
}

TEST(PeriodicWave, HasTheRightPeriod) {
  shear_wave<2>(16, 0.02);
  shear_wave<2>(32, 0.005);
  shear_wave<3>(32, 0.005);
}

}  // namespace
