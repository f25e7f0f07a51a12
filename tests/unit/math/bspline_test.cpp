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

}  // namespace
