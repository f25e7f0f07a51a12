// Sand columns on half the spacing.
#include "support/sand_column.hpp"

namespace {

TEST(SandColumnFine, RunsOutAsMeasured) {
  mpm::test::verify_sand_columns("sand_column_fine", {{0.5, 0.000625}, {1, 0.001}, {2, 0.002}, {4, 0.0025}});
}

}  // namespace
