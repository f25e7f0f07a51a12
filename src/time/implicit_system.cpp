#include "mpm_hpc/time/implicit_system.hpp"

#include <algorithm>
#include <cmath>

#include "mpm_hpc/effects/material_columns.hpp"
#include "mpm_hpc/solvers/linear_solver.hpp"

namespace mpm {

namespace {

constexpr std::size_t room = StencilProducts<2>::room;

// Largest row sum of |dt grad v|, up to which a Newton step may change a particle's deformation at once.
constexpr Real largest_strain_of_step = 0.5;

}  // namespace

// Arrays of one chunk, [p - begin], in the scratch; finite behind the last particle.
template <int Dim>
struct ImplicitSystem<Dim>::Columns {
  Real *gradient[Dim * Dim], *stress[Dim * Dim], *tangent[TrialColumns<Dim>::tangent_size];
  static constexpr std::size_t count = 2 * Dim * Dim + TrialColumns<Dim>::tangent_size;

  explicit Columns(AlignedBuffer& scratch) {
    Real* next = static_cast<Real*>(scratch.data());
    for (Real*& p : gradient) p = next, next += room;
    for (Real*& p : stress) p = next, next += room;
    for (Real*& p : tangent) p = next, next += room;
  }
};

template <int Dim>
ImplicitSystem<Dim>::ImplicitSystem(State<Dim>& state, const ImplicitOptions& options)
    : options_(options), solver_(state.communicator(), options_prefix, Dim, options.newton) {
  require(state.precision == Precision::double_precision,
          "time.integrator: implicit and quasi_static steps need precision = \"double\"; the residual of a "
          "single-precision "
          "grid has no digits left");
  require(state.deformation_update == DeformationUpdate::first_order,
          "time.deformation_update: implicit and quasi_static steps take F <- (I + dt grad v) F; leave the "
          "key out");
  const std::string entries = LinearSolver::preconditioner_of_entries(options_prefix);
  require(!options_.matrix_free || entries.empty(),
          "newton.operator = \"matrix_free\" has no entries for -newton_pc_type {}; choose \"assembled\"",
          entries);
  storage_ = storage_for(entries);
  for (std::size_t b = 0; b < state.bodies.size(); ++b)
    products_.push_back(make_stencil_products<Dim>(state.transfer));
  GridFields& f = state.fields;
  velocity_ = f.add({.name = "implicit_velocity", .units = "m/s", .components = Dim, .halo_components = Dim});
  force_ = f.add({.name = "implicit_force", .units = "N s", .components = Dim, .halo_components = Dim});
  if (!options_.matrix_free && !products_.empty()) {
    const int entries_of_node = products_.front()->tangent_blocks() * Dim * Dim;
    stencil_ = f.add({.name = "implicit_tangent",
                      .units = "J",
                      .components = entries_of_node,
                      .halo_components = entries_of_node});
    row_number_ = f.add({.name = "implicit_row", .units = "1"});
    projector_ = f.add({.name = "implicit_projector",
                        .units = "1",
                        .components = Dim * Dim + 1,
                        .halo_components = Dim * Dim + 1});
    state.distribution.require_row_halo();
  }
  tangents_.resize(state.bodies.size());
  scratch_.allocate(Columns::count * room * sizeof(Real), 0);
  std::fill_n(static_cast<Real*>(scratch_.data()), Columns::count * room, 0.0);
}

template <int Dim>
void ImplicitSystem<Dim>::begin(State<Dim>& state, const Vec<Dim>& acceleration) {
  dt_ = state.dt;
  for (std::size_t b = 0; b < state.bodies.size(); ++b) {
    products_[b]->rebuild(state.geometry(), state.topology(), state.bodies[b]);
    if (options_.matrix_free)
      tangents_[b].allocate(static_cast<std::size_t>(TrialColumns<Dim>::tangent_size) *
                                (static_cast<std::size_t>(state.bodies[b].particles.size()) + room) *
                                sizeof(Real),
                            0);
  }
  const auto owned = static_cast<std::size_t>(state.topology().owned()) * nodes_per_block<Dim>;
  const Real* node = state.fields.template data<Real>(state.nodes);
  rows_.clear();
  mass_.clear();
  start_.clear();
  row_of_node_.assign(owned, -1);
  for (std::size_t i = 0; i < owned; ++i, node += node_values) {
    if (!(node[Dim] > 0)) continue;
    row_of_node_[i] = static_cast<int>(rows_.size());
    rows_.push_back(i);
    mass_.push_back(node[Dim]);
    for (int a = 0; a < Dim; ++a) start_.push_back(node[a] + dt_ * acceleration[a]);
  }
  load_.assign(start_.size(), 0);
  // The quasi-static momentum is that of the loads alone.
  if (!options_.inertia)
    for (std::size_t k = 0; k < start_.size(); ++k) load_[k] = mass_[k / Dim] * start_[k];
  x_ = start_;
  if (!options_.inertia) std::fill(x_.begin(), x_.end(), 0.0);
  if (options_.stabilisation > 0) set_stiffness(state);
  solver_.set_rows(rows());
  neighbours_.clear();
  clear_constraints();
}

// From the particles as they are, so that E keeps its form during the step.
template <int Dim>
void ImplicitSystem<Dim>::set_stiffness(State<Dim>& state) {
  Columns columns(scratch_);
  const Real factor = options_.stabilisation / std::pow(state.geometry().spacing(), 2);
  for (int c = 0; c < Dim * Dim; ++c) std::fill_n(columns.gradient[c], room, 0.0);
  for (std::size_t b = 0; b < state.bodies.size(); ++b)
    for (const bool boundary : {true, false})
      for (const Chunk& chunk : products_[b]->chunks(boundary)) {
        TrialColumns<Dim> out;
        out.modulus = columns.stress[0];
        state.material_of(b).trial(material_columns<Real>(state, b), columns.gradient, dt_, chunk.begin,
                                   chunk.end, out);
        for (Index p = 0; p < chunk.end - chunk.begin; ++p) out.modulus[p] *= factor;
        products_[b]->set_stiffness(chunk, out.modulus);
      }
}

template <int Dim>
void ImplicitSystem<Dim>::clear_constraints() {
  constraints_.clear();
  constraint_of_row_.assign(rows_.size(), -1);
}

template <int Dim>
void ImplicitSystem<Dim>::constrain(int row, const Mat<Dim>& basis, int count, const Vec<Dim>& velocity) {
  const Mat<Dim> held = basis.leftCols(count) * basis.leftCols(count).transpose();
  constraint_of_row_[row] = static_cast<int>(constraints_.size());
  constraints_.push_back({row, Mat<Dim>::Identity() - held});
  Eigen::Map<Vec<Dim>> x(x_.data() + static_cast<std::size_t>(row) * Dim);
  x += held * (velocity - x);
}

template <int Dim>
void ImplicitSystem<Dim>::set_load(int row, const Vec<Dim>& impulse) {
  for (int a = 0; a < Dim; ++a) {
    const std::size_t k = static_cast<std::size_t>(row) * Dim + a;
    load_[k] = impulse[a] + (options_.inertia ? 0 : mass_[row] * start_[k]);
  }
}

template <int Dim>
void ImplicitSystem<Dim>::project(Real* values) const {
  for (const Constraint& c : constraints_) {
    Eigen::Map<Vec<Dim>> value(values + static_cast<std::size_t>(c.row) * Dim);
    value = (c.projector * value).eval();
  }
}

// Calls f(body, chunk, columns) with the gradients of v for all chunks; those that need no ghosts come while these arrive.
template <int Dim>
template <class F>
void ImplicitSystem<Dim>::sweep(State<Dim>& state, const Real* v, F&& f) {
  state.fields.zero(velocity_);
  Real* field = state.fields.template data<Real>(velocity_);
  for (std::size_t r = 0; r < rows_.size(); ++r)
    for (int a = 0; a < Dim; ++a) field[rows_[r] * Dim + a] = v[r * Dim + a];
  Columns columns(scratch_);
  state.halo().start_fill(state.fields, {velocity_});
  for (const bool boundary : {false, true}) {
    if (boundary) state.halo().finish_fill();
    for (std::size_t b = 0; b < state.bodies.size(); ++b)
      for (const Chunk& chunk : products_[b]->chunks(boundary)) {
        products_[b]->gather(chunk, field, columns.gradient);
        f(b, chunk, columns);
      }
  }
}

template <int Dim>
void ImplicitSystem<Dim>::sum_to_rows(State<Dim>& state, FieldId field, Real* out) {
  state.halo().sum(state.fields, {field});
  const Real* values = state.fields.template data<Real>(field);
  for (std::size_t r = 0; r < rows_.size(); ++r)
    for (int a = 0; a < Dim; ++a) out[r * Dim + a] = values[rows_[r] * Dim + a];
}

// The energy of the particles and, if wanted, what force_ sums to on the nodes of this rank and its ghosts.
template <int Dim>
TrialSums ImplicitSystem<Dim>::forces(State<Dim>& state, const Real* v, bool wanted) {
  if (wanted) state.fields.zero(force_);
  Real* force = state.fields.template data<Real>(force_);
  TrialSums sums;
  const Real* velocity = state.fields.template data<Real>(velocity_);
  sweep(state, v, [&](std::size_t b, const Chunk& chunk, Columns& columns) {
    TrialColumns<Dim> out;
    if (wanted) std::copy(std::begin(columns.stress), std::end(columns.stress), out.stress);
    sums.include(state.material_of(b).trial(material_columns<Real>(state, b), columns.gradient, dt_,
                                            chunk.begin, chunk.end, out));
    if (wanted) products_[b]->scatter(chunk, columns.stress, force);
    sums.energy += dt_ * dt_ * products_[b]->stabilise(chunk, velocity, dt_, wanted ? force : nullptr);
  });
  return sums;
}

template <int Dim>
NewtonProblem::Potential ImplicitSystem<Dim>::potential(State<Dim>& state, const Real* v) {
  const TrialSums elastic = forces(state, v, false);
  // NaN of a particle that is inside out would not survive all sums.
  std::vector<Real> sums = {elastic.energy, elastic.magnitude, elastic.min_jacobian > 0 ? 0.0 : 1.0};
  for (std::size_t r = 0; r < rows_.size(); ++r)
    for (int a = 0; a < Dim; ++a) {
      const std::size_t k = r * Dim + a;
      const Real change = v[k] - start_[k];
      const Real kinetic = options_.inertia ? 0.5 * mass_[r] * change * change : 0, work = load_[k] * v[k];
      sums[0] += kinetic - work;
      sums[1] += kinetic + std::abs(work);
    }
  state.communicator().sum(sums);
  if (sums[2] > 0 || !std::isfinite(sums[0])) sums[0] = std::numeric_limits<Real>::infinity();
  return {sums[0], sums[1]};
}

template <int Dim>
Real ImplicitSystem<Dim>::residual(State<Dim>& state, const Real* v, Real* gradient, bool constrained) {
  forces(state, v, true);
  sum_to_rows(state, force_, gradient);
  std::vector<Real> squares(4, 0.0);
  for (std::size_t r = 0; r < rows_.size(); ++r)
    for (int a = 0; a < Dim; ++a) {
      const std::size_t k = r * Dim + a;
      const Real elastic = dt_ * gradient[k], inertia = options_.inertia ? mass_[r] * (v[k] - start_[k]) : 0;
      squares[0] += elastic * elastic;
      squares[1] += inertia * inertia;
      squares[2] += load_[k] * load_[k];
      if (options_.inertia) squares[3] += std::pow(mass_[r] * v[k], 2);
      gradient[k] = inertia + elastic - load_[k];
    }
  state.communicator().sum(squares);
  if (constrained) project(gradient);
  // A change of velocity has the rounding errors of the velocity.
  const Real rounding = rounding_ + 1e-15 * std::sqrt(squares[3]);
  return std::sqrt(*std::max_element(squares.begin(), squares.begin() + 3)) + rounding / options_.newton.tolerance;
}

template <int Dim>
Real* ImplicitSystem<Dim>::tangent_of(std::size_t body, int component) const {
  const std::size_t stride = tangents_[body].allocated() / sizeof(Real) / TrialColumns<Dim>::tangent_size;
  return static_cast<Real*>(tangents_[body].data()) + stride * static_cast<std::size_t>(component);
}

// Nodes without mass are neither written nor read.
template <int Dim>
void ImplicitSystem<Dim>::clear_stencil(State<Dim>& state) {
  const auto entries = static_cast<std::size_t>(products_.front()->tangent_blocks()) * Dim * Dim,
             owned = static_cast<std::size_t>(state.topology().owned()) * nodes_per_block<Dim>;
  Real* stencil = state.fields.template data<Real>(stencil_);
  for (const std::size_t node : rows_) std::fill_n(stencil + node * entries, entries, 0.0);
  std::fill(stencil + owned * entries, stencil + static_cast<std::size_t>(state.fields.nodes()) * entries, 0.0);
}

template <int Dim>
void ImplicitSystem<Dim>::linearise(State<Dim>& state, const Real* v, bool projected) {
  auto s = state.timers.scope("Newton assembly");
  if (stencil_ == no_field) {
    state.fields.zero(force_);
  } else {
    clear_stencil(state);
  }
  Real* diagonal = state.fields.template data<Real>(force_);
  Real* stencil = stencil_ == no_field ? nullptr : state.fields.template data<Real>(stencil_);
  auto particles = state.timers.scope("Newton sweep");
  sweep(state, v, [&](std::size_t b, const Chunk& chunk, Columns& columns) {
    TrialColumns<Dim> out;
    std::copy(std::begin(columns.tangent), std::end(columns.tangent), out.tangent);
    out.project = projected;
    state.material_of(b).trial(material_columns<Real>(state, b), columns.gradient, dt_, chunk.begin,
                               chunk.end, out);
    if (stencil) {
      products_[b]->scatter_tangent(chunk, columns.tangent, stencil);
    } else {
      products_[b]->scatter_diagonal(chunk, columns.tangent, diagonal);
      for (int n = 0; n < out.tangent_size; ++n)
        std::copy_n(columns.tangent[n], chunk.end - chunk.begin, tangent_of(b, n) + chunk.begin);
    }
  });
  particles.stop();
  diagonal_.resize(x_.size());
  if (stencil) {
    state.halo().sum(state.fields, {stencil_});
    const std::size_t of_node =
        static_cast<std::size_t>(products_.front()->tangent_blocks()) * Dim * Dim;
    for (std::size_t k = 0; k < diagonal_.size(); ++k)
      diagonal_[k] = stencil[rows_[k / Dim] * of_node + k % Dim * (Dim + 1)];
  } else {
    sum_to_rows(state, force_, diagonal_.data());
  }
  std::vector<Real> square(1, 0.0);
  for (std::size_t k = 0; k < diagonal_.size(); ++k) {
    diagonal_[k] *= dt_ * dt_;
    square[0] += diagonal_[k] * diagonal_[k];
    if (options_.inertia) diagonal_[k] += mass_[k / Dim];
  }
  state.communicator().sum(square);
  // Deformation gradients have rounding errors as if nodes were misplaced by this share of a cell.
  rounding_ = 1e-14 * state.geometry().spacing() / dt_ * std::sqrt(square[0]);
  // A constrained direction's equation is its own, scaled like its neighbours.
  for (Constraint& c : constraints_) {
    Eigen::Map<Vec<Dim>> d(diagonal_.data() + static_cast<std::size_t>(c.row) * Dim);
    c.scale = d.mean();
    Vec<Dim> projected;
    for (int a = 0; a < Dim; ++a)
      projected[a] = c.projector.col(a).cwiseAbs2().dot(d) + (1 - c.projector(a, a)) * c.scale;
    d = projected;
  }
  if (stencil) {
    assemble(state);
  } else {
    solver_.set_operator([this, &state](const Real* d, Real* y) { apply(state, d, y); }, diagonal_);
  }
}

// y = (P A P + (I - P) D) d with the tangents of the last linearise(), without a matrix.
template <int Dim>
void ImplicitSystem<Dim>::apply(State<Dim>& state, const Real* d, Real* y) {
  std::vector<Real> free(d, d + x_.size());
  project(free.data());
  state.fields.zero(force_);
  Real* force = state.fields.template data<Real>(force_);
  const Real* velocity = state.fields.template data<Real>(velocity_);
  constexpr int block = Dim * Dim;
  sweep(state, free.data(), [&](std::size_t b, const Chunk& chunk, Columns& columns) {
    for (Index p = chunk.begin; p < chunk.end; p += pack_width<Real>) {
      using S = Pack<Real>;
      S L[block];
      for (int m = 0; m < block; ++m) L[m] = load<S>(columns.gradient[m] + (p - chunk.begin));
      for (int n = 0; n < block; ++n) {
        S sum = S::Zero();
        for (int m = 0; m < block; ++m)
          sum += Eigen::Map<const S>(tangent_of(b, SymTensor<S, block>::index(n, m)) + p) * L[m];
        store(columns.stress[n] + (p - chunk.begin), sum);
      }
    }
    products_[b]->scatter(chunk, columns.stress, force);
    products_[b]->stabilise(chunk, velocity, 1, force);
  });
  sum_to_rows(state, force_, y);
  for (std::size_t k = 0; k < x_.size(); ++k)
    y[k] = dt_ * dt_ * y[k] + (options_.inertia ? mass_[k / Dim] * free[k] : 0);
  project(y);
  for (const Constraint& c : constraints_)
    for (int a = 0; a < Dim; ++a) {
      const std::size_t k = static_cast<std::size_t>(c.row) * Dim + a;
      y[k] += c.scale * (d[k] - free[k]);
    }
}

// What a step may take at once without turning a particle inside out; the potential finds what this misses.
template <int Dim>
Real ImplicitSystem<Dim>::step_share(State<Dim>& state, const Real* step) {
  Real largest = 0;
  sweep(state, step, [&](std::size_t, const Chunk& chunk, Columns& columns) {
    for (Index p = 0; p < chunk.end - chunk.begin; ++p)
      for (int a = 0; a < Dim; ++a) {
        Real row = 0;
        for (int b = 0; b < Dim; ++b) row += std::abs(columns.gradient[a * Dim + b][p]);
        largest = std::max(largest, row);
      }
  });
  largest = dt_ * state.communicator().max(largest);
  return largest > largest_strain_of_step ? largest_strain_of_step / largest : 1;
}

template <int Dim>
NewtonResult ImplicitSystem<Dim>::solve(State<Dim>& state) {
  NewtonProblem problem;
  problem.potential = [&](const Real* v) {
    auto s = state.timers.scope("Newton potential");
    return potential(state, v);
  };
  problem.residual = [&](const Real* v, Real* gradient) {
    auto s = state.timers.scope("Newton residual");
    return residual(state, v, gradient);
  };
  problem.linearise = [&](const Real* v, bool projected) { linearise(state, v, projected); };
  problem.step_share = [&](const Real*, const Real* step) {
    auto s = state.timers.scope("Newton potential");
    return step_share(state, step);
  };
  problem.project = [&](Real* step) { project(step); };
  NewtonResult result = solver_.solve(problem, x_);
  reaction_.resize(x_.size());
  if (result.converged) residual(state, x_.data(), reaction_.data(), false);
  return result;
}

template <int Dim>
void ImplicitSystem<Dim>::deform(State<Dim>& state) {
  const DeformationStep step{dt_, DeformationUpdate::first_order};
  sweep(state, x_.data(), [&](std::size_t b, const Chunk& chunk, Columns& columns) {
    state.material_of(b).advance(material_columns<Real>(state, b), columns.gradient, step, chunk.begin, chunk.end);
  });
}

template <int Dim>
MemoryAccount ImplicitSystem<Dim>::memory() const {
  std::size_t tangents = scratch_.allocated();
  for (const AlignedBuffer& buffer : tangents_) tangents += buffer.allocated();
  return {{"implicit/rows", capacity_bytes(rows_) + capacity_bytes(row_of_node_) + capacity_bytes(mass_) +
                                capacity_bytes(start_) + capacity_bytes(load_) + capacity_bytes(x_) +
                                capacity_bytes(reaction_) + capacity_bytes(diagonal_) +
                                capacity_bytes(constraint_of_row_)},
          {"implicit/tangents", tangents},
          {"implicit/matrix rows",
           capacity_bytes(matrix_.values) + capacity_bytes(matrix_.columns) + capacity_bytes(matrix_.starts) +
               capacity_bytes(neighbours_) + capacity_bytes(first_neighbours_)},
          {"implicit/PETSc", solver_.allocated_bytes()}};
}

template class ImplicitSystem<2>;
template class ImplicitSystem<3>;

}  // namespace mpm
