// Eigenvalues of packs of tensors against Eigen's solver, one tensor at a time.
#include "mpm_hpc/math/symmetric_eigen.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <random>

#include "mpm_hpc/base/types.hpp"
#include "support/typed_cases.hpp"

namespace mpm {
namespace {

template <class C>
struct SymmetricEigenTest : testing::Test {};
TYPED_TEST_SUITE(SymmetricEigenTest, test::EveryCase);

// Random, repeated and nearly repeated values, strong compression and stretch, diagonal tensors, negative values, zero.
template <int Dim>
std::vector<Mat<Dim>> samples() {
  std::mt19937 generator(3);
  std::normal_distribution<double> normal;
  const auto rotated = [&](const Vec<Dim>& values) -> Mat<Dim> {
    const Mat<Dim> random = Mat<Dim>::NullaryExpr([&] { return normal(generator); });
    const Mat<Dim> Q = Eigen::HouseholderQR<Mat<Dim>>(random).householderQ();
    return Q * values.asDiagonal() * Q.transpose();
  };
  std::vector<Mat<Dim>> list;
  for (int i = 0; i < 100; ++i) {
    list.push_back(rotated(Vec<Dim>::NullaryExpr([&] { return std::exp(normal(generator)); })));
    list.push_back(rotated(Vec<Dim>::NullaryExpr([&] { return normal(generator); })));
    Vec<Dim> values = Vec<Dim>::Constant(0.8);
    list.push_back(rotated(values));
    values[0] = 1.3;
    list.push_back(rotated(values));
    for (const double gap : {1e-3, 1e-8, 1e-12, 1e-15}) {
      values = Vec<Dim>::Constant(1.1);
      values[Dim - 1] += gap;
      list.push_back(rotated(values));
    }
    for (const double ratio : {1e-4, 1e4}) {
      values = Vec<Dim>::Constant(1.0);
      values[0] = ratio;
      list.push_back(rotated(values));
    }
  }
  list.push_back(Mat<Dim>::Identity());
  list.push_back(Mat<Dim>::Zero());
  list.push_back(Vec<Dim>::LinSpaced(-1, 2).asDiagonal());
  Mat<Dim> swap = Mat<Dim>::Zero();
  swap(0, 1) = swap(1, 0) = 1;
  list.push_back(swap);
  swap(0, 1) = swap(1, 0) = 1e-18;
  list.push_back(swap);
  while (list.size() % 16 != 0) list.push_back(list.back());
  return list;
}

TYPED_TEST(SymmetricEigenTest, EqualsEigensSolver) {
  constexpr int Dim = TypeParam::Dim;
  using T = typename TypeParam::T;
  using S = Pack<T>;
  constexpr int W = pack_width<T>;
  const double epsilon = std::numeric_limits<T>::epsilon();
  const auto list = samples<Dim>();
  for (std::size_t first = 0; first < list.size(); first += W) {
    SymTensor<S, Dim> A;
    for (int i = 0; i < Dim; ++i)
      for (int j = i; j < Dim; ++j)
        for (int lane = 0; lane < W; ++lane) A(i, j)[lane] = static_cast<T>(list[first + lane](i, j));
    const SymmetricEigen<S, Dim> eigen = symmetric_eigen(A);
    const SymTensor<S, Dim> again = eigen.with_values(eigen.values);
    for (int lane = 0; lane < W; ++lane) {
      Mat<Dim> a, V, composed;
      Vec<Dim> values;
      for (int i = 0; i < Dim; ++i) {
        values[i] = eigen.values[i][lane];
        for (int j = 0; j < Dim; ++j) {
          a(i, j) = A(i, j)[lane];
          composed(i, j) = again(i, j)[lane];
          V(i, j) = eigen.vectors(i, j)[lane];
        }
      }
      const double size = a.norm();
      std::sort(values.data(), values.data() + Dim);
      const Vec<Dim> expected = Eigen::SelfAdjointEigenSolver<Mat<Dim>>(a).eigenvalues();
      EXPECT_LE((values - expected).norm(), 8 * epsilon * size) << a;
      EXPECT_LE((V.transpose() * V - Mat<Dim>::Identity()).norm(), 40 * epsilon) << a;
      EXPECT_NEAR(V.determinant(), 1, 40 * epsilon);
      EXPECT_LE((composed - a).norm(), 20 * epsilon * size) << a;
      // Packs do what plain numbers do.
      SymTensor<T, Dim> one;
      for (int k = 0; k < one.size; ++k) one.m[k] = A.m[k][lane];
      const SymmetricEigen<T, Dim> plain = symmetric_eigen(one);
      for (int k = 0; k < Dim; ++k) EXPECT_NEAR(plain.values[k], eigen.values[k][lane], 8 * epsilon * size);
    }
  }
}

TYPED_TEST(SymmetricEigenTest, ANaNStaysInItsLane) {
  constexpr int Dim = TypeParam::Dim;
  using T = typename TypeParam::T;
  using S = Pack<T>;
  SymTensor<S, Dim> A;
  for (int k = 0; k < A.size; ++k) A.m[k] = S::Constant(T(k + 1));
  const SymmetricEigen<S, Dim> sound = symmetric_eigen(A);
  A(0, 1)[3] = std::numeric_limits<T>::quiet_NaN();
  const SymmetricEigen<S, Dim> eigen = symmetric_eigen(A);
  for (int lane = 0; lane < pack_width<T>; ++lane)
    for (int k = 0; k < 2; ++k) {
      EXPECT_EQ(std::isnan(eigen.values[k][lane]), lane == 3);
      if (lane != 3) {
        EXPECT_NEAR(eigen.values[k][lane], sound.values[k][lane], 20 * std::numeric_limits<T>::epsilon());
      }
    }
}

}  // namespace
}  // namespace mpm
