// The distributed system (M + H) c = r of one phase solve, assembled as a PETSc matrix or applied matrix-free.
#pragma once

#include <vector>

#include "mpm_hpc/effects/state.hpp"
#include "mpm_hpc/solvers/linear_solver.hpp"

namespace mpm {

template <int Dim>
class PhaseSystem {
 public:
  // `bodies`: numbers of the bodies that can fracture; `conductivity`: their column V_p 4 l0^2 by body number.
  PhaseSystem(State<Dim>& state, bool assembled, const LinearSolverOptions& options);
  void set_bodies(std::vector<std::size_t> bodies, std::vector<FieldId> conductivity);

  // Grid fields: four sums per node and the diagonal of H, filled by the particles in P2G ...
  FieldId values() const { return values_; }
  FieldId diagonal() const { return diagonal_; }
  // ... and c^{n+1} - c^n, or c, which the halo fill carries.
  FieldId increment() const { return increment_; }
  enum Value { mass_term, right_hand_side, weighted_phase, weight };

  // Solves on the owned nodes with weight and leaves c^{n+1} - c^n in increment(). Collective.
  int solve(State<Dim>& state);
  // Leaves c^n = sum w c / sum w in increment(), with the ghosts filled. Collective.
  void project_phase(State<Dim>& state);

  std::size_t allocated_bytes() const;
  GlobalIndex unknowns() const { return static_cast<GlobalIndex>(rows_.size()); }  // of this rank, last solve

 private:
  template <class T>
  int solve_in(State<Dim>& state);
  template <class T>
  void apply(State<Dim>& state, const Real* x, Real* y);
  template <class T>
  void assemble(State<Dim>& state, GlobalIndex first_row);
  template <class T>
  void find_rows(State<Dim>& state);

  bool assembled_;
  LinearSolver solver_;
  std::vector<std::size_t> bodies_;
  std::vector<FieldId> conductivity_;
  FieldId values_, diagonal_, increment_, product_ = no_field, stencil_ = no_field, row_number_ = no_field;
  std::vector<std::size_t> rows_;  // node of each row: slot * nodes_per_block + node in block
  std::vector<Real> mass_, rhs_, solution_, start_;
  SparseRows matrix_;
};

}  // namespace mpm
