// The clamped strip of clamped_strip_test.cpp for every kernel, both reactions, and the particles' rows at two places.
#include "support/clamped_strip.hpp"

using namespace mpm;

namespace {

void check(KernelKind kernel, Real shift) {
  for (const bool lumped : {false, true})
    for (const Real length : {0.5, 1.0, 2.0})
      for (const Real place : {0.0, shift})
        test::check_load_of_running("6 fracture", {kernel, length, lumped, place});
}

// Not at a quarter of a cell, which brings rows onto nodes, where this kernel has two slopes.
TEST(ClampedStripSlow, LinearRunsAtTheLoadThatPays) { check(KernelKind::linear, 0.2); }
TEST(ClampedStripSlow, QuadraticRunsAtTheLoadThatPays) { check(KernelKind::quadratic, 0.25); }
TEST(ClampedStripSlow, CubicRunsAtTheLoadThatPays) { check(KernelKind::cubic, 0.25); }

}  // namespace
