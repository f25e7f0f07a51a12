// Effects on hand-made node values and particles, distributed over the ranks: forces, work and reactions are
// closed forms that don't know how many ranks there are.
#include <gtest/gtest.h>

#include <optional>

#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/effects/gravity/gravity.hpp"
#include "mpm_hpc/effects/grips/grip.hpp"
#include "mpm_hpc/effects/obstacles/obstacle.hpp"
#include "mpm_hpc/effects/traction/traction.hpp"
#include "mpm_hpc/effects/walls/walls.hpp"
#include "support/effects_world.hpp"

using namespace mpm;

namespace {

template <class C>
class Effects : public test::EffectsWorld<C> {};

using Cases =
    testing::Types<test::Case<2, double>, test::Case<2, float>, test::Case<3, double>, test::Case<3, float>>;
TYPED_TEST_SUITE(Effects, Cases);

#define USE_FIXTURE                                   \
  constexpr int Dim = TestFixture::Dim;               \
  using T [[maybe_unused]] = typename TestFixture::T; \
  using V [[maybe_unused]] = Vec<Dim>;                \
  [[maybe_unused]] auto& state = this->state;         \
  [[maybe_unused]] const Real tolerance = this->tolerance

TYPED_TEST(Effects, GravityGivesWeightTimesTimeAndLeavesEmptyNodesAlone) {
  USE_FIXTURE;
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
  USE_FIXTURE;
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

TYPED_TEST(Effects, WallsActOnTheirSidesOnly) {
  USE_FIXTURE;
  auto walls = this->template make<Walls<Dim>>(
      "walls",
      "x_min = \"sticky\"\nx_max = \"slip\"\ny_min = \"separate\"\ny_max = \"separate\"\nfriction = 0.4");
  this->fill_bodies();
  this->distribute();
  // Downwards with 0.5 at a speed of 1 along x: the floor takes 0.5 and friction 0.2, the ceiling lets go; in
  // the upper half x_max takes what points outwards, and friction 0.4 of it from the rest, after which y_max
  // has nothing to do.
  const V v = this->vec(1, -0.5, 0);
  this->set_nodes_where([&](const V& x) { return state.geometry().contains(x); }, v, 2);
  const auto before = this->totals();
  const auto velocities = this->velocities();
  this->run_grid();
  std::vector<Real> seen(4, 0.0);
  this->for_nodes([&](const V& x, const T* values) {
    if (values[Dim] == 0) return;
    V expected = v;
    int kind = 3;
    if (x[0] <= 0) {
      expected.setZero();
      kind = 0;
    } else if (x[0] >= 1) {
      expected = this->vec(0, -0.1, 0);
      if (x[1] <= 0) expected.setZero();
      kind = 1;
    } else if (x[1] <= 0) {
      expected = this->vec(0.8, 0, 0);
      kind = 2;
    }
    ++seen[kind];
    EXPECT_LT((this->velocity_of(values) - expected).norm(), 1e-6) << x.transpose();
  });
  state.communicator().sum(seen);
  for (const Real count : seen) EXPECT_GT(count, 0);
  const auto after = this->totals();
  const V force = (after.momentum - before.momentum) / state.dt;
  EXPECT_LT((this->reaction(*walls, "walls") - force).norm(), 1e-13 * force.norm());
  EXPECT_NEAR(this->external_work(), this->work_since(velocities), 1e-13 * before.energy);
}

// Nodes with mass on both sides: a node and its images get the common velocity, turned about each side, that keeps the
// momentum of this motion.
TYPED_TEST(Effects, WallsReflect) {
  USE_FIXTURE;
  auto walls = this->template make<Walls<Dim>>(
      "walls", "x_min = \"slip\"\nx_max = \"sticky\"\ny_min = \"slip\"\ny_max = \"slip\"");
  this->fill_bodies();
  this->distribute();
  auto start = [](const V& x) {
    V v;
    for (int a = 0; a < Dim; ++a) v[a] = T(0.3 * (a + 1) - x[a] * x[0] + 0.1 * x[1]);
    return v;
  };
  auto mass = [](const V& x) { return 1 + x.squaredNorm() + x[0]; };
  this->for_nodes([&](const V& x, T* values) {
    for (int a = 0; a < Dim; ++a) values[a] = T(start(x)[a]);
    values[Dim] = T(mass(x));
  });
  const auto before = this->totals();
  const auto velocities = this->velocities();
  this->run_grid();
  Real checked = 0;
  this->for_nodes([&](const V& x, const T* values) {
    const Real reach = 1.25 * this->h;  // nodes farther outside have no images
    if (std::min(x[0], x[1]) < -reach || std::max(x[0], x[1]) > 1 + reach) return;
    // 2 times the place of the side next to the node in x and y, if there is one.
    std::optional<Real> twice[2];
    for (int a = 0; a < 2; ++a)
      for (const Real side : {0.0, 1.0})
        if (std::abs(x[a] - side) < reach) twice[a] = 2 * side;
    V momentum = V::Zero();
    Real sum = 0;
    for (int turns = 0; turns < 4; ++turns) {
      if (((turns & 1) && !twice[0]) || ((turns & 2) && !twice[1])) continue;
      V image = x, R = V::Ones();
      for (int a = 0; a < 2; ++a) {
        if (!(turns >> a & 1)) continue;
        image[a] = *twice[a] - x[a];
        if (a == 0 && *twice[a] == 2) {
          R = -R;
        } else {
          R[a] = -R[a];
        }
      }
      momentum += mass(image) * R.cwiseProduct(start(image));
      sum += mass(image);
    }
    ++checked;
    EXPECT_LT((this->velocity_of(values) - momentum / sum).norm(), 10 * tolerance) << x.transpose();
  });
  EXPECT_GT(state.communicator().sum(checked), 0);
  const auto after = this->totals();
  const V force = (after.momentum - before.momentum) / state.dt;
  EXPECT_LT((this->reaction(*walls, "walls") - force).norm(), 1e-12 * force.norm());
  EXPECT_NEAR(this->external_work(), this->work_since(velocities), 1e-12 * before.energy);
  // What moves like its images already gets nothing.
  this->run_grid();
  EXPECT_LT(this->reaction(*walls, "walls").norm(), 100 * tolerance * force.norm());
}

// Friction takes from the momentum along the wall what it may by the impulse across, and no more than there is.
TYPED_TEST(Effects, AMirrorRubs) {
  USE_FIXTURE;
  auto walls = this->template make<Walls<Dim>>("walls", "y_min = \"slip\"\nfriction = 0.25");
  this->fill_bodies();
  this->distribute();
  const Real h = this->h;
  for (const Real along : {1.0, 0.05}) {
    this->set_nodes_where([&](const V& x) { return std::abs(x[1]) < 1.5 * h; }, this->vec(0.6 * along, -0.4, 0.8 * along),
                          2);
    const Real speed = Dim == 2 ? 0.6 * along : along;
    const auto before = this->totals();
    this->run_grid();
    const auto after = this->totals();
    // The three layers of nodes at the wall lose all of their momentum across; friction acts on each by its own part.
    const V lost = before.momentum - after.momentum;
    EXPECT_NEAR(lost[1], -0.4 * before.mass, this->tolerance * before.mass);
    V tangential = lost;
    tangential[1] = 0;
    EXPECT_NEAR(tangential.norm(), std::min(0.25 * 0.4, speed) * before.mass, 10 * this->tolerance * before.mass);
  }
}

// A grip that ends at a wall takes the nodes beyond along.
TYPED_TEST(Effects, NodesBeyondFollowAGrip) {
  USE_FIXTURE;
  auto walls = this->template make<Walls<Dim>>("walls", "y_min = \"slip\"");
  auto grip = this->template make<Grip<Dim>>("grip", "name = \"foot\"\nshape = {type = \"box\", lower = " +
                                                         this->list(-1, 0, -1) + ", upper = " + this->list(2, 0.2, 2) +
                                                         "}\ndirections = [\"x\"]\nvelocity = " +
                                                         this->list(0.5, 0, 0));
  this->fill_bodies();
  this->distribute();
  this->set_nodes_where([&](const V& x) { return std::abs(x[1]) < 1.5 * this->h; }, this->vec(1, -0.4, 2), 2);
  const auto before = this->totals();
  const auto velocities = this->velocities();
  this->run_grid();
  EXPECT_NEAR(this->external_work(), this->work_since(velocities), 1e-12 * before.energy);
  this->for_nodes([&](const V& x, const T* values) {
    if (values[Dim] == 0) return;
    EXPECT_LT((this->velocity_of(values) - this->vec(0.5, 0, 2)).norm(), tolerance) << x.transpose();
  });
  const V given = (this->totals().momentum - before.momentum) / state.dt;
  const V told = this->reaction(*walls, "walls") + this->reaction(*grip, "foot");
  EXPECT_LT((given - told).norm(), 1e-12 * given.norm());
}

// A block on a floor under gravity decelerates with mu g until it rests; the floor carries its weight.
TYPED_TEST(Effects, ABlockSlidesToRestByFriction) {
  USE_FIXTURE;
  auto gravity = this->template make<Gravity<Dim>>("gravity", "acceleration = " + this->list(0, -10, 0));
  auto walls = this->template make<Walls<Dim>>("walls", "y_min = \"separate\"\nfriction = 0.25");
  this->fill_bodies();
  this->distribute();
  const V start = this->vec(0.6, 0, 0.8) / (Dim == 2 ? 0.6 : 1);
  this->set_nodes_where([](const V& x) { return x[1] == 0; }, start, 0.5);
  const auto before = this->totals();
  const V unit = start.normalized();
  for (int step = 1; step <= 20; ++step) {
    this->run_grid();
    if (step == 10) {  // 1 - mu g t = 1 - 2.5 * 0.1
      EXPECT_LT((this->totals().momentum - before.mass * 0.75 * unit).norm(), tolerance * before.mass);
    }
  }
  const V weight = this->vec(0, 10 * before.mass, 0);
  EXPECT_LT((this->reaction(*walls, "walls") - weight + 2.5 * before.mass * unit).norm(),
            tolerance * weight.norm());
  EXPECT_EQ(this->reaction(*walls, "walls"), V::Zero());  // no step since the last row
  for (int step = 1; step <= 20; ++step) {
    this->run_grid();
    if (step == 5) this->reaction(*walls, "walls");
  }
  // Speed 0.5 is gone after 20 more steps; a row that starts after 5 of them averages over the other 15.
  EXPECT_LT(this->totals().momentum.norm(), 10 * tolerance * before.mass);
  EXPECT_LT((this->reaction(*walls, "walls") - weight + 2.5 * before.mass * unit).norm(),
            10 * tolerance * weight.norm());
  this->run_grid();
  EXPECT_LT((this->reaction(*walls, "walls") - weight).norm(), 1e4 * tolerance * weight.norm());
  // Friction m mu g along the way sum dt v0 (1 - n/N) of the N = 40 steps until it rests.
  EXPECT_NEAR(this->external_work(), -(1 - 1.0 / 40) * before.energy, 10 * tolerance * before.energy);
}

TYPED_TEST(Effects, AStickyObstacleCarriesItsNodesAlong) {
  USE_FIXTURE;
  const std::string spin = Dim == 2 ? "angular_velocity = 3\n" : "angular_velocity = [0, 0, 3]\n";
  auto obstacle = this->template make<Obstacle<Dim>>(
      "obstacle", "shape = {type = \"box\", lower = " + this->list(0.2, 0.4, 0.4) +
                      ", upper = " + this->list(0.4, 0.6, 0.6) + "}\nvelocity = " + this->list(1, 0, 0) +
                      "\n" + spin + "ramp = 0.2");
  this->fill_bodies();
  this->distribute();
  this->set_nodes();
  state.time = 0.4;  // progress 0.3: the centre moved from 0.3 to 0.6 and the box turned by 0.9
  int inside = 0;
  this->for_nodes([&](const V& x, T* values) {
    const Real rx = x[0] - 0.6, ry = x[1] - 0.5, c = std::cos(0.9), s = std::sin(0.9);
    const bool in = std::abs(c * rx + s * ry) <= 0.1 && std::abs(c * ry - s * rx) <= 0.1 &&
                    (Dim == 2 || std::abs(x[Dim - 1] - 0.5) <= 0.1);
    if (in && values[Dim] > 0) {
      ++inside;
      values[Dim] = 7;  // marks it: the others have less than 5
    }
  });
  const auto marked = this->totals();
  const auto velocities = this->velocities();
  this->run_grid();
  Real worst = 0;
  this->for_nodes([&](const V& x, const T* values) {
    V expected;
    for (int a = 0; a < Dim; ++a) expected[a] = T(0.3 * (a + 1) - x[a] * x[0]);
    if (values[Dim] == 7) expected = this->vec(1 - 3 * (x[1] - 0.5), 3 * (x[0] - 0.6), 0);
    worst = std::max(worst, (this->velocity_of(values) - expected).norm());
  });
  EXPECT_LT(state.communicator().max(worst), tolerance);
  EXPECT_GT(state.communicator().sum(GlobalIndex{inside}), 0);
  const auto after = this->totals();
  const V force = (after.momentum - marked.momentum) / state.dt;
  EXPECT_LT((this->reaction(*obstacle, "obstacle_0") - force).norm(), 1e-11 * force.norm());
  EXPECT_NEAR(this->external_work(), this->work_since(velocities), 1e-12 * marked.energy);
}

// On a plane that slides and turns, the velocity relative to it loses what points along its present normal.
TYPED_TEST(Effects, AMovingSlopeSlipsAndSeparates) {
  USE_FIXTURE;
  const std::string turning = Dim == 2 ? "angular_velocity = 2" : "angular_velocity = [0, 0, 2]";
  const std::string middle = this->list(0.5, 0.5, 0.5);
  auto slope = this->template make<Obstacle<Dim>>(
      "obstacle", "name = \"slope\"\ncondition = \"separate\"\nfriction = 0.5\ncenter = " + middle +
                      "\nshape = {type = \"plane\", point = " + middle + ", normal = " + this->list(1, 0, 0) +
                      "}\nvelocity = " + this->list(0.5, 0, 0) + "\n" + turning);
  this->fill_bodies();
  this->distribute();
  state.time = 0.25;
  const Real angle = 0.5;
  const V normal = this->vec(std::cos(angle), std::sin(angle), 0);
  const V along = this->vec(-normal[1], normal[0], 0);
  const V center = this->vec(0.625, 0.5, 0.5);
  auto surface = [&](const V& x) -> V { return this->vec(0.5 - 2 * (x[1] - 0.5), 2 * (x[0] - 0.625), 0); };
  // Against the plane: 1 is taken along the normal and 0.5 along it by friction; away from it: nothing.
  for (const Real approach : {-1.0, 1.0}) {
    this->for_nodes([&](const V& x, T* values) {
      const V v = surface(x) + 2 * along + approach * normal;
      for (int a = 0; a < Dim; ++a) values[a] = T(v[a]);
      values[Dim] = T(1.5);
    });
    this->run_grid();
    this->for_nodes([&](const V& x, const T* values) {
      const bool stopped = approach < 0 && normal.dot(x - center) <= 1e-9;
      const V relative = stopped ? V(1.5 * along) : V(2 * along + approach * normal);
      EXPECT_LT((this->velocity_of(values) - surface(x) - relative).norm(), tolerance) << x.transpose();
    });
  }
}

TYPED_TEST(Effects, AGripEnforcesTheChosenComponents) {
  USE_FIXTURE;
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
  USE_FIXTURE;
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
  USE_FIXTURE;
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
  USE_FIXTURE;
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
