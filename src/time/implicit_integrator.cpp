#include "mpm_hpc/time/implicit_integrator.hpp"

#include <algorithm>
#include <cmath>

#include "mpm_hpc/base/error.hpp"

namespace mpm {

namespace {

constexpr int most_contact_passes = 10;
constexpr Real growth = 1.5;  // of the step after a success

}  // namespace

template <int Dim>
ImplicitIntegrator<Dim>::ImplicitIntegrator(State<Dim>& state, StepHooks<Dim> hooks, const Options& options)
    : stages_(state, std::move(hooks)), options_(options), system_(state, options.system) {
  debug_check(stages_.hooks().implicit, "the effects joined the hooks of an explicit step");
  state.step_limit = options_.largest_step;
  state.inertia = options_.system.inertia;
  state.accounts.push_back([this] {
    MemoryAccount account = system_.memory();
    account.emplace_back("implicit/copies of columns", loaded_.allocated_bytes() + staggered_.allocated_bytes() +
                                                           compared_.allocated_bytes() + deformed_.allocated_bytes());
    return account;
  });
  state.solvers["newton"];
  state.solvers["newton_krylov"];
  plan_copies(state);
}

template <int Dim>
void ImplicitIntegrator<Dim>::plan_copies(State<Dim>& state) {
  for (std::size_t b = 0; b < state.bodies.size(); ++b) loaded_.add(b, core::velocity);
  pass_tolerance_ = std::numeric_limits<Real>::infinity();
  for (const StaggeredField<Dim>& field : stages_.hooks().staggered) {
    most_passes_ = std::max(most_passes_, field.most_passes);
    pass_tolerance_ = std::min(pass_tolerance_, field.tolerance);
    for (const auto& column : field.columns) {
      staggered_.add(column.body, column.field);
      if (column.compared) compared_.add(column.body, column.field);
    }
  }
  if (stages_.hooks().staggered.empty()) return;
  state.solvers["staggered_passes"];
  for (std::size_t b = 0; b < state.bodies.size(); ++b) {
    if (state.bodies[b].particles.has(core::deformation_gradient)) deformed_.add(b, core::deformation_gradient);
    const int own = static_cast<int>(state.material_of(b).own_columns().size());
    for (int k = 0; k < own; ++k) deformed_.add(b, core::count + k);
  }
}

template <int Dim>
void ImplicitIntegrator<Dim>::initialise(State<Dim>& state) {
  stages_.initialise(state);
}

template <int Dim>
Real ImplicitIntegrator<Dim>::stable_step(const State<Dim>& state) {
  const Real speed = state.limits.kinematic.speed_component;
  const Real travel =
      speed > 0 ? options_.cfl * state.geometry().spacing() / speed : std::numeric_limits<Real>::infinity();
  const Real limit = std::min(state.step_limit, options_.largest_step);
  bound_by_ = travel < limit ? "distance travelled" : "step control";
  return std::min(travel, limit);
}

template <int Dim>
std::string ImplicitIntegrator<Dim>::solved() const {
  return fmt::format("Newton {}, Krylov {}, residual {:.1e} -> {:.1e}{}", work_.newton, work_.krylov,
                     work_.first_residual, result_.residual,
                     work_.solves > 1 ? fmt::format(", {} solves", work_.solves) : "");
}

template <int Dim>
Vec<Dim> ImplicitIntegrator<Dim>::acceleration(const State<Dim>& state) const {
  Vec<Dim> sum = Vec<Dim>::Zero();
  for (const auto& f : stages_.hooks().accelerations) sum += f(state);
  return sum;
}

template <int Dim>
void ImplicitIntegrator<Dim>::prepare(State<Dim>& state) {
  stages_.to_grid(state, GridStages<Dim>::Stress::none);
  system_.begin(state, acceleration(state));
  constraints_.clear();
  for (const auto& f : stages_.hooks().constraints) f(state, constraints_);
  contacts_.begin(constraints_.entries(), system_, options_.system.inertia);
  contacts_.apply(system_);
}

// One step's solves with state.dt; failure_ says why it returns false. The particles' velocities and staggered columns are
// spoilt then.
template <int Dim>
bool ImplicitIntegrator<Dim>::attempt(State<Dim>& state) {
  prepare(state);
  work_ = {};
  for (int pass = 1; pass <= most_passes_; ++pass) {
    if (!solve_contacts(state)) return false;
    const Real travel = state.dt * fastest(state);
    if (travel > state.geometry().spacing()) {
      failure_ = fmt::format("material would travel {:.3g} cells", travel / state.geometry().spacing());
      return false;
    }
    if (staggered_.empty() || staggered_pass(state) <= pass_tolerance_) return true;
  }
  if (most_passes_ > 1) state.guards["staggered_passes_still_changing"] += state.communicator().root();
  return true;
}

// The staggered fields with the solution's deformation. Returns their largest change since the last pass.
template <int Dim>
Real ImplicitIntegrator<Dim>::staggered_pass(State<Dim>& state) {
  state.solvers["staggered_passes"].iterations += 1;
  compared_.save(state);
  staggered_.restore(state);
  deformed_.save(state);
  system_.deform(state);
  for (const auto& field : stages_.hooks().staggered) field.pass(state);
  deformed_.restore(state);
  return state.communicator().max(compared_.largest_change(state));
}

// Velocities for the staggered fields as they are, with contacts that open and close until they fit them.
template <int Dim>
bool ImplicitIntegrator<Dim>::solve_contacts(State<Dim>& state) {
  SolverWork &newton = state.solvers["newton"], &krylov = state.solvers["newton_krylov"];
  for (int pass = 0;; ++pass) {
    if (pass > 0) contacts_.apply(system_);
    result_ = system_.solve(state);
    newton.solves += 1;
    newton.iterations += result_.iterations;
    newton.unknowns += Dim * system_.global_rows();
    krylov.solves += result_.iterations;
    krylov.iterations += result_.krylov_iterations;
    krylov.unknowns += Dim * system_.global_rows() * result_.iterations;
    if (work_.solves++ == 0) work_.first_residual = result_.first_residual;
    work_.newton += result_.iterations;
    work_.krylov += result_.krylov_iterations;
    if (!result_.converged) {
      failure_ = fmt::format("Newton's method stopped after {} iterations with a residual of {:.2g} ({})",
                             result_.iterations, result_.residual, result_.reason);
      return false;
    }
    const GlobalIndex changes =
        state.communicator().sum(contacts_.update(system_, state.communicator(), pass));
    if (changes == 0) return true;
    if (pass == most_contact_passes) {
      state.guards["contact_states_still_changing"] += state.communicator().root();
      return true;
    }
  }
}

// Of the nodes that carry particles: one that hardly has weight moves far without moving anything.
template <int Dim>
Real ImplicitIntegrator<Dim>::fastest(const State<Dim>& state) const {
  constexpr Real share_of_heaviest = 0.05;
  Real heaviest = 0, speed = 0;
  for (int r = 0; r < system_.rows(); ++r) heaviest = std::max(heaviest, system_.mass(r));
  for (int r = 0; r < system_.rows(); ++r)
    if (system_.mass(r) > share_of_heaviest * heaviest)
      speed = std::max(speed, system_.velocity(r).cwiseAbs().maxCoeff());
  return state.communicator().max(speed);
}

// The solution onto the nodes, and what it means for the accounts: work of an impulse is its product with the velocity at the
// end of the step, as the potential has it.
template <int Dim>
void ImplicitIntegrator<Dim>::take_velocities(State<Dim>& state) {
  const Vec<Dim> of_all = acceleration(state);
  Real* nodes = state.fields.template data<Real>(state.nodes);
  Real work = 0;
  for (int r = 0; r < system_.rows(); ++r) {
    const Vec<Dim> v = system_.velocity(r);
    work += state.dt * system_.mass(r) * of_all.dot(v);
    for (int a = 0; a < Dim; ++a) nodes[system_.node(r) * node_values + static_cast<std::size_t>(a)] = v[a];
  }
  if (!stages_.hooks().accelerations.empty()) state.ledger["external_work"] += work;
  const std::vector<Exchange<Dim>> exchanges = contacts_.exchanges(system_, constraints_.reactions());
  for (std::size_t k = 0; k < exchanges.size(); ++k) constraints_.reactions()[k]->add(state, exchanges[k]);
}

template <int Dim>
void ImplicitIntegrator<Dim>::step(State<Dim>& state) {
  stages_.sort(state, true);
  if (!options_.system.inertia)
    for (Body<Dim>& body : state.bodies)
      for (const FieldId f : {core::velocity, core::velocity_gradient, body.velocity_modes})
        if (f != no_field)
          for (int c = 0; c < body.particles.traits(f).components; ++c)
            std::fill_n(body.particles.template data<Real>(f, c), body.particles.size(), 0.0);
  loaded_.save(state);
  staggered_.save(state);
  const Ledger ledger = state.ledger;

  bool failed = false;
  const Real wanted = std::max(state.dt, std::isfinite(state.step_limit) ? state.step_limit : 0);
  while (!attempt(state)) {
    failed = true;
    state.guards["implicit_steps_halved"] += state.communicator().root();
    if (state.dt / 2 < least_step * wanted)
      throw NumericalFailure(
          fmt::format("an implicit step fails even with dt = {:.3g} s: {}; is something free to move that "
                      "nothing holds, or is the load more than the material bears? Try a smaller time.max_dt, "
                      "more newton.max_iterations, or inertia (\"implicit\")",
                      state.dt, failure_));
    state.dt /= 2;
    loaded_.restore(state);
    staggered_.restore(state);
    state.ledger = ledger;
  }
  SolverWork& newton = state.solvers["newton"];
  newton.first_residual = work_.first_residual;
  newton.residual = result_.residual;
  newton.largest_residual = std::max(newton.largest_residual, result_.residual);
  take_velocities(state);
  stages_.on_grid(state);
  const Real taken = state.dt;
  stages_.to_particles(state);
  if (failed) {
    state.step_limit = taken;
  } else if (std::isfinite(state.step_limit)) {
    // A step that an event cut short says nothing about longer ones.
    state.step_limit = std::min(options_.largest_step, std::max(state.step_limit, growth * taken));
  }
}

template class ImplicitIntegrator<2>;
template class ImplicitIntegrator<3>;

}  // namespace mpm
