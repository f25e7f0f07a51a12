// A copper rod that hits a wall (verification.md section 5).
#include "support/taylor_bar.hpp"

using namespace mpm;

namespace {

constexpr Real pi = 3.14159265358979323846;

TEST(TaylorBar, AgainstItsMirrorImage) {
  test::verify_taylor_bar("two that meet, h = 0.5 mm", "mirror",
                          test::taylor_bar(test::mirrored_bar("0.0005"), pi / 2, 2));
}

TEST(TaylorBar, AgainstAWall) {
  test::verify_taylor_bar(
      "slip wall, h = 0.5 mm", "wall", test::taylor_bar({"grid.spacing=0.0005"}, pi / 2, 1));
}

}  // namespace
