// The MPI communicator behind a Communicator, for the layers that may name MPI (parallel, solvers, io, apps).
#pragma once

#include <mpi.h>

#include "mpm_hpc/parallel/communicator.hpp"

namespace mpm {

struct Communicator::Handle {
  MPI_Comm comm = MPI_COMM_NULL;
  MPI_Datatype sum_pair = MPI_DATATYPE_NULL;
  MPI_Op compensated_sum = MPI_OP_NULL;
  int exchange_round = 0;
  GlobalIndex messages = 0, bytes = 0, collectives = 0;

  Handle() = default;
  Handle(const Handle&) = delete;
  Handle& operator=(const Handle&) = delete;
  ~Handle() {
    int over = 0;
    MPI_Finalized(&over);
    if (over) return;
    if (compensated_sum != MPI_OP_NULL) MPI_Op_free(&compensated_sum);
    if (sum_pair != MPI_DATATYPE_NULL) MPI_Type_free(&sum_pair);
  }
};

inline MPI_Comm mpi_comm(const Communicator& communicator) { return communicator.handle().comm; }

}  // namespace mpm
