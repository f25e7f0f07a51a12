// The distributed system (M + H) c = r of one phase solve: the operator as a PETSc matrix, as numbers on the nodes, or
// applied by sweeps over the particles.
#pragma once

#include <limits>
#include <span>
#include <vector>

#include "mpm_hpc/effects/phase_field/active_set.hpp"
#include "mpm_hpc/effects/state.hpp"
#include "mpm_hpc/solvers/linear_solver.hpp"
#include "mpm_hpc/transfer/operator_stencil.hpp"

namespace mpm {

template <int Dim>
class PhaseSystem {
 public:
  // How M + H is applied. particles: matrix-free, one sweep over the particles per iteration, the least work if there is
  // one; stencil: one costlier sweep per solve, then a small part of a sweep per iteration; matrix: the stencil made a PETSc
  // matrix, for the preconditioners that need its entries.
  enum class Form { particles, stencil, matrix };
  // What the form `particles` needs of a body that can fracture: its number and the columns V_p 4 l0^2 and, unless the
  // reaction is lumped, V_p 4 l0 (1 - r) H_p / G_c.
  struct Part {
    std::size_t body;
    FieldId conductivity, reaction = no_field;
  };
  static constexpr const char* options_prefix = "phase_";  // of its PETSc options
  // What the particles give to the nodes: the first of Value alone, if the reaction isn't lumped and c^n isn't known to the
  // equation (values() is for project_phase() only, then); the first two; or all, for lumped reactions.
  enum class Sums { volume, with_phase, all };
  // Precision of the stencil's entries: the run's own, or single where this leaves an error well below the tolerance.
  enum class Entries { as_run, single };
  PhaseSystem(State<Dim>& state, Form form, Sums sums, Entries entries, const LinearSolverOptions& options);
  // Rows and products are those of the active blocks.
  void set_parts(std::vector<Part> parts, const ActiveSet<Dim>* active) {
    parts_ = std::move(parts);
    active_ = active;
  }

  // Forgets the last step's operator; before the step's first scatter. M_ii = sum_p w_ip V_p (1 + m + d_p) with d_p the lumped
  // drive, r_i = sum_p w_ip V_p (1 + m c_p).
  void begin(const State<Dim>& state, Real m);
  // What some of a body's particles add to the system.
  template <class T>
  void scatter(State<Dim>& state, std::size_t body, const std::vector<int>& ranges, ValueSource<T>& source);

  // Grid fields: sums per node and the operator's diagonal, filled by the particles in P2G ...
  FieldId values() const { return values_; }
  // With Sums::volume: whether the next solve starts from values(), which somebody must fill before. The same on all ranks.
  bool starts_from_values(const State<Dim>& state) const;
  FieldId diagonal() const { return diagonal_; }
  // All that the particles fill and the halo sums.
  std::vector<FieldId> sums() const;
  // ... and what comes back to them, which the halo fill carries.
  FieldId result() const { return result_; }
  // V_p, V_p c_p, and V_p times the lumped drive.
  enum Value { volume, phase, drive };

  // What a solve leaves in result() on the owned nodes with particles near them: c^{n+1} or c^{n+1} - c^n, where
  // c^n = sum w V c / sum w V is what the equation's time derivative starts from. With another mean, such as the plain one of
  // physics.md section 5, c would change by the difference of the two in each step, however short, and only downwards.
  enum class Result { value, increment };

  // Returns the number of iterations. Collective.
  int solve(State<Dim>& state, Result result);
  // f(Values()) for the number of values() per node.
  template <class F>
  void with_values(F&& f) const {
    if (sums_ == Sums::all) {
      f(std::integral_constant<int, node_values>());
    } else {
      f(std::integral_constant<int, 2>());
    }
  }
  // Leaves c^n of values() in result(), with the ghosts filled. Collective.
  void project_phase(State<Dim>& state);

  MemoryAccount memory() const;  // without the grid fields
  GlobalIndex unknowns() const { return solver_.global_rows(); }  // of all ranks, last solve

 private:
  // f(the stencil's entries), which are of type T or float.
  template <class T, class F>
  void with_entries(F&& f);
  template <class T>
  OperatorColumns<T> columns(const State<Dim>& state, const Part& part) const;
  template <class T>
  int solve_in(State<Dim>& state, Result result);
  template <class T>
  void apply(State<Dim>& state, const Real* x, Real* y);
  void find_blocks(const BlockTopology<Dim>& topology);
  template <class Stencil, class T>
  void assemble(State<Dim>& state, GlobalIndex first_row);
  template <class Stencil, class T>
  void stencil_to_field(State<Dim>& state);
  template <class T>
  void find_rows(const State<Dim>& state);
  template <class T>
  void fill_rows(const State<Dim>& state, Result result);
  void keep_solution(const State<Dim>& state);

  // f(OperatorStencil<Kernel, Dim>()) of the scene's kernel.
  template <class F>
  decltype(auto) with_stencil(F&& f) const {
    return with_kernel(kernel_, [&f](auto kernel) { return f(OperatorStencil<decltype(kernel), Dim>()); });
  }

  Form form_;
  Sums sums_;
  bool single_entries_;
  KernelKind kernel_;
  Real memory_ = 0;  // m
  LinearSolver solver_;
  std::vector<Part> parts_;
  const ActiveSet<Dim>* active_ = nullptr;
  FieldId values_, volume_sum_ = no_field, diagonal_, result_, product_ = no_field, stencil_ = no_field, row_number_ = no_field;
  // By row: its node, slot * nodes_per_block + node in block; M_ii; c^n, for increments. The arrays have room for all owned
  // nodes, whose number is that of the last sort, while rows come and go at each step.
  std::span<const std::size_t> rows_;
  std::vector<std::size_t> row_nodes_;
  std::vector<Real> mass_, start_;
  // The last solution by owned node and its change since the one before, a far better start than the smoothed c^n; no_value
  // where there is none. It dies with the blocks at the next sort, and so it is gone at a checkpoint whether the run goes on or
  // restarts.
  static constexpr Real no_value = std::numeric_limits<Real>::max();
  std::vector<Real> last_solution_, last_change_;
  int last_sort_ = -1;
  // The operator's stencil, this rank's part of the sum; blocks that it has entries in, and of them those that no ghost
  // has to do with, and the others.
  AlignedBuffer entries_;
  std::vector<char> touched_;
  std::vector<Slot> inner_, edge_;
  SparseRows matrix_;
};

}  // namespace mpm
