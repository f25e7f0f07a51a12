// The tangent as a sum of squares, and its projection, against the closed form and against a full eigenvalue decomposition.
#include "mpm_hpc/materials/tangent_modes.hpp"

#include <gtest/gtest.h>

#include "unit/materials/law_samples.hpp"

namespace mpm::test {
namespace {

// sum_m value_m vec(direction_m) vec(direction_m)^T
template <int Dim>
Eigen::MatrixXd matrix_of_modes(const TangentModes<double, Dim>& modes) {
  return matrix_of<Dim>([&](const Mat<Dim>& L) {
    Mat<Dim> sum = Mat<Dim>::Zero();
    for (int m = 0; m < modes.count; ++m) {
      const Mat<Dim> X = to_matrix<Dim>(modes.direction[m]);
      sum += modes.value[m] * X.cwiseProduct(L).sum() * X;
    }
    return sum;
  });
}

template <class Law>
struct TangentModesTest : testing::Test {};
using Laws = testing::Types<NeoHookean<2>, NeoHookean<3>, SplitNeoHookean<2>, SplitNeoHookean<3>,
                            FixedCorotated<2>, FixedCorotated<3>, Hencky<2>, Hencky<3>>;
TYPED_TEST_SUITE(TangentModesTest, Laws);

TYPED_TEST(TangentModesTest, AddUpToTheTangentAndProjectToItsSemiDefinitePart) {
  constexpr int dim = Traits<TypeParam>::dim;
  using Full = Eigen::MatrixXd;
  const auto law = Traits<TypeParam>::law();
  int definite = 0, indefinite = 0;
  auto samples = sample_deformations<dim>();
  // Undeformed, where all blocks meet their limits, and pressed flat, where shear and rotation buckle.
  samples.push_back({"undeformed", Mat<dim>::Identity()});
  Vec<dim> flat = Vec<dim>::Constant(0.3);
  flat(0) = 1;
  samples.push_back({"pressed", flat.asDiagonal()});
  for (const auto& [name, F] : samples) {
    const Full exact = matrix_of<dim>([&, &F = F](const Mat<dim>& dF) {
      return to_matrix<dim>(law.first_piola_differential(to_tensor<dim>(F), to_tensor<dim>(dF)));
    });
    TangentModes<double, dim> modes(law, to_tensor<dim>(F), Tensor<double, dim>::identity());
    EXPECT_LE((matrix_of_modes(modes) - exact).norm(), 1e-8 * exact.norm()) << name;
    modes.project();
    const Full projected = matrix_of_modes(modes);
    EXPECT_GE(Eigen::SelfAdjointEigenSolver<Full>(projected).eigenvalues().minCoeff(),
              -1e-12 * std::max(test_mu, projected.norm()))
        << name;

    const Eigen::SelfAdjointEigenSolver<Full> eigen(exact);
    const bool is_definite = eigen.eigenvalues().minCoeff() > -1e-9 * exact.norm();
    (is_definite ? definite : indefinite)++;
    const Full expected = eigen.eigenvectors() * eigen.eigenvalues().cwiseMax(0).asDiagonal() *
                          eigen.eigenvectors().transpose();
    EXPECT_LE((projected - expected).norm(), 1e-8 * exact.norm())
        << name << " " << eigen.eigenvalues().transpose();
  }
  EXPECT_GT(definite, 0);
  EXPECT_GT(indefinite, 0);
}

// As a function of L in F = (I + L) F^n, d(P F^nT) = (dP/dF : dL F^n) F^nT.
TYPED_TEST(TangentModesTest, KnowTheDeformationBeforeTheStep) {
  constexpr int dim = Traits<TypeParam>::dim;
  const auto law = Traits<TypeParam>::law();
  const auto samples = sample_deformations<dim>();
  Mat<dim> L = Mat<dim>::Zero();
  L(0, 1) = 0.1;
  L(1, 1) = -0.2;
  for (const auto& [name, before] : samples) {
    const Mat<dim> F = (Mat<dim>::Identity() + L) * before;
    const Eigen::MatrixXd exact = matrix_of<dim>([&, &before = before](const Mat<dim>& dL) {
      return Mat<dim>(
          to_matrix<dim>(law.first_piola_differential(to_tensor<dim>(F), to_tensor<dim>(dL * before))) *
          before.transpose());
    });
    const TangentModes<double, dim> modes(law, to_tensor<dim>(F), to_tensor<dim>(before));
    EXPECT_LE((matrix_of_modes(modes) - exact).norm(), 1e-8 * exact.norm()) << name;
  }
}

// On both sides of the gap where the quotient (P_a - P_b)/(s_a - s_b) gives way to its limit.
TYPED_TEST(TangentModesTest, AreRightForEveryGapOfTheStretches) {
  constexpr int dim = Traits<TypeParam>::dim;
  const auto law = Traits<TypeParam>::law();
  for (double gap = 1e-1; gap > 1e-13; gap /= 10) {
    Vec<dim> s = Vec<dim>::Constant(1.1);
    s(1) += gap;
    const Mat<dim> F = s.asDiagonal();
    const Eigen::MatrixXd exact = matrix_of<dim>([&](const Mat<dim>& dF) {
      return to_matrix<dim>(law.first_piola_differential(to_tensor<dim>(F), to_tensor<dim>(dF)));
    });
    const TangentModes<double, dim> modes(law, to_tensor<dim>(F), Tensor<double, dim>::identity());
    EXPECT_LE((matrix_of_modes(modes) - exact).norm(), 3e-10 * exact.norm()) << gap;
  }
}

template <class C>
struct DegradedModesTest : testing::Test {};
using Dimensions = testing::Types<std::integral_constant<int, 2>, std::integral_constant<int, 3>>;
TYPED_TEST_SUITE(DegradedModesTest, Dimensions);

// g times the tangent where J >= 1; where J < 1 the volume's part stays whole, which is the tangent of a law without shear.
TYPED_TEST(DegradedModesTest, BelongToTheDegradedEnergy) {
  constexpr int dim = TypeParam::value;
  const SplitNeoHookean<dim> law = Traits<SplitNeoHookean<dim>>::law(), shapeless{0, law.kappa};
  const double g = 0.37;
  for (const auto& [name, F] : sample_deformations<dim>()) {
    auto tangent_of = [&, &F = F](const SplitNeoHookean<dim>& of) {
      return matrix_of<dim>([&](const Mat<dim>& dF) {
        return to_matrix<dim>(of.first_piola_differential(to_tensor<dim>(F), to_tensor<dim>(dF)));
      });
    };
    const TangentModes<double, dim> modes(DegradedLaw<SplitNeoHookean<dim>, double>{law, g},
                                          to_tensor<dim>(F), Tensor<double, dim>::identity());
    Eigen::MatrixXd expected = g * tangent_of(law);
    if (F.determinant() < 1) expected += (1 - g) * tangent_of(shapeless);
    EXPECT_LE((matrix_of_modes(modes) - expected).norm(), 1e-8 * expected.norm()) << name;
  }
}

}  // namespace
}  // namespace mpm::test
