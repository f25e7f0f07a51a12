// Tests that misbehave on purpose; tests/checks/check_mpi_harness.sh runs them one by one and looks at what
// the harness makes of each.
#include <gtest/gtest.h>
#include <mpi.h>

#include <fstream>

#include "support/mpi_test.hpp"

namespace mpm::test {
namespace {

TEST(HarnessFaults, Passes) {
  SharedTemporaryFolder folder;
  if (rank() == 0) std::ofstream(folder / "written_by_rank_0") << "text";
  ASSERT_TRUE(all_ranks_ok(true));
  EXPECT_TRUE(std::filesystem::exists(folder / "written_by_rank_0"));
  EXPECT_FALSE(all_ranks_ok(rank() != size() - 1));
}

TEST(HarnessFaults, FailsOnTheLastRank) { EXPECT_NE(rank(), size() - 1) << "planted"; }

TEST(HarnessFaults, ThrowsOnTheLastRank) {
  if (rank() == size() - 1) throw std::runtime_error("planted");
}

TEST(HarnessFaults, LeavesTheOthersInABarrier) {
  ASSERT_NE(rank(), size() - 1) << "planted";
  MPI_Barrier(MPI_COMM_WORLD);
}

TEST(HarnessFaults, WaitsForAMessageThatNobodySends) {
  int received = 0;
  if (rank() == 0) MPI_Recv(&received, 1, MPI_INT, MPI_ANY_SOURCE, 7, MPI_COMM_WORLD, MPI_STATUS_IGNORE);
}

TEST(HarnessFaults, LeaksOnTheLastRank) {
  static int* volatile leaked = nullptr;
  if (rank() == size() - 1) {
    leaked = new int[1000];
    leaked = nullptr;
  }
}

TEST(HarnessFaults, OverflowsOnTheLastRank) {
  volatile int largest = 2147483647;
  if (rank() == size() - 1) largest = largest + 1;
}

}  // namespace
}  // namespace mpm::test
