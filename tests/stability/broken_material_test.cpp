// Broken material that is pressed together and let go, in steps at their bound.
#include <gtest/gtest.h>

#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/time/explicit_integrator.hpp"
#include "support/stepper.hpp"

using namespace mpm;
using test::Stepper;

namespace {

const std::string rubber =
    "[material.m]\nmodel = \"split_neo_hookean\"\nyoungs_modulus = 1000\npoisson_ratio = 0.3\ndensity = "
    "1000\n";

// The bound of an isolated particle alone.
constexpr StepSizeOptions isolated(Real share) {
  return {.cfl = 100, .isolated_safety = share, .max_strain = 100, .acceleration = 1e6};
}

// Springs of two stiffnesses resonate with some steps even within the bound (the shares 0.72 to 0.8 among them for g = 0.01), if
// nothing damps them and the step is always the same; the wave's bound keeps a particle alone at about half of its own.
//
// A particle alone in its cell, which breaks when it is pulled and then swings between soft expansion and stiff compression;
// its largest elastic energy at late times over that at early ones.
Real growth_of_one(Real residual, const StepSizeOptions& options) {
  Stepper<2> world(fmt::format(
      "dimension = 2\n[domain]\nlower = [0, 0]\nupper = [1, 1]\n[grid]\nspacing = 0.125\n[time]\nend = 60\n{}"
      "[[body]]\nmaterial = \"m\"\nparticles_per_cell = 1\n"
      "shape = {{type = \"box\", lower = [0.5, 0.5], upper = [0.625, 0.625]}}\n"
      "deformation_gradient = [[0.98, 0], [0, 0.98]]\n"
      "[effect.threshold_damage]\nstrength = 1e-6\nsoftening = 1.5\nresidual = {}\n",
      rubber, residual));
  world.integrator = std::make_unique<ExplicitIntegrator<2>>(world.state, world.hooks, options);
  Real early = 0, late = 0;
  world.advance(60, [&] {
    const Real t = world.state.time, energy = world.value("elastic_energy");
    if (t > 5 && t < 20) early = std::max(early, energy);
    if (t > 45) late = std::max(late, energy);
  });
  EXPECT_EQ(world.value("broken_fraction"), 1);
  return late / early;
}

TEST(BrokenMaterial, AParticleAloneIsStable) {
  for (const Real residual : {0.5, 0.3, 0.1, 0.03}) EXPECT_LT(growth_of_one(residual, {}), 1) << residual;
  // Steps past the bound must be seen to fail: it isn't loose.
  EXPECT_THROW(growth_of_one(0.3, isolated(1.1)), NumericalFailure);
}

// A closed box full of it; the largest energy at late times over that at early ones.
Real growth_of_many(const std::string& scheme) {
  Stepper<2> world(
      "dimension = 2\n[domain]\nlower = [0, 0]\nupper = [1, 1]\n[grid]\nspacing = 0.0625\n[time]\nend = "
      "20\n" +
      test::transfer_text(scheme) + rubber +
      "[[body]]\nmaterial = \"m\"\nparticles_per_cell = 4\nshape = {type = \"box\", lower = [0, 0], upper = "
      "[1, 1]}\n"
      "velocity = [\"0.2*sin(2*pi*x)*cos(pi*y)\", \"0.2*sin(pi*x)*sin(3*pi*y)\"]\n"
      "[effect.walls]\nx_min = \"slip\"\nx_max = \"slip\"\ny_min = \"slip\"\ny_max = \"slip\"\n"
      "[effect.threshold_damage]\nstrength = 1e-6\nsoftening = 1.5\nresidual = 0.001\n");
  world.integrator = std::make_unique<ExplicitIntegrator<2>>(world.state, world.hooks, isolated(0.8));
  const auto energy = [&] { return world.value("kinetic_energy") + world.value("elastic_energy"); };
  Real early = 0, late = 0;
  world.advance(20, [&] {
    Real& largest = world.state.time < 10 ? early : late;
    largest = std::max(largest, energy());
  });
  EXPECT_GT(world.value("broken_fraction"), 0.99);
  return late / early;
}

TEST(BrokenMaterial, ABoxFullIsStable) {
  for (const std::string scheme : {"apic", "flip"}) EXPECT_LT(growth_of_many(scheme), 1) << scheme;
}

}  // namespace
