// Every law: the energy fixes the stress and the stress the tangent; frame indifference; small strains; step
// bounds.
#include <gtest/gtest.h>

#include "unit/materials/law_samples.hpp"

namespace mpm::test {
namespace {

template <class Law>
struct LawTest : testing::Test, LawProbe<Law> {
  std::mt19937 generator{7};
};

using Laws = testing::Types<NeoHookean<2>, NeoHookean<3>, SplitNeoHookean<2>, SplitNeoHookean<3>,
                            FixedCorotated<2>, FixedCorotated<3>, Hencky<2>, Hencky<3>>;
TYPED_TEST_SUITE(LawTest, Laws);

// The error of central differences falls as h^2 and reaches 1e-8 before roundoff takes over.
template <class Error>
void expect_second_order(const Error& relative_error, double length, const std::string& name) {
  const double coarse = relative_error(0.01 * length), fine = relative_error(0.005 * length);
  EXPECT_GT(coarse, 1e-8) << name;  // else roundoff would be part of it; energies can be nearly quadratic
  EXPECT_NEAR(std::log2(coarse / fine), 2.0, 0.05) << name;
  EXPECT_LE(best_difference(relative_error, length), 1e-8) << name;
}

TYPED_TEST(LawTest, StressIsTheGradientOfTheEnergy) {
  for (const auto& [name, F] : sample_deformations<TestFixture::dim>()) {
    const auto P = this->piola(F);
    expect_second_order([&, &F = F](double h) { return this->gradient_error(F, h); }, 1 / F.inverse().norm(),
                        name);
    const auto tau = this->kirchhoff(F);
    EXPECT_LE((P * F.transpose() - tau).norm(), 1e-13 * (P.norm() * F.norm())) << name;
  }
}

TYPED_TEST(LawTest, TangentIsTheGradientOfTheStress) {
  constexpr int dim = TestFixture::dim;
  for (const auto& [name, F] : sample_deformations<dim>()) {
    Mat<dim> dF = random_matrix<dim>(this->generator);
    dF.normalize();
    expect_second_order([&, &F = F](double h) { return this->tangent_error(F, dF, h); },
                        1 / F.inverse().norm(), name);
  }
}

TYPED_TEST(LawTest, TangentHasMajorSymmetry) {
  constexpr int dim = TestFixture::dim;
  for (const auto& [name, F] : sample_deformations<dim>()) {
    const auto C = matrix_of<dim>([&, &F = F](const Mat<dim>& dF) { return this->differential(F, dF); });
    EXPECT_LE((C - C.transpose()).norm(), 1e-13 * C.norm()) << name;
  }
}

TYPED_TEST(LawTest, IsObjectiveAndIsotropic) {
  constexpr int dim = TestFixture::dim;
  for (const auto& [name, F] : sample_deformations<dim>()) {
    const Mat<dim> Q = random_rotation<dim>(this->generator);
    const double energy = this->energy(F);
    const Mat<dim> P = this->piola(F);
    EXPECT_NEAR(this->energy(Q * F), energy, 1e-12 * energy) << name;
    EXPECT_NEAR(this->energy(F * Q), energy, 1e-12 * energy) << name;
    EXPECT_LE((this->piola(Q * F) - Q * P).norm(), 1e-12 * P.norm()) << name;
    EXPECT_LE((this->piola(F * Q) - P * Q).norm(), 1e-12 * P.norm()) << name;
    const Mat<dim> tau = this->kirchhoff(F);
    EXPECT_LE((this->kirchhoff(Q * F) - Q * tau * Q.transpose()).norm(), 1e-12 * P.norm() * F.norm()) << name;
    for (const auto& bound :
         {&TypeParam::template stiffness_bound<double>, &TypeParam::template wave_modulus<double>}) {
      const double value = (this->law.*bound)(to_tensor<dim>(F));
      EXPECT_NEAR((this->law.*bound)(to_tensor<dim>(Q * F)), value, 1e-12 * std::abs(value)) << name;
    }
  }
}

TYPED_TEST(LawTest, IsAtRestUndeformed) {
  constexpr int dim = TestFixture::dim;
  const Mat<dim> I = Mat<dim>::Identity();
  EXPECT_EQ(this->energy(I), 0);
  EXPECT_EQ(this->piola(I).norm(), 0);
  EXPECT_EQ(this->kirchhoff(I).norm(), 0);
  const Mat<dim> Q = random_rotation<dim>(this->generator);
  EXPECT_LE(this->kirchhoff(Q).norm(), 1e-14 * test_mu);
}

// P = 2 mu eps + lambda tr(eps) I + O(eps^2) with eps the symmetric part of F - I.
TYPED_TEST(LawTest, IsLinearElasticityAtSmallStrain) {
  constexpr int dim = TestFixture::dim;
  const Mat<dim> I = Mat<dim>::Identity();
  for (int i = 0; i < 10; ++i) {
    const Mat<dim> dF = random_matrix<dim>(this->generator);
    const Mat<dim> strain = 0.5 * (dF + dF.transpose());
    const Mat<dim> hooke = 2 * test_mu * strain + test_lambda * strain.trace() * I;
    EXPECT_LE((this->differential(I, dF) - hooke).norm(), 1e-14 * hooke.norm());
    const double coarse = (this->piola(I + 1e-4 * dF) - 1e-4 * hooke).norm();
    const double fine = (this->piola(I + 5e-5 * dF) - 5e-5 * hooke).norm();
    EXPECT_NEAR(std::log2(coarse / fine), 2.0, 0.05);
  }
}

TYPED_TEST(LawTest, PrincipalDerivativesBelongToTheEnergy) {
  constexpr int dim = TestFixture::dim;
  for (const auto& [name, F] : sample_deformations<dim>()) {
    const Vec<dim> s =
        (F.transpose() * F).eval().template selfadjointView<Eigen::Lower>().eigenvalues().cwiseSqrt();
    double stretches[dim], tau[dim];
    for (int a = 0; a < dim; ++a) stretches[a] = s(a);
    this->law.principal_stress(stretches, tau);
    const Vec<dim> P = Eigen::Map<const Vec<dim>>(tau).cwiseQuotient(s);
    EXPECT_LE((this->piola(s.asDiagonal()).diagonal() - P).norm(), 1e-12 * P.norm()) << name;
    const SymTensor<double, dim> A = this->law.principal_moduli(stretches);
    for (int b = 0; b < dim; ++b) {
      const Mat<dim> dP = this->differential(s.asDiagonal(), Vec<dim>::Unit(b).asDiagonal());
      Vec<dim> expected;  // d^2 Psi / d s_a d s_b
      for (int a = 0; a < dim; ++a) expected(a) = (A(a, b) - (a == b ? tau[a] : 0)) / (s(a) * s(b));
      EXPECT_LE((dP.diagonal() - expected).norm(), 1e-12 * std::max(expected.norm(), test_mu)) << name;
    }
  }
}

// Both Lame constants that stabilise and a negative lambda (an auxetic solid).
TYPED_TEST(LawTest, StepBoundsHoldAndAreExactAtRest) {
  constexpr int dim = TestFixture::dim;
  for (const double lambda : {test_lambda, -0.3 * test_mu}) {
    const auto law = Traits<TypeParam>::law(test_mu, lambda);
    const auto at_rest = Tensor<double, dim>::identity();
    const double expected = std::max(2 * test_mu, 2 * test_mu + dim * lambda);
    EXPECT_NEAR(law.stiffness_bound(at_rest), expected, 1e-14 * expected);
    EXPECT_NEAR(law.wave_modulus(at_rest), 2 * test_mu + lambda, 1e-14 * expected);

    std::uniform_real_distribution<double> log_stretch(-1.2, 1.2);
    for (int i = 0; i < 200; ++i) {
      const Vec<dim> s = Vec<dim>::NullaryExpr([&] { return std::exp(log_stretch(this->generator)); });
      const Mat<dim> F =
          random_rotation<dim>(this->generator) * s.asDiagonal() * random_rotation<dim>(this->generator);
      const auto stress = [&](const Tensor<double, dim>& a) { return law.kirchhoff_stress(a); };
      const Mat<dim> A = principal_moduli<dim>(stress, s);
      const double stiffness = largest_eigenvalue(A), modulus = A.diagonal().maxCoeff();
      EXPECT_GE(law.stiffness_bound(to_tensor<dim>(F)), stiffness - 1e-7 * A.norm());
      EXPECT_GE(law.wave_modulus(to_tensor<dim>(F)), modulus - 1e-7 * A.norm());
      // No looser than 4/3 of what isn't lambda, reached in equal biaxial stretch.
      // Where terms of the moduli cancel, no looser than the terms: 4/3 of 4 mu s^2 for the largest stretch s, and the
      // volume's d lambda J (2J - 1) and 2 mu s (2s - 1) >= -mu / 4, which count for nothing where they are negative.
      const double J = s.prod();
      const double least = Traits<TypeParam>::softens
                               ? 4 * test_mu * s.maxCoeff() * s.maxCoeff() +
                                     3 * dim * std::max(0.0, -lambda * J * (2 * J - 1)) +
                                     3 * (s.maxCoeff() < 0.5 ? test_mu / 4 : 0)
                               : 0;
      EXPECT_LE(law.stiffness_bound(to_tensor<dim>(F)), stiffness + 0.34 * std::max(stiffness, least));
      EXPECT_LE(law.wave_modulus(to_tensor<dim>(F)),
                modulus + 0.34 * (std::max(modulus, least) + std::max(0.0, -lambda)));
    }
  }
}

// The stress of the stretches alone, which the work of a return is told from.
TYPED_TEST(LawTest, PrincipalStressIsTheStress) {
  constexpr int dim = TestFixture::dim;
  if constexpr (requires(double(&s)[dim]) { this->law.principal_stress(s, s); }) {
    for (const auto& [name, F] : sample_deformations<dim>()) {
      const Eigen::SelfAdjointEigenSolver<Mat<dim>> eigen(F * F.transpose());
      double s[dim], tau[dim];
      for (int a = 0; a < dim; ++a) s[a] = std::sqrt(eigen.eigenvalues()[a]);
      this->law.principal_stress(s, tau);
      const Mat<dim> composed =
          eigen.eigenvectors() * Eigen::Map<Vec<dim>>(tau).asDiagonal() * eigen.eigenvectors().transpose();
      const Mat<dim> expected = this->kirchhoff(F);
      EXPECT_LE((composed - expected).norm(), 1e-12 * (expected.norm() + test_mu)) << name;
    }
  }
}

// Linear in F - I, whose energy is a quadratic form, so that central differences are exact.
template <int Dim>
void expect_linear_elasticity() {
  const LinearElastic<Dim> law{test_mu, test_lambda};
  std::mt19937 generator(9);
  const Mat<Dim> I = Mat<Dim>::Identity();
  EXPECT_EQ(law.energy_density(to_tensor<Dim>(I)), 0);
  for (int n = 0; n < 20; ++n) {
    const Mat<Dim> F = I + 0.2 * random_matrix<Dim>(generator), strain = 0.5 * (F + F.transpose()) - I;
    const Mat<Dim> P = to_matrix<Dim>(law.first_piola(to_tensor<Dim>(F)));
    const Mat<Dim> hooke = 2 * test_mu * strain + test_lambda * strain.trace() * I;
    EXPECT_LE((P - hooke).norm(), 1e-14 * hooke.norm());
    EXPECT_EQ((to_matrix<Dim>(law.kirchhoff_stress(to_tensor<Dim>(F))) - P).norm(), 0);
    EXPECT_NEAR(law.energy_density(to_tensor<Dim>(F)), 0.5 * strain.cwiseProduct(hooke).sum(),
                1e-14 * hooke.norm());
    const Mat<Dim> dF = random_matrix<Dim>(generator);
    const double slope =
        (law.energy_density(to_tensor<Dim>(F + dF)) - law.energy_density(to_tensor<Dim>(F - dF))) / 2;
    EXPECT_NEAR(slope, P.cwiseProduct(dF).sum(), 1e-13 * test_mu * dF.squaredNorm());
    const Mat<Dim> dP = to_matrix<Dim>(law.first_piola_differential(to_tensor<Dim>(F), to_tensor<Dim>(dF)));
    EXPECT_LE((to_matrix<Dim>(law.first_piola(to_tensor<Dim>(F + dF))) - P - dP).norm(), 1e-13 * dP.norm());

    const Vec<Dim> s = Vec<Dim>::Constant(1) + 0.3 * Vec<Dim>::Random();
    const Mat<Dim> A =
        principal_moduli<Dim>([&](const Tensor<double, Dim>& a) { return law.kirchhoff_stress(a); }, s);
    const Mat<Dim> turned = random_rotation<Dim>(generator) * s.asDiagonal();
    const double largest = largest_eigenvalue(A), modulus = A.diagonal().maxCoeff();
    EXPECT_GE(law.stiffness_bound(to_tensor<Dim>(turned)), largest - 1e-7 * A.norm());
    EXPECT_GE(law.wave_modulus(to_tensor<Dim>(turned)), modulus - 1e-7 * A.norm());
    EXPECT_LE(law.wave_modulus(to_tensor<Dim>(turned)), 1.34 * modulus);
  }
  EXPECT_NEAR(law.stiffness_bound(to_tensor<Dim>(I)), 2 * test_mu + Dim * test_lambda,
              1e-14 * test_lambda * 10);
  EXPECT_NEAR(law.wave_modulus(to_tensor<Dim>(I)), 2 * test_mu + test_lambda, 1e-14 * test_lambda * 10);
}
TEST(LinearElasticTest, IsLinear) {
  expect_linear_elasticity<2>();
  expect_linear_elasticity<3>();
}

// Psi printed with the equations: F = diag(2, 1) and F = [[2, 1], [0, 1]].
TEST(NeoHookeanTest, EnergyOfTwoPlaneDeformations) {
  const auto law = Traits<NeoHookean<2>>::law();
  const double ln2 = std::log(2.0);
  const double volumetric = -test_mu * ln2 + 0.5 * test_lambda * ln2 * ln2;
  const Tensor<double, 2> stretch{{2, 0, 0, 1}}, with_shear{{2, 1, 0, 1}};
  EXPECT_NEAR(law.energy_density(stretch), 1.5 * test_mu + volumetric, 1e-15 * test_mu * 10);
  EXPECT_NEAR(law.energy_density(with_shear), 2.0 * test_mu + volumetric, 1e-15 * test_mu * 10);
  // tau = mu (b - I) + lambda ln J I with b = diag(4, 1)
  const auto tau = law.kirchhoff_stress(stretch);
  EXPECT_NEAR(tau(0, 0), 3 * test_mu + test_lambda * ln2, 1e-14 * test_mu);
  EXPECT_NEAR(tau(1, 1), test_lambda * ln2, 1e-14 * test_mu);
  EXPECT_EQ(tau(0, 1), 0);
}

}  // namespace
}  // namespace mpm::test
