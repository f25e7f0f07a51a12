// Two discs on grids on which the rebound loses less than a hundredth of the energy.
#include "support/two_discs.hpp"

namespace {

TEST(TwoDiscsFine, Apic) { mpm::test::two_discs("apic", 1.0 / 400, 1, 0); }
TEST(TwoDiscsFine, Flip) { mpm::test::two_discs("flip", 1.0 / 320, 0.4, 0); }

}  // namespace
