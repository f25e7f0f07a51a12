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
  Real work = 0;                        // J . (v + v')/2 [J], the exact change of kinetic energy

  // Sets the velocity in a node's values and notes what the stored (rounded) velocities say.
  template <class T>
  void set_velocity(T* values, const Vec<Dim>& velocity) {
    set_velocity(values, velocity, values[Dim]);
  }
  template <class T>
  void set_velocity(T* values, const Vec<Dim>& velocity, Real mass) {
    for (int a = 0; a < Dim; ++a) {
      const Real before = values[a];
      values[a] = static_cast<T>(velocity[a]);
      const Real after = values[a], given = mass * (after - before);
      impulse[a] += given;
      work += given * (before + after) / 2;
    }
  }
  void add(const Exchange& other, Real factor) {
    impulse += factor * other.impulse;
    work += factor * other.work;
  }
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
  // Adds one step of state.dt.
  void add(State<Dim>& state, const Exchange<Dim>& exchange);
  // Appends the columns and starts anew.
  void history(State<Dim>& state, std::vector<HistoryValue>& row);

  void save(std::map<std::string, std::vector<Real>>& numbers) const;
  void restore(const std::map<std::string, std::vector<Real>>& numbers);

 private:
  std::string impulse_entry(int a) const { return "impulse_" + name_ + "_" + "xyz"[a]; }
  std::string span_entry() const { return "reaction_" + name_ + "_span"; }

  std::string name_, where_;
  Real span_ = 0;  // time since the last history row [s]; the same on all ranks
};

}  // namespace mpm
