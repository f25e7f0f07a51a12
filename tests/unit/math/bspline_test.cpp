// The kernels' weights in their two forms.
#include "mpm_hpc/math/bspline.hpp"

#include <gtest/gtest.h>

using namespace mpm;

namespace {

template <class T>
void expect_quad_equals_weights(T tolerance) {
  for (T fx : {T(0.5), T(0.51), T(0.8), T(1), T(1.3), T(1.4999)}) {
    T w[3];
    QuadraticKernel::weights(fx, w);
    const Quad<T> quad = QuadraticKernel::weight_quad(fx);
    for (int n = 0; n < 3; ++n) EXPECT_NEAR(quad[n], w[n], tolerance) << "fx " << fx << ", node " << n;
    EXPECT_EQ(quad[3], 0);  // row stages rely on it
  }
}

TEST(Bspline, QuadraticWeightsInOneRegister) {
  expect_quad_equals_weights(4e-16);
  expect_quad_equals_weights(2e-7f);
}

// verification.md section 1: sum w = 1, sum g = 0, sum w (x_i - x) = 0, sum g x_i = 1, sum w (x_i - x)^2 = D; and the
// bound of sum g^2 / w that step sizes rely on.
template <class Kernel>
void check_moments() {
  double largest = 0;
  for (int i = 0; i < 1000; ++i) {
    const double fx = Kernel::shift + i / 1000.0;
    double w[Kernel::support], g[Kernel::support];
    Kernel::weights(fx, w);
    Kernel::gradients(fx, g);
    double sum = 0, slope = 0, first = 0, identity = 0, second = 0, stiffness = 0;
    for (int n = 0; n < Kernel::support; ++n) {
      sum += w[n];
      slope += g[n];
      first += w[n] * (n - fx);
      identity += g[n] * n;
      second += w[n] * (n - fx) * (n - fx);
      if (w[n] > 1e-12) stiffness += g[n] * g[n] / w[n];
      const double step = 1e-6;
      double above[Kernel::support], below[Kernel::support];
      Kernel::weights(fx + step, above);
      Kernel::weights(fx - step, below);
      EXPECT_NEAR(g[n], (above[n] - below[n]) / (2 * step), 1e-9) << Kernel::name << " " << fx << " " << n;
    }
    EXPECT_NEAR(sum, 1, 1e-14) << Kernel::name << " " << fx;
    EXPECT_NEAR(slope, 0, 1e-14);
    EXPECT_NEAR(first, 0, 1e-14);
    EXPECT_NEAR(identity, 1, 1e-14);
    EXPECT_NEAR(second, Kernel::inertia(fx), 1e-14);
    if constexpr (Kernel::has_inertia) EXPECT_NEAR(second * Kernel::inverse_inertia, 1, 1e-14);
    largest = std::max(largest, stiffness);
  }
  std::printf("%s: largest sum g^2/w %.4f, assumed %.4f\n", Kernel::name, largest, Kernel::gradient_stiffness);
  if constexpr (Kernel::has_inertia) {
    EXPECT_LE(largest, Kernel::gradient_stiffness);
    EXPECT_GE(largest, 0.95 * Kernel::gradient_stiffness);
  }
}

TEST(Bspline, Moments) {
  check_moments<LinearKernel>();
  check_moments<QuadraticKernel>();
  check_moments<CubicKernel>();
}

}  // namespace
