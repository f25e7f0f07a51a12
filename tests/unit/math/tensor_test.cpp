// Small tensors against Eigen, and packs against plain numbers.
#include "mpm_hpc/math/tensor.hpp"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/QR>
#include <random>

namespace mpm {
namespace {

template <class D>
struct TensorTest : testing::Test {
  static constexpr int dim = D::value;
  using M = Eigen::Matrix<double, dim, dim>;
  using T = Tensor<double, dim>;
  std::mt19937 generator{5};

  static M matrix(const T& a) {
    return Eigen::Map<const Eigen::Matrix<double, dim, dim, Eigen::RowMajor>>(a.m);
  }
  static M matrix(const SymTensor<double, dim>& a) {
    return M::NullaryExpr(
        [&](Eigen::Index i, Eigen::Index j) { return a(static_cast<int>(i), static_cast<int>(j)); });
  }
  T random() {
    std::normal_distribution<double> normal;
    T a;
    for (double& entry : a.m) entry = normal(generator);
    return a;
  }
};
using Dims = testing::Types<std::integral_constant<int, 2>, std::integral_constant<int, 3>>;
TYPED_TEST_SUITE(TensorTest, Dims);

TYPED_TEST(TensorTest, AgreesWithEigen) {
  constexpr int dim = TestFixture::dim;
  for (int i = 0; i < 50; ++i) {
    const auto a = this->random(), b = this->random();
    const auto A = this->matrix(a), B = this->matrix(b);
    EXPECT_NEAR(determinant(a), A.determinant(), 1e-13);
    EXPECT_LE((this->matrix(cofactor(a)) - A.determinant() * A.inverse().transpose()).norm(), 1e-12);
    EXPECT_LE((this->matrix(multiply(a, b)) - A * B).norm(), 1e-14);
    EXPECT_LE((this->matrix(a + b) - (A + B)).norm(), 1e-15);
    EXPECT_LE((this->matrix(a - 2.0 * b) - (A - 2 * B)).norm(), 1e-15);
    EXPECT_EQ(this->matrix(transpose(a)), A.transpose());
    EXPECT_NEAR(inner(a, b), A.cwiseProduct(B).sum(), 1e-14);
    EXPECT_EQ(this->matrix(Tensor<double, dim>::identity()), TestFixture::M::Identity());

    const auto symmetric = left_cauchy_green(a);
    const auto S = this->matrix(symmetric);
    EXPECT_LE((S - A * A.transpose()).norm(), 1e-13);
    EXPECT_NEAR(trace(symmetric), S.trace(), 1e-14);
    EXPECT_NEAR(norm(symmetric), S.norm(), 1e-13);
    EXPECT_LE((this->matrix(deviator(symmetric)) - (S - S.trace() / dim * TestFixture::M::Identity())).norm(),
              1e-13);
    EXPECT_LE((this->matrix(3.0 * symmetric) - 3 * S).norm(), 1e-13);
  }
}

TYPED_TEST(TensorTest, CofactorOfASingularTensorIsFinite) {
  constexpr int dim = TestFixture::dim;
  Tensor<double, dim> a{};
  for (int i = 0; i + 1 < dim; ++i) a(i, i) = 2;
  const auto c = this->matrix(cofactor(a));
  typename TestFixture::M expected = TestFixture::M::Zero();
  expected(dim - 1, dim - 1) = dim == 2 ? 2 : 4;
  EXPECT_EQ(c, expected);
}

TYPED_TEST(TensorTest, SymmetricEntriesFollowTheUpperTriangle) {
  constexpr int dim = TestFixture::dim;
  int next = 0;
  for (int i = 0; i < dim; ++i)
    for (int j = i; j < dim; ++j) {
      EXPECT_EQ((SymTensor<double, dim>::index(i, j)), next);
      EXPECT_EQ((SymTensor<double, dim>::index(j, i)), next++);
    }
  EXPECT_EQ(next, (SymTensor<double, dim>::size));
}

// Both bounds hold for indefinite tensors too; the invariant one doesn't depend on the frame, is exact in 2D,
// and in 3D for one large eigenvalue.
TYPED_TEST(TensorTest, EigenvalueBoundsHold) {
  constexpr int dim = TestFixture::dim;
  const auto symmetric = [](const typename TestFixture::M& S) {
    SymTensor<double, dim> s;
    for (int i = 0; i < dim; ++i)
      for (int j = i; j < dim; ++j) s(i, j) = S(i, j);
    return s;
  };
  for (int i = 0; i < 200; ++i) {
    const auto A = this->matrix(this->random());
    const typename TestFixture::M S = A + A.transpose();
    const double largest = Eigen::SelfAdjointEigenSolver<typename TestFixture::M>(S).eigenvalues().maxCoeff();
    EXPECT_GE(row_sum_bound(symmetric(S)), largest - 1e-13);
    EXPECT_GE(largest_eigenvalue_bound(symmetric(S)), largest - 1e-13);
    if (dim == 2) {
      EXPECT_NEAR(largest_eigenvalue_bound(symmetric(S)), largest, 1e-13);
    }

    const typename TestFixture::M Q = Eigen::HouseholderQR<typename TestFixture::M>(A).householderQ();
    EXPECT_NEAR(largest_eigenvalue_bound(symmetric(Q * S * Q.transpose())),
                largest_eigenvalue_bound(symmetric(S)), 1e-13);
    typename TestFixture::M uniaxial = TestFixture::M::Identity();
    uniaxial(0, 0) = 3;
    EXPECT_NEAR(largest_eigenvalue_bound(symmetric(Q * uniaxial * Q.transpose())), 3, 1e-13);
  }
}

TYPED_TEST(TensorTest, ColumnsAreReadAndWrittenByComponent) {
  constexpr int dim = TestFixture::dim, sym = SymTensor<double, dim>::size;
  alignas(64) float columns[dim * dim][32], results[sym][32] = {};
  const float* in[dim * dim];
  float* out[sym];
  for (int k = 0; k < dim * dim; ++k) {
    for (int p = 0; p < 32; ++p) columns[k][p] = static_cast<float>(100 * k + p);
    in[k] = columns[k];
  }
  for (int k = 0; k < sym; ++k) out[k] = results[k];

  const auto one = load_tensor<double, dim>(in, 21);
  const auto floats = load_tensor<Pack<float>, dim>(in, 16);
  const auto doubles = load_tensor<Pack<double>, dim>(in, 16);
  for (int k = 0; k < dim * dim; ++k) {
    EXPECT_EQ(one.m[k], 100 * k + 21);
    EXPECT_EQ(floats.m[k][5], 100 * k + 21);
    EXPECT_EQ(doubles.m[k][5], 100 * k + 21);
  }
  SymTensor<Pack<double>, dim> s;
  for (int k = 0; k < sym; ++k) s.m[k] = Pack<double>::LinSpaced(10 * k, 10 * k + 7);
  store_tensor(out, 8, s);
  for (int k = 0; k < sym; ++k) {
    EXPECT_EQ(results[k][7], 0);
    for (int lane = 0; lane < 8; ++lane) EXPECT_EQ(results[k][8 + lane], 10 * k + lane);
    EXPECT_EQ(results[k][16], 0);
  }
}

}  // namespace
}  // namespace mpm
