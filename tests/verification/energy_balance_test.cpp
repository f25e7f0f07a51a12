// The external work against the energy that it leaves: force times way, in the order of the step.
#include "support/stepper.hpp"
#include "support/verification.hpp"

using namespace mpm;
using test::Stepper;

namespace {

const std::string section = "3 elastodynamics";

// Symplectic Euler has the velocities half a step behind the places: of a fall the kinetic energy lacks sum m (g dt)^2 / 2, half
// a step times the power, and no more.
TEST(EnergyBalance, AFallIsHalfAStepBehind) {
  constexpr Real g = 10;
  Stepper<2> world(
      "dimension = 2\n[domain]\nlower = [0, 0]\nupper = [2, 2]\n[grid]\nspacing = 0.125\n[time]\nend = 0.4\n"
      "[material.m]\nmodel = \"neo_hookean\"\nyoungs_modulus = 1e4\npoisson_ratio = 0.3\ndensity = 1000\n"
      "[[body]]\nmaterial = \"m\"\nshape = {type = \"box\", lower = [0.5, 1.25], upper = [1, 1.75]}\n"
      "[effect.gravity]\nacceleration = [0, -10]\n");
  const Real mass = world.value("mass");
  Real squares = 0;
  world.advance(0.4, [&] { squares += world.state.dt * world.state.dt; });
  const Real expected = -mass * g * g * squares / 2;
  EXPECT_NEAR(world.value("energy_residual"), expected, 1e-8 * std::abs(expected));
}

// A grip pulls a bar out and stops: what it worked is stored, but for what the transfers take from the bar's swinging.
void pulled_bar(const std::string& scheme) {
  Stepper<2> world(
      "dimension = 2\n[domain]\nlower = [0, 0]\nupper = [2.5, 0.75]\n[grid]\nspacing = 0.0625\n[time]\nend = "
      "5\n" +
      test::transfer_text(scheme) +
      "[material.m]\nmodel = \"neo_hookean\"\nyoungs_modulus = 1000\npoisson_ratio = 0.3\ndensity = 10\n"
      "[[body]]\nmaterial = \"m\"\nshape = {type = \"box\", lower = [0.25, 0.25], upper = [2.25, 0.5]}\n"
      "[[effect.grip]]\nname = \"left\"\nshape = {type = \"box\", lower = [0, 0], upper = [0.4, 0.75]}\n"
      "[[effect.grip]]\nname = \"right\"\nshape = {type = \"box\", lower = [2.1, 0], upper = [2.5, 0.75]}\n"
      "velocity = [0.05, 0]\nramp = 1\nstop = 4\n");
  world.advance(5, [] {});
  test::verify(section, "bar pulled by a grip, " + scheme + ": stored energy over external work",
               (world.value("elastic_energy") + world.value("kinetic_energy")) / world.value("external_work"),
               test::within(1, 0.01));
}

TEST(EnergyBalance, WhatAGripWorksIsStoredApic) { pulled_bar("apic"); }
TEST(EnergyBalance, WhatAGripWorksIsStoredFlip) { pulled_bar("flip"); }

// A block that bounces on a floor at rest: the weight times its way is all the work there is.
TEST(EnergyBalance, AFloorAtRestDoesNoWork) {
  for (const std::string scheme : {"apic", "flip"})
    for (const std::string condition : {"separate", "slip", "sticky"}) {
      Stepper<2> world(
          "dimension = 2\n[domain]\nlower = [0, 0]\nupper = [2, 2]\n[grid]\nspacing = 0.0625\n[time]\nend = "
          "1\n" +
          test::transfer_text(scheme) +
          "[material.m]\nmodel = \"neo_hookean\"\nyoungs_modulus = 1e5\npoisson_ratio = 0.3\ndensity = 1000\n"
          "[[body]]\nmaterial = \"m\"\nshape = {type = \"box\", lower = [0.5, 0], upper = [1.5, 1]}\n"
          "[effect.gravity]\nacceleration = [0, -10]\n[effect.walls]\ny_min = \"" +
          condition + "\"\n");
      const auto height = [](const Vec<2>& x, const Vec<2>&) { return x[1]; };
      const Real start = sum_over(world, height);
      world.advance(1, [] {});
      const Real expected = 10 * (start - sum_over(world, height));
      test::verify(section, "block on a floor, " + scheme + ", " + condition + ": work over weight times way",
                   world.value("external_work") / expected, test::within(1, 1e-8));
    }
}

}  // namespace
