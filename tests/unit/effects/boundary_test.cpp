// Contact conditions, ramps and rigid motions against closed forms, and the messages for wrong scenes.
#include <gtest/gtest.h>

#include <numbers>

#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/effects/boundary/contact.hpp"
#include "mpm_hpc/effects/boundary/rigid_motion.hpp"
#include "mpm_hpc/effects/gravity/gravity.hpp"
#include "mpm_hpc/effects/grips/grip.hpp"
#include "mpm_hpc/effects/obstacles/obstacle.hpp"
#include "mpm_hpc/effects/traction/traction.hpp"
#include "mpm_hpc/effects/walls/walls.hpp"

using namespace mpm;

namespace {

const Vec<2> up(0, 1);

TEST(Contact, StickyStopsEverything) {
  const Contact contact{ContactCondition::sticky};
  EXPECT_EQ(contact.apply<2>(up, Vec<2>(3, 4)), Vec<2>::Zero());
}

TEST(Contact, SlipRemovesTheNormalPartEitherWay) {
  const Contact contact{ContactCondition::slip};
  EXPECT_EQ(contact.apply<2>(up, Vec<2>(3, -4)), Vec<2>(3, 0));
  EXPECT_EQ(contact.apply<2>(up, Vec<2>(3, 4)), Vec<2>(3, 0));
}

TEST(Contact, SeparateLetsGo) {
  const Contact contact{ContactCondition::separate, 0.5};
  EXPECT_EQ(contact.apply<2>(up, Vec<2>(3, 4)), Vec<2>(3, 4));
  EXPECT_EQ(contact.apply<2>(up, Vec<2>(3, 0)), Vec<2>(3, 0));
}

TEST(Contact, FrictionTakesItsShareOfTheNormalPartAndAtMostEverything) {
  // |v_t| = 3, |dv_n| = 4: 3 - 0.25 * 4 = 2.
  for (const auto condition : {ContactCondition::slip, ContactCondition::separate}) {
    EXPECT_LT((Contact{condition, 0.25}.apply<2>(up, Vec<2>(-3, -4)) - Vec<2>(-2, 0)).norm(), 1e-15);
    EXPECT_EQ((Contact{condition, 0.75}.apply<2>(up, Vec<2>(-3, -4))), Vec<2>::Zero());
    EXPECT_EQ((Contact{condition, 1e9}.apply<2>(up, Vec<2>(0, -4))), Vec<2>::Zero());
  }
}

TEST(Contact, HoldsForAnyDirectionIn3D) {
  const Vec<3> normal = Vec<3>(1, -2, 2) / 3, along = Vec<3>(2, 2, 1) / 3;  // orthonormal
  const Vec<3> after =
      Contact{ContactCondition::separate, 0.5}.apply<3>(normal, Vec<3>(-2 * normal + 5 * along));
  EXPECT_LT((after - 4 * along).norm(), 1e-15);
}

TEST(RampTest, IntegralAndMean) {
  const Ramp ramp{1, 2, 7};  // 0 to 1 in 1..3, ends at 7
  EXPECT_EQ(ramp.factor(0.5), 0);
  EXPECT_EQ(ramp.factor(2), 0.5);
  EXPECT_EQ(ramp.factor(4), 1);
  EXPECT_EQ(ramp.factor(7), 0);
  EXPECT_EQ(ramp.progress(1), 0);
  EXPECT_EQ(ramp.progress(2), 0.25);  // triangle of base 1 and height 1/2
  EXPECT_EQ(ramp.progress(5), 3);     // 1 + 2
  EXPECT_EQ(ramp.progress(100), 5);
  // The means over any steps add up to the integral, across the kinks too.
  Real sum = 0, t = 0;
  for (const Real dt : {0.7, 0.9, 0.3, 2.3, 0.0, 1.1, 3.7, 2.0}) {
    sum += dt * ramp.mean(t, dt);
    t += dt;
  }
  EXPECT_NEAR(sum, 5, 1e-14);
  EXPECT_EQ((Ramp{}.factor(0)), 1);
  EXPECT_EQ((Ramp{}.progress(3)), 3);
}

TEST(RigidMotionTest, TurnsAndShifts) {
  RigidMotion<2>::Options options;
  options.velocity = {2, -1};
  options.angular_velocity[2] = std::numbers::pi / 2;
  options.center = {1, 1};
  options.ramp.rise = 2;
  const RigidMotion<2> motion(options);
  // Progress at t = 2 is 1: a quarter turn, and the centre at (3, 0).
  const Pose<2> pose = motion.pose(2);
  EXPECT_LT((pose.from_shape(Vec<2>(2, 1)) - Vec<2>(3, 1)).norm(), 1e-15);
  EXPECT_LT((pose.to_shape(Vec<2>(3, 1)) - Vec<2>(2, 1)).norm(), 1e-15);
  const RigidStep<2> step = motion.step(2, 0);
  EXPECT_LT((step.velocity_at(Vec<2>(3, 1)) - Vec<2>(2 - std::numbers::pi / 2, -1)).norm(), 1e-15);
  EXPECT_FALSE(motion.at_rest());
}

// Material points follow d x/dt = velocity_at(x): the derivative of the pose.
template <int Dim>
void check_velocity_is_the_derivative_of_the_pose() {
  typename RigidMotion<Dim>::Options options;
  options.velocity = Vec<Dim>::LinSpaced(0.3, -0.7);
  options.angular_velocity = Dim == 2 ? Vec<3>(0, 0, -1.3) : Vec<3>(0.5, -0.4, 0.9);
  options.center = Vec<Dim>::Constant(0.2);
  options.ramp = {0.1, 0.5};
  const RigidMotion<Dim> motion(options);
  const Vec<Dim> point = Vec<Dim>::LinSpaced(0.5, 0.8);
  for (const Real t : {0.3, 1.1}) {
    const Real e = 1e-5;
    const Vec<Dim> rate =
        (motion.pose(t + e).from_shape(point) - motion.pose(t - e).from_shape(point)) / (2 * e);
    EXPECT_LT((motion.step(t, 0).velocity_at(motion.pose(t).from_shape(point)) - rate).norm(), 1e-9);
  }
  // The centre's mean velocity is exact over any step.
  const Vec<Dim> way =
      motion.pose(0.9).from_shape(options.center) - motion.pose(0).from_shape(options.center);
  const RigidStep<Dim> step = motion.step(0, 0.9);
  EXPECT_LT((0.9 * step.velocity_at(step.center) - way).norm(), 1e-15);
}
TEST(RigidMotionTest, VelocityIsTheDerivativeOfThePose) {
  check_velocity_is_the_derivative_of_the_pose<2>();
  check_velocity_is_the_derivative_of_the_pose<3>();
}

// The message of the fault in a scene that holds one [[effect.kind]].
template <class E>
std::string fault_of(const std::string& kind, const std::string& table) {
  Parameters root = Parameters::read_text("[[effect." + kind + "]]\n" + table, "scene.toml");
  try {
    root.section("effect", [&](Parameters& effects) {
      effects.section_list(kind, {}, [&](Parameters& p, int) { E{p}.explain(); });
    });
  } catch (const UserError& error) {
    return error.what();
  }
  return "";
}
void expect_fault(const std::string& message, const std::string& place, const std::string& part) {
  EXPECT_TRUE(message.starts_with(place)) << message;
  EXPECT_NE(message.find(part), std::string::npos) << message;
}

TEST(EffectTables, FaultsAreToldWithTheirPlace) {
  const std::string shape = "shape = {type = \"sphere\", center = [0, 0], radius = 1}\n";
  EXPECT_EQ(fault_of<Obstacle<2>>("obstacle", shape + "name = \"tup-1\""), "");
  expect_fault(fault_of<Obstacle<2>>("obstacle", shape + "condition = \"slip\"\nfriction = -1"),
               "scene.toml:4:", "friction");
  expect_fault(fault_of<Obstacle<2>>("obstacle", shape + "friction = 0.1"), "scene.toml:3:", "sticky");
  expect_fault(fault_of<Obstacle<2>>("obstacle", shape + "name = \"a,b\""), "scene.toml:3:", "letters");
  expect_fault(fault_of<Obstacle<2>>("obstacle", shape + "start = 2\nstop = 1"), "scene.toml:4:", "later");
  expect_fault(fault_of<Obstacle<2>>("obstacle", shape + "center = [1]"), "scene.toml:3:", "center");
  expect_fault(fault_of<Obstacle<2>>("obstacle", "velocity = [1, 0]"), "scene.toml:1:", "shape");
  expect_fault(fault_of<Obstacle<2>>("obstacle",
                                     "shape = {type = \"plane\", point = [0, 0], normal = [0, 1]}\n"
                                     "angular_velocity = \"3 rpm\""),
               "scene.toml:3:", "center");
  expect_fault(fault_of<Grip<2>>("grip", shape + "directions = [\"z\"]"), "scene.toml:3:", "\"x\" and \"y\"");
  expect_fault(fault_of<Grip<2>>("grip", shape + "directions = []"), "scene.toml:3:", "no direction");
  expect_fault(fault_of<Traction<2>>("traction", shape + "traction = [0, 1]\narea = 0"),
               "scene.toml:4:", "area");
  expect_fault(fault_of<Traction<2>>("traction", shape + "area = 1"), "scene.toml:1:", "traction");
  expect_fault(fault_of<Walls<2>>("walls", "x_min = \"none\""), "scene.toml:1:", "no side");
  expect_fault(fault_of<Walls<2>>("walls", "z_min = \"slip\"\nx_min = \"slip\""), "scene.toml:2:", "z_min");
  expect_fault(fault_of<Walls<2>>("walls", "x_min = \"sticky\"\nfriction = 0.2"), "scene.toml:3:", "sticky");
  expect_fault(fault_of<Gravity<2>>("gravity", "acceleration = [0, 0, -9.81]"),
               "scene.toml:2:", "acceleration");
}

TEST(EffectTables, AreDescribed) {
  Parameters p = Parameters::describe();
  p.section_list("obstacle", {}, [&](Parameters& q, int) { Obstacle<3>{q}; });
  p.section_list("grip", {}, [&](Parameters& q, int) { Grip<3>{q}; });
  p.section_list("traction", {}, [&](Parameters& q, int) { Traction<3>{q}; });
  p.section("walls", [&](Parameters& q) { Walls<3>{q}; });
  p.section("gravity", [&](Parameters& q) { Gravity<3>{q}; });
  const std::string text = p.describe_text();
  for (const char* key :
       {"friction", "directions", "z_max", "acceleration", "angular_velocity", "area", "ramp"})
    EXPECT_NE(text.find(key), std::string::npos) << key;
}

}  // namespace
