// A PETSc matrix of dense blocks that is filled again and again.
#pragma once

#include <petscmat.h>

#include "mpm_hpc/solvers/newton_solver.hpp"

namespace mpm {

// All members but the accessors are collective.
class TangentMatrix {
 public:
  TangentMatrix() = default;
  ~TangentMatrix() { MatDestroy(&matrix_); }
  TangentMatrix(const TangentMatrix&) = delete;
  TangentMatrix& operator=(const TangentMatrix&) = delete;

  // Forgets the matrix; the next ones have so many rows of blocks on this rank, the first of which has this number.
  void set_rows(MPI_Comm comm, int block, int local_rows, GlobalIndex first_row);
  // Where the blocks are as they were, only their values are written. Always the same storage.
  void fill(const BlockRows& rows, BlockStorage storage);
  ::Mat get() const { return matrix_; }
  std::size_t allocated_bytes() const;

 private:
  void make(const BlockRows& rows);
  void make_entries(const BlockRows& rows);
  void refill(const BlockRows& rows);
  void set_rigid_motions(const std::vector<Real>& places);

  MPI_Comm comm_ = MPI_COMM_NULL;
  int block_ = 1, local_rows_ = 0, first_row_ = 0;
  BlockStorage storage_ = BlockStorage::symmetric;
  ::Mat matrix_ = nullptr;
  std::vector<int> starts_, columns_;  // of the matrix
};

}  // namespace mpm
