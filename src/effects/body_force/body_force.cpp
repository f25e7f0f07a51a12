#include "mpm_hpc/effects/body_force/body_force.hpp"

#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/effects/body_names.hpp"

namespace mpm {

namespace {

constexpr const char* start_name = "initial_position";

template <int Dim>
std::vector<std::string> variable_names() {
  std::vector<std::string> names = place_variables(Dim);
  names.push_back("t");
  for (const std::string& name : place_variables(Dim, true)) names.push_back(name);
  return names;
}

}  // namespace

template <int Dim>
BodyForce<Dim>::BodyForce(Parameters& p) : where_(p.where("acceleration")), where_bodies_(p.where("bodies")) {
  declare_formulas(
      p, "acceleration", variable_names<Dim>(), Dim, acceleration_,
      {.unit = "m/s^2",
       .required = true,
       .doc =
           "Force per mass: numbers, or formulas in x, y, z (a particle's place), X, Y, Z (its place at the "
           "start) and t, in SI, such as \"-0.1*sin(pi*X)*cos(2*t)\"."});
  p.text_list("bodies", body_names_, {.doc = "Names of the bodies that it acts on. Default: all."});
  for (const std::string& name : place_variables(Dim, true))
    uses_start_ = uses_start_ || acceleration_.uses(name);
}

template <int Dim>
std::string BodyForce<Dim>::explain() const {
  return fmt::format("body_force: {} m/s^2{}", acceleration_.text(),
                     uses_start_ ? "; particles carry their place at the start for it" : "");
}

template <int Dim>
void BodyForce<Dim>::declare_fields(State<Dim>& state) {
  state.ledger["external_work"];
  loaded_ = named_bodies(state, body_names_, where_bodies_);
  start_.assign(state.bodies.size(), no_field);
  for (std::size_t b = 0; b < state.bodies.size() && uses_start_; ++b)
    if (loaded_[b])
      start_[b] = state.bodies[b].particles.add({.name = start_name, .units = "m", .components = Dim});
}

// Calls f(body, particle, what the formulas want to know) for each particle that the force acts on.
template <int Dim>
template <class F>
void BodyForce<Dim>::for_particles(State<Dim>& state, F&& f) const {
  std::array<Real, variables> values{};
  values[Dim] = at_end_ ? state.time + state.dt : state.time;
  for (std::size_t b = 0; b < state.bodies.size(); ++b) {
    if (!loaded_[b]) continue;
    Body<Dim>& body = state.bodies[b];
    for (Index p = 0; p < body.particles.size(); ++p) {
      if (body.is_padding(p)) continue;
      for (int a = 0; a < Dim; ++a) {
        values[a] = body.particles.template data<Real>(core::position, a)[p];
        if (uses_start_) values[Dim + 1 + a] = body.particles.template data<Real>(start_[b], a)[p];
      }
      f(body, p, values.data());
    }
  }
}

template <int Dim>
void BodyForce<Dim>::initialise(State<Dim>& state) {
  GlobalIndex undefined = 0;
  if (uses_start_)
    for (std::size_t b = 0; b < state.bodies.size(); ++b)
      for (int a = 0; a < Dim && loaded_[b]; ++a) {
        const FieldSet& f = state.bodies[b].particles;
        std::copy_n(f.template data<Real>(core::position, a), f.size(), f.template data<Real>(start_[b], a));
      }
  for_particles(state, [&](Body<Dim>&, Index, const Real* values) {
    Vec<Dim> b;
    acceleration_.evaluate(values, b.data());
    undefined += !b.allFinite();
  });
  undefined = state.communicator().sum(undefined);
  require(undefined == 0,
          "{}: the acceleration {} is no finite number for {} of the particles at the start; correct the "
          "formula.",
          where_, acceleration_.text(), undefined);
}

template <int Dim>
void BodyForce<Dim>::join(StepHooks<Dim>& hooks) {
  at_end_ = hooks.implicit;
  hooks.before_p2g.push_back([this](State<Dim>& state) { load(state); });
  hooks.after_g2p.push_back([this](State<Dim>& state) { account(state); });
}

template <int Dim>
void BodyForce<Dim>::load(State<Dim>& state) {
  impulses_.clear();
  with_precision(state.precision, [&](auto zero) {
    using T = decltype(zero);
    for_particles(state, [&](Body<Dim>& body, Index p, const Real* values) {
      Vec<Dim> change;
      acceleration_.evaluate(values, change.data());
      change *= state.dt;
      for (int a = 0; a < Dim; ++a) {
        T& v = body.particles.template data<T>(core::velocity, a)[p];
        v = static_cast<T>(v + change[a]);
      }
      impulses_.push_back(static_cast<Real>(body.particles.template data<T>(core::mass)[p]) * change);
    });
  });
}

// Force times the way of the particles, as for a traction. The particles keep their order during a step.
template <int Dim>
void BodyForce<Dim>::account(State<Dim>& state) {
  Real work = 0;
  std::size_t n = 0;
  with_precision(state.precision, [&](auto zero) {
    using T = decltype(zero);
    for_particles(state, [&](Body<Dim>& body, Index p, const Real*) {
      for (int a = 0; a < Dim; ++a)
        work += impulses_[n][a] * body.particles.template data<T>(core::velocity, a)[p];
      ++n;
    });
  });
  state.ledger["external_work"] += work;
}

template <int Dim>
MemoryAccount BodyForce<Dim>::memory() const {
  return {{"body_force/impulses", impulses_.capacity() * sizeof(Vec<Dim>)}};
}

template class BodyForce<2>;
template class BodyForce<3>;

}  // namespace mpm
