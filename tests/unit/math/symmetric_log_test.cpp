// Logarithms of packs of tensors against those of their eigenvalues, on both sides of where the series ends.
#include "mpm_hpc/math/symmetric_log.hpp"

#include <Eigen/Eigenvalues>
#include <random>

#include "support/typed_cases.hpp"

namespace mpm {
namespace {

template <class C>
struct SymmetricLogTest : testing::Test {};
TYPED_TEST_SUITE(SymmetricLogTest, test::EveryCase);

TYPED_TEST(SymmetricLogTest, IsTheLogarithmOfTheEigenvalues) {
  constexpr int Dim = TypeParam::Dim;
  using T = typename TypeParam::T;
  using S = Pack<T>;
  std::mt19937 generator(11);
  std::normal_distribution<double> normal;
  for (const double strain : {1e-6, 1e-3, 0.03, 0.06, 0.1, 0.5}) {
    SymTensor<S, Dim> A;
    for (int lane = 0; lane < pack_width<T>; ++lane) {
      const Mat<Dim> H = Mat<Dim>::NullaryExpr([&] { return strain * normal(generator) / Dim; });
      const Mat<Dim> F = Mat<Dim>::Identity() + H, b = F * F.transpose();
      for (int i = 0; i < Dim; ++i)
        for (int j = i; j < Dim; ++j) A(i, j)[lane] = static_cast<T>(b(i, j));
    }
    const SymTensor<S, Dim> logarithm = symmetric_log(A);
    for (int lane = 0; lane < pack_width<T>; ++lane) {
      Mat<Dim> b, found;
      SymTensor<T, Dim> one;
      for (int i = 0; i < Dim; ++i)
        for (int j = 0; j < Dim; ++j) {
          b(i, j) = A(i, j)[lane];
          one(i, j) = A(i, j)[lane];
          found(i, j) = logarithm(i, j)[lane];
        }
      const Eigen::SelfAdjointEigenSolver<Mat<Dim>> eigen(b);
      const Mat<Dim> expected = eigen.eigenvectors() *
                                eigen.eigenvalues().array().log().matrix().asDiagonal() *
                                eigen.eigenvectors().transpose();
      const double tolerance = 10 * std::numeric_limits<T>::epsilon() / eigen.eigenvalues()[0];
      EXPECT_LE((found - expected).norm(), tolerance) << strain;
      const SymTensor<T, Dim> plain = symmetric_log(one);
      for (int k = 0; k < one.size; ++k) EXPECT_NEAR(plain.m[k], logarithm.m[k][lane], tolerance) << strain;
    }
  }
}

TYPED_TEST(SymmetricLogTest, OfTheUnitTensorIsZeroAndNearItExact) {
  constexpr int Dim = TypeParam::Dim;
  using T = typename TypeParam::T;
  SymTensor<T, Dim> unit;
  for (int i = 0; i < Dim; ++i)
    for (int j = i; j < Dim; ++j) unit(i, j) = T(i == j);
  for (const T x : symmetric_log(unit).m) EXPECT_EQ(x, 0);
  // Of little more it keeps all digits of the difference.
  const T more = std::ldexp(T(1), -20);
  unit(0, 0) += more;
  EXPECT_NEAR(symmetric_log(unit)(0, 0), std::log1p(more), 4 * std::numeric_limits<T>::epsilon() * more);
}

}  // namespace
}  // namespace mpm
