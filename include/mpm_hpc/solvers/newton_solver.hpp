// Newton's method for the least of a potential over distributed unknowns, by PETSc's SNES: line search on the potential,
// directions from the assembled or matrix-free tangent by Jacobi-PCG unless the command line says otherwise.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "mpm_hpc/parallel/communicator.hpp"

namespace mpm {

// Whether the tangent is made semi-definite. It always gives directions of descent then, but what the projection takes away,
// such as the softening of what is compressed, makes the last iterations converge linearly. automatic: projected while the
// residual is large, and from the first direction on along which the tangent bends down.
enum class Projection { automatic, always, never };

struct NewtonOptions {
  Projection projection = Projection::automatic;
  // Of the residual against the largest of the forces that balance in it (see NewtonProblem::residual).
  Real tolerance = 1e-6;
  int max_iterations = 50;
  int max_krylov = 2000;  // per iteration
};

// The tangent's rows on this rank, in dense blocks, with global block columns in ascending order.
struct BlockRows {
  std::vector<int> starts{0};  // rows + 1
  std::vector<int> columns;
  std::vector<Real> values;  // blocks row by row
  std::vector<Real> places;  // of the rows' nodes [m]; only where they are stored by entries
};

// The kinds of rows that PETSc's formats hold.
enum class BlockStorage {
  symmetric,  // only columns from the row on: half the memory, for preconditioners of the diagonal
  full,
  entries  // one by one, with the rigid motions: for algebraic multigrid
};
// What the preconditioner of this type needs, that PETSc's options name; empty: one of the diagonal.
BlockStorage storage_for(const std::string& preconditioner);

// What is solved, by its rank's unknowns x. The functions are collective and may throw.
struct NewtonProblem {
  struct Potential {
    Real value;      // no finite number where the potential is not defined
    Real magnitude;  // of what it is a sum of: differences below its rounding errors mean nothing
  };
  std::function<Potential(const Real* x)> potential;
  // Its gradient, and the scale of the parts that cancel in it.
  std::function<Real(const Real* x, Real* gradient)> residual;
  // Puts the second derivative at x in place, by assemble() or set_operator().
  std::function<void(const Real* x, bool projected)> linearise;
  // The largest share of the step in (0, 1] with which x - share * step is allowed.
  std::function<Real(const Real* x, const Real* step)> step_share;
  // Takes out of a step what x must keep: Krylov solvers that stop early leave some of it there.
  std::function<void(Real* step)> project;
};

struct NewtonResult {
  bool converged = false;
  std::string reason;  // in words if not
  int iterations = 0, krylov_iterations = 0;
  std::vector<Real> potentials;  // after each iteration, the start included
  Real rounding = 0;             // of the potentials
  Real first_residual = 0, residual = 0;  // over their scales
};

// All members but the accessors are collective.
class NewtonSolver {
 public:
  // PETSc reads its options with this prefix. `block` unknowns belong to one node.
  NewtonSolver(const Communicator& communicator, const std::string& prefix, int block,
               const NewtonOptions& options);
  ~NewtonSolver();
  NewtonSolver(const NewtonSolver&) = delete;
  NewtonSolver& operator=(const NewtonSolver&) = delete;

  // Sets the block rows of this rank and returns the global number of the first one.
  GlobalIndex set_rows(int local_block_rows);
  GlobalIndex first_row() const;
  GlobalIndex global_rows() const;  // blocks, of all ranks

  // For linearise():
  void assemble(const BlockRows& rows, BlockStorage storage);
  using Apply = std::function<void(const Real* x, Real* y)>;
  void set_operator(Apply apply, std::vector<Real> diagonal);

  // y = A d with what the last of these put in place.
  void multiply(const std::vector<Real>& d, std::vector<Real>& y);

  // x holds the start and then the solution. Doesn't throw when Newton's method fails.
  NewtonResult solve(const NewtonProblem& problem, std::vector<Real>& x);

  std::size_t allocated_bytes() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace mpm
