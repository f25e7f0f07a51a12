// What a run was and how it went: run.json, the table at its end, and --explain.
#pragma once

#include <array>
#include <string>

#include "mpm_hpc/effects/effect.hpp"
#include "mpm_hpc/io/run_json.hpp"
#include "mpm_hpc/scene/scene.hpp"

namespace mpm {

// Every array that lives between two steps on this rank: particles/BODY/COLUMN, grid/FIELD, blocks/..., halo/..., and
// those of the effects. The same holders on every rank.
template <int Dim>
MemoryAccount memory_account(const State<Dim>& state, const std::vector<std::unique_ptr<Effect<Dim>>>& effects);

// What this rank has sent, waited for and done since the start.
inline constexpr std::array traffic_names = {"halo_messages",     "halo_bytes", "halo_wait_seconds",
                                             "sort_messages",     "sort_bytes", "collectives",
                                             "solver_reductions", "sorts",      "migrated_particles"};
using Traffic = std::array<Real, traffic_names.size()>;

template <int Dim>
Traffic traffic(const State<Dim>& state);

// Counters that a run keeps beside its state.
struct RunTotals {
  std::int64_t first_step = 0;
  GlobalIndex particle_steps = 0;  // of all ranks
  Real loop_seconds = 0;           // in the step loop, output included
  Real step_seconds = 0;           // in the steps alone
  Real peak_bytes = 0;             // of all arrays of all ranks
  std::size_t largest_account = 0;  // of all arrays of this rank
  FileTraffic frames, checkpoints, restart;
  Traffic step_traffic{};          // in the steps alone
};

// Collective.
template <int Dim>
RunReport make_report(State<Dim>& state, const std::vector<std::unique_ptr<Effect<Dim>>>& effects,
                      const RunTotals& totals, const std::string& scene_hash);

// The closing table for the terminal.
std::string closing_table(const RunReport& report);

// What the scene builds and what it costs. Collective.
template <int Dim>
std::string explain(State<Dim>& state, const std::vector<std::unique_ptr<Effect<Dim>>>& effects);

// FNV-1a of a text, as 16 hexadecimal digits.
std::string text_hash(const std::string& text);

}  // namespace mpm
