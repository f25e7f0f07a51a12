#include "tangent_matrix.hpp"

#include "mpm_hpc/base/memory.hpp"
#include "petsc_check.hpp"

namespace mpm {

namespace {

// Of calls that may fail on one rank while the others wait: this ends all ranks.
void local_check(PetscErrorCode code, const char* what) {
  if (code != 0)
    throw LogicError(fmt::format("PETSc failed in {} with code {}", what, static_cast<int>(code)));
}

MatType type_of(BlockStorage storage) {
  switch (storage) {
    case BlockStorage::symmetric:
      return MATSBAIJ;
    case BlockStorage::full:
      return MATBAIJ;
    case BlockStorage::entries:
      return MATAIJ;
  }
  return nullptr;
}

}  // namespace

void TangentMatrix::set_rows(MPI_Comm comm, int block, int local_rows, GlobalIndex first_row) {
  comm_ = comm;
  block_ = block;
  local_rows_ = local_rows;
  first_row_ = static_cast<int>(first_row);
  petsc_check(MatDestroy(&matrix_), "MatDestroy");
}

void TangentMatrix::fill(const BlockRows& rows, BlockStorage storage) {
  static_assert(sizeof(PetscInt) == sizeof(int), "BlockRows holds PETSc's index type");
  int same = matrix_ && rows.starts == starts_ && rows.columns == columns_;
  MPI_Allreduce(MPI_IN_PLACE, &same, 1, MPI_INT, MPI_MIN, comm_);
  if (same) {
    refill(rows);
    return;
  }
  storage_ = storage;
  starts_ = rows.starts;
  columns_ = rows.columns;
  make(rows);
}

// Exact preallocation and row-wise insertion in one; the calls for other kinds of matrices do nothing. Newton's solver may
// hold the matrix, so it stays the same object when its pattern changes.
void TangentMatrix::make(const BlockRows& rows) {
  if (!matrix_) {
    const int size = block_ * local_rows_;
    petsc_check(MatCreate(comm_, &matrix_), "MatCreate");
    petsc_check(MatSetSizes(matrix_, size, size, PETSC_DETERMINE, PETSC_DETERMINE), "MatSetSizes");
    petsc_check(MatSetBlockSize(matrix_, block_), "MatSetBlockSize");
    petsc_check(MatSetType(matrix_, type_of(storage_)), "MatSetType");
  }
  const int *starts = rows.starts.data(), *columns = rows.columns.data();
  const Real* values = rows.values.data();
  if (storage_ == BlockStorage::symmetric) {
    local_check(MatSeqSBAIJSetPreallocationCSR(matrix_, block_, starts, columns, values),
                "MatSeqSBAIJSetPreallocationCSR");
    local_check(MatMPISBAIJSetPreallocationCSR(matrix_, block_, starts, columns, values),
                "MatMPISBAIJSetPreallocationCSR");
  } else if (storage_ == BlockStorage::full) {
    local_check(MatSeqBAIJSetPreallocationCSR(matrix_, block_, starts, columns, values),
                "MatSeqBAIJSetPreallocationCSR");
    local_check(MatMPIBAIJSetPreallocationCSR(matrix_, block_, starts, columns, values),
                "MatMPIBAIJSetPreallocationCSR");
  } else {
    make_entries(rows);
  }
  // BAIJ knows no such option.
  if (storage_ != BlockStorage::full) petsc_check(MatSetOption(matrix_, MAT_SPD, PETSC_TRUE), "MatSetOption");
}

// The same rows entry by entry.
void TangentMatrix::make_entries(const BlockRows& rows) {
  const auto d = static_cast<std::size_t>(block_);
  std::vector<int> starts{0}, columns;
  std::vector<Real> values;
  for (int r = 0; r < local_rows_; ++r)
    for (std::size_t a = 0; a < d; ++a) {
      for (int k = rows.starts[r]; k < rows.starts[r + 1]; ++k)
        for (std::size_t b = 0; b < d; ++b) {
          columns.push_back(rows.columns[k] * block_ + static_cast<int>(b));
          values.push_back(rows.values[(static_cast<std::size_t>(k) * d + a) * d + b]);
        }
      starts.push_back(static_cast<int>(columns.size()));
    }
  local_check(MatSeqAIJSetPreallocationCSR(matrix_, starts.data(), columns.data(), values.data()),
              "MatSeqAIJSetPreallocationCSR");
  local_check(MatMPIAIJSetPreallocationCSR(matrix_, starts.data(), columns.data(), values.data()),
              "MatMPIAIJSetPreallocationCSR");
  set_rigid_motions(rows.places);
}

// What an elastic body's tangent hardly resists, for algebraic multigrid.
void TangentMatrix::set_rigid_motions(const std::vector<Real>& places) {
  ::Vec nodes = nullptr;
  MatNullSpace motions = nullptr;
  petsc_check(MatCreateVecs(matrix_, &nodes, nullptr), "MatCreateVecs");
  PetscScalar* out = nullptr;
  petsc_check(VecSetBlockSize(nodes, block_), "VecSetBlockSize");
  petsc_check(VecGetArray(nodes, &out), "VecGetArray");
  std::copy(places.begin(), places.end(), out);
  petsc_check(VecRestoreArray(nodes, &out), "VecRestoreArray");
  petsc_check(MatNullSpaceCreateRigidBody(nodes, &motions), "MatNullSpaceCreateRigidBody");
  petsc_check(MatSetNearNullSpace(matrix_, motions), "MatSetNearNullSpace");
  petsc_check(MatNullSpaceDestroy(&motions), "MatNullSpaceDestroy");
  petsc_check(VecDestroy(&nodes), "VecDestroy");
}

// Columns of this rank straight into the arrays that hold them, the others by insertion: PETSc's search for each block takes
// longer than all else.
void TangentMatrix::refill(const BlockRows& rows) {
  ::Mat mine = nullptr;
  PetscScalar* out = nullptr;
  petsc_check(MatGetDiagonalBlock(matrix_, &mine), "MatGetDiagonalBlock");
  const auto d = static_cast<std::size_t>(block_), block = d * d;
  const bool by_entry = storage_ == BlockStorage::entries;
  if (storage_ == BlockStorage::symmetric)
    local_check(MatSeqSBAIJGetArray(mine, &out), "MatSeqSBAIJGetArray");
  if (storage_ == BlockStorage::full) local_check(MatSeqBAIJGetArray(mine, &out), "MatSeqBAIJGetArray");
  if (by_entry) local_check(MatSeqAIJGetArray(mine, &out), "MatSeqAIJGetArray");
  PetscScalar* next = out;
  std::vector<int> others;
  for (int r = 0; r < local_rows_; ++r) {
    const int *first = columns_.data() + starts_[r], *last = columns_.data() + starts_[r + 1];
    const int *begin = std::lower_bound(first, last, first_row_),
              *end = std::lower_bound(begin, last, first_row_ + local_rows_);
    const Real* value = rows.values.data() + block * static_cast<std::size_t>(begin - columns_.data());
    const auto count = static_cast<std::size_t>(end - begin);
    // Blocks lie by columns, entries row by row of the matrix.
    for (std::size_t k = 0; k < count; ++k, value += block)
      for (std::size_t a = 0; a < d; ++a)
        for (std::size_t b = 0; b < d; ++b)
          next[by_entry ? (a * count + k) * d + b : k * block + b * d + a] = value[a * d + b];
    next += count * block;
    if (count < static_cast<std::size_t>(last - first)) others.push_back(r);
  }
  if (storage_ == BlockStorage::symmetric)
    local_check(MatSeqSBAIJRestoreArray(mine, &out), "MatSeqSBAIJRestoreArray");
  if (storage_ == BlockStorage::full)
    local_check(MatSeqBAIJRestoreArray(mine, &out), "MatSeqBAIJRestoreArray");
  if (by_entry) local_check(MatSeqAIJRestoreArray(mine, &out), "MatSeqAIJRestoreArray");
  for (const int r : others)
    for (int k = starts_[r]; k < starts_[r + 1]; ++k) {
      const int row = first_row_ + r, column = columns_[k];
      if (column >= first_row_ && column < first_row_ + local_rows_) continue;
      local_check(
          MatSetValuesBlocked(matrix_, 1, &row, 1, &column,
                              rows.values.data() + block * static_cast<std::size_t>(k), INSERT_VALUES),
          "MatSetValuesBlocked");
    }
  // This also tells the preconditioner of the new values.
  petsc_check(MatAssemblyBegin(matrix_, MAT_FINAL_ASSEMBLY), "MatAssemblyBegin");
  petsc_check(MatAssemblyEnd(matrix_, MAT_FINAL_ASSEMBLY), "MatAssemblyEnd");
}

// An estimate: values, columns and starts as PETSc keeps them, and the pattern here.
std::size_t TangentMatrix::allocated_bytes() const {
  if (!matrix_) return 0;
  const std::size_t blocks = columns_.size(), d = static_cast<std::size_t>(block_);
  const std::size_t indices = storage_ == BlockStorage::entries ? blocks * d * d : blocks;
  return blocks * d * d * sizeof(Real) + indices * sizeof(int) + starts_.size() * sizeof(int) +
         capacity_bytes(starts_) + capacity_bytes(columns_);
}

}  // namespace mpm
