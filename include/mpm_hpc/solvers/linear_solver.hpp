// A distributed symmetric linear system, assembled or matrix-free, solved by PETSc (Jacobi-PCG unless the command line
// says otherwise).
#pragma once

#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "mpm_hpc/parallel/communicator.hpp"

namespace mpm {

struct LinearSolverOptions {
  Real relative_tolerance = 1e-6;  // of the preconditioned residual against the preconditioned right-hand side
  int max_iterations = 10000;
};

// Compressed rows of this rank, with global column numbers.
struct SparseRows {
  std::vector<int> starts{0};  // rows + 1
  std::vector<int> columns;
  std::vector<Real> values;

  void clear() {
    starts.assign(1, 0);
    columns.clear();
    values.clear();
  }
};

// All members but the accessors are collective. Throws NumericalFailure when PETSc fails or doesn't converge.
class LinearSolver {
 public:
  // PETSc reads its options with this prefix: "phase_" gives -phase_ksp_type and so on.
  LinearSolver(const Communicator& communicator, const std::string& prefix, const LinearSolverOptions& options);
  ~LinearSolver();
  LinearSolver(const LinearSolver&) = delete;
  LinearSolver& operator=(const LinearSolver&) = delete;

  // Sets the rows of this rank and returns the global number of the first one. With spare rows, for set_operator() only, their
  // number is rounded up by a sixteenth at most, with equations x = 0: a moving body has other nodes in each step, and PETSc
  // would make all its vectors anew, of memory that the system maps and clears page by page.
  enum class Spare { none, some };
  GlobalIndex set_rows(int local_rows, Spare spare = Spare::none);
  // Of all ranks, after set_rows(), without the spare ones.
  GlobalIndex global_rows() const;

  // Entries of this rank's rows, which PETSc works on where they are: the right-hand side; the start values, and after the
  // solve the solution. Undefined after set_rows().
  std::span<Real> rhs();
  std::span<Real> solution();

  // The operator: as rows, copied into a PETSc AIJ matrix ...
  void assemble(const SparseRows& rows);
  // ... or as a function y = A x on this rank's entries (collective itself), and one that writes its diagonal.
  using Apply = std::function<void(const Real* x, Real* y)>;
  using Diagonal = std::function<void(Real* diagonal)>;
  void set_operator(Apply apply, Diagonal diagonal);

  // Returns the number of iterations.
  int solve();

  // Of another solver, whose options are this class's business as well.
  static void add_prefix(const std::string& prefix);
  // Whether an option (with its dash) is addressed to a solver that exists.
  static bool knows_prefix(const std::string& option);

  // The preconditioner that the command line asks for, if it needs the matrix's entries and not just its diagonal; else
  // empty.
  static std::string preconditioner_of_entries(const std::string& prefix);

  // What the matrix and the vectors take on this rank.
  std::size_t allocated_bytes() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace mpm
