// The distributed system (M + H) c = r of one phase solve, assembled as a PETSc matrix or applied matrix-free.
#pragma once

#include <limits>
#include <vector>

#include "mpm_hpc/effects/state.hpp"
#include "mpm_hpc/solvers/linear_solver.hpp"
#include "mpm_hpc/transfer/scalar_transfer.hpp"

namespace mpm {

template <int Dim>
class PhaseSystem {
 public:
  // What the system needs of a body that can fracture: its number and the columns V_p 4 l0^2 and, unless the reaction is
  // lumped, V_p 4 l0 (1 - r) H_p / G_c.
  struct Part {
    std::size_t body;
    FieldId conductivity, reaction = no_field;
  };
  PhaseSystem(State<Dim>& state, bool assembled, const LinearSolverOptions& options);
  void set_parts(std::vector<Part> parts) { parts_ = std::move(parts); }

  // Grid fields: four sums per node and the operator's diagonal, filled by the particles in P2G ...
  FieldId values() const { return values_; }
  FieldId diagonal() const { return diagonal_; }
  // ... and what comes back to them, which the halo fill carries.
  FieldId result() const { return result_; }
  enum Value { mass_term, right_hand_side, weighted_phase, weight };

  // What a solve leaves in result() on the owned nodes with weight.
  enum class Result { value, increment };  // c^{n+1}; c^{n+1} - c^n with c^n = sum w c / sum w

  // Returns the number of iterations. Collective.
  int solve(State<Dim>& state, Result result);
  // Leaves c^n = sum w c / sum w in result(), with the ghosts filled. Collective.
  void project_phase(State<Dim>& state);

  std::size_t allocated_bytes() const;
  GlobalIndex unknowns() const { return static_cast<GlobalIndex>(rows_.size()); }  // of this rank, last solve

 private:
  template <class T>
  OperatorColumns<T> columns(const State<Dim>& state, const Part& part) const;
  template <class T>
  int solve_in(State<Dim>& state, Result result);
  template <class T>
  void apply(State<Dim>& state, const Real* x, Real* y);
  template <class T>
  void assemble(State<Dim>& state, GlobalIndex first_row);
  template <class T>
  void find_rows(State<Dim>& state);
  void start_from_last_solution(const State<Dim>& state);
  void keep_solution(const State<Dim>& state);

  bool assembled_;
  LinearSolver solver_;
  std::vector<Part> parts_;
  FieldId values_, diagonal_, result_, product_ = no_field, stencil_ = no_field, row_number_ = no_field;
  std::vector<std::size_t> rows_;  // node of each row: slot * nodes_per_block + node in block
  std::vector<Real> mass_, rhs_, solution_, start_;
  // The last solution by owned node, a far better start than the smoothed c^n; no_value where there is none. It dies with
  // the blocks at the next sort, and so it is gone at a checkpoint whether the run goes on or restarts.
  static constexpr Real no_value = std::numeric_limits<Real>::max();
  std::vector<Real> last_solution_;
  int last_sort_ = -1;
  SparseRows matrix_;
};

}  // namespace mpm
