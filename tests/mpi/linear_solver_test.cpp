// The distributed linear solver: a chain of springs between fixed ends, whose solution is known, as a matrix and as a function
// with spare rows, while the rows come and go.
#include "mpm_hpc/solvers/linear_solver.hpp"

#include <gtest/gtest.h>
#include <petscksp.h>

#include <algorithm>
#include <cmath>

#include "support/mpi_test.hpp"

using namespace mpm;

namespace {

constexpr LinearSolverOptions tight{.relative_tolerance = 1e-12, .max_iterations = 1000};

// Rows of each rank: uneven, and none on the last one where there are several.
struct Rows {
  Rows(const Communicator& communicator, int per_rank)
      : communicator(communicator), share(static_cast<std::size_t>(communicator.size())) {
    for (int r = 0; r < communicator.size(); ++r)
      share[static_cast<std::size_t>(r)] = r > 0 && r == communicator.size() - 1 ? 0 : per_rank + 7 * r;
    for (int r = 0; r < communicator.size(); ++r) {
      if (r < communicator.rank()) first += share[static_cast<std::size_t>(r)];
      all += share[static_cast<std::size_t>(r)];
    }
  }
  int mine() const { return share[static_cast<std::size_t>(communicator.rank())]; }

  const Communicator& communicator;
  std::vector<int> share;
  int first = 0, all = 0;
};

Real stiffness(int row) { return 2.2 + 1.0 / (1 + row); }
Real solution_at(int row) { return std::sin(0.1 * row) + 0.01 * row; }
// (A x)_i = s_i x_i - x_{i-1} - x_{i+1}, symmetric and positive definite.
Real product(const Rows& rows, int i, const std::function<Real(int)>& x) {
  return stiffness(i) * x(i) - (i > 0 ? x(i - 1) : 0) - (i + 1 < rows.all ? x(i + 1) : 0);
}

void expect_solution(LinearSolver& solver, const Rows& rows) {
  ASSERT_EQ(solver.solution().size(), static_cast<std::size_t>(rows.mine()));
  for (int r = 0; r < rows.mine(); ++r)
    EXPECT_NEAR(solver.solution()[static_cast<std::size_t>(r)], solution_at(rows.first + r), 1e-8)
        << "row " << rows.first + r;
}

void start(LinearSolver& solver, const Rows& rows, Real value) {
  for (int r = 0; r < rows.mine(); ++r) {
    solver.rhs()[static_cast<std::size_t>(r)] = product(rows, rows.first + r, solution_at);
    solver.solution()[static_cast<std::size_t>(r)] = value;
  }
}

// All entries of a vector of `size` entries per rank, of which the first rows.mine() are summed up.
std::vector<Real> everywhere(const Rows& rows, const Real* x) {
  std::vector<Real> all(static_cast<std::size_t>(rows.all), 0.0);
  std::copy_n(x, rows.mine(), all.begin() + rows.first);
  rows.communicator.sum(all);
  return all;
}

int solve_function(LinearSolver& solver, const Rows& rows, Real value, LinearSolver::Spare spare) {
  solver.set_rows(rows.mine(), spare);
  start(solver, rows, value);
  solver.set_operator(
      [&rows](const Real* x, Real* y) {
        const std::vector<Real> all = everywhere(rows, x);
        for (int r = 0; r < rows.mine(); ++r)
          y[r] = product(rows, rows.first + r, [&all](int i) { return all[static_cast<std::size_t>(i)]; });
      },
      [&rows](Real* diagonal) {
        for (int r = 0; r < rows.mine(); ++r) diagonal[r] = stiffness(rows.first + r);
      });
  return solver.solve();
}

int solve_matrix(LinearSolver& solver, const Rows& rows, Real value) {
  EXPECT_EQ(solver.set_rows(rows.mine()), rows.first);
  start(solver, rows, value);
  SparseRows matrix;
  for (int r = 0; r < rows.mine(); ++r) {
    const int i = rows.first + r;
    for (int j = std::max(0, i - 1); j <= std::min(rows.all - 1, i + 1); ++j) {
      matrix.columns.push_back(j);
      matrix.values.push_back(j == i ? stiffness(i) : -1);
    }
    matrix.starts.push_back(static_cast<int>(matrix.columns.size()));
  }
  solver.assemble(matrix);
  return solver.solve();
}

}  // namespace

