// Sand columns of four heights (verification.md section 5).
#include "support/sand_column.hpp"

namespace {

TEST(SandColumn, RunsOutAsMeasured) {
  mpm::test::verify_sand_columns("sand_column", {{0.5, 0.00125}, {1, 0.002}, {2, 0.004}, {4, 0.005}});
}

}  // namespace
