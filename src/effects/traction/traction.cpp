#include "mpm_hpc/effects/traction/traction.hpp"

#include <fmt/ranges.h>

#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/effects/body_names.hpp"
#include "mpm_hpc/effects/boundary/node_loop.hpp"
#include "mpm_hpc/effects/boundary/reaction.hpp"

namespace mpm {

template <int Dim>
Traction<Dim>::Traction(Parameters& p)
    : name_(numbered_name(p, "traction")), where_shape_(p.where("shape")), where_bodies_(p.where("bodies")) {
  declare_shape<Dim>(p, "shape", shape_, true,
                     "Region that covers the loaded layer of particles at the start.");
  if (shape_ && shape_.bounds().is_empty()) p.error_at("shape", "the shape is empty; give it a size.");
  p.text_list("bodies", body_names_, {.doc = "Names of the loaded bodies. Default: all."});
  p.vector<Dim>("traction", traction_, {.unit = "Pa", .required = true, .doc = "Force per undeformed area."});
  p.real("area", area_,
         {.unit = Dim == 2 ? "m" : "m^2",
          .min = 0,
          .min_exclusive = true,
          .required = true,
          .doc = Dim == 2 ? "Length of the loaded surface." : "Area of the loaded surface."});
  ramp_ = Ramp::read(p);
}

template <int Dim>
std::string Traction<Dim>::explain() const {
  return fmt::format("{}: dead load of [{:.6g}] Pa on {:.6g} {}", name_,
                     fmt::join(traction_.data(), traction_.data() + Dim, ", "), area_,
                     Dim == 2 ? "m (per metre of depth)" : "m^2");
}

template <int Dim>
void Traction<Dim>::declare_fields(State<Dim>& state) {
  state.ledger["external_work"];
  const std::vector<char> loaded = named_bodies(state, body_names_, where_bodies_);
  marks_.assign(state.bodies.size(), no_field);
  for (std::size_t b = 0; b < state.bodies.size(); ++b) {
    if (!loaded[b]) continue;
    marks_[b] =
        state.bodies[b].particles.add({.name = name_, .units = "1", .type = real_type(state.precision)});
  }
}

template <int Dim>
void Traction<Dim>::initialise(State<Dim>& state) {
  const Real tolerance = surface_tolerance * state.geometry().spacing();
  with_precision(state.precision, [&](auto zero) {
    using T = decltype(zero);
    for (std::size_t b = 0; b < state.bodies.size(); ++b) {
      if (marks_[b] == no_field) continue;
      const Body<Dim>& body = state.bodies[b];
      T* mark = body.particles.template data<T>(marks_[b]);
      for (Index p = 0; p < body.particles.size(); ++p) {
        Vec<Dim> x;
        for (int a = 0; a < Dim; ++a) x[a] = body.particles.template data<Real>(core::position, a)[p];
        mark[p] = !body.is_padding(p) && shape_.distance(x) <= tolerance;
      }
    }
  });
}

template <int Dim>
void Traction<Dim>::join(StepHooks<Dim>& hooks) {
  hooks.before_p2g.push_back([this](State<Dim>& state) { load(state); });
  hooks.after_g2p.push_back([this](State<Dim>& state) { account(state); });
}

// Once per run: particles that are deleted later take their share of the load with them.
template <int Dim>
void Traction<Dim>::measure(State<Dim>& state) {
  CompensatedSum sum;
  with_precision(state.precision, [&](auto zero) {
    using T = decltype(zero);
    for (std::size_t b = 0; b < state.bodies.size(); ++b) {
      if (marks_[b] == no_field) continue;
      const Body<Dim>& body = state.bodies[b];
      const T* mark = body.particles.template data<T>(marks_[b]);
      const T* volume = body.particles.template data<T>(core::volume);
      for (Index p = 0; p < body.particles.size(); ++p)
        if (!body.is_padding(p) && mark[p] > 0) sum.add(volume[p]);
    }
  });
  std::vector<CompensatedSum> sums = {sum};
  state.communicator().sum(sums);
  volume_ = sums[0].value();
  require(volume_ > 0, "{}: no particle of the loaded bodies lies in the shape of {}; move or enlarge it.",
          where_shape_, name_);
}

// Calls f(velocity component, its mass, its impulse in this step [N s]) for each loaded particle and direction.
template <int Dim>
template <class F>
void Traction<Dim>::for_loaded(State<Dim>& state, F&& f) const {
  // An equilibrium is that of the load at the end of its step.
  const Real factor = state.inertia ? ramp_.mean(state.time, state.dt) : ramp_.factor(state.time + state.dt);
  const Vec<Dim> impulse_per_volume = state.dt * factor * area_ / volume_ * traction_;  // [N s/m^3]
  with_precision(state.precision, [&](auto zero) {
    using T = decltype(zero);
    for (std::size_t b = 0; b < state.bodies.size(); ++b) {
      if (marks_[b] == no_field) continue;
      const Body<Dim>& body = state.bodies[b];
      const T* mark = body.particles.template data<T>(marks_[b]);
      const T* volume = body.particles.template data<T>(core::volume);
      const T* mass = body.particles.template data<T>(core::mass);
      for (Index p = 0; p < body.particles.size(); ++p) {
        if (!(mark[p] > 0 && mass[p] > 0)) continue;
        for (int a = 0; a < Dim; ++a)
          f(body.particles.template data<T>(core::velocity, a)[p], static_cast<Real>(mass[p]),
            impulse_per_volume[a] * volume[p]);
      }
    }
  });
}

template <int Dim>
void Traction<Dim>::load(State<Dim>& state) {
  if (volume_ == 0) measure(state);
  for_loaded(state, [](auto& velocity, Real mass, Real impulse) {
    velocity = static_cast<std::decay_t<decltype(velocity)>>(velocity + impulse / mass);
  });
}

// Force times the way of the particles it acts on: what the transfer makes of the impulse, not the impulse itself, moves
// the load.
template <int Dim>
void Traction<Dim>::account(State<Dim>& state) {
  Real work = 0;
  for_loaded(state, [&work](const auto& velocity, Real, Real impulse) { work += impulse * velocity; });
  state.ledger["external_work"] += work;
}

template <int Dim>
void Traction<Dim>::save(std::map<std::string, std::vector<Real>>& numbers) const {
  numbers[name_ + "_volume"] = {volume_};
}

template <int Dim>
void Traction<Dim>::restore(const std::map<std::string, std::vector<Real>>& numbers) {
  const auto found = numbers.find(name_ + "_volume");
  if (found != numbers.end()) volume_ = found->second.at(0);
}

template class Traction<2>;
template class Traction<3>;

}  // namespace mpm
