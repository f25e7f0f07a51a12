#include "mpm_hpc/solvers/linear_solver.hpp"

#include <petscksp.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cctype>
#include <exception>
#include <limits>
#include <sstream>

#include "mpm_hpc/base/memory.hpp"
#include "mpm_hpc/parallel/mpi_handle.hpp"
#include "petsc_check.hpp"

namespace mpm {

struct LinearSolver::Impl {
  MPI_Comm comm = MPI_COMM_NULL;
  KSP ksp = nullptr;
  ::Mat matrix = nullptr;
  ::Vec rhs = nullptr, solution = nullptr;  // of the arrays below
  int local_rows = 0, size = -1;            // the latter with the spare rows
  GlobalIndex global_rows = 0;
  Apply apply;
  Diagonal diagonal;
  std::vector<Real> rhs_values, solution_values;  // of `size`
  std::exception_ptr fault;  // thrown inside a callback, where PETSc's frames must not be unwound
  std::size_t matrix_bytes = 0, vector_bytes = 0;

  // Here and not in ~LinearSolver, which doesn't run when its constructor refuses an option.
  ~Impl() {
    MatDestroy(&matrix);
    VecDestroy(&rhs);
    VecDestroy(&solution);
    KSPDestroy(&ksp);
  }

  // PETSc calls these; they answer with codes.
  static PetscErrorCode multiply(::Mat shell, ::Vec x, ::Vec y) {
    void* context = nullptr;
    const PetscScalar* in = nullptr;
    PetscScalar* out = nullptr;
    PetscCall(MatShellGetContext(shell, &context));
    PetscCall(VecGetArrayRead(x, &in));
    PetscCall(VecGetArray(y, &out));
    Impl& self = *static_cast<Impl*>(context);
    try {
      self.apply(in, out);
      std::copy(in + self.local_rows, in + self.size, out + self.local_rows);
    } catch (...) {
      self.fault = std::current_exception();
      return PETSC_ERR_LIB;
    }
    PetscCall(VecRestoreArray(y, &out));
    PetscCall(VecRestoreArrayRead(x, &in));
    return 0;
  }
  static PetscErrorCode get_diagonal(::Mat shell, ::Vec d) {
    void* context = nullptr;
    PetscScalar* out = nullptr;
    PetscCall(MatShellGetContext(shell, &context));
    PetscCall(VecGetArray(d, &out));
    const Impl& self = *static_cast<Impl*>(context);
    self.diagonal(out);
    std::fill(out + self.local_rows, out + self.size, 1.0);
    PetscCall(VecRestoreArray(d, &out));
    return 0;
  }
};

namespace {

// Of all solvers of the process, for knows_prefix.
std::vector<std::string>& prefixes() {
  static std::vector<std::string> all;
  return all;
}

// The options given to a solver, as " -phase_pc_type nonsense ...".
std::string options_with_prefix(const std::string& prefix) {
  char* all = nullptr;
  petsc_check(PetscOptionsGetAll(nullptr, &all), "PetscOptionsGetAll");
  std::istringstream words(all);
  petsc_check(PetscFree(all), "PetscFree");
  std::string found;
  bool ours = false;
  for (std::string word; words >> word;) {
    if (word.size() > 1 && word[0] == '-' && !std::isdigit(static_cast<unsigned char>(word[1])))
      ours = word.starts_with("-" + prefix);
    if (ours) found += " " + word;
  }
  return found;
}

// Of the number of rows alone: a run that goes on from a checkpoint must add up in the same order.
int with_spare_rows(int rows) {
  const std::int64_t step = std::max<std::int64_t>(1, std::bit_floor(static_cast<unsigned>(rows)) / 16);
  return static_cast<int>(
      std::min<std::int64_t>((rows + step - 1) / step * step, std::numeric_limits<int>::max()));
}

}  // namespace

LinearSolver::LinearSolver(const Communicator& communicator, const std::string& prefix,
                           const LinearSolverOptions& options)
    : impl_(std::make_unique<Impl>()) {
  impl_->comm = mpi_comm(communicator);
  petsc_check(KSPCreate(impl_->comm, &impl_->ksp), "KSPCreate");
  KSP ksp = impl_->ksp;
  PC pc = nullptr;
  petsc_check(KSPSetOptionsPrefix(ksp, prefix.c_str()), "KSPSetOptionsPrefix");
  petsc_check(KSPSetType(ksp, KSPCG), "KSPSetType");
  petsc_check(KSPGetPC(ksp, &pc), "KSPGetPC");
  petsc_check(PCSetType(pc, PCJACOBI), "PCSetType");
  petsc_check(KSPSetTolerances(ksp, options.relative_tolerance, 0.0, PETSC_DEFAULT, options.max_iterations),
              "KSPSetTolerances");
  petsc_check(KSPSetInitialGuessNonzero(ksp, PETSC_TRUE), "KSPSetInitialGuessNonzero");
  require(KSPSetFromOptions(ksp) == 0, "PETSc refuses one of the options{}; correct its value or leave it out",
          options_with_prefix(prefix));
  add_prefix(prefix);
}

void LinearSolver::add_prefix(const std::string& prefix) { prefixes().push_back(prefix); }

bool LinearSolver::knows_prefix(const std::string& option) {
  return std::any_of(prefixes().begin(), prefixes().end(),
                     [&option](const std::string& prefix) { return option.starts_with("-" + prefix); });
}

std::string LinearSolver::preconditioner_of_entries(const std::string& prefix) {
  char type[64] = "";
  PetscBool given = PETSC_FALSE;
  petsc_check(PetscOptionsGetString(nullptr, prefix.c_str(), "-pc_type", type, sizeof(type), &given), "PetscOptionsGetString");
  const std::string name = given ? type : "";
  return name == PCJACOBI || name == PCNONE || name == PCSHELL ? "" : name;
}

LinearSolver::~LinearSolver() = default;

GlobalIndex LinearSolver::set_rows(int local_rows, Spare spare) {
  Impl& s = *impl_;
  const int size = spare == Spare::some ? with_spare_rows(local_rows) : local_rows;
  s.local_rows = local_rows;
  // Vectors are kept while no rank's share changes.
  std::array<GlobalIndex, 2> sums{local_rows, size != s.size};
  MPI_Allreduce(MPI_IN_PLACE, sums.data(), 2, MPI_INT64_T, MPI_SUM, s.comm);
  s.global_rows = sums[0];
  if (sums[1] > 0) {
    petsc_check(VecDestroy(&s.rhs), "VecDestroy");
    petsc_check(VecDestroy(&s.solution), "VecDestroy");
    petsc_check(KSPReset(s.ksp), "KSPReset");
    s.size = size;
    const auto make = [&s](std::vector<Real>& values, ::Vec* vector) {
      values.resize(static_cast<std::size_t>(s.size));
      petsc_check(VecCreateMPIWithArray(s.comm, 1, s.size, PETSC_DETERMINE, values.data(), vector),
                  "VecCreateMPIWithArray");
    };
    make(s.rhs_values, &s.rhs);
    make(s.solution_values, &s.solution);
    // Four work vectors of CG with its preconditioner.
    s.vector_bytes = 4 * sizeof(PetscScalar) * static_cast<std::size_t>(s.size);
  }
  std::fill(s.rhs_values.begin() + local_rows, s.rhs_values.end(), 0);
  std::fill(s.solution_values.begin() + local_rows, s.solution_values.end(), 0);
  PetscInt first = 0;
  petsc_check(VecGetOwnershipRange(s.rhs, &first, nullptr), "VecGetOwnershipRange");
  return first;
}

GlobalIndex LinearSolver::global_rows() const { return impl_->global_rows; }

std::span<Real> LinearSolver::rhs() { return std::span(impl_->rhs_values).first(impl_->local_rows); }
std::span<Real> LinearSolver::solution() {
  return std::span(impl_->solution_values).first(impl_->local_rows);
}

void LinearSolver::assemble(const SparseRows& rows) {
  Impl& s = *impl_;
  static_assert(sizeof(PetscInt) == sizeof(int), "SparseRows holds PETSc's index type");
  debug_check(s.size == s.local_rows, "a matrix has no spare rows");
  petsc_check(MatDestroy(&s.matrix), "MatDestroy");
  petsc_check(MatCreate(s.comm, &s.matrix), "MatCreate");
  petsc_check(MatSetSizes(s.matrix, s.local_rows, s.local_rows, PETSC_DETERMINE, PETSC_DETERMINE), "MatSetSizes");
  petsc_check(MatSetType(s.matrix, MATAIJ), "MatSetType");
  // Exact preallocation and row-wise insertion in one; each call is ignored by the other kind of matrix.
  petsc_check(MatSeqAIJSetPreallocationCSR(s.matrix, rows.starts.data(), rows.columns.data(), rows.values.data()),
              "MatSeqAIJSetPreallocationCSR");
  petsc_check(MatMPIAIJSetPreallocationCSR(s.matrix, rows.starts.data(), rows.columns.data(), rows.values.data()),
              "MatMPIAIJSetPreallocationCSR");
  petsc_check(MatSetOption(s.matrix, MAT_SPD, PETSC_TRUE), "MatSetOption");
  petsc_check(KSPSetOperators(s.ksp, s.matrix, s.matrix), "KSPSetOperators");
  s.matrix_bytes = rows.values.size() * (sizeof(Real) + sizeof(int)) + rows.starts.size() * sizeof(int);
}

void LinearSolver::set_operator(Apply apply, Diagonal diagonal) {
  Impl& s = *impl_;
  s.apply = std::move(apply);
  s.diagonal = std::move(diagonal);
  petsc_check(MatDestroy(&s.matrix), "MatDestroy");
  petsc_check(MatCreateShell(s.comm, s.size, s.size, PETSC_DETERMINE, PETSC_DETERMINE, &s, &s.matrix),
              "MatCreateShell");
  petsc_check(MatShellSetOperation(s.matrix, MATOP_MULT, reinterpret_cast<void (*)()>(&Impl::multiply)),
              "MatShellSetOperation");
  petsc_check(MatShellSetOperation(s.matrix, MATOP_GET_DIAGONAL, reinterpret_cast<void (*)()>(&Impl::get_diagonal)),
              "MatShellSetOperation");
  petsc_check(MatSetOption(s.matrix, MAT_SPD, PETSC_TRUE), "MatSetOption");
  petsc_check(KSPSetOperators(s.ksp, s.matrix, s.matrix), "KSPSetOperators");
  s.matrix_bytes = 0;
}

int LinearSolver::solve() {
  Impl& s = *impl_;
  if (s.global_rows == 0) return 0;
  // The values have changed behind PETSc's back, which keeps norms.
  for (::Vec vector : {s.rhs, s.solution}) {
    PetscScalar* values = nullptr;
    petsc_check(VecGetArray(vector, &values), "VecGetArray");
    petsc_check(VecRestoreArray(vector, &values), "VecRestoreArray");
  }
  s.fault = nullptr;
  const PetscErrorCode code = KSPSolve(s.ksp, s.rhs, s.solution);
  if (s.fault) std::rethrow_exception(s.fault);
  petsc_check(code, "KSPSolve");
  KSPConvergedReason reason;
  PetscInt iterations = 0;
  petsc_check(KSPGetConvergedReason(s.ksp, &reason), "KSPGetConvergedReason");
  petsc_check(KSPGetIterationNumber(s.ksp, &iterations), "KSPGetIterationNumber");
  if (reason < 0) {
    const char* prefix = nullptr;
    KSPGetOptionsPrefix(s.ksp, &prefix);
    throw NumericalFailure(
        fmt::format("the linear solver did not converge in {} iterations ({}); allow more with -{}ksp_max_it, loosen "
                    "-{}ksp_rtol, or try another -{}pc_type",
                    iterations, KSPConvergedReasons[reason], prefix, prefix, prefix));
  }
  return static_cast<int>(iterations);
}

std::size_t LinearSolver::allocated_bytes() const {
  const Impl& s = *impl_;
  return s.matrix_bytes + s.vector_bytes + capacity_bytes(s.rhs_values) + capacity_bytes(s.solution_values);
}

}  // namespace mpm
