// Fluids: pressure from the energy, bounds, J under shear, viscosity, and the lazy liquid as the same physics.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "mpm_hpc/base/parameters.hpp"
#include "mpm_hpc/materials/lazy_liquid.hpp"
#include "mpm_hpc/materials/linear_fluid.hpp"
#include "mpm_hpc/materials/material_loops.hpp"
#include "mpm_hpc/materials/tait_fluid.hpp"
#include "unit/materials/test_columns.hpp"

namespace mpm::test {
namespace {

constexpr Real K = 2.2e9, eta = 3;

template <class Law>
Law fluid(Real viscosity = 0) {
  Law law;
  law.bulk_modulus = K;
  law.viscosity = viscosity;
  return law;
}

template <class Law>
struct FluidTest : testing::Test {};
using Fluids = testing::Types<LinearFluid, TaitFluid>;
TYPED_TEST_SUITE(FluidTest, Fluids);

TYPED_TEST(FluidTest, PressureIsTheGradientOfTheEnergyAndTheModulusThatOfTheStress) {
  const TypeParam law = fluid<TypeParam>();
  for (const double J : {0.2, 0.5, 0.9, 1.0, 1.1, 1.7, 4.0}) {
    const double x = J - 1, h = 1e-6 * J;
    const double slope = (law.energy_density(x + h) - law.energy_density(x - h)) / (2 * h);
    EXPECT_NEAR(law.spherical_stress(x), J * slope, 1e-8 * (std::abs(J * slope) + K)) << J;
    const double modulus = J * (law.spherical_stress(x + h) - law.spherical_stress(x - h)) / (2 * h);
    EXPECT_GE(law.wave_modulus(x), modulus - 1e-8 * (std::abs(modulus) + K)) << J;
  }
  EXPECT_EQ(law.energy_density(0.0), 0);
  EXPECT_EQ(law.spherical_stress(0.0), 0);
  EXPECT_NEAR(law.wave_modulus(0.0), K, 1e-15 * K);
  // K dJ for small changes, with all digits of the change.
  EXPECT_NEAR(law.spherical_stress(1e-12), K * 1e-12, 1e-10 * K * 1e-12);
  EXPECT_NEAR(law.spherical_stress(1e-6f), static_cast<float>(K * 1e-6), 1e-4 * K * 1e-6);
}

TEST(FluidLawTest, PressuresOfTheTwoEquationsOfState) {
  EXPECT_NEAR(fluid<LinearFluid>().spherical_stress(-0.2), -K * 0.2 * 0.8, 1e-15 * K);
  const double p = K / 7 * (std::pow(0.8, -7) - 1);
  EXPECT_NEAR(fluid<TaitFluid>().spherical_stress(-0.2), -p * 0.8, 1e-14 * p);
}

template <class T>
struct One {
  static constexpr int W = pack_width<T>;
  Columns<T> own{1, W}, gradient{9, W}, tau{6, W};
  MaterialColumns<3, T> columns;
  One() {
    columns.own[0] = own[0];
    for (int c = 0; c < 9; ++c) columns.velocity_gradient[c] = gradient[c];
  }
  void set_gradient(int c, double value) { std::fill_n(gradient[c], W, static_cast<T>(value)); }
};

template <class T>
struct FluidColumns : testing::Test {};
using Scalars = testing::Types<double, float>;
TYPED_TEST_SUITE(FluidColumns, Scalars);

// After shear of 10, 100 and 1000 with a compression on top the stored J is that of the compression; det F would have lost it.
TYPED_TEST(FluidColumns, VolumeIsExactInShear) {
  using T = TypeParam;
  const MaterialLoops<LinearFluid, 3> material({.name = "water", .density = 1000}, fluid<LinearFluid>());
  EXPECT_FALSE(material.needs_deformation_gradient());
  EXPECT_FALSE(material.needs_velocity_gradient());
  ASSERT_EQ(material.own_columns().size(), 1u);
  One<T> one;
  const int steps = 10000;
  for (const double shear : {10.0, 100.0, 1000.0}) {
    std::fill_n(one.own[0], one.W, T(0));
    one.set_gradient(1, shear / steps);
    one.set_gradient(0, -1e-3 / steps);
    MaterialUpdate update;
    for (int i = 0; i < steps; ++i)
      update = material.advance(one.columns, one.gradient.data(), {.dt = 1}, 0, one.W);
    const double expected = std::exp(steps * std::log1p(-static_cast<double>(static_cast<T>(1e-3 / steps))));
    EXPECT_NEAR(1 + static_cast<double>(one.own[0][0]), expected, sizeof(T) == 8 ? 1e-13 : 1e-6) << shear;
    EXPECT_NEAR(update.limits.min_jacobian, expected, 1e-6);
    T J[one.W];
    material.jacobian(one.columns, 0, one.W, J);
    EXPECT_NEAR(J[1], expected, 1e-6);
  }
}

// exp(tr A) of the exponential, the first terms of its series of the others.
TYPED_TEST(FluidColumns, VolumeFollowsTheChosenUpdate) {
  using T = TypeParam;
  const MaterialLoops<TaitFluid, 3> material({.name = "water", .density = 1000}, fluid<TaitFluid>());
  const double a = 0.25;
  const std::pair<DeformationUpdate, double> cases[] = {{DeformationUpdate::first_order, a},
                                                        {DeformationUpdate::second_order, a + a * a / 2},
                                                        {DeformationUpdate::exponential, std::expm1(a)}};
  for (const auto& [update, growth] : cases) {
    One<T> one;
    std::fill_n(one.own[0], one.W, T(0.5));
    one.set_gradient(4, a);
    material.advance(one.columns, one.gradient.data(), {.dt = 1, .update = update}, 0, one.W);
    EXPECT_NEAR(one.own[0][0], 0.5 + 1.5 * growth, 4 * std::numeric_limits<T>::epsilon());
  }
}

// tau = -p J I + eta J (grad v + grad v^T), and the limits know eta J.
TYPED_TEST(FluidColumns, ViscosityActsOnTheRateOfStrain) {
  using T = TypeParam;
  const MaterialLoops<LinearFluid, 3> material({.name = "honey", .density = 1000}, fluid<LinearFluid>(eta));
  EXPECT_TRUE(material.needs_velocity_gradient());
  One<T> one;
  std::fill_n(one.own[0], one.W, T(0.25));
  one.set_gradient(1, 2);
  one.set_gradient(3, 5);
  one.set_gradient(8, -7);
  material.stress(one.columns, 0, one.W, one.tau.data());
  const double spherical = K * 0.25 * 1.25, J = 1.25, tolerance = 4 * std::numeric_limits<T>::epsilon();
  const double expected[] = {spherical, eta * J * 7, 0, spherical, 0, spherical - eta * J * 14};
  for (int c = 0; c < 6; ++c) EXPECT_NEAR(one.tau[c][2], expected[c], tolerance * (spherical + 1)) << c;
  EXPECT_NEAR(one.tau[1][2], expected[1], tolerance * expected[1]);
  EXPECT_NEAR(material.limits(one.columns, 0, one.W).viscosity, eta * J, tolerance * eta);
}

TEST(FluidColumnsTest, LimitsFindABrokenVolume) {
  const MaterialLoops<LinearFluid, 3> material({.name = "water", .density = 1000}, fluid<LinearFluid>());
  One<double> one;
  for (int p = 0; p < one.W; ++p) {
    one.own[0][p] = std::numeric_limits<double>::quiet_NaN();
    const MaterialLimits limits = material.limits(one.columns, 0, one.W);
    EXPECT_EQ(limits.wave_modulus, std::numeric_limits<double>::infinity());
    EXPECT_EQ(limits.min_jacobian, -std::numeric_limits<double>::infinity());
    one.own[0][p] = -1.5;
    EXPECT_EQ(material.limits(one.columns, 0, one.W).min_jacobian, -0.5);
    one.own[0][p] = 0;
  }
}

// The same pressure and energy as linear_fluid, and no memory of shape.
TEST(LazyLiquidTest, IsTheLinearFluidInAnotherDress) {
  LazyLiquid<3> lazy;
  lazy.bulk_modulus = K;
  const MaterialLoops<LazyLiquid<3>, 3> material({.name = "water", .density = 1000}, lazy);
  EXPECT_TRUE(material.needs_deformation_gradient());
  EXPECT_TRUE(material.own_columns().empty());
  Columns<double> F{9, 8}, gradient{9, 8}, tau{6, 8}, energy{1, 8};
  MaterialColumns<3, double> columns;
  for (int c = 0; c < 9; ++c) {
    columns.F[c] = F[c];
    std::fill_n(F[c], 8, c % 4 == 0 ? 1.0 : 0.0);
  }
  std::fill_n(gradient[1], 8, 0.3);
  std::fill_n(gradient[4], 8, 0.1);
  material.advance(columns, gradient.data(), {.dt = 1}, 0, 8);
  for (int c = 0; c < 9; ++c) EXPECT_NEAR(F[c][3], c % 4 == 0 ? std::cbrt(1.1) : 0, 1e-15) << c;
  material.stress(columns, 0, 8, tau.data());
  material.energy_density(columns, 0, 8, energy[0]);
  const LinearFluid linear = fluid<LinearFluid>();
  for (const int c : {0, 3, 5}) EXPECT_NEAR(tau[c][3], linear.spherical_stress(0.1), 1e-14 * K);
  for (const int c : {1, 2, 4}) EXPECT_EQ(tau[c][3], 0);
  EXPECT_NEAR(energy[0][3], linear.energy_density(0.1), 1e-15 * K);
  // A particle that is turned inside out is left for the step-size rule to find.
  F[0][5] = -1;
  EXPECT_LT(material.advance(columns, gradient.data(), {.dt = 1}, 0, 8).limits.min_jacobian, 0);
}

template <class Law>
std::string message_of(const std::string& keys) {
  try {
    Law law;
    Parameters parameters = Parameters::read_text(keys, "dam.toml");
    law.declare(parameters);
    parameters.finish();
  } catch (const UserError& error) {
    return error.what();
  }
  return "no error";
}

TEST(FluidLawTest, RefusesWhatMakesNoSense) {
  using testing::HasSubstr;
  EXPECT_EQ(message_of<LinearFluid>("bulk_modulus = 1e6\nviscosity = 1\n"), "no error");
  EXPECT_THAT(message_of<LinearFluid>("viscosity = 1\n"), HasSubstr("bulk_modulus"));
  EXPECT_THAT(message_of<LinearFluid>("bulk_modulus = 0\n"), HasSubstr("dam.toml:1"));
  EXPECT_THAT(message_of<LinearFluid>("bulk_modulus = 1e6\nviscosity = -1\n"), HasSubstr("dam.toml:2"));
  EXPECT_THAT(message_of<TaitFluid>("bulk_modulus = 1e6\nexponent = 1\n"), HasSubstr("exponent"));
  EXPECT_THAT(message_of<LazyLiquid<2>>("bulk_modulus = -1\n"), HasSubstr("bulk_modulus"));
}

}  // namespace
}  // namespace mpm::test
