// The clamped strip of clamped_strip_test.cpp for every kernel, both reactions, and the particles' rows at two places.
#include "support/clamped_strip.hpp"

using namespace mpm;

namespace {

TEST(ClampedStripSlow, RunsAtTheLoadThatPays) {
  for (const KernelKind kernel : {KernelKind::linear, KernelKind::quadratic, KernelKind::cubic})
    for (const bool lumped : {false, true})
      for (const Real length : {0.5, 1.0, 2.0})
        for (const Real shift : {0.0, 0.25})
          test::check_load_of_running("6 fracture", {kernel, length, lumped, shift});
}

}  // namespace
