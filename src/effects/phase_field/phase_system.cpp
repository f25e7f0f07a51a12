#include "mpm_hpc/effects/phase_field/phase_system.hpp"

#include <algorithm>

#include "mpm_hpc/math/bspline.hpp"
#include "mpm_hpc/transfer/operator_stencil.hpp"

namespace mpm {

namespace {

using Kernel = QuadraticKernel;
// Row numbers travel in grid fields of either precision, as two parts that a float holds exactly.
constexpr GlobalIndex row_base = 1 << 20;

}  // namespace

template <int Dim>
PhaseSystem<Dim>::PhaseSystem(State<Dim>& state, bool assembled, const LinearSolverOptions& options)
    : assembled_(assembled), solver_(state.communicator(), "phase_", options) {
  GridFields& f = state.fields;
  values_ = f.add({.name = "phase_sums", .units = "1", .components = 4, .halo_components = 4, .sums_ghosts = true});
  diagonal_ = f.add({.name = "phase_diagonal", .units = "1", .sums_ghosts = true});
  result_ = f.add({.name = "phase_result", .units = "1", .fills_ghosts = true});
  if (assembled_) {
    constexpr int entries = HalfStencil<Kernel, Dim>::size;
    stencil_ = f.add({.name = "phase_stencil", .units = "1", .components = entries, .halo_components = entries});
    row_number_ = f.add({.name = "phase_row", .units = "1", .components = 2, .halo_components = 2});
    state.distribution.require_row_halo();
  } else {
    product_ = f.add({.name = "phase_product", .units = "1"});
  }
}

template <int Dim>
template <class T>
OperatorColumns<T> PhaseSystem<Dim>::columns(const State<Dim>& state, const Part& part) const {
  const FieldSet& f = state.bodies[part.body].particles;
  return {f.template data<T>(part.conductivity),
          part.reaction == no_field ? nullptr : f.template data<T>(part.reaction)};
}

template <int Dim>
template <class T>
void PhaseSystem<Dim>::find_rows(State<Dim>& state) {
  const T* sums = state.fields.template data<T>(values_);
  const std::size_t owned = static_cast<std::size_t>(state.topology().owned()) * nodes_per_block<Dim>;
  rows_.clear();
  mass_.clear();
  rhs_.clear();
  start_.clear();
  for (std::size_t i = 0; i < owned; ++i) {
    const T* node = sums + i * node_values;
    if (!(node[weight] > 0)) continue;
    rows_.push_back(i);
    mass_.push_back(node[mass_term]);
    rhs_.push_back(node[right_hand_side]);
    start_.push_back(static_cast<Real>(node[weighted_phase]) / static_cast<Real>(node[weight]));
  }
}

// y = (M + H) x by one sweep over the particles.
template <int Dim>
template <class T>
void PhaseSystem<Dim>::apply(State<Dim>& state, const Real* x, Real* y) {
  state.fields.zero(result_);
  state.fields.zero(product_);
  T* in = state.fields.template data<T>(result_);
  T* out = state.fields.template data<T>(product_);
  for (std::size_t r = 0; r < rows_.size(); ++r) in[rows_[r]] = static_cast<T>(x[r]);
  const ScalarGrid<Dim> grid{state.geometry(), state.topology()};
  auto sweep = [&](bool boundary) {
    for (const Part& part : parts_) {
      const Body<Dim>& body = state.bodies[part.body];
      apply_operator<Kernel>(grid, body, boundary ? body.boundary : body.interior, columns<T>(state, part), in, out);
    }
  };
  state.halo().start_fill(state.fields, {result_});
  sweep(false);
  state.halo().finish_fill();
  sweep(true);
  state.halo().sum(state.fields, {product_});
  for (std::size_t r = 0; r < rows_.size(); ++r) y[r] = mass_[r] * x[r] + out[rows_[r]];
}

// The rows of M + H from the nodes' stencils: the entries to later nodes are the node's own, those to earlier ones stand
// in the mirrored place.
template <int Dim>
template <class T>
void PhaseSystem<Dim>::assemble(State<Dim>& state, GlobalIndex first_row) {
  using Stencil = HalfStencil<Kernel, Dim>;
  constexpr int npb = nodes_per_block<Dim>;
  GridFields& fields = state.fields;
  fields.zero(stencil_);
  T* stencil = fields.template data<T>(stencil_);
  const ScalarGrid<Dim> grid{state.geometry(), state.topology()};
  for (const Part& part : parts_) {
    const Body<Dim>& body = state.bodies[part.body];
    for (const auto* ranges : {&body.boundary, &body.interior})
      scatter_operator_stencil<Kernel>(grid, body, *ranges, columns<T>(state, part), stencil);
  }
  state.halo().sum(fields, {stencil_});

  T* number = fields.template data<T>(row_number_);
  std::fill_n(number, 2 * fields.nodes(), T(-1));
  for (std::size_t r = 0; r < rows_.size(); ++r) {
    const GlobalIndex row = first_row + static_cast<GlobalIndex>(r);
    number[2 * rows_[r]] = static_cast<T>(row / row_base);
    number[2 * rows_[r] + 1] = static_cast<T>(row % row_base);
  }
  state.distribution.row_halo().fill(fields, {stencil_, row_number_});

  IntVec<Dim> offsets[Stencil::full];
  for (int o = 0; o < Stencil::full; ++o) offsets[o] = Stencil::offset(o);
  matrix_.clear();
  for (std::size_t r = 0; r < rows_.size(); ++r) {
    const Slot* around = state.topology().neighbours(static_cast<Slot>(rows_[r] / npb));
    const IntVec<Dim> local = node_in_block<Dim>(static_cast<int>(rows_[r] % npb));
    for (int o = 0; o < Stencil::full; ++o) {
      int neighbour = 0, in_block = 0;
      for (int a = 0; a < Dim; ++a) {
        const int position = local[a] + offsets[o][a];
        neighbour = 3 * neighbour + (position < 0 ? 0 : position < block_side ? 1 : 2);
        in_block = block_side * in_block + (position & (block_side - 1));
      }
      if (around[neighbour] == no_slot) continue;
      const std::size_t other = static_cast<std::size_t>(around[neighbour]) * npb + in_block;
      if (number[2 * other] < 0) continue;
      Real entry = o >= Stencil::centre ? stencil[rows_[r] * Stencil::size + (o - Stencil::centre)]
                                        : stencil[other * Stencil::size + (Stencil::centre - o)];
      if (o == Stencil::centre) entry += mass_[r];
      if (entry == 0) continue;
      matrix_.columns.push_back(static_cast<int>(static_cast<GlobalIndex>(number[2 * other]) * row_base +
                                                 static_cast<GlobalIndex>(number[2 * other + 1])));
      matrix_.values.push_back(entry);
    }
    matrix_.starts.push_back(static_cast<int>(matrix_.columns.size()));
  }
  solver_.assemble(matrix_);
}

template <int Dim>
template <class T>
int PhaseSystem<Dim>::solve_in(State<Dim>& state, Result result) {
  find_rows<T>(state);
  const GlobalIndex first_row = solver_.set_rows(static_cast<int>(rows_.size()));
  if (assembled_) {
    assemble<T>(state, first_row);
  } else {
    const T* laplacian = state.fields.template data<T>(diagonal_);
    std::vector<Real> diagonal(rows_.size());
    for (std::size_t r = 0; r < rows_.size(); ++r) diagonal[r] = mass_[r] + laplacian[rows_[r]];
    solver_.set_operator([this, &state](const Real* x, Real* y) { apply<T>(state, x, y); }, std::move(diagonal));
  }
  solution_ = start_;
  if (result == Result::value) start_from_last_solution(state);
  const int iterations = solver_.solve(rhs_, solution_);
  if (result == Result::value) keep_solution(state);
  state.fields.zero(result_);
  T* out = state.fields.template data<T>(result_);
  for (std::size_t r = 0; r < rows_.size(); ++r)
    out[rows_[r]] = static_cast<T>(result == Result::value ? solution_[r] : solution_[r] - start_[r]);
  return iterations;
}

template <int Dim>
void PhaseSystem<Dim>::start_from_last_solution(const State<Dim>& state) {
  if (last_sort_ != state.distribution.sorts()) return;
  for (std::size_t r = 0; r < rows_.size(); ++r)
    if (const Real last = last_solution_[rows_[r]]; last != no_value) solution_[r] = last;
}

template <int Dim>
void PhaseSystem<Dim>::keep_solution(const State<Dim>& state) {
  last_sort_ = state.distribution.sorts();
  last_solution_.assign(static_cast<std::size_t>(state.topology().owned()) * nodes_per_block<Dim>, no_value);
  for (std::size_t r = 0; r < rows_.size(); ++r) last_solution_[rows_[r]] = solution_[r];
}

template <int Dim>
int PhaseSystem<Dim>::solve(State<Dim>& state, Result result) {
  return with_precision(state.precision, [&](auto zero) { return solve_in<decltype(zero)>(state, result); });
}

template <int Dim>
void PhaseSystem<Dim>::project_phase(State<Dim>& state) {
  with_precision(state.precision, [&](auto zero) {
    using T = decltype(zero);
    find_rows<T>(state);
    state.fields.zero(result_);
    T* phase = state.fields.template data<T>(result_);
    for (std::size_t r = 0; r < rows_.size(); ++r) phase[rows_[r]] = static_cast<T>(start_[r]);
  });
  state.halo().fill(state.fields, {result_});
}

template <int Dim>
std::size_t PhaseSystem<Dim>::allocated_bytes() const {
  return solver_.allocated_bytes() + last_solution_.capacity() * sizeof(Real) + rows_.capacity() * sizeof(std::size_t) +
         (mass_.capacity() + rhs_.capacity() + solution_.capacity() + start_.capacity()) * sizeof(Real) +
         matrix_.values.capacity() * sizeof(Real) + (matrix_.columns.capacity() + matrix_.starts.capacity()) * sizeof(int);
}

template class PhaseSystem<2>;
template class PhaseSystem<3>;

}  // namespace mpm
