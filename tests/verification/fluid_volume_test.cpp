// J of a fluid in strong shear (verification.md section 4): the column that fluids keep, against det F, both in single precision.
#include <cmath>

#include "mpm_hpc/materials/linear_fluid.hpp"
#include "mpm_hpc/materials/material_loops.hpp"
#include "mpm_hpc/materials/neo_hookean.hpp"
#include "support/verification.hpp"
#include "unit/materials/test_columns.hpp"

using namespace mpm;
using namespace mpm::test;

namespace {

constexpr int steps = 10000, W = pack_width<float>;

// Largest distance of J from `expected` after all steps with this gradient of velocity, over the pack.
template <class Loops>
Real error_of_volume(const Loops& material, const float (&gradient)[4], Real expected) {
  Columns<float> F{4, W}, own{1, W}, G{4, W};
  MaterialColumns<2, float> columns;
  for (int c = 0; c < 4; ++c) {
    std::fill_n(F[c], W, c % 3 == 0 ? 1.0f : 0.0f);
    std::fill_n(G[c], W, gradient[c]);
    if (material.needs_deformation_gradient()) columns.F[c] = F[c];
  }
  columns.own[0] = own[0];
  for (int n = 0; n < steps; ++n) material.advance(columns, G.data(), {.dt = 1}, 0, W);
  Real worst = 0;
  for (int p = 0; p < W; ++p) {
    const Real J = material.needs_deformation_gradient()
                       ? Real(F[0][p]) * Real(F[3][p]) - Real(F[1][p]) * Real(F[2][p])
                       : 1 + Real(own[0][p]);
    worst = std::max(worst, std::abs(J - expected));
  }
  return worst;
}

// Shear along a direction that no axis is aligned with, and a compression by a thousandth.
TEST(FluidVolume, InShear) {
  const MaterialLoops<LinearFluid, 2> water({.name = "water", .density = 1000}, [] {
    LinearFluid law;
    law.bulk_modulus = 2.2e9;
    return law;
  }());
  const MaterialLoops<NeoHookean<2>, 2> solid({.name = "solid", .density = 1000}, NeoHookean<2>{1e6, 1e6});
  Curve curve{"fluid_volume", true, {"shear", "error of J, the fluid's column", "error of J = det F"}, {}};
  const Real c = std::cos(0.5), s = std::sin(0.5);
  for (const Real shear : {10.0, 100.0, 1000.0}) {
    const Real a = shear / steps, squeeze = -0.5e-3 / steps;
    const float G[4] = {static_cast<float>(squeeze - a * c * s), static_cast<float>(a * c * c),
                        static_cast<float>(-a * s * s), static_cast<float>(squeeze + a * c * s)};
    const Real expected = std::pow(1 + (Real(G[0]) + Real(G[3])), steps);
    const Real kept = error_of_volume(water, G, expected), lost = error_of_volume(solid, G, expected);
    const std::string at = fmt::format("J in single precision after shear by {}: error of ", shear);
    verify("4 fluids", at + "the fluid's column", kept, at_most(1e-6));
    // Rounding one F costs det F about 1e-7 times the squared shear; ten thousand steps add theirs.
    verify("4 fluids", at + "det F", lost, at_least(1e-7 * shear * shear / 10));
    curve.rows.push_back({shear, kept, lost});
  }
  curve.write();
}

}  // namespace
