#include "mpm_hpc/time/grid_stages.hpp"

#include <algorithm>
#include <cmath>

#include "mpm_hpc/time/failure.hpp"
#include "mpm_hpc/time/material_access.hpp"

namespace mpm {

namespace {

template <int Dim, class T>
class NoStress final : public StressSource<Dim, T> {
 public:
  void kirchhoff_stress(Index begin, Index end, T* const* tau) const override {
    for (int c = 0; c < SymTensor<T, Dim>::size; ++c) std::fill_n(tau[c], end - begin, T(0));
  }
};

}  // namespace

template <int Dim>
GridStages<Dim>::GridStages(State<Dim>& state, StepHooks<Dim> hooks)
    : hooks_(std::move(hooks)),
      single_(transfer_kernels<Dim, float>(state.transfer)),
      double_(transfer_kernels<Dim, double>(state.transfer)) {
  for (FieldId f = 0; f < state.fields.count(); ++f) {
    // Without hooks in P2G and G2P these serve the core's fields alone: implicit steps fill those of effects in their own turn.
    const bool core = f == state.nodes || f == state.changes;
    if (state.fields.traits(f).sums_ghosts && (core || !hooks_.on_p2g.empty())) summed_.push_back(f);
    if (state.fields.traits(f).fills_ghosts && (core || !hooks_.on_g2p.empty())) filled_.push_back(f);
  }
  Timers& t = state.timers;
  stage_sort_ = t.stage("sort and migrate");
  stage_p2g_ = t.stage("P2G");
  stage_halo_sum_ = t.stage("halo sum");
  stage_grid_ = t.stage("grid");
  stage_halo_fill_ = t.stage("halo fill");
  stage_g2p_ = t.stage("G2P");
  stage_effects_ = t.stage("effects");
  stage_limits_ = t.stage("step size");
}

template <int Dim>
void GridStages<Dim>::initialise(State<Dim>& state) {
  state.limits = {};
  with_precision(state.precision, [&](auto zero) {
    using T = decltype(zero);
    for (std::size_t b = 0; b < state.bodies.size(); ++b) {
      MaterialAdvance<Dim, T> sink(state, b);
      const FieldSet& fields = state.bodies[b].particles;
      for (const BlockRange& range : state.bodies[b].ranges) {
        KinematicLimits kinematic;
        for (Index p = range.begin; p < range.end; ++p) {
          Real speed2 = 0;
          for (int a = 0; a < Dim; ++a) {
            const Real v = fields.template data<T>(core::velocity, a)[p];
            speed2 += v * v;
            kinematic.speed_component = std::max(kinematic.speed_component, std::abs(v));
            Real row = 0;
            for (int c = 0; fields.has(core::velocity_gradient) && c < Dim; ++c)
              row += std::abs(fields.template data<T>(core::velocity_gradient, a * Dim + c)[p]);
            kinematic.gradient = std::max(kinematic.gradient, row);
          }
          kinematic.speed = std::max(kinematic.speed, std::sqrt(speed2));
        }
        sink.measure(range.begin, range.end, kinematic);
      }
    }
  });
  reduce_limits(state);
}

// One reduction for all limits; a NaN was turned into an infinity by those who measured.
template <int Dim>
void GridStages<Dim>::reduce_limits(State<Dim>& state) {
  StepLimits& l = state.limits;
  std::vector<Real> values = {
      l.kinematic.speed, l.kinematic.speed_component, l.kinematic.gradient, l.kinematic.acceleration,
      l.signal_speed,    l.stiffness_speed,           -l.min_jacobian,      state.stop_requested ? 1.0 : 0.0,
      l.viscosity};
  state.communicator().max(values);
  l.kinematic = {values[0], values[1], values[2], values[3]};
  l.signal_speed = values[4];
  l.stiffness_speed = values[5];
  l.min_jacobian = -values[6];
  state.stop_requested = values[7] > 0;
  l.viscosity = values[8];
  const bool finite = std::isfinite(l.signal_speed) && std::isfinite(l.kinematic.gradient);
  if (!(l.min_jacobian > 0) || !finite) report_failed_particle(state);
}

template <int Dim>
template <class T>
const TransferKernels<Dim, T>& GridStages<Dim>::kernels() const {
  if constexpr (std::is_same_v<T, float>) return single_;
  if constexpr (std::is_same_v<T, double>) return double_;
}

template <int Dim>
template <class T>
void GridStages<Dim>::transfer_to_grid(State<Dim>& state, bool boundary, Stress stress) {
  const TransferGrid<Dim, T> grid = state.template transfer_grid<T>();
  for (std::size_t b = 0; b < state.bodies.size(); ++b) {
    const Body<Dim>& body = state.bodies[b];
    const std::vector<int>& ranges = boundary ? body.boundary : body.interior;
    if (stress == Stress::of_materials) {
      kernels<T>().to_grid(grid, body, ranges, MaterialStress<Dim, T>(state, b), state.dt);
    } else {
      kernels<T>().to_grid(grid, body, ranges, NoStress<Dim, T>(), state.dt);
    }
  }
}

template <int Dim>
template <class T>
void GridStages<Dim>::transfer_to_particles(State<Dim>& state, bool boundary) {
  const TransferGrid<Dim, T> grid = state.template transfer_grid<T>();
  for (std::size_t b = 0; b < state.bodies.size(); ++b) {
    Body<Dim>& body = state.bodies[b];
    MaterialAdvance<Dim, T> sink(state, b);
    kernels<T>().to_particles(grid, body, boundary ? body.boundary : body.interior, state.dt, sink);
  }
}

namespace {

template <int Dim>
std::size_t owned_nodes(const State<Dim>& state) {
  return static_cast<std::size_t>(state.topology().owned()) * nodes_per_block<Dim>;
}

// Turns the owned nodes' momentum into velocity; with increments the impulse of the forces joins it here, and the velocity
// before them takes its place.
template <class T, int Dim>
void momentum_to_velocity(State<Dim>& state) {
  T* node = state.fields.template data<T>(state.nodes);
  const std::size_t count = owned_nodes(state);
  for (std::size_t i = 0; i < count; ++i, node += node_values) {
    const T inverse = node[Dim] > 0 ? 1 / node[Dim] : T(0);
    for (int a = 0; a < Dim; ++a) node[a] *= inverse;
  }
  if (!state.transfer.increments()) return;
  node = state.fields.template data<T>(state.nodes);
  T* change = state.fields.template data<T>(state.changes);
  for (std::size_t i = 0; i < count; ++i, node += node_values, change += node_values) {
    const T inverse = node[Dim] > 0 ? 1 / node[Dim] : T(0);
    for (int a = 0; a < Dim; ++a) {
      const T before = node[a];
      node[a] += inverse * change[a];
      change[a] = before;
    }
  }
}

// The velocity before the forces becomes its change by all that acted on the nodes since.
template <class T, int Dim>
void find_changes(State<Dim>& state) {
  const T* node = state.fields.template data<T>(state.nodes);
  T* change = state.fields.template data<T>(state.changes);
  const std::size_t count = owned_nodes(state);
  for (std::size_t i = 0; i < count; ++i, node += node_values, change += node_values)
    for (int a = 0; a < Dim; ++a) change[a] = node[a] - change[a];
}

}  // namespace

template <int Dim>
Real GridStages<Dim>::busy_seconds(const State<Dim>& state) const {
  const auto& seconds = state.timers.seconds();
  return seconds[stage_p2g_] + seconds[stage_g2p_];
}

template <int Dim>
void GridStages<Dim>::run(State<Dim>& state, const std::vector<typename StepHooks<Dim>::Hook>& hooks) {
  if (hooks.empty()) return;
  auto s = state.timers.scope(stage_effects_);
  for (const auto& hook : hooks) hook(state);
}

template <int Dim>
void GridStages<Dim>::run(State<Dim>& state, const std::vector<typename StepHooks<Dim>::RangeHook>& hooks,
                          bool boundary) {
  if (hooks.empty()) return;
  auto s = state.timers.scope(stage_effects_);
  for (const auto& hook : hooks)
    for (std::size_t b = 0; b < state.bodies.size(); ++b)
      hook(state, b, boundary ? state.bodies[b].boundary : state.bodies[b].interior);
}

template <int Dim>
template <class T>
void GridStages<Dim>::to_grid_in(State<Dim>& state, Stress stress) {
  Timers& timers = state.timers;
  run(state, hooks_.before_p2g);
  for (const bool boundary : {true, false}) {
    {
      auto s = timers.scope(stage_p2g_);
      if (boundary)
        for (FieldId f : summed_) state.fields.zero(f);
      transfer_to_grid<T>(state, boundary, stress);
    }
    run(state, hooks_.on_p2g, boundary);
    // What the ghosts' owners need is ready after the boundary blocks; the interior hides the messages.
    auto s = timers.scope(stage_halo_sum_);
    if (boundary) {
      state.halo().start_sum(state.fields, summed_);
    } else {
      state.halo().finish_sum();
    }
  }
  auto s = timers.scope(stage_grid_);
  momentum_to_velocity<T>(state);
}

template <int Dim>
template <class T>
void GridStages<Dim>::to_particles_in(State<Dim>& state) {
  Timers& timers = state.timers;
  if (state.transfer.increments()) {
    auto s = timers.scope(stage_grid_);
    find_changes<T>(state);
  }
  {
    auto s = timers.scope(stage_halo_fill_);
    state.halo().start_fill(state.fields, filled_);
  }
  state.limits = {};
  for (const bool boundary : {false, true}) {
    if (boundary) {
      auto s = timers.scope(stage_halo_fill_);
      state.halo().finish_fill();
    }
    run(state, hooks_.on_g2p, boundary);
    auto s = timers.scope(stage_g2p_);
    transfer_to_particles<T>(state, boundary);
  }
  run(state, hooks_.after_g2p);
}

template <int Dim>
void GridStages<Dim>::to_grid(State<Dim>& state, Stress stress) {
  const Real busy = busy_seconds(state);
  with_precision(state.precision, [&](auto zero) { to_grid_in<decltype(zero)>(state, stress); });
  state.busy += busy_seconds(state) - busy;
}

template <int Dim>
void GridStages<Dim>::on_grid(State<Dim>& state) {
  run(state, hooks_.on_grid);
  run(state, hooks_.end_of_grid);
  run(state, hooks_.after_grid);
}

template <int Dim>
void GridStages<Dim>::to_particles(State<Dim>& state) {
  const Real busy = busy_seconds(state);
  with_precision(state.precision, [&](auto zero) { to_particles_in<decltype(zero)>(state); });
  state.busy += busy_seconds(state) - busy;
  state.time += state.dt;
  ++state.step;
  {
    auto s = state.timers.scope(stage_limits_);
    reduce_limits(state);
  }
  state.drift += state.dt * state.limits.kinematic.speed_component;
}

template <int Dim>
void GridStages<Dim>::sort(State<Dim>& state, bool always) {
  auto s = state.timers.scope(stage_sort_);
  if (always) {
    sort_particles(state, OrderWithinCell::stable);
  } else {
    sort_if_drifted(state);
  }
}

template class GridStages<2>;
template class GridStages<3>;

}  // namespace mpm
