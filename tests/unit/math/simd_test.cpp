// Packs lane by lane: choices with NaN, conversions, and the functions that are ours.
#include "mpm_hpc/math/simd.hpp"

#include <gtest/gtest.h>

#include <random>

namespace mpm {
namespace {

template <class S>
struct SimdTest : testing::Test {
  using Scalar = typename PackTraits<S>::Scalar;
  static constexpr int width = PackTraits<S>::width;
  static Scalar lane(const S& s, int i) {
    if constexpr (width == 1) {
      return s;
    } else {
      return s[i];
    }
  }
};
using Scalars = testing::Types<double, float, Pack<double>, Pack<float>, Eigen::Array<double, 4, 1>>;
TYPED_TEST_SUITE(SimdTest, Scalars);

TYPED_TEST(SimdTest, SelectLessChoosesLaneByLane) {
  using T = typename TestFixture::Scalar;
  constexpr T nan = std::numeric_limits<T>::quiet_NaN(), infinity = std::numeric_limits<T>::infinity();
  const T values[] = {-infinity, -2, -0.0f, 0, 1, infinity, nan};
  for (const T a : values)
    for (const T b : values) {
      alignas(64) T left[64], right[64];
      for (int i = 0; i < 64; ++i) {  // every other lane swapped
        left[i] = i % 2 ? a : b;
        right[i] = i % 2 ? b : a;
      }
      const auto chosen = select_less<TypeParam>(load<TypeParam>(left), load<TypeParam>(right),
                                                 broadcast<TypeParam>(3.0), broadcast<TypeParam>(4.0));
      for (int i = 0; i < TestFixture::width; ++i)
        EXPECT_EQ(this->lane(chosen, i), left[i] < right[i] ? 3 : 4);
    }
}

TYPED_TEST(SimdTest, LoadAndStoreConvert) {
  constexpr int width = TestFixture::width;
  const auto round_trip = [&](auto type) {
    using T = decltype(type);
    alignas(64) T in[64], out[64] = {};
    for (int i = 0; i < 64; ++i) in[i] = static_cast<T>(i) / 8;
    const TypeParam value = load<TypeParam>(in + 2 * width);
    for (int i = 0; i < width; ++i) EXPECT_EQ(this->lane(value, i), in[2 * width + i]);
    store(out + width, value);
    for (int i = 0; i < width; ++i) EXPECT_EQ(out[width + i], in[2 * width + i]);
    EXPECT_EQ(out[2 * width], 0);
  };
  round_trip(double{});
  round_trip(float{});
}

TYPED_TEST(SimdTest, InverseCubeRootIsRightToTwoUlp) {
  using T = typename TestFixture::Scalar;
  constexpr int width = TestFixture::width;
  std::mt19937 generator(17);
  std::uniform_real_distribution<double> exponent(-12, 12), near_one(0.5, 2);
  double worst = 0;
  for (int i = 0; i < 20000; ++i) {
    alignas(64) T in[16], out[16];
    for (int lane = 0; lane < width; ++lane)
      in[lane] = static_cast<T>(i % 2 ? std::pow(10, exponent(generator)) : near_one(generator));
    store(out, inverse_cube_root<TypeParam>(load<TypeParam>(in)));
    for (int lane = 0; lane < width; ++lane) {
      const long double exact = 1 / std::cbrt(static_cast<long double>(in[lane]));
      worst = std::max(worst, std::abs(static_cast<double>((out[lane] - exact) / exact)));
    }
  }
  EXPECT_LE(worst, 2 * std::numeric_limits<T>::epsilon());
}

TYPED_TEST(SimdTest, InverseCubeRootOfSpecialNumbers) {
  using T = typename TestFixture::Scalar;
  const auto of = [&](T a) { return this->lane(inverse_cube_root<TypeParam>(broadcast<TypeParam>(a)), 0); };
  EXPECT_EQ(of(1), 1);
  EXPECT_EQ(of(8), T(0.5));
  for (const T bad : {T(0), T(-1), -std::numeric_limits<T>::infinity(), std::numeric_limits<T>::quiet_NaN()})
    EXPECT_TRUE(std::isnan(of(bad))) << bad;
}

// Eigen's log and exp in packs are as good as the C library's.
TYPED_TEST(SimdTest, ElementaryFunctionsAreRightToTwoUlp) {
  using T = typename TestFixture::Scalar;
  for (const double a : {1e-3, 0.2, 0.99, 1.0, 1.01, 7.0, 1e4}) {
    const T x = static_cast<T>(a), tolerance = 2 * std::numeric_limits<T>::epsilon();
    const auto near = [&](const TypeParam& value, double expected) {
      EXPECT_NEAR(this->lane(value, 0), expected, tolerance * std::abs(expected)) << a;
    };
    near(log_of<TypeParam>(broadcast<TypeParam>(x)), std::log(static_cast<double>(x)));
    near(sqrt_of<TypeParam>(broadcast<TypeParam>(x)), std::sqrt(static_cast<double>(x)));
    near(exp_of<TypeParam>(broadcast<TypeParam>(-x / 1000)), std::exp(static_cast<double>(-x / 1000)));
    near(abs_of<TypeParam>(broadcast<TypeParam>(-x)), x);
  }
}

template <class T>
struct SmallArguments : testing::Test {};
using SmallScalars = testing::Types<float, double>;
TYPED_TEST_SUITE(SmallArguments, SmallScalars);

// log(1 + a), exp(a) - 1 and 1 / sqrt(a) on both sides of where their series end, with all digits.
TYPED_TEST(SmallArguments, KeepTheirDigits) {
  using T = TypeParam;
  using S = Pack<T>;
  const double tolerance = 4 * std::numeric_limits<T>::epsilon();
  for (const double largest : {1e-12, 1e-3, 0.2, 0.3, 0.7}) {
    S a;
    for (int lane = 0; lane < pack_width<T>; ++lane)
      a[lane] = static_cast<T>(largest * (1 - 2.0 * lane / (pack_width<T> - 1)));
    const S logarithm = log1p_of<S>(a), exponential = expm1_of<S>(a), root = inverse_sqrt_of<S>(S(S::Ones() + a));
    for (int lane = 0; lane < pack_width<T>; ++lane) {
      const double x = a[lane], one_more = T(1) + a[lane];
      EXPECT_NEAR(logarithm[lane], std::log1p(x), tolerance * std::abs(std::log1p(x))) << x;
      EXPECT_NEAR(exponential[lane], std::expm1(x), tolerance * std::abs(std::expm1(x))) << x;
      EXPECT_NEAR(root[lane], 1 / std::sqrt(one_more), tolerance / std::sqrt(one_more)) << x;
    }
  }
  const S nan = S::Constant(std::numeric_limits<T>::quiet_NaN());
  EXPECT_TRUE(log1p_of<S>(nan).isNaN().all());
  EXPECT_TRUE(expm1_of<S>(nan).isNaN().all());
}

}  // namespace
}  // namespace mpm
