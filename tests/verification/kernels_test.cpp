// Moments of the kernels, from one side of a stencil to the other (verification.md section 1).
#include <cmath>

#include "mpm_hpc/math/bspline.hpp"
#include "support/verification.hpp"

using namespace mpm;

namespace {

// sum w = 1, sum g = 0, sum w (x_i - x) = 0, sum g x_i = 1, sum w (x_i - x)^2 = D; g is the derivative of w; and the bound of
// sum g^2 / w that step sizes rely on.
template <class Kernel>
void verify_moments() {
  Real largest = 0, worst = 0, worst_slope = 0;
  const auto differs = [&](Real value, Real expected) {
    worst = std::max(worst, std::abs(value - expected));
  };
  for (int i = 0; i < 1000; ++i) {
    const Real fx = Kernel::shift + i / 1000.0, step = 1e-6;
    Real w[Kernel::support], g[Kernel::support], above[Kernel::support], below[Kernel::support];
    Kernel::weights(fx, w);
    Kernel::gradients(fx, g);
    Kernel::weights(fx + step, above);
    Kernel::weights(fx - step, below);
    Real sum = 0, slope = 0, first = 0, identity = 0, second = 0, stiffness = 0;
    for (int n = 0; n < Kernel::support; ++n) {
      sum += w[n];
      slope += g[n];
      first += w[n] * (n - fx);
      identity += g[n] * n;
      second += w[n] * (n - fx) * (n - fx);
      if (w[n] > 1e-12) stiffness += g[n] * g[n] / w[n];
      worst_slope = std::max(worst_slope, std::abs(g[n] - (above[n] - below[n]) / (2 * step)));
    }
    differs(sum, 1);
    differs(slope, 0);
    differs(first, 0);
    differs(identity, 1);
    differs(second, Kernel::inertia(fx));
    if constexpr (Kernel::has_inertia) differs(second * Kernel::inverse_inertia, 1);
    largest = std::max(largest, stiffness);
  }
  const std::string section = "1 transfers", name = fmt::format("{} kernel: ", Kernel::name);
  test::verify(section, name + "largest error of the moments", worst, test::at_most(1e-14));
  test::verify(section, name + "largest error of the slopes against differences", worst_slope,
               test::at_most(1e-9));
  if constexpr (Kernel::has_inertia)
    test::verify(section, name + "largest sum g^2 / w", largest,
                 test::between(0.95 * Kernel::gradient_stiffness, Kernel::gradient_stiffness));
}

TEST(Kernels, Moments) {
  verify_moments<LinearKernel>();
  verify_moments<QuadraticKernel>();
  verify_moments<CubicKernel>();
}

}  // namespace
