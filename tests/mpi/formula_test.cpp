// Formulas of the scene on the particles: velocity and deformation at the start, and a force that follows the material, on
// any number of ranks.
#include <gtest/gtest.h>

#include <cmath>

#include "mpm_hpc/base/error.hpp"
#include "support/mpi_test.hpp"
#include "support/scene_world.hpp"

using namespace mpm;

namespace {

template <int Dim>
std::string scene_text(const std::string& body, const std::string& effects = "", Real density = 2) {
  const std::string zeros = Dim == 2 ? "[0, 0]" : "[0, 0, 0]", ones = Dim == 2 ? "[1, 1]" : "[1, 1, 1]";
  return fmt::format(
      "dimension = {0}\n[domain]\nlower = {1}\nupper = {2}\n[grid]\nspacing = 0.125\n[time]\nend = 1\n"
      "[material.m]\nmodel = \"neo_hookean\"\nyoungs_modulus = 10\npoisson_ratio = 0.3\ndensity = {3}\n"
      "[[body]]\nname = \"block\"\nmaterial = \"m\"\nshape = {{type = \"box\", lower = {1}, upper = "
      "{2}}}\n{4}\n{5}",
      Dim, zeros, ones, density, body, effects);
}

template <int Dim>
std::string list(const std::string& x, const std::string& y, const std::string& z) {
  return "[" + x + ", " + y + (Dim == 3 ? ", " + z : "") + "]";
}

template <int Dim>
Vec<Dim> position(const FieldSet& f, Index p) {
  Vec<Dim> x;
  for (int a = 0; a < Dim; ++a) x[a] = f.template data<Real>(core::position, a)[p];
  return x;
}

std::string fault_of(const std::string& text) {
  try {
    test::SceneWorld<2> world(text);
  } catch (const UserError& error) {
    return error.what();
  }
  return "accepted";
}

template <class D>
class FormulaStart : public testing::Test {};
using Dimensions = testing::Types<std::integral_constant<int, 2>, std::integral_constant<int, 3>>;
TYPED_TEST_SUITE(FormulaStart, Dimensions);

TYPED_TEST(FormulaStart, VelocityAndItsGradientFollowTheFormula) {
  constexpr int Dim = TypeParam::value;
  const std::string spin = Dim == 2 ? "3" : "[0, 0, 3]";
  test::SceneWorld<Dim> world(
      scene_text<Dim>("velocity = " + list<Dim>("\"k*sin(2*y)\"", "\"-x^3\"", "\"1 cm/s\"") +
                          "\nangular_velocity = " + spin + "\ncenter = " + list<Dim>("0", "0", "0"),
                      "[define]\nk = \"0.5 m/s\""));
  world.for_particles([&](const Body<Dim>& body, Index p) {
    const FieldSet& f = body.particles;
    const Vec<Dim> x = position<Dim>(f, p);
    EXPECT_NEAR(f.data<Real>(core::velocity, 0)[p], 0.5 * std::sin(2 * x[1]) - 3 * x[1], 1e-14);
    EXPECT_NEAR(f.data<Real>(core::velocity, 1)[p], -std::pow(x[0], 3) + 3 * x[0], 1e-14);
    const Real expected[] = {0, std::cos(2 * x[1]) - 3, -3 * x[0] * x[0] + 3, 0};
    for (int a = 0; a < Dim; ++a)
      for (int b = 0; b < Dim; ++b)
        EXPECT_NEAR(f.data<Real>(core::velocity_gradient, a * Dim + b)[p],
                    a < 2 && b < 2 ? expected[2 * a + b] : 0, 3e-8);
    if (Dim == 3) {
      EXPECT_EQ(f.data<Real>(core::velocity, Dim - 1)[p], 0.01);
    }
  });
}

// The shape is filled as it is, so a particle in a part that is stretched has less mass.
TYPED_TEST(FormulaStart, DeformationSetsVolumeAndMass) {
  constexpr int Dim = TypeParam::value;
  const std::string F =
      Dim == 2 ? "[[\"1 + x\", 0.5], [0, 2]]" : "[[\"1 + x\", 0.5, 0], [0, 2, 0], [0, 0, \"1 + z^2\"]]";
  test::SceneWorld<Dim> world(scene_text<Dim>("deformation_gradient = " + F));
  const Real cell = std::pow(0.125 / 2, Dim);
  world.for_particles([&](const Body<Dim>& body, Index p) {
    const FieldSet& f = body.particles;
    const Vec<Dim> x = position<Dim>(f, p);
    Real J = 2 * (1 + x[0]);
    if (Dim == 3) J *= 1 + x[Dim - 1] * x[Dim - 1];
    EXPECT_EQ(f.data<Real>(core::deformation_gradient, 1)[p], 0.5);
    EXPECT_EQ(f.data<Real>(core::deformation_gradient, Dim)[p], 0);
    EXPECT_NEAR(f.data<Real>(core::deformation_gradient, 0)[p], 1 + x[0], 1e-15);
    EXPECT_NEAR(f.data<Real>(core::volume)[p], cell / J, 1e-14 * cell);
    EXPECT_NEAR(f.data<Real>(core::mass)[p], 2 * cell / J, 1e-14 * cell);
  });
}

TYPED_TEST(FormulaStart, ABodyForceActsWhereItsParticlesWereAtTheStart) {
  constexpr int Dim = TypeParam::value;
  test::SceneWorld<Dim> world(scene_text<Dim>(
      "", "[effect.body_force]\nacceleration = " + list<Dim>("\"X + t\"", "\"-3*x*Y\"", "4")));
  State<Dim>& state = world.state;
  // Particles move, and with them to other ranks.
  world.for_particles([&](Body<Dim>& body, Index p) {
    Real& x = body.particles.template data<Real>(core::position, 0)[p];
    x = std::fmod(x + 0.5, 1.0);
  });
  sort_particles(state, OrderWithinCell::stable);
  state.time = 0.25;
  state.dt = 0.01;
  for (const auto& hook : world.hooks.before_p2g) hook(state);
  Real work = 0;
  world.for_particles([&](const Body<Dim>& body, Index p) {
    const FieldSet& f = body.particles;
    const Vec<Dim> x = position<Dim>(f, p);
    const Real X = std::fmod(x[0] + 0.5, 1.0);
    Vec<Dim> b;
    b[Dim - 1] = 4;
    b[0] = X + 0.25;
    b[1] = -3 * x[0] * x[1];
    for (int a = 0; a < Dim; ++a) {
      EXPECT_NEAR(f.data<Real>(core::velocity, a)[p], 0.01 * b[a], 1e-16);
      work += f.data<Real>(core::mass)[p] * 1e-4 * b[a] * b[a];
    }
  });
  // The work is force times the way that the particles take with the velocity that they have in the end.
  for (const auto& hook : world.hooks.after_g2p) hook(state);
  const Real expected = state.communicator().sum(work);
  EXPECT_NEAR(state.communicator().sum(state.ledger["external_work"]), expected, 1e-12 * expected);
}

TEST(FormulaScene, APlaceAtTheStartThatNoFormulaUsesIsNotCarried) {
  const std::string force = "[effect.body_force]\nacceleration = ";
  test::SceneWorld<2> without(scene_text<2>("", force + "[\"y\", \"t\"]"));
  EXPECT_EQ(without.state.bodies[0].particles.find("initial_position"), no_field);
  test::SceneWorld<2> with(scene_text<2>("", force + "[\"s\", 0]\n[define]\ns = \"2*Y\""));
  EXPECT_NE(with.state.bodies[0].particles.find("initial_position"), no_field);
}

TEST(FormulaScene, FaultsThatOnlyTheParticlesShow) {
  EXPECT_EQ(
      fault_of(scene_text<2>("velocity = [\"sqrt(x - 0.5)\", 0]")).rfind("scene.toml:18:12: the velocity", 0),
      0u);
  EXPECT_EQ(fault_of(scene_text<2>("deformation_gradient = [[\"0.5 - x\", 0], [0, 1]]"))
                .rfind("scene.toml:18:24: det F = ", 0),
            0u);
  EXPECT_EQ(fault_of(scene_text<2>("", "[effect.body_force]\nacceleration = [\"1/(X - 0.03125)\", 0]")),
            "scene.toml:20:16: the acceleration [1/(X - 0.03125), 0] is no finite number for 16 of the "
            "particles at the start; "
            "correct the formula.");
  EXPECT_EQ(fault_of(scene_text<2>("", "[effect.body_force]\nacceleration = [\"Z\", 0]"))
                .rfind("scene.toml:20:17: the formula \"Z\": there is no \"Z\" here", 0),
            0u);
  EXPECT_EQ(fault_of(scene_text<2>("", "[effect.body_force]\nacceleration = [1, 0]\nbodies = [\"blok\"]")),
            "scene.toml:21:10: there is no body \"blok\"; the bodies are block.");
}

}  // namespace
