// The equations of one implicit step: the potential of the grid's velocities, its gradient and its tangent (physics.md
// section 6).
#pragma once

#include "mpm_hpc/effects/state.hpp"
#include "mpm_hpc/solvers/newton_solver.hpp"
#include "mpm_hpc/transfer/stencil_products.hpp"

namespace mpm {

struct ImplicitOptions {
  NewtonOptions newton;
  bool inertia = true;  // false: quasi-static
  bool matrix_free = false;
  // Of nodes with next to no weight (StencilProducts::set_stiffness): s_p = stabilisation V0_p M_p / h^2, M_p the modulus of
  // waves. It acts on a step's displacements dt v and leaves no stress behind.
  Real stabilisation = 0;
};

// With v the velocities of the nodes that have mass, v* those before the forces, and loads p (impulses),
//   E(v) = sum_i m_i |v_i - v*_i|^2 / 2 - p_i . v_i + sum_p V0_p Psi((I + dt grad v_p) F_p) + E_s(dt v),
// without the first term in the quasi-static case. Its gradient is the impulse that is left over at each node, which
// vanishes but for what holds constrained nodes. All members but the accessors are collective.
template <int Dim>
class ImplicitSystem {
 public:
  static constexpr const char* options_prefix = "newton_";  // of its PETSc options

  // Declares its grid fields, so it must exist before the particles are sorted. Throws UserError for a scene that it can't
  // solve.
  ImplicitSystem(State<Dim>& state, const ImplicitOptions& options);

  // From nodes that hold velocities and mass after P2G without stress. The particles must be sorted. v* is their velocity
  // plus dt times the acceleration.
  void begin(State<Dim>& state, const Vec<Dim>& acceleration);

  // Number of unknown nodes of this rank, and by row:
  int rows() const { return static_cast<int>(rows_.size()); }
  std::size_t node(int row) const { return rows_[row]; }
  int row_of(std::size_t node) const { return row_of_node_[node]; }
  Real mass(int row) const { return mass_[row]; }
  Vec<Dim> start_velocity(int row) const { return velocity_at(start_, row); }
  Vec<Dim> velocity(int row) const { return velocity_at(x_, row); }
  // Impulse left over at the solution: what the constraints and nothing else gave [N s].
  Vec<Dim> reaction(int row) const { return velocity_at(reaction_, row); }

  // Constraints and loads are set between begin() and solve(). The velocity keeps its part in the span of `basis`, whose
  // columns [0, count) are orthonormal; x gets these components now.
  void clear_constraints();
  void constrain(int row, const Mat<Dim>& basis, int count, const Vec<Dim>& velocity);
  void set_load(int row, const Vec<Dim>& impulse);

  // Minimises E from the present velocities on.
  NewtonResult solve(State<Dim>& state);

  // Deforms the particles as the solution does, plastic return included, without moving them.
  void deform(State<Dim>& state);

  // Exposed for tests, row by row: E at velocities v, its gradient, its tangent put in place, and this times d.
  NewtonProblem::Potential potential(State<Dim>& state, const Real* v);
  Real residual(State<Dim>& state, const Real* v, Real* gradient, bool constrained = true);
  void linearise(State<Dim>& state, const Real* v, bool projected);
  void multiply(const std::vector<Real>& d, std::vector<Real>& y) { solver_.multiply(d, y); }
  const std::vector<Real>& unknowns() const { return x_; }
  // Takes the constrained components out of a vector over the rows.
  void project(Real* values) const;

  GlobalIndex first_row() const { return solver_.first_row(); }  // of this rank, in the numbering of all
  GlobalIndex global_rows() const { return solver_.global_rows(); }
  MemoryAccount memory() const;

 private:
  struct Columns;  // arrays of a chunk
  using Chunk = typename StencilProducts<Dim>::Chunk;
  Vec<Dim> velocity_at(const std::vector<Real>& values, int row) const {
    return Eigen::Map<const Vec<Dim>>(values.data() + static_cast<std::size_t>(row) * Dim);
  }
  template <class F>
  void sweep(State<Dim>& state, const Real* v, F&& f);
  void sum_to_rows(State<Dim>& state, FieldId field, Real* out);
  TrialSums forces(State<Dim>& state, const Real* v, bool wanted);
  void clear_stencil(State<Dim>& state);
  void assemble(State<Dim>& state);
  void find_neighbours(const State<Dim>& state, const Real* number);
  void apply(State<Dim>& state, const Real* d, Real* y);
  void set_stiffness(State<Dim>& state);
  Real step_share(State<Dim>& state, const Real* step);
  Real* tangent_of(std::size_t body, int component) const;

  ImplicitOptions options_;
  NewtonSolver solver_;
  std::vector<std::unique_ptr<StencilProducts<Dim>>> products_;  // by body
  BlockStorage storage_;
  FieldId velocity_, force_, stencil_ = no_field, row_number_ = no_field, projector_ = no_field;
  std::vector<std::size_t> rows_;
  std::vector<int> row_of_node_;
  std::vector<Real> mass_, start_, load_, x_, reaction_, diagonal_;
  struct Constraint {
    int row;
    Mat<Dim> projector;  // onto the free directions
    Real scale = 1;      // of the constrained directions' own equations
  };
  std::vector<Constraint> constraints_;
  std::vector<int> constraint_of_row_;
  std::vector<AlignedBuffer> tangents_;  // by body, all particles, if matrix-free
  AlignedBuffer scratch_;
  BlockRows matrix_;
  // Of each row, the nodes whose columns the matrix stores, in the order of these; empty: not found in this step yet.
  struct Neighbour {
    std::int32_t node, offset;  // number of the offset among all within reach
  };
  std::vector<Neighbour> neighbours_;
  std::vector<std::size_t> first_neighbours_;  // rows + 1
  Real dt_ = 0, rounding_ = 0;  // rounding_: of the residual
};

}  // namespace mpm
