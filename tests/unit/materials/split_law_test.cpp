// Laws that split their energy: the parts add up, degrade linearly, and compression drives no crack.
#include <gtest/gtest.h>

#include "unit/materials/law_samples.hpp"

namespace mpm::test {
namespace {

template <class Law>
struct SplitTest : testing::Test {};
using SplitLaws = testing::Types<SplitNeoHookean<2>, SplitNeoHookean<3>>;
TYPED_TEST_SUITE(SplitTest, SplitLaws);

// tau of F = diag(2, 1, ...): mu J^(-2/d) dev(b) + kappa/2 (J^2 - 1) I.
TYPED_TEST(SplitTest, StressOfAUniaxialStretch) {
  constexpr int dim = Traits<TypeParam>::dim;
  const auto law = Traits<TypeParam>::law();
  auto F = Tensor<double, dim>::identity();
  F(0, 0) = 2;
  const auto tau = law.kirchhoff_stress(F);
  const double mean = (4.0 + dim - 1) / dim, shear = test_mu / std::pow(2.0, 2.0 / dim),
               volumetric = 1.5 * law.kappa;
  EXPECT_NEAR(tau(0, 0), shear * (4 - mean) + volumetric, 1e-14 * law.kappa);
  EXPECT_NEAR(tau(1, 1), shear * (1 - mean) + volumetric, 1e-14 * law.kappa);
  const double energy =
      0.5 * shear * (3 + dim) - 0.5 * test_mu * dim + 0.5 * law.kappa * (1.5 - std::log(2.0));
  EXPECT_NEAR(law.energy_density(F), energy, 1e-14 * law.kappa);
  EXPECT_NEAR(law.energy_plus(F), energy, 1e-14 * law.kappa);
}

TYPED_TEST(SplitTest, PartsAddUpAndDegradeLinearly) {
  constexpr int dim = Traits<TypeParam>::dim;
  const auto law = Traits<TypeParam>::law();
  int expanded = 0, compressed = 0;
  for (const auto& [name, matrix] : sample_deformations<dim>()) {
    const auto F = to_tensor<dim>(matrix);
    (determinant(F) < 1 ? compressed : expanded)++;
    const double all = law.energy_density(F), plus = law.energy_plus(F), minus = law.energy_degraded(F, 0.0);
    EXPECT_NEAR(plus + minus, all, 1e-14 * law.kappa) << name;
    EXPECT_GE(plus, -1e-15 * law.kappa) << name;
    EXPECT_GE(minus, 0) << name;
    if (determinant(F) >= 1) {
      EXPECT_EQ(minus, 0) << name;
    }
    EXPECT_NEAR(law.energy_degraded(F, 0.3), 0.3 * plus + minus, 1e-14 * (plus + minus)) << name;
    const auto tau = to_matrix<dim>(law.kirchhoff_stress(F));
    const auto none = to_matrix<dim>(law.kirchhoff_stress_degraded(F, 0.0));
    EXPECT_LE((to_matrix<dim>(law.kirchhoff_stress_degraded(F, 1.0)) - tau).norm(), 1e-15 * tau.norm())
        << name;
    EXPECT_LE((to_matrix<dim>(law.kirchhoff_stress_degraded(F, 0.3)) - (0.3 * tau + 0.7 * none)).norm(),
              1e-14 * tau.norm())
        << name;
  }
  EXPECT_GT(expanded, 0);
  EXPECT_GT(compressed, 0);
}

TYPED_TEST(SplitTest, DegradedStressIsTheGradientOfTheDegradedEnergy) {
  constexpr int dim = Traits<TypeParam>::dim;
  const auto law = Traits<TypeParam>::law();
  const double g = 0.2;
  for (const auto& [name, F] : sample_deformations<dim>()) {
    const Mat<dim> P =
        to_matrix<dim>(law.kirchhoff_stress_degraded(to_tensor<dim>(F), g)) * F.inverse().transpose();
    const double h = 1e-5 / F.inverse().norm();
    Mat<dim> difference;
    for (int k = 0; k < dim * dim; ++k) {
      Mat<dim> up = F, down = F;
      up.data()[k] += h;
      down.data()[k] -= h;
      difference.data()[k] =
          (law.energy_degraded(to_tensor<dim>(up), g) - law.energy_degraded(to_tensor<dim>(down), g)) /
          (2 * h);
    }
    EXPECT_LE((difference - P).norm(), 1e-8 * P.norm()) << name;
  }
}

// Volume change is pure: no deviator, so compression drives no crack and isn't degraded; expansion is,
// entirely.
TYPED_TEST(SplitTest, PureCompressionDrivesNoCrack) {
  constexpr int dim = Traits<TypeParam>::dim;
  const auto law = Traits<TypeParam>::law();
  for (const double stretch : {0.3, 0.9, 0.999999}) {
    const Tensor<double, dim> F = stretch * Tensor<double, dim>::identity();
    EXPECT_NEAR(law.energy_plus(F), 0, 1e-15 * test_mu);
    EXPECT_GT(law.energy_degraded(F, 0.0), 0);
    EXPECT_NEAR(law.kirchhoff_stress_degraded(F, 0.0)(0, 0), law.kirchhoff_stress(F)(0, 0), 1e-15 * test_mu);
  }
  const Tensor<double, dim> F = 1.1 * Tensor<double, dim>::identity();
  EXPECT_EQ(law.energy_degraded(F, 0.0), 0);
  EXPECT_EQ(law.kirchhoff_stress_degraded(F, 0.0)(0, 0), 0);
}

// Across J = 1 energy and stress of both parts change by no more than the distance allows, and the rates
// agree with a part that is quadratic in J - 1.
TYPED_TEST(SplitTest, IsContinuousWhereVolumeIsKept) {
  constexpr int dim = Traits<TypeParam>::dim;
  const auto law = Traits<TypeParam>::law();
  Mat<dim> shear = Mat<dim>::Identity();
  shear(0, 1) = 0.4;
  for (const double gap : {1e-3, 1e-6, 1e-9}) {
    const auto below = to_tensor<dim>(std::pow(1 - gap, 1.0 / dim) * shear);
    const auto above = to_tensor<dim>(std::pow(1 + gap, 1.0 / dim) * shear);
    EXPECT_NEAR(law.energy_plus(below), law.energy_plus(above), law.kappa * (gap * gap + 1e-15));
    const auto tau_below = to_matrix<dim>(law.kirchhoff_stress_degraded(below, 0.1));
    const auto tau_above = to_matrix<dim>(law.kirchhoff_stress_degraded(above, 0.1));
    EXPECT_LE((tau_below - tau_above).norm(), 4 * law.kappa * (gap + 1e-15));
  }
}

// The bounds of the degraded stress hold for any F and g, for the same F closed up to J < 1 as well, where the stress of volume
// change comes back, and are no larger than those of the intact particle or of the intact one at rest.
TYPED_TEST(SplitTest, DegradedStepBoundsHold) {
  constexpr int dim = Traits<TypeParam>::dim;
  std::mt19937 generator(3);
  std::uniform_real_distribution<double> log_stretch(-1, 1), degradation(0, 1);
  for (const double lambda : {test_lambda, -0.5 * test_mu}) {  // with a soft volume, shear decides too
    const auto law = Traits<TypeParam>::law(test_mu, lambda);
    const auto at_rest = Tensor<double, dim>::identity();
    for (int i = 0; i < 600; ++i) {
      const Vec<dim> s = Vec<dim>::NullaryExpr([&] { return std::exp(log_stretch(generator)); });
      const double g = i % 3 == 0 ? 0 : i % 3 == 1 ? 1e-3 : degradation(generator);
      const auto F = to_tensor<dim>(s.asDiagonal());
      const double stiffness = law.stiffness_bound_degraded(F, g), modulus = law.wave_modulus_degraded(F, g);
      const auto stress = [&](const Tensor<double, dim>& a) { return law.kirchhoff_stress_degraded(a, g); };
      for (const double J : {s.prod(), 0.999, 0.7}) {
        if (J > s.prod()) continue;
        const Mat<dim> A = principal_moduli<dim>(stress, std::pow(J / s.prod(), 1.0 / dim) * s);
        EXPECT_GE(stiffness, largest_eigenvalue(A) - 1e-7 * A.norm()) << J;
        EXPECT_GE(modulus, A.diagonal().maxCoeff() - 1e-7 * A.norm()) << J;
      }
      const double slack = 1 + 1e-14;
      const double intact = law.stiffness_bound(F), intact_modulus = law.wave_modulus(F);
      EXPECT_LE(stiffness, slack * std::max(g * intact, std::min(intact, law.stiffness_bound(at_rest))));
      EXPECT_LE(modulus, slack * (g * intact_modulus + std::min(intact_modulus, law.wave_modulus(at_rest))));
    }
  }
}

// The bound of this law is the eigenvalue itself at every F.
TYPED_TEST(SplitTest, StiffnessBoundIsExact) {
  constexpr int dim = Traits<TypeParam>::dim;
  const auto law = Traits<TypeParam>::law(test_mu, -0.5 * test_mu);  // a soft volume: shear decides too
  std::mt19937 generator(4);
  std::uniform_real_distribution<double> log_stretch(-1, 1);
  for (int i = 0; i < 200; ++i) {
    const Vec<dim> s = Vec<dim>::NullaryExpr([&] { return std::exp(log_stretch(generator)); });
    const auto stress = [&](const Tensor<double, dim>& a) { return law.kirchhoff_stress(a); };
    const Mat<dim> A = principal_moduli<dim>(stress, s);
    EXPECT_NEAR(law.stiffness_bound(to_tensor<dim>(s.asDiagonal())), largest_eigenvalue(A), 1e-7 * A.norm());
  }
}

}  // namespace
}  // namespace mpm::test
