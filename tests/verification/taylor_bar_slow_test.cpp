// The Taylor bar on a finer grid and with its whole cross section, without any wall.
#include "support/taylor_bar.hpp"

using namespace mpm;

namespace {

TEST(TaylorBar, WithItsWholeCrossSection) {
  std::vector<std::string> whole = test::mirrored_bar("0.0004");
  whole.push_back("domain.lower=[-0.01, -0.01, -0.034]");
  whole.push_back("body.0.shape.of.1.lower=[-0.004, -0.004, -0.033]");
  test::verify_taylor_bar("whole, two that meet, h = 0.4 mm", "whole",
                          test::taylor_bar(whole, 2 * 3.14159265358979323846, 2));
}

}  // namespace
