// The block-wise projection of the tangent against the closed form and against a full eigenvalue
// decomposition.
#include "mpm_hpc/materials/tangent_projection.hpp"

#include <gtest/gtest.h>

#include "unit/materials/law_samples.hpp"

namespace mpm::test {
namespace {

template <class Law>
struct TangentProjectionTest : testing::Test {};
using Laws = testing::Types<NeoHookean<2>, NeoHookean<3>, SplitNeoHookean<2>, SplitNeoHookean<3>,
                            FixedCorotated<2>, FixedCorotated<3>, Hencky<2>, Hencky<3>>;
TYPED_TEST_SUITE(TangentProjectionTest, Laws);

TYPED_TEST(TangentProjectionTest, IsTheSemiDefinitePartOfTheTangent) {
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
    const ProjectedTangent<dim> tangent(law, F);
    const Full projected = matrix_of<dim>([&](const Mat<dim>& dF) { return tangent.apply(dF); });
    EXPECT_LE((projected - projected.transpose()).norm(), 1e-13 * projected.norm()) << name;
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
    if (is_definite) {
      EXPECT_LE((projected - exact).norm(), 1e-8 * exact.norm()) << name;
    }
  }
  EXPECT_GT(definite, 0);
  EXPECT_GT(indefinite, 0);
}

// On both sides of the gap where the quotient (P_a - P_b)/(s_a - s_b) gives way to its limit.
TYPED_TEST(TangentProjectionTest, IsRightForEveryGapOfTheStretches) {
  constexpr int dim = Traits<TypeParam>::dim;
  const auto law = Traits<TypeParam>::law();
  for (double gap = 1e-1; gap > 1e-13; gap /= 10) {
    Vec<dim> s = Vec<dim>::Constant(1.1);
    s(1) += gap;
    const Mat<dim> F = s.asDiagonal();
    const ProjectedTangent<dim> tangent(law, F);
    Mat<dim> shear = Mat<dim>::Zero();
    shear(0, 1) = 1;
    const Mat<dim> exact =
        to_matrix<dim>(law.first_piola_differential(to_tensor<dim>(F), to_tensor<dim>(shear)));
    EXPECT_LE((tangent.apply(shear) - exact).norm(), 3e-10 * exact.norm()) << gap;
  }
}

}  // namespace
}  // namespace mpm::test
