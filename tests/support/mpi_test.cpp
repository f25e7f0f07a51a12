#include "support/mpi_test.hpp"

#include <mpi.h>

#include <cstdio>
#include <stdexcept>

#include "support/temporary_folder.hpp"

namespace mpm::test {

int rank() {
  int rank = 0;
  MPI_Comm_rank(MPI_COMM_WORLD, &rank);
  return rank;
}

int size() {
  int size = 1;
  MPI_Comm_size(MPI_COMM_WORLD, &size);
  return size;
}

bool all_ranks_ok(bool ok) {
  int all = ok ? 1 : 0;
  MPI_Allreduce(MPI_IN_PLACE, &all, 1, MPI_INT, MPI_MIN, MPI_COMM_WORLD);
  return all == 1;
}

SharedTemporaryFolder::SharedTemporaryFolder() {
  std::string name;
  if (rank() == 0) {
    try {
      name = make_temporary_folder().string();
    } catch (const std::exception& error) {
      std::fprintf(stderr, "%s\n", error.what());
    }
  }
  int length = static_cast<int>(name.size());
  MPI_Bcast(&length, 1, MPI_INT, 0, MPI_COMM_WORLD);
  if (length == 0) throw std::runtime_error("rank 0 could not create a temporary folder");
  name.resize(length);
  MPI_Bcast(name.data(), length, MPI_CHAR, 0, MPI_COMM_WORLD);
  path_ = name;
}

SharedTemporaryFolder::~SharedTemporaryFolder() {
  MPI_Barrier(MPI_COMM_WORLD);  // nobody writes any more
  std::error_code ignored;
  if (rank() == 0) std::filesystem::remove_all(path_, ignored);
}

}  // namespace mpm::test
