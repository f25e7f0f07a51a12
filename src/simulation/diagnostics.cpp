#include "mpm_hpc/simulation/diagnostics.hpp"

#include <algorithm>
#include <cmath>

#include "mpm_hpc/effects/material_columns.hpp"
#include "mpm_hpc/math/bspline.hpp"

namespace mpm {

namespace {

constexpr const char* axis_names[] = {"x", "y", "z"};

// Diagonal of D_p over h^2 of a particle at x.
template <int Dim>
Vec<3> inertia(const State<Dim>& state, const Vec<3>& x) {
  return with_kernel(state.transfer.kernel, [&](auto kernel) {
    Vec<3> diagonal = Vec<3>::Zero();
    for (int a = 0; a < Dim; ++a) {
      const Real xi = (x[a] - state.geometry().origin()[a]) * state.geometry().inverse_spacing();
      diagonal[a] = kernel.inertia(xi - std::floor(xi - kernel.shift));
    }
    return diagonal;
  });
}

// What a rank's particles add to the sums; the order is that of history_row.
template <int Dim>
struct Sums {
  CompensatedSum mass, momentum[Dim], angular[3], kinetic, elastic;

  template <class T>
  void add_body(const State<Dim>& state, std::size_t number) {
    const Body<Dim>& body = state.bodies[number];
    const FieldSet& f = body.particles;
    const MaterialColumns<Dim, T> columns = material_columns<T>(state, number);
    // Affine particles carry angular momentum in their gradient: L = x x m v + m (B^T : eps), B = C D.
    const bool affine = state.transfer.affine();
    const Real h2 = std::pow(state.geometry().spacing(), 2);
    alignas(64) T energy[chunk_particles];
    for (const BlockRange& range : body.ranges)
      for (Index begin = range.begin; begin < range.end; begin += chunk_particles) {
        const Index end = std::min<Index>(begin + chunk_particles, range.end);
        state.material_of(number).energy_density(columns, begin, end, energy);
        for (Index p = begin; p < end; ++p) {
          if (body.is_padding(p)) continue;
          const Real m = f.template data<T>(core::mass)[p];
          Vec<3> x = Vec<3>::Zero(), v = Vec<3>::Zero();
          Eigen::Matrix3d C = Eigen::Matrix3d::Zero();
          for (int a = 0; a < Dim; ++a) {
            x[a] = f.template data<Real>(core::position, a)[p];
            v[a] = f.template data<T>(core::velocity, a)[p];
            if (affine)
              for (int b = 0; b < Dim; ++b) C(a, b) = f.template data<T>(core::velocity_gradient, a * Dim + b)[p];
            momentum[a].add(m * v[a]);
          }
          mass.add(m);
          const Vec<3> D = affine ? Vec<3>(h2 * inertia(state, x)) : Vec<3>(Vec<3>::Zero());
          for (int c = 0; c < 3; ++c) {
            const int a = (c + 1) % 3, b = (c + 2) % 3;
            angular[c].add(m * (x[a] * v[b] - x[b] * v[a] + C(b, a) * D[a] - C(a, b) * D[b]));
          }
          if (state.inertia) kinetic.add(0.5 * m * v.squaredNorm());
          elastic.add(static_cast<Real>(f.template data<T>(core::volume)[p]) * energy[p - begin]);
        }
      }
  }
};

}  // namespace

template <int Dim>
GlobalIndex count_particles(const State<Dim>& state) {
  GlobalIndex count = 0;
  for (const auto& body : state.bodies) count += body.real_particles();
  return state.communicator().sum(count);
}

template <int Dim>
std::vector<HistoryValue> history_row(State<Dim>& state, const std::vector<std::unique_ptr<Effect<Dim>>>& effects) {
  using Kind = HistoryValue::Kind;
  // Effects first: they may have to sort, which changes what the rest reads.
  std::vector<HistoryValue> of_effects;
  for (const auto& effect : effects) effect->history(state, of_effects);
  Sums<Dim> sums;
  with_precision(state.precision, [&](auto zero) {
    for (std::size_t b = 0; b < state.bodies.size(); ++b) sums.template add_body<decltype(zero)>(state, b);
  });
  std::vector<CompensatedSum> exact = {sums.mass};
  for (const auto& s : sums.momentum) exact.push_back(s);
  for (const auto& s : sums.angular) exact.push_back(s);
  exact.insert(exact.end(), {sums.kinetic, sums.elastic, {state.ledger["external_work"], 0}});
  const bool plastic = std::any_of(state.materials.begin(), state.materials.end(),
                                   [](const auto& material) { return material->plasticity() != nullptr; });
  if (plastic) exact.push_back({state.ledger["plastic_work"], 0});
  std::vector<Real> lowest, highest;
  for (const HistoryValue& v : of_effects) {
    if (v.kind == Kind::sum) exact.push_back({v.value, 0});
    if (v.kind == Kind::min) lowest.push_back(v.value);
    if (v.kind == Kind::max) highest.push_back(v.value);
  }
  const Communicator& communicator = state.communicator();
  communicator.sum(exact);
  communicator.min(lowest);
  communicator.max(highest);

  std::vector<HistoryValue> row;
  std::size_t next = 0;
  auto put = [&row](std::string name, std::string unit, Real value) {
    row.push_back({std::move(name), std::move(unit), value});
  };
  put("step", "1", static_cast<Real>(state.step));
  put("time", "s", state.time);
  put("dt", "s", state.dt);
  put("particles", "1", static_cast<Real>(count_particles(state)));
  put("mass", "kg", exact[next++].value());
  for (int a = 0; a < Dim; ++a) put(fmt::format("momentum_{}", axis_names[a]), "kg m/s", exact[next++].value());
  for (int a = 0; a < 3; ++a, ++next)
    if (Dim == 3 || a == 2) put(fmt::format("angular_momentum_{}", axis_names[a]), "kg m^2/s", exact[next].value());
  Real energy = exact[next].value() + exact[next + 1].value();
  put("kinetic_energy", "J", exact[next++].value());
  put("elastic_energy", "J", exact[next++].value());
  const Real work = exact[next++].value();
  const Real plastic_work = plastic ? exact[next++].value() : 0;
  energy += plastic_work;
  std::size_t low = 0, high = 0;
  for (HistoryValue& v : of_effects)
    v.value = v.kind == Kind::sum ? exact[next++].value() : v.kind == Kind::min ? lowest[low++] : highest[high++];
  for (const HistoryValue& v : of_effects)
    if (v.name.ends_with("_energy")) {
      row.push_back(v);
      energy += v.value;
    }
  // The first row's energy is what the balance starts from; rank 0 keeps it with the other sums.
  if (!state.ledger.entries().contains("initial_energy"))
    state.ledger["initial_energy"] = communicator.root() ? energy - work : 0.0;
  if (plastic) put("plastic_work", "J", plastic_work);
  put("external_work", "J", work);
  put("energy_residual", "J", energy - work - communicator.sum(state.ledger["initial_energy"]));
  put("min_J", "1", state.limits.min_jacobian);
  put("max_speed", "m/s", state.limits.kinematic.speed);
  for (const HistoryValue& v : of_effects)
    if (!v.name.ends_with("_energy")) row.push_back(v);
  // Iterations since the last row, residuals of the last step; of several solvers, the phase field's iterations are the effect's.
  for (const auto& [solver, column] : {std::pair{"newton", "newton_iterations"}, {"newton_krylov", "newton_krylov_iterations"}})
    if (const auto it = state.solvers.find(solver); it != state.solvers.end()) {
      put(column, "1", static_cast<Real>(it->second.iterations - it->second.told));
      it->second.told = it->second.iterations;
    }
  if (const auto it = state.solvers.find("newton"); it != state.solvers.end()) {
    put("newton_first_residual", "1", it->second.first_residual);
    put("newton_residual", "1", it->second.residual);
  }
  put("imbalance", "1", state.distribution.imbalance());
  return row;
}

namespace {

// Calls f(begin, end, storage) for each chunk of the particles, with scratch for `Components` columns.
template <int Components, class T, class F>
void for_chunks(Index begin, Index end, F&& f) {
  alignas(64) T storage[Components][chunk_particles];
  T* columns[Components];
  for (int c = 0; c < Components; ++c) columns[c] = storage[c];
  for (Index start = begin; start < end; start += chunk_particles)
    f(start, std::min<Index>(start + chunk_particles, end), columns);
}

// The value of particle p goes to out[p - begin].
template <int Dim>
void frame_jacobian(const State<Dim>& state, std::size_t body, Index begin, Index end, Real* out) {
  with_precision(state.precision, [&](auto zero) {
    using T = decltype(zero);
    const MaterialColumns<Dim, T> columns = material_columns<T>(state, body);
    for_chunks<1, T>(begin, end, [&](Index start, Index stop, T* const* J) {
      state.material_of(body).jacobian(columns, start, stop, J[0]);
      std::copy(J[0], J[0] + (stop - start), out + (start - begin));
    });
  });
}

template <int Dim>
void frame_von_mises(const State<Dim>& state, std::size_t body, Index begin, Index end, Real* out) {
  constexpr int components = SymTensor<Real, Dim>::size;
  with_precision(state.precision, [&](auto zero) {
    using T = decltype(zero);
    const MaterialColumns<Dim, T> columns = material_columns<T>(state, body);
    for_chunks<components + 1, T>(begin, end, [&](Index start, Index stop, T* const* tau) {
      const T* J = tau[components];
      state.material_of(body).stress(columns, start, stop, tau);
      state.material_of(body).jacobian(columns, start, stop, tau[components]);
      // Roots in a loop of their own: their error handling would keep the rest out of the vector registers.
      Real* values = out + (start - begin);
      for (Index i = 0; i < stop - start; ++i) {
        Real pressure = 0, squares = 0;
        for (int a = 0; a < Dim; ++a) pressure += tau[SymTensor<Real, Dim>::index(a, a)][i] / Dim;
        for (int a = 0; a < Dim; ++a)
          for (int b = 0; b < Dim; ++b) {
            const Real s = tau[SymTensor<Real, Dim>::index(a, b)][i] - (a == b ? pressure : 0);
            squares += s * s;
          }
        values[i] = 1.5 * squares;
      }
      for (Index i = 0; i < stop - start; ++i) values[i] = std::sqrt(values[i]) / J[i];
    });
  });
}

}  // namespace

template <int Dim>
std::vector<DerivedField> derived_fields(const State<Dim>& state) {
  return {{"jacobian", 1,
           [&state](std::size_t b, Index begin, Index end, Real* out) { frame_jacobian(state, b, begin, end, out); }},
          {"von_mises", 1,
           [&state](std::size_t b, Index begin, Index end, Real* out) { frame_von_mises(state, b, begin, end, out); }}};
}

#define MPM_INSTANTIATE(Dim)                                                                                        \
  template GlobalIndex count_particles<Dim>(const State<Dim>&);                                                     \
  template std::vector<HistoryValue> history_row<Dim>(State<Dim>&, const std::vector<std::unique_ptr<Effect<Dim>>>&); \
  template std::vector<DerivedField> derived_fields<Dim>(const State<Dim>&);
MPM_INSTANTIATE(2)
MPM_INSTANTIATE(3)
#undef MPM_INSTANTIATE

}  // namespace mpm
