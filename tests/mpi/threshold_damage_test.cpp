// Threshold damage of homogeneous bodies against the closed form, with stresses from the formulas of physics.md.
#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <cmath>

#include "mpm_hpc/base/error.hpp"
#include "support/mpi_test.hpp"
#include "support/scene_world.hpp"

using namespace mpm;

namespace {

constexpr Real modulus = 10, ratio = 0.3, residual = 1e-3;

template <int Dim>
struct Homogeneous {
  Mat<Dim> F;
  Real mu = modulus / (2 * (1 + ratio)), lambda = modulus * ratio / ((1 + ratio) * (1 - 2 * ratio));
  Real kappa = lambda + 2 * mu / Dim;
  Real J = F.determinant();
  Mat<Dim> b = F * F.transpose();

  // tau = mu J^(-2/d) dev(b) + kappa/2 (J^2 - 1) I (physics.md section 3).
  Real principal_stress() const {
    const Mat<Dim> I = Mat<Dim>::Identity();
    const Mat<Dim> tau =
        mu * std::pow(J, -2.0 / Dim) * (b - b.trace() / Dim * I) + kappa / 2 * (J * J - 1) * I;
    return Eigen::SelfAdjointEigenSolver<Mat<Dim>>(Mat<Dim>(tau / J)).eigenvalues().maxCoeff();
  }
  Real tensile_energy() const {
    const Real shape = mu / 2 * (std::pow(J, -2.0 / Dim) * b.trace() - Dim);
    return shape + (J >= 1 ? kappa / 2 * ((J * J - 1) / 2 - std::log(J)) : 0);
  }
};

template <int Dim>
std::string scene_text(const Mat<Dim>& F, const std::string& effect,
                       const std::string& model = "split_neo_hookean", const std::string& toughness = "") {
  std::string rows;
  for (int a = 0; a < Dim; ++a) {
    rows += a ? ", [" : "[";
    for (int b = 0; b < Dim; ++b) rows += fmt::format("{}{:.17g}", b ? ", " : "", F(a, b));
    rows += "]";
  }
  const std::string zeros = Dim == 2 ? "[0, 0]" : "[0, 0, 0]", ones = Dim == 2 ? "[1, 1]" : "[1, 1, 1]";
  return fmt::format(
      "dimension = {0}\n[domain]\nlower = {1}\nupper = {2}\n[grid]\nspacing = 0.125\n[time]\nend = 1\n"
      "[material.m]\nmodel = \"{3}\"\nyoungs_modulus = {4}\npoisson_ratio = {5}\ndensity = 2\n{7}"
      "[[body]]\nname = \"block\"\nmaterial = \"m\"\nshape = {{type = \"box\", lower = {1}, upper = {2}}}\n"
      "deformation_gradient = [{6}]\n{8}",
      Dim, zeros, ones, model, modulus, ratio, rows, toughness, effect);
}

template <int Dim>
void deform(test::SceneWorld<Dim>& world, const Mat<Dim>& F) {
  world.for_particles([&](Body<Dim>& body, Index p) {
    for (int c = 0; c < Dim * Dim; ++c)
      body.particles.template data<Real>(core::deformation_gradient, c)[p] = F(c / Dim, c % Dim);
  });
}

template <int Dim>
void expect_phase(test::SceneWorld<Dim>& world, Real expected) {
  world.run_effects();
  world.for_particles([&](const Body<Dim>& body, Index p) {
    EXPECT_NEAR(body.particles.template data<Real>(body.particles.find("phase"))[p], expected, 1e-12);
  });
}

template <class D>
class ThresholdDamageLaw : public testing::Test {};
using Dimensions = testing::Types<std::integral_constant<int, 2>, std::integral_constant<int, 3>>;
TYPED_TEST_SUITE(ThresholdDamageLaw, Dimensions);

TYPED_TEST(ThresholdDamageLaw, FollowsTheClosedFormAndNeverHeals) {
  constexpr int Dim = TypeParam::value;
  constexpr Real softening = 1.5;
  Mat<Dim> stretch = Mat<Dim>::Identity(), sheared = Mat<Dim>::Identity();
  stretch(0, 0) = 1.2;
  sheared(0, 1) = 0.3;
  sheared(1, 0) = 0.1;
  sheared(Dim - 1, Dim - 1) = 1.1;
  for (const Mat<Dim>& F : {stretch, sheared}) {
    const Homogeneous<Dim> bar{F};
    const Real stress = bar.principal_stress(), strength = stress / 1.4;
    const Real expected = 1 - softening * (1 - 1 / 1.4);
    test::SceneWorld<Dim> world(scene_text<Dim>(
        F, fmt::format("[effect.threshold_damage]\nstrength = {:.17g}\nsoftening = {}\nresidual = {}",
                       strength, softening, residual)));
    expect_phase(world, expected);
    if (test::rank() == 0)
      std::printf("%dD: sigma/sigma_f = 1.4, H_s = 1.5: c = %.12f expected\n", Dim, expected);
    // The shape is the deformed one.
    const Real lost = (1 - residual) * (1 - expected * expected) * bar.tensile_energy() / bar.J;
    const Communicator& communicator = world.state.communicator();
    EXPECT_NEAR(communicator.sum(world.history()["fracture_energy"]), lost, 1e-12 * lost);
    EXPECT_NEAR(world.state.degradation[0].residual, residual, 0);

    deform(world, Mat<Dim>(Mat<Dim>::Identity()));
    expect_phase(world, expected);
    // Twice as far: c = 0 past sigma_f H_s / (H_s - 1) = 3 sigma_f.
    deform(world, Mat<Dim>(Mat<Dim>::Identity() + 4 * (F - Mat<Dim>::Identity())));
    const Homogeneous<Dim> torn{Mat<Dim>(Mat<Dim>::Identity() + 4 * (F - Mat<Dim>::Identity()))};
    ASSERT_GT(torn.principal_stress(), 3 * strength);
    expect_phase(world, 0);
    EXPECT_EQ(communicator.min(world.history()["min_phase"]), 0);
    EXPECT_NEAR(communicator.sum(world.history()["broken_fraction"]), 1, 1e-12);
  }
}

TYPED_TEST(ThresholdDamageLaw, LeavesAloneWhatIsBelowItsStrengthOrCompressed) {
  constexpr int Dim = TypeParam::value;
  Mat<Dim> F = Mat<Dim>::Identity();
  F(0, 0) = 1.2;
  const Real stress = Homogeneous<Dim>{F}.principal_stress();
  test::SceneWorld<Dim> world(
      scene_text<Dim>(F, fmt::format("[effect.threshold_damage]\nstrength = {:.17g}", 1.0001 * stress)));
  expect_phase(world, 1);
  deform(world, Mat<Dim>(0.5 * Mat<Dim>::Identity()));
  expect_phase(world, 1);
  EXPECT_EQ(world.state.communicator().sum(world.history()["fracture_energy"]), 0);
}

std::string fault(const std::string& effect, const std::string& model = "split_neo_hookean",
                  const std::string& toughness = "") {
  try {
    test::SceneWorld<2> world(scene_text<2>(Mat<2>::Identity(), effect, model, toughness));
  } catch (const UserError& error) {
    return error.what();
  }
  return "accepted";
}

TEST(ThresholdDamageScene, CombinationsThatMakeNoSenseAreRefused) {
  const std::string damage = "[effect.threshold_damage]\nstrength = 1\n";
  EXPECT_EQ(fault(damage + "[effect.phase_field]\n", "split_neo_hookean", "fracture_toughness = 1\n"),
            "scene.toml:20:1: effect.threshold_damage and effect.phase_field can't both weaken a scene's "
            "stress; take one of "
            "them out.");
  EXPECT_NE(fault(damage, "neo_hookean").find("effect.threshold_damage"), std::string::npos)
      << fault(damage, "neo_hookean");
  EXPECT_EQ(fault("[effect.threshold_damage]\nstrength = 0\n").rfind("scene.toml:20:12: strength = 0", 0),
            0u);
  EXPECT_EQ(fault(damage + "bodies = [\"blok\"]"),
            "scene.toml:21:10: there is no body \"blok\"; the bodies are block.");
}

}  // namespace