TEST(LinearSolver, FindsTheKnownSolutionWhileRowsComeAndGo) {
  const Communicator communicator = Communicator::world();
  LinearSolver solver(communicator, "chain_", tight);
  for (const int per_rank : {100, 103, 97, 100, 1, 400, 103}) {
    SCOPED_TRACE(per_rank);
    const Rows rows(communicator, per_rank);
    const int with_matrix = solve_matrix(solver, rows, 0.5);
    expect_solution(solver, rows);
    EXPECT_EQ(solver.global_rows(), rows.all);
    for (const LinearSolver::Spare spare : {LinearSolver::Spare::none, LinearSolver::Spare::some}) {
      EXPECT_EQ(solve_function(solver, rows, 0.5, spare), with_matrix);
      expect_solution(solver, rows);
      EXPECT_EQ(solver.global_rows(), rows.all);
    }
  }
}

// Up to 1024 rows per rank there are spare ones to all of these: PETSc's vectors stay, with what an entry held as a row. A loose
// tolerance leaves large residuals in them.
TEST(LinearSolver, RowsThatBecomeSpareLeaveNothing) {
  const Communicator communicator = Communicator::world();
  const LinearSolverOptions loose{.relative_tolerance = 0.3};
  LinearSolver solver(communicator, "chain_", loose);
  for (const int per_rank : {1003, 994, 1001, 994}) {
    SCOPED_TRACE(per_rank);
    const Rows rows(communicator, per_rank);
    LinearSolver fresh(communicator, "chain_", loose);
    EXPECT_GT(solve_function(solver, rows, 5, LinearSolver::Spare::some), 0);
    solve_function(fresh, rows, 5, LinearSolver::Spare::some);
    EXPECT_TRUE(std::ranges::equal(solver.solution(), fresh.solution()));
  }
}

// PETSc keeps the norms of vectors, here that of the right-hand side, which must not outlive the values.
TEST(LinearSolver, SeesNewValuesInItsOwnArrays) {
  const Communicator communicator = Communicator::world();
  ASSERT_EQ(PetscOptionsSetValue(nullptr, "-plain_chain_ksp_norm_type", "unpreconditioned"), 0);
  LinearSolver solver(communicator, "plain_chain_", tight);
  ASSERT_EQ(PetscOptionsClearValue(nullptr, "-plain_chain_ksp_norm_type"), 0);
  const Rows rows(communicator, 50);
  solve_function(solver, rows, 0.5, LinearSolver::Spare::some);
  EXPECT_EQ(solver.solve(), 0) << "the solution is the start";
  for (Real& x : solver.solution()) x = -3;
  EXPECT_GT(solver.solve(), 0);
  expect_solution(solver, rows);
  // Against the norm of the old right-hand side the start would do.
  const Real factor = 1e-15;
  for (Real& b : solver.rhs()) b *= factor;
  for (Real& x : solver.solution()) x = 0;
  EXPECT_GT(solver.solve(), 0);
  for (int r = 0; r < rows.mine(); ++r)
    EXPECT_NEAR(solver.solution()[static_cast<std::size_t>(r)], factor * solution_at(rows.first + r),
                factor * 1e-8);
}

TEST(LinearSolver, HasNothingToDoWithoutRows) {
  const Communicator communicator = Communicator::world();
  LinearSolver solver(communicator, "chain_", {});
  for (const LinearSolver::Spare spare : {LinearSolver::Spare::none, LinearSolver::Spare::some}) {
    EXPECT_EQ(solver.set_rows(0, spare), 0);
    solver.set_operator([](const Real*, Real*) { FAIL(); }, [](Real*) { FAIL(); });
    EXPECT_EQ(solver.solve(), 0);
    EXPECT_EQ(solver.global_rows(), 0);
  }
}
