// Walls, obstacles and grips on hand-made node values, distributed over the ranks: velocities, work and reactions are
// closed forms.
#include <gtest/gtest.h>

#include <optional>

#include "mpm_hpc/effects/gravity/gravity.hpp"
#include "mpm_hpc/effects/grips/grip.hpp"
#include "mpm_hpc/effects/obstacles/obstacle.hpp"
#include "mpm_hpc/effects/walls/walls.hpp"
#include "support/effects_world.hpp"

using namespace mpm;

namespace {

template <class C>
class Contacts : public test::EffectsWorld<C> {};

TYPED_TEST_SUITE(Contacts, test::EveryCase);

TYPED_TEST(Contacts, WallsActOnTheirSidesOnly) {
  IN_EFFECTS_WORLD;
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
TYPED_TEST(Contacts, WallsReflect) {
  IN_EFFECTS_WORLD;
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
TYPED_TEST(Contacts, AMirrorRubs) {
  IN_EFFECTS_WORLD;
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
TYPED_TEST(Contacts, NodesBeyondFollowAGrip) {
  IN_EFFECTS_WORLD;
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
TYPED_TEST(Contacts, ABlockSlidesToRestByFriction) {
  IN_EFFECTS_WORLD;
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

TYPED_TEST(Contacts, AStickyObstacleCarriesItsNodesAlong) {
  IN_EFFECTS_WORLD;
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
TYPED_TEST(Contacts, AMovingSlopeSlipsAndSeparates) {
  IN_EFFECTS_WORLD;
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

}  // namespace
