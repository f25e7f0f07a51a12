#include "mpm_hpc/effects/phase_field/phase_system.hpp"

#include <algorithm>
#include <cstring>

#include "mpm_hpc/fields/node_box.hpp"
#include "mpm_hpc/math/bspline.hpp"
#include "mpm_hpc/transfer/operator_stencil.hpp"

namespace mpm {

namespace {

// Row numbers travel in grid fields of either precision, as two parts that a float holds exactly.
constexpr GlobalIndex row_base = 1 << 20;

}  // namespace

template <int Dim>
PhaseSystem<Dim>::PhaseSystem(State<Dim>& state, Form form, Sums sums, Entries entries,
                              const LinearSolverOptions& options)
    : form_(form),
      sums_(sums),
      single_entries_(entries == Entries::single || state.precision == Precision::single_precision),
      kernel_(state.transfer.kernel),
      solver_(state.communicator(), options_prefix, options) {
  GridFields& f = state.fields;
  with_values([&](auto values) {
    values_ = f.add({.name = "phase_sums",
                     .units = "m^d",
                     .components = values,
                     .halo_components = std::min<int>(values, drive + 1),
                     .sums_ghosts = sums != Sums::volume});
  });
  if (sums == Sums::volume) volume_sum_ = f.add({.name = "phase_volume", .units = "m^d", .sums_ghosts = true});
  diagonal_ = f.add({.name = "phase_diagonal", .units = "1", .sums_ghosts = true});
  result_ = f.add({.name = "phase_result", .units = "1", .fills_ghosts = true});
  if (form_ == Form::matrix) {
    const int entries = with_stencil([](auto stencil) { return decltype(stencil)::size; });
    stencil_ = f.add({.name = "phase_stencil", .units = "1", .components = entries, .halo_components = entries});
    row_number_ = f.add({.name = "phase_row", .units = "1", .components = 2, .halo_components = 2});
    state.distribution.require_row_halo();
  } else {
    product_ = f.add({.name = "phase_product", .units = "1"});
  }
}

template <int Dim>
std::vector<FieldId> PhaseSystem<Dim>::sums() const {
  return {sums_ == Sums::volume ? volume_sum_ : values_, diagonal_};
}

template <int Dim>
void PhaseSystem<Dim>::begin(const State<Dim>& state, Real m) {
  memory_ = m;
  if (form_ == Form::particles) return;
  const std::size_t block = with_stencil([](auto stencil) { return decltype(stencil)::block_values; }) *
                            (single_entries_ ? sizeof(float) : sizeof(double));
  const auto blocks = static_cast<std::size_t>(state.topology().size());
  entries_.allocate(blocks * block, 0);
  touched_.assign(blocks, 0);
}

template <int Dim>
template <class T>
void PhaseSystem<Dim>::scatter(State<Dim>& state, std::size_t body, const std::vector<int>& ranges,
                               ValueSource<T>& source) {
  const ScalarGrid<Dim> grid{state.geometry(), state.topology()};
  const Body<Dim>& particles = state.bodies[body];
  T* values = state.fields.template data<T>(values_);
  T* diagonal = state.fields.template data<T>(diagonal_);
  with_kernel(kernel_, [&](auto kernel) {
    using Kernel = decltype(kernel);
    if (form_ == Form::particles) {
      with_values([&](auto count) { scatter_values<Kernel, count>(grid, particles, ranges, source, values, diagonal); });
      return;
    }
    with_entries<T>([&](auto* entries) {
      if (sums_ == Sums::volume) {
        scatter_values_and_stencil<Kernel, 1>(grid, particles, ranges, source, state.fields.template data<T>(volume_sum_),
                                              diagonal, entries, touched_);
        return;
      }
      with_values([&](auto count) {
        scatter_values_and_stencil<Kernel, count>(grid, particles, ranges, source, values, diagonal, entries, touched_);
      });
    });
  });
}

template <int Dim>
template <class T, class F>
void PhaseSystem<Dim>::with_entries(F&& f) {
  if (single_entries_) {
    f(static_cast<float*>(entries_.data()));
  } else {
    f(static_cast<T*>(entries_.data()));
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
void PhaseSystem<Dim>::find_rows(const State<Dim>& state) {
  const std::size_t owned = static_cast<std::size_t>(state.topology().owned()) * nodes_per_block<Dim>;
  if (row_nodes_.size() != owned) row_nodes_.resize(owned);
  std::size_t rows = 0;
  const auto find = [&](const T* volumes, int stride) {
    for (std::size_t i = 0; i < owned; ++i) {
      row_nodes_[rows] = i;
      rows += volumes[i * stride] > 0;
    }
  };
  if (sums_ == Sums::volume) {
    find(state.fields.template data<T>(volume_sum_), 1);
  } else {
    with_values([&](auto count) { find(state.fields.template data<T>(values_) + volume, count); });
  }
  rows_ = std::span(row_nodes_).first(rows);
}

// M_ii, r_i and the start: c^n, or what the last two solutions point at.
template <int Dim>
template <class T>
void PhaseSystem<Dim>::fill_rows(const State<Dim>& state, Result result) {
  const T* sums = state.fields.template data<T>(values_);
  const T* volumes = sums_ == Sums::volume ? state.fields.template data<T>(volume_sum_) : nullptr;
  const bool has_phase = !volumes || starts_from_values(state), increment = result == Result::increment,
             has_last = !increment && last_sort_ == state.distribution.sorts();
  const std::size_t owned = row_nodes_.size();
  if (mass_.size() != owned) mass_.resize(owned);
  if (increment && start_.size() != owned) start_.resize(owned);
  const std::span<Real> rhs = solver_.rhs(), solution = solver_.solution();
  with_values([&](auto count) {
    for (std::size_t r = 0; r < rows_.size(); ++r) {
      const std::size_t i = rows_[r];
      const T* node = sums + i * count;
      const Real all = volumes ? volumes[i] : node[volume];
      mass_[r] = all + memory_ * all + (sums_ == Sums::all ? node[drive] : 0);
      rhs[r] = all + (volumes ? 0 : memory_ * node[phase]);
      Real start = has_phase && node[volume] > 0
                       ? static_cast<Real>(node[phase]) / static_cast<Real>(node[volume])
                       : 1.0;
      if (increment) start_[r] = start;
      if (has_last && last_solution_[i] != no_value) start = last_solution_[i] + last_change_[i];
      solution[r] = start;
    }
  });
}

// y = (M + H) x. Ghosts of x come while the part that needs none is under way. Nodes without a row hold 0 in `result_`.
template <int Dim>
template <class T>
void PhaseSystem<Dim>::apply(State<Dim>& state, const Real* x, Real* y) {
  auto s = state.timers.scope("phase products");
  state.fields.zero(product_);
  T* in = state.fields.template data<T>(result_);
  T* out = state.fields.template data<T>(product_);
  for (std::size_t r = 0; r < rows_.size(); ++r) in[rows_[r]] = static_cast<T>(x[r]);
  for (const bool edge : {false, true}) {
    if (edge) {
      state.halo().finish_fill();
    } else {
      state.halo().start_fill(state.fields, {result_});
    }
    with_kernel(kernel_, [&](auto kernel) {
      using Kernel = decltype(kernel);
      if (form_ == Form::stencil) {
        with_entries<T>([&](const auto* entries) {
          apply_stencil<Kernel>(state.topology(), edge ? edge_ : inner_, entries, in, out);
        });
        return;
      }
      const ScalarGrid<Dim> grid{state.geometry(), state.topology()};
      for (const Part& part : parts_) {
        const Body<Dim>& body = state.bodies[part.body];
        apply_operator<Kernel>(grid, body, active_->select(body, edge ? body.boundary : body.interior), columns<T>(state, part),
                               in, out);
      }
    });
  }
  state.halo().sum(state.fields, {product_});
  for (std::size_t r = 0; r < rows_.size(); ++r) y[r] = mass_[r] * x[r] + out[rows_[r]];
}

// A box reaches from its block to those behind it.
template <int Dim>
void PhaseSystem<Dim>::find_blocks(const BlockTopology<Dim>& topology) {
  inner_.clear();
  edge_.clear();
  for (Slot s = 0; s < topology.size(); ++s) {
    if (!touched_[s]) continue;
    const Slot* around = topology.neighbours(s);
    const bool edge = std::any_of(around + block_neighbours<Dim> / 2, around + block_neighbours<Dim>,
                                  [&topology](Slot other) { return other >= topology.owned(); });
    (edge ? edge_ : inner_).push_back(s);
  }
}

// The stencil in the order of a grid field, summed over the ranks.
template <int Dim>
template <class Stencil, class T>
void PhaseSystem<Dim>::stencil_to_field(State<Dim>& state) {
  GridFields& fields = state.fields;
  fields.zero(stencil_);
  T* out = fields.template data<T>(stencil_);
  with_entries<T>([&](const auto* in) {
    for (Slot s = 0; s < state.topology().size(); ++s) {
      if (!touched_[s]) continue;
      for (int n = 0; n < nodes_per_block<Dim>; ++n) {
        T* entries = out + (static_cast<std::size_t>(s) * nodes_per_block<Dim> + n) * Stencil::size;
        for (int e = 0; e < Stencil::size; ++e) entries[e] = in[Stencil::index(s, n, Stencil::offset(e))];
      }
    }
  });
  state.halo().sum(fields, {stencil_});
}

// The rows of M + H: the entry of two nodes stands at the lower corner of the box that they span.
template <int Dim>
template <class Stencil, class T>
void PhaseSystem<Dim>::assemble(State<Dim>& state, GlobalIndex first_row) {
  GridFields& fields = state.fields;
  stencil_to_field<Stencil, T>(state);
  T* number = fields.template data<T>(row_number_);
  std::fill_n(number, 2 * fields.nodes(), T(-1));
  for (std::size_t r = 0; r < rows_.size(); ++r) {
    const GlobalIndex row = first_row + static_cast<GlobalIndex>(r);
    number[2 * rows_[r]] = static_cast<T>(row / row_base);
    number[2 * rows_[r] + 1] = static_cast<T>(row % row_base);
  }
  state.distribution.row_halo().fill(fields, {stencil_, row_number_});
  const T* stencil = fields.template data<T>(stencil_);

  matrix_.clear();
  for (std::size_t r = 0; r < rows_.size(); ++r) {
    const Slot* around = state.topology().neighbours(static_cast<Slot>(rows_[r] / nodes_per_block<Dim>));
    const IntVec<Dim> node = node_in_block<Dim>(static_cast<int>(rows_[r] % nodes_per_block<Dim>));
    for_offsets<Dim>(Stencil::offsets - 1, [&](int, const IntVec<Dim>& offset) {
      const std::size_t other = node_around<Dim>(around, node + offset),
                        corner = node_around<Dim>(around, node + offset.cwiseMin(0));
      if (other == no_node || corner == no_node || number[2 * other] < 0) return;
      Real entry = stencil[corner * Stencil::size + static_cast<std::size_t>(Stencil::number(offset.cwiseAbs()))];
      if (other == rows_[r]) entry += mass_[r];
      if (entry == 0) return;
      matrix_.columns.push_back(static_cast<int>(static_cast<GlobalIndex>(number[2 * other]) * row_base +
                                                 static_cast<GlobalIndex>(number[2 * other + 1])));
      matrix_.values.push_back(entry);
    });
    matrix_.starts.push_back(static_cast<int>(matrix_.columns.size()));
  }
  solver_.assemble(matrix_);
}

template <int Dim>
template <class T>
int PhaseSystem<Dim>::solve_in(State<Dim>& state, Result result) {
  auto assembly = state.timers.scope("phase assembly");
  find_rows<T>(state);
  const auto spare = form_ == Form::matrix ? LinearSolver::Spare::none : LinearSolver::Spare::some;
  const GlobalIndex first_row = solver_.set_rows(static_cast<int>(rows_.size()), spare);
  fill_rows<T>(state, result);
  state.fields.zero(result_);
  if (form_ == Form::matrix) {
    with_stencil([&](auto stencil) { assemble<decltype(stencil), T>(state, first_row); });
  } else {
    if (form_ == Form::stencil) find_blocks(state.topology());
    const T* laplacian = state.fields.template data<T>(diagonal_);
    solver_.set_operator([this, &state](const Real* x, Real* y) { apply<T>(state, x, y); },
                         [this, laplacian](Real* diagonal) {
                           for (std::size_t r = 0; r < rows_.size(); ++r)
                             diagonal[r] = mass_[r] + laplacian[rows_[r]];
                         });
  }
  assembly.stop();
  auto krylov = state.timers.scope("phase Krylov");
  const int iterations = solver_.solve();
  krylov.stop();
  if (result == Result::value) keep_solution(state);
  const std::span<const Real> solution = solver_.solution();
  T* out = state.fields.template data<T>(result_);
  for (std::size_t r = 0; r < rows_.size(); ++r)
    out[rows_[r]] = static_cast<T>(result == Result::value ? solution[r] : solution[r] - start_[r]);
  return iterations;
}

template <int Dim>
bool PhaseSystem<Dim>::starts_from_values(const State<Dim>& state) const {
  return sums_ == Sums::volume && last_sort_ != state.distribution.sorts();
}

template <int Dim>
void PhaseSystem<Dim>::keep_solution(const State<Dim>& state) {
  const bool same_nodes = last_sort_ == state.distribution.sorts();
  last_sort_ = state.distribution.sorts();
  if (!same_nodes) {
    last_solution_.assign(row_nodes_.size(), no_value);
    last_change_.resize(row_nodes_.size());
  }
  const std::span<const Real> solution = solver_.solution();
  std::size_t next = 0;  // node after the last row's; those between two rows have no solution
  for (std::size_t r = 0; r < rows_.size(); ++r) {
    const std::size_t i = rows_[r];
    for (; next < i; ++next) last_solution_[next] = no_value;
    next = i + 1;
    const Real last = last_solution_[i];
    last_change_[i] = last != no_value ? solution[r] - last : 0;
    last_solution_[i] = solution[r];
  }
  std::fill(last_solution_.begin() + static_cast<std::ptrdiff_t>(next), last_solution_.end(), no_value);
}

template <int Dim>
int PhaseSystem<Dim>::solve(State<Dim>& state, Result result) {
  return with_precision(state.precision, [&](auto zero) { return solve_in<decltype(zero)>(state, result); });
}

template <int Dim>
void PhaseSystem<Dim>::project_phase(State<Dim>& state) {
  with_precision(state.precision, [&](auto zero) {
    using T = decltype(zero);
    state.fields.zero(result_);
    const T* node = state.fields.template data<T>(values_);
    T* result = state.fields.template data<T>(result_);
    const std::size_t owned = static_cast<std::size_t>(state.topology().owned()) * nodes_per_block<Dim>;
    with_values([&](auto count) {
      for (std::size_t i = 0; i < owned; ++i, node += count)
        if (node[Value::volume] > 0) result[i] = node[Value::phase] / node[Value::volume];
    });
  });
  state.halo().fill(state.fields, {result_});
}

template <int Dim>
MemoryAccount PhaseSystem<Dim>::memory() const {
  return {{"phase_field/stencil",
           entries_.allocated() + capacity_bytes(touched_) + capacity_bytes(inner_) + capacity_bytes(edge_)},
          {"phase_field/rows", capacity_bytes(row_nodes_) + capacity_bytes(mass_) + capacity_bytes(start_) +
                                   capacity_bytes(last_solution_) + capacity_bytes(last_change_)},
          {"phase_field/matrix rows",
           capacity_bytes(matrix_.values) + capacity_bytes(matrix_.columns) + capacity_bytes(matrix_.starts)},
          {"phase_field/PETSc", solver_.allocated_bytes()}};
}

#define MPM_INSTANTIATE(Dim)                                                                                      \
  template class PhaseSystem<Dim>;                                                                                \
  template void PhaseSystem<Dim>::scatter(State<Dim>&, std::size_t, const std::vector<int>&, ValueSource<float>&); \
  template void PhaseSystem<Dim>::scatter(State<Dim>&, std::size_t, const std::vector<int>&, ValueSource<double>&);
MPM_INSTANTIATE(2)
MPM_INSTANTIATE(3)
#undef MPM_INSTANTIATE

}  // namespace mpm
