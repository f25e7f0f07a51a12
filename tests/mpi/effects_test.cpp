// Effects on hand-made node values and particles, distributed over the ranks: forces, work and reactions are
// closed forms that don't know how many ranks there are.
#include <gtest/gtest.h>

#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/effects/gravity/gravity.hpp"
#include "mpm_hpc/effects/grips/grip.hpp"
#include "mpm_hpc/effects/obstacles/obstacle.hpp"
#include "mpm_hpc/effects/traction/traction.hpp"
#include "support/effects_world.hpp"

using namespace mpm;

namespace {

template <class C>
class Effects : public test::EffectsWorld<C> {};

TYPED_TEST_SUITE(Effects, test::EveryCase);

TYPED_TEST(Effects, GravityGivesWeightTimesTimeAndLeavesEmptyNodesAlone) {
  IN_EFFECTS_WORLD;
  auto gravity = this->template make<Gravity<Dim>>("gravity", "acceleration = " + this->list(1, -9.81, 2));
  this->fill_bodies();
  this->distribute();
  this->set_nodes();
  const auto before = this->totals();
  const auto velocities = this->velocities();
  this->run_grid();
  const auto after = this->totals();
  const V impulse = before.mass * state.dt * this->vec(1, -9.81, 2);
  EXPECT_LT((after.momentum - before.momentum - impulse).norm(), tolerance * before.mass);
  EXPECT_NEAR(this->external_work(), this->work_since(velocities), tolerance * after.energy);
  this->for_nodes([&](const V& x, const T* values) {
    if (values[Dim] == 0) {
      EXPECT_EQ(values[0], T(0.3 - x[0] * x[0]));
    }
  });
}

// Stress holds a weight on a grip that moves: gravity works on the way alone, and what it took from the velocity on its turn
// is no matter. The mean of the velocities before and after each would be wrong by m (g dt)^2 / 2 and (J / m)^2 / 2.
TYPED_TEST(Effects, WorkIsForceTimesWayWhereForcesBalance) {
  IN_EFFECTS_WORLD;
  auto gravity = this->template make<Gravity<Dim>>("gravity", "acceleration = " + this->list(0, -10, 0));
  auto grip = this->template make<Grip<Dim>>(
      "grip", "name = \"lift\"\nvelocity = " + this->list(0, 0.25, 0) + "\nshape = {type = \"plane\", point = " +
                  this->list(0, 0.5, 0) + ", normal = " + this->list(0, -1, 0) + "}");
  this->fill_bodies();
  this->distribute();
  // Below the grip at rest after all, with the impulse of the stress in it; above it on the way with what pulls it down.
  const Real weight_impulse = 10 * state.dt;
  this->set_nodes_where([](const V&) { return true; }, this->vec(0, weight_impulse, 0), 2);
  Real lifted = 0;
  this->for_nodes([&](const V& x, T* values) {
    if (x[1] < 0.5) return;
    values[1] = T(0.25 - 3);
    ++lifted;
  });
  this->run_grid();
  const Real mass = 2 * state.communicator().sum(lifted);
  const Real by_gravity = -mass * weight_impulse * 0.25, by_grip = mass * (3 + weight_impulse) * 0.25;
  EXPECT_NEAR(this->external_work(), by_gravity + by_grip, 100 * tolerance * by_grip);
  EXPECT_NEAR(this->reaction(*grip, "lift")[1] * state.dt, mass * (3 + weight_impulse), 100 * tolerance * mass);
}

TYPED_TEST(Effects, AGripEnforcesTheChosenComponents) {
  IN_EFFECTS_WORLD;
  auto grip = this->template make<Grip<Dim>>(
      "grip", "name = \"top\"\nshape = {type = \"plane\", point = " + this->list(0, 0.75, 0) +
                  ", normal = " + this->list(0, -1, 0) + "}\nvelocity = " + this->list(0, 2, 0) +
                  "\nramp = 0.5\ndirections = [\"y\"]");
  this->fill_bodies();
  this->distribute();
  this->set_nodes();
  state.time = 0.25;  // the region's lower face is at 0.75 + 2 * 0.25^2 / (2 * 0.5) = 0.875, a plane of nodes
  const auto before = this->totals();
  const auto velocities = this->velocities();
  this->run_grid();
  Real gripped = 0;
  this->for_nodes([&](const V& x, const T* values) {
    V expected;
    for (int a = 0; a < Dim; ++a) expected[a] = T(0.3 * (a + 1) - x[a] * x[0]);
    if (x[1] >= 0.875 && values[Dim] > 0) {
      expected[1] = 2 * 0.51;  // the ramp's mean over the step from 0.25 to 0.26
      ++gripped;
    }
    EXPECT_LT((this->velocity_of(values) - expected).norm(), tolerance) << x.transpose();
  });
  EXPECT_GT(state.communicator().sum(gripped), 0);
  const auto after = this->totals();
  const V force = (after.momentum - before.momentum) / state.dt, reaction = this->reaction(*grip, "top");
  EXPECT_LT((reaction - force).norm(), 1e-11 * force.norm());
  EXPECT_EQ(reaction[0], 0);
  EXPECT_NEAR(this->external_work(), this->work_since(velocities), 1e-12 * before.energy);
}

TYPED_TEST(Effects, ReactionsAverageOverStepsAndSurviveARestart) {
  IN_EFFECTS_WORLD;
  const std::string table = "name = \"foot\"\nshape = {type = \"plane\", point = " + this->list(0, 0, 0) +
                            ", normal = " + this->list(0, 1, 0) + "}";
  auto grip = this->template make<Grip<Dim>>("grip", table);
  this->fill_bodies();
  this->distribute();
  auto stop = [&](Real speed, Real dt) {
    this->set_nodes_where([](const V& x) { return x[1] == 0; }, this->vec(speed, 0, 0), 0.5);
    state.dt = dt;
    this->run_grid();
  };
  stop(1, 0.01);
  std::map<std::string, std::vector<Real>> numbers;
  grip->save(numbers);
  state.ledger.consolidate(state.communicator());
  const std::map<std::string, Real> ledger = state.ledger.entries();

  state.ledger = Ledger();
  this->hooks = StepHooks<Dim>();
  auto restored = this->template make<Grip<Dim>>("grip", table);
  restored->restore(numbers);
  for (const auto& [name, value] : ledger) state.ledger[name] = value;
  stop(3, 0.03);
  const Real mass = this->totals().mass;
  EXPECT_NEAR(this->reaction(*restored, "foot")[0], -mass * (1 + 3) / 0.04, 1e-12 * mass * 100);
}

TYPED_TEST(Effects, TractionAddsUpToItsForce) {
  IN_EFFECTS_WORLD;
  // The layer is 1.5 cells thick: shares of an area, not a thickness, make the force exact.
  auto traction = this->template make<Traction<Dim>>(
      "traction", "shape = {type = \"plane\", point = " + this->list(0, 0.8125, 0) + ", normal = " +
                      this->list(0, -1, 0) + "}\nbodies = [\"right\"]\ntraction = " + this->list(3, 7, -2) +
                      "\narea = 0.6\nramp = 0.5");
  EXPECT_EQ(state.bodies[0].particles.find("traction_0"), no_field);
  this->fill_bodies();
  traction->initialise(state);
  this->distribute();
  auto sums = [&] {
    std::vector<Real> s(Dim + 1, 0.0);
    for (auto& body : state.bodies)
      for (Index p = 0; p < body.particles.size(); ++p)
        for (int a = 0; a < Dim; ++a) {
          const Real m = body.particles.template data<T>(core::mass)[p];
          const Real v = body.particles.template data<T>(core::velocity, a)[p];
          EXPECT_TRUE(std::isfinite(v));
          s[a] += m * v;
          s[Dim] += 0.5 * m * v * v;
        }
    state.communicator().sum(s);
    return s;
  };
  const auto before = sums();
  state.time = 0.1;
  this->run(this->hooks.before_p2g);
  const auto after = sums();
  const Real share = state.dt * (0.105 / 0.5) * 0.6;  // the ramp's mean over the step
  const V force = this->vec(3, 7, -2);
  for (int a = 0; a < Dim; ++a) EXPECT_NEAR(after[a] - before[a], share * force[a], tolerance) << a;

  // Only the layer of the named body moved, and all its particles alike.
  Real changed = 0, wrong = 0, power = 0;
  for (std::size_t b = 0; b < 2; ++b)
    for (Index p = 0; p < state.bodies[b].particles.size(); ++p) {
      const FieldSet& particles = state.bodies[b].particles;
      if (state.bodies[b].is_padding(p)) continue;
      const bool loaded = b == 1 && particles.template data<Real>(core::position, 1)[p] >= 0.8125;
      const bool moved = particles.template data<T>(core::velocity, 0)[p] != T(0.25);
      changed += moved;
      wrong += moved != loaded;
      for (int a = 0; a < Dim && loaded; ++a) power += force[a] * particles.template data<T>(core::velocity, a)[p];
    }
  EXPECT_EQ(state.communicator().sum(wrong), 0);
  const Real loaded_particles = 3 * std::pow(2 / this->h, Dim - 1) / 2;
  EXPECT_EQ(state.communicator().sum(changed), loaded_particles);

  // Work is force times the way of the particles in the step, each of which carries the same share of the force here.
  this->run(this->hooks.after_g2p);
  const Real work = share * state.communicator().sum(power) / loaded_particles;
  EXPECT_NEAR(this->external_work(), work, tolerance * std::abs(work));
}

TYPED_TEST(Effects, FaultsThatOnlyTheStateShows) {
  IN_EFFECTS_WORLD;
  const std::string shape = "shape = {type = \"sphere\", center = " + this->list(5, 5, 5) + ", radius = 1}\n";
  auto fault = [](auto&& call) -> std::string {
    try {
      call();
    } catch (const UserError& error) {
      return error.what();
    }
    return "";
  };
  const std::string load = "traction = " + this->list(0, 1, 0) + "\narea = 1\n";
  const std::string unknown =
      fault([&] { this->template make<Traction<Dim>>("traction", shape + load + "bodies = [\"lift\"]"); });
  EXPECT_TRUE(unknown.starts_with("scene.toml:5:")) << unknown;
  EXPECT_NE(unknown.find("\"lift\"; the bodies are left, right"), std::string::npos) << unknown;

  auto far = this->template make<Traction<Dim>>("traction", shape + load);
  this->template make<Grip<Dim>>("grip", shape + "name = \"a\"");
  const std::string twice =
      fault([&] { this->template make<Obstacle<Dim>>("obstacle", shape + "name = \"a\""); });
  EXPECT_TRUE(twice.starts_with("scene.toml:3:")) << twice;
  this->fill_bodies();
  far->initialise(state);
  this->distribute();
  const std::string empty = fault([&] { this->run(this->hooks.before_p2g); });
  EXPECT_TRUE(empty.starts_with("scene.toml:2:")) << empty;
  EXPECT_NE(empty.find("no particle"), std::string::npos) << empty;
}

}  // namespace
