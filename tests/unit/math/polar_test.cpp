// The rotation of a polar decomposition: Newton's iteration against singular values, and where it must give way to them.
#include "mpm_hpc/math/polar.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <random>
#include <vector>

using namespace mpm;

namespace {

template <int Dim>
using Matrix = Eigen::Matrix<double, Dim, Dim>;

template <int Dim>
Matrix<Dim> random_rotation(std::mt19937& random) {
  std::normal_distribution<double> normal;
  const Matrix<Dim> a = Matrix<Dim>::NullaryExpr([&] { return normal(random); });
  Matrix<Dim> q = Eigen::HouseholderQR<Matrix<Dim>>(a).householderQ();
  if (q.determinant() < 0) q.col(0) *= -1;
  return q;
}

// F = U diag(s) V^T with U, V rotations has the rotation U V^T, if the stretches are positive, or the smallest one alone
// is negative.
template <int Dim>
struct Sample {
  Matrix<Dim> F, R;
};
template <int Dim>
Sample<Dim> sample(const Eigen::Matrix<double, Dim, 1>& s, std::mt19937& random) {
  const Matrix<Dim> U = random_rotation<Dim>(random), V = random_rotation<Dim>(random);
  return {U * s.asDiagonal() * V.transpose(), U * V.transpose()};
}

template <class T, int Dim>
void expect_rotations(const std::vector<Sample<Dim>>& samples, double tolerance) {
  using S = Pack<T>;
  constexpr int W = pack_width<T>;
  ASSERT_EQ(samples.size() % W, 0u);
  for (std::size_t first = 0; first < samples.size(); first += W) {
    Tensor<S, Dim> F;
    for (int l = 0; l < W; ++l)
      for (int k = 0; k < Dim * Dim; ++k) F.m[k][l] = static_cast<T>(samples[first + l].F(k / Dim, k % Dim));
    const Tensor<S, Dim> R = rotation_of(F);
    for (int l = 0; l < W; ++l) {
      Tensor<T, Dim> one;
      Matrix<Dim> pack, number;
      for (int k = 0; k < Dim * Dim; ++k) one.m[k] = F.m[k][l];
      const Tensor<T, Dim> r = rotation_of(one);
      for (int k = 0; k < Dim * Dim; ++k) {
        pack(k / Dim, k % Dim) = R.m[k][l];
        number(k / Dim, k % Dim) = r.m[k];
      }
      EXPECT_LT((pack - samples[first + l].R).norm(), tolerance) << "F =\n" << samples[first + l].F;
      EXPECT_LT((number - samples[first + l].R).norm(), tolerance) << "F =\n" << samples[first + l].F;
    }
  }
}

template <int Dim>
std::vector<Sample<Dim>> samples_between(double smallest, double largest, bool inverted) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> exponent(std::log(smallest), std::log(largest));
  std::vector<Sample<Dim>> samples;
  for (int i = 0; i < 64; ++i) {
    Eigen::Matrix<double, Dim, 1> s;
    for (int a = 0; a < Dim; ++a) s(a) = std::exp(exponent(random));
    std::sort(s.data(), s.data() + Dim, std::greater<>());
    // The rotation of an inverted F is determined as well as the two smallest singular values differ.
    if (inverted && i % 3 == 0) s(Dim - 1) *= -0.7;
    samples.push_back(sample<Dim>(s, random));
  }
  return samples;
}

TEST(Polar, RotationOfModerateStretches) {
  expect_rotations<double, 2>(samples_between<2>(0.5, 2, false), 1e-14);
  expect_rotations<double, 3>(samples_between<3>(0.5, 2, false), 1e-14);
  expect_rotations<float, 2>(samples_between<2>(0.5, 2, false), 2e-6);
  expect_rotations<float, 3>(samples_between<3>(0.5, 2, false), 2e-6);
}

// R is as uncertain as F's rounding over its two smallest stretches.
TEST(Polar, RotationOfExtremeStretches) {
  expect_rotations<double, 2>(samples_between<2>(1e-3, 1e3, false), 1e-9);
  expect_rotations<double, 3>(samples_between<3>(1e-3, 1e3, false), 1e-9);
}

// Some lanes of a pack turned inside out: they go the slow way, the others are as before.
TEST(Polar, RotationOfInvertedLanes) {
  expect_rotations<double, 2>(samples_between<2>(0.5, 2, true), 1e-12);
  expect_rotations<double, 3>(samples_between<3>(0.5, 2, true), 1e-12);
}

template <int Dim>
void expect_a_rotation(const Matrix<Dim>& F) {
  Tensor<double, Dim> t;
  for (int k = 0; k < Dim * Dim; ++k) t.m[k] = F(k / Dim, k % Dim);
  const Tensor<double, Dim> r = rotation_of(t);
  Matrix<Dim> R;
  for (int k = 0; k < Dim * Dim; ++k) R(k / Dim, k % Dim) = r.m[k];
  EXPECT_LT((R * R.transpose() - Matrix<Dim>::Identity()).norm(), 1e-14) << F;
  EXPECT_NEAR(R.determinant(), 1, 1e-14) << F;
}

TEST(Polar, SingularMatricesHaveSomeRotation) {
  expect_a_rotation<2>(Matrix<2>::Zero());
  expect_a_rotation<3>(Matrix<3>::Zero());
  expect_a_rotation<2>(Matrix<2>{{1, 0}, {0, -1}});
  expect_a_rotation<3>(Matrix<3>{{1, 2, 0}, {2, 4, 0}, {0, 0, 1}});
}

TEST(Polar, NotFiniteStaysSo) {
  Tensor<double, 3> F = Tensor<double, 3>::identity();
  F(0, 1) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_TRUE(std::isnan(rotation_of(F)(0, 0)));
}

}  // namespace
