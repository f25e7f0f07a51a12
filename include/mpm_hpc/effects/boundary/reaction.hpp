// Bookkeeping of what boundaries do to nodes: impulse, work and the reaction force of a history row.
#pragma once

#include <string>
#include <vector>

#include "mpm_hpc/base/parameters.hpp"
#include "mpm_hpc/effects/effect.hpp"

namespace mpm {

// Number of this entry of an array of tables: "kind_0" for the first [[effect.kind]].
std::string numbered_name(const Parameters& p, const std::string& kind);

// Reads `name` with numbered_name() as its default. Throws UserError unless it consists of letters, digits, _
// and -.
std::string read_effect_name(Parameters& p, const std::string& kind);

// What one boundary gave to the nodes of this rank during one step.
template <int Dim>
struct Exchange {
  Vec<Dim> impulse = Vec<Dim>::Zero();  // [N s]
  Real work = 0;                        // impulse times the velocity at the end of the step [J]
};

// Impulses on single nodes in a step whose velocities are changed one effect after the other. Work is known when all have
// acted: force times way is J . v' with the velocity v' that the particles move with, as the elastic energy knows it
// (dt f . v'). The mean of v and v' before and after one effect would be wrong by J^2/2m where forces balance on a node.
template <int Dim>
class NodeImpulses {
 public:
  // Sets the velocity of a node and notes what the stored (rounded) velocities say, times the factor.
  template <class T>
  void set_velocity(std::size_t node, T* velocities, const Vec<Dim>& velocity, Real mass, Real factor = 1) {
    Vec<Dim> given;
    for (int a = 0; a < Dim; ++a) {
      const Real before = velocities[a];
      given[a] = factor * mass * (store_rounded(velocities[a], velocity[a]) - before);
    }
    if (!given.isZero(0)) given_.push_back({node, given});
  }
  // What was given in this step, which ends here.
  Exchange<Dim> take(const State<Dim>& state);

  std::size_t allocated_bytes() const { return capacity_bytes(given_); }

 private:
  // Inlined, GCC 12 would make one vector of the components and forget the rounding to float.
  template <class T>
  [[gnu::noinline]] static Real store_rounded(T& place, Real value) {
    place = static_cast<T>(value);
    return place;
  }

  struct Given {
    std::size_t node;
    Vec<Dim> impulse;
  };
  std::vector<Given> given_;
};

// The force [N] that a body exerts on the material (minus the force that the material exerts on the body),
// averaged over the steps since the last history row: columns reaction_NAME_x, ... The impulse since then is
// in the ledger, as impulse_NAME_x [N s], so that it survives a checkpoint on any number of ranks.
template <int Dim>
class Reaction {
 public:
  // where: place in the scene, for messages.
  Reaction(std::string name, std::string where) : name_(std::move(name)), where_(std::move(where)) {}

  const std::string& name() const { return name_; }

  // Makes the entries of the ledger. Throws UserError if another effect has the same name.
  void declare(State<Dim>& state) const;
  // Accounts for each explicit step what `impulses()` noted in it.
  void join(StepHooks<Dim>& hooks);
  NodeImpulses<Dim>& impulses() { return impulses_; }
  // Adds one step of state.dt.
  void add(State<Dim>& state, const Exchange<Dim>& exchange);
  // Appends the columns and starts anew.
  void history(State<Dim>& state, std::vector<HistoryValue>& row);

  void save(std::map<std::string, std::vector<Real>>& numbers) const;
  void restore(const std::map<std::string, std::vector<Real>>& numbers);
  MemoryAccount memory() const { return {{name_ + "/impulses", impulses_.allocated_bytes()}}; }

 private:
  std::string impulse_entry(int a) const { return "impulse_" + name_ + "_" + "xyz"[a]; }
  std::string span_entry() const { return "reaction_" + name_ + "_span"; }

  std::string name_, where_;
  NodeImpulses<Dim> impulses_;
  Real span_ = 0;  // time since the last history row [s]; the same on all ranks
};

}  // namespace mpm
