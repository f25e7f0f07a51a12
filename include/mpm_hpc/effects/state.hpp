// Everything that one simulation holds on this rank; what integrators and effects work on.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "mpm_hpc/base/memory.hpp"
#include "mpm_hpc/base/timer.hpp"
#include "mpm_hpc/fields/grid_fields.hpp"
#include "mpm_hpc/materials/material_update.hpp"
#include "mpm_hpc/parallel/distribution.hpp"
#include "mpm_hpc/transfer/transfer_kernels.hpp"

namespace mpm {

// What the next step's size must respect: maxima over all particles after the last step.
struct StepLimits {
  KinematicLimits kinematic;
  Real signal_speed = 0;     // |v| + c [m/s]
  Real stiffness_speed = 0;  // sqrt(lambda_max(A) / rho0) [m/s]
  Real min_jacobian = std::numeric_limits<Real>::infinity();
  Real viscosity = 0;        // largest kinematic viscosity [m^2/s]
};

// How the stress of a body is weakened: the phase column, when an effect gives it one, and its residual.
struct Degradation {
  FieldId phase = no_field;
  Real residual = 0;
};

// Sums over time that history and checkpoint carry, by name; each rank adds its own part.
class Ledger {
 public:
  Real& operator[](const std::string& name) { return entries_[name]; }
  const std::map<std::string, Real>& entries() const { return entries_; }
  // Moves all parts to rank 0, so that a run that goes on and one that restarts add in the same order. Collective.
  void consolidate(const Communicator& communicator);

 private:
  std::map<std::string, Real> entries_;
};

// Work of an implicit solve, the same on all ranks.
struct SolverWork {
  GlobalIndex solves = 0, iterations = 0, unknowns = 0;  // unknowns: the sum over the solves
  GlobalIndex told = 0;  // iterations up to the last row of the history
  // Of Newton's method: residual over its scale before and after the last solve, and the largest after one.
  Real first_residual = 0, residual = 0, largest_residual = 0;
};

template <int Dim>
struct State {
  Precision precision = Precision::double_precision;
  std::vector<Body<Dim>> bodies;
  std::vector<std::unique_ptr<Material<Dim>>> materials;
  std::vector<Degradation> degradation;  // by body
  Distribution<Dim> distribution;        // communicator, geometry, topology, halo
  GridFields fields;
  FieldId nodes = no_field;  // the core grid field: momentum, then velocity; mass
  TransferOptions transfer;
  // With increments: the forces' impulse, then the velocity before them, then the change since; else there is none.
  FieldId changes = no_field;

  Real time = 0, dt = 0;  // [s]; of the step under way
  DeformationUpdate deformation_update = DeformationUpdate::first_order;
  std::int64_t step = 0;
  // Whether a row, frame or checkpoint is planned after the step under way, so that what only those need must be ready. It
  // may turn out that one is written all the same, when a signal ends the run.
  bool observed = true;
  StepLimits limits;
  bool inertia = true;    // false: velocities are those of the load steps and carry no energy
  Real step_limit = std::numeric_limits<Real>::infinity();  // of an integrator that controls its own steps [s]
  Real drift = 0;  // bound of the particles' way since the last sort [m]
  bool stop_requested = false;  // by a signal: on this rank before a step, on any rank after it
  Ledger ledger;   // "external_work" and "plastic_work" [J] among others
  std::map<std::string, GlobalIndex> guards;  // how often each guard acted on this rank
  std::map<std::string, SolverWork> solvers;          // by name, since the start of the run
  Real busy = 0;  // compute time since the last sort [s], for weights by time
  Timers timers;
  MemoryWatch memory;
  // Arrays on this rank that are neither columns nor fields nor an effect's; the same names on every rank.
  std::vector<std::function<MemoryAccount()>> accounts;

  const Communicator& communicator() const { return distribution.communicator(); }
  const GridGeometry<Dim>& geometry() const { return distribution.grid(); }
  const BlockTopology<Dim>& topology() const { return distribution.topology(); }
  Halo<Dim>& halo() { return distribution.halo(); }
  const Material<Dim>& material_of(std::size_t body) const { return *materials[bodies[body].material]; }

  template <class T>
  TransferGrid<Dim, T> transfer_grid() const {
    return {geometry(), topology(), fields.template data<T>(nodes),
            changes == no_field ? nullptr : fields.template data<T>(changes), transfer.flip_blend};
  }
  // Number of the node whose values are at this place.
  template <class T>
  std::size_t number_of_node(const T* values) const {
    return static_cast<std::size_t>(values - fields.template data<T>(nodes)) / node_values;
  }
  // (velocity, mass) of node 0 of a slot.
  template <class T>
  T* node_values_of(Slot slot) const {
    return fields.template data<T>(nodes) + static_cast<std::size_t>(slot) * nodes_per_block<Dim> * node_values;
  }
};

// Sorts and migrates if the particles may have drifted by a cell since the last sort, beyond which the transfers refuse
// to work. Collective.
template <int Dim>
void sort_if_drifted(State<Dim>& state);

// Sorts and migrates in any case. Collective.
template <int Dim>
void sort_particles(State<Dim>& state, OrderWithinCell within);

// Calls f(node's grid coordinates, pointer to its velocity and mass) for each owned node with mass in the given block.
template <class T, int Dim, class F>
void for_massive_nodes(const State<Dim>& state, Slot slot, F&& f) {
  T* values = state.template node_values_of<T>(slot);
  const IntVec<Dim> first = state.topology().first_node(slot);
  for (int n = 0; n < nodes_per_block<Dim>; ++n, values += node_values)
    if (values[Dim] > 0) f(IntVec<Dim>(first + node_in_block<Dim>(n)), values);
}

}  // namespace mpm
