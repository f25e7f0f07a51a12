// What a scene can switch on: an effect declares its fields and joins the hooks of the step. One that the scene does not
// name is not constructed and costs nothing.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "mpm_hpc/base/memory.hpp"
#include "mpm_hpc/effects/boundary/constraints.hpp"
#include "mpm_hpc/effects/state.hpp"

namespace mpm {

// A field that implicit steps solve for in turn with the velocities.
template <int Dim>
struct StaggeredField {
  struct Column {
    std::size_t body;
    FieldId field;
    bool compared = false;  // its values tell whether the passes have converged
  };
  // Everything that a pass changes of the particles. Each pass finds them as they were before the step.
  std::vector<Column> columns;
  // Solves on particles that are deformed as the step will leave them, in their places before it. Collective.
  std::function<void(State<Dim>&)> pass;
  int most_passes = 1;
  Real tolerance = 0;  // largest change of a compared value from one pass to the next that ends them
};

// Where effects join the step (design: before_p2g | P2G, on_p2g | halo sum | on_grid, end_of_grid, after_grid | halo fill |
// G2P, on_g2p | after_g2p). Empty hooks cost one test per step.
template <int Dim>
struct StepHooks {
  using Hook = std::function<void(State<Dim>&)>;
  // Called with a body's number and some of its ranges: those next to ghosts before the halo starts, the rest while it
  // is under way.
  using RangeHook = std::function<void(State<Dim>&, std::size_t body, const std::vector<int>& ranges)>;

  std::vector<Hook> before_p2g;
  std::vector<RangeHook> on_p2g;
  std::vector<Hook> on_grid;  // owned nodes hold velocities and mass
  std::vector<Hook> end_of_grid;  // the same, after all of on_grid: what holds whatever those did
  std::vector<Hook> after_grid;   // the velocities are those that the particles will move with: work is accounted
  std::vector<RangeHook> on_g2p;
  std::vector<Hook> after_g2p;

  // An integrator that solves for the grid's velocities can't have them changed at once: set before the effects join, it asks
  // those that act on velocities to join here instead of on_grid.
  bool implicit = false;
  std::vector<std::function<Vec<Dim>(const State<Dim>&)>> accelerations;  // of all matter [m/s^2]
  std::vector<std::function<void(State<Dim>&, NodeConstraints<Dim>&)>> constraints;
  // Instead of the hooks around the transfers, for what the deformation drives and what weakens the stress in turn.
  std::vector<StaggeredField<Dim>> staggered;
};

// One number of a history row. Parts of the ranks are combined by `kind`.
struct HistoryValue {
  enum class Kind { sum, min, max };
  std::string name, unit;
  Real value = 0;
  Kind kind = Kind::sum;
};

template <int Dim>
class Effect {
 public:
  virtual ~Effect() = default;

  // One line for --explain: what it does here and why it is built.
  virtual std::string explain() const = 0;
  // Whether materials that have a fracture_toughness break by it.
  virtual bool uses_toughness() const { return false; }
  // Adds particle columns and grid fields; materials and (empty) bodies exist, particles don't. Throws UserError for a
  // combination that makes no sense.
  virtual void declare_fields(State<Dim>&) {}
  // Sets its columns for new particles of a fresh run, before they are distributed. Collective. Throws UserError on all
  // ranks.
  virtual void initialise(State<Dim>&) {}
  virtual void join(StepHooks<Dim>& hooks) = 0;

  // Its columns of history.csv, in a fixed order: this rank's parts. Collective.
  virtual void history(State<Dim>&, std::vector<HistoryValue>&) {}
  // Numbers that a checkpoint must carry beside particle columns and the ledger.
  virtual void save(std::map<std::string, std::vector<Real>>&) const {}
  virtual void restore(const std::map<std::string, std::vector<Real>>&) {}
  // Its own arrays on this rank outside the field sets; the same names on every rank.
  virtual MemoryAccount memory() const { return {}; }
};

}  // namespace mpm
