#include "mpm_hpc/simulation/report.hpp"

#include <algorithm>
#include <cstring>

#include "mpm_hpc/simulation/diagnostics.hpp"
#include "mpm_hpc/simulation/simulation.hpp"
#include "mpm_hpc/solvers/petsc_session.hpp"

namespace mpm {

std::string text_hash(const std::string& text) {
  std::uint64_t hash = 0xcbf29ce484222325ull;
  for (const char c : text) hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001b3ull;
  return fmt::format("{:016x}", hash);
}

template <int Dim>
MemoryAccount memory_account(const State<Dim>& state, const std::vector<std::unique_ptr<Effect<Dim>>>& effects) {
  MemoryAccount account;
  for (const Body<Dim>& body : state.bodies) {
    const FieldSet& particles = body.particles;
    const std::string folder = "particles/" + body.name + "/";
    for (FieldId f = 0; f < particles.count(); ++f)
      account.emplace_back(folder + particles.traits(f).name, particles.allocated_bytes(f));
    account.emplace_back(folder + "room for sorting", particles.spare_bytes());
    account.emplace_back(folder + "ranges",
                         capacity_bytes(body.ranges) + capacity_bytes(body.boundary) + capacity_bytes(body.interior));
  }
  for (FieldId f = 0; f < state.fields.count(); ++f)
    account.emplace_back("grid/" + state.fields.traits(f).name, state.fields.allocated_bytes(f));
  const Distribution<Dim>& distribution = state.distribution;
  account.emplace_back("blocks/keys and neighbours", distribution.topology().allocated_bytes());
  account.emplace_back("blocks/owners", distribution.decomposition().allocated_bytes());
  account.emplace_back("halo/lists", distribution.halo().list_bytes() + distribution.row_halo().list_bytes());
  account.emplace_back("halo/messages", distribution.halo().buffer_bytes() + distribution.row_halo().buffer_bytes());
  for (const auto& effect : effects)
    for (const auto& item : effect->memory()) account.push_back(item);
  for (const auto& of : state.accounts)
    for (const auto& item : of()) account.push_back(item);
  return account;
}

template <int Dim>
Traffic traffic(const State<Dim>& state) {
  const Communicator& communicator = state.communicator();
  const Halo<Dim>& halo = state.distribution.halo();
  const Halo<Dim>& rows = state.distribution.row_halo();
  return {static_cast<Real>(halo.messages() + rows.messages()),
          static_cast<Real>(halo.bytes() + rows.bytes()),
          halo.wait_seconds() + rows.wait_seconds(),
          static_cast<Real>(communicator.messages()),
          static_cast<Real>(communicator.bytes()),
          static_cast<Real>(communicator.collectives()),
          PetscSession::reductions(),
          static_cast<Real>(state.distribution.sorts()),
          static_cast<Real>(state.distribution.migrated())};
}

namespace {

// Each value's least, mean and largest over the ranks. Collective.
std::vector<Spread> over_ranks(const Communicator& communicator, const std::vector<Real>& values) {
  std::vector<Real> least = values, mean = values, most = values;
  communicator.min(least);
  communicator.sum(mean);
  communicator.max(most);
  std::vector<Spread> result;
  for (std::size_t i = 0; i < values.size(); ++i)
    result.push_back({least[i], mean[i] / communicator.size(), most[i]});
  return result;
}

std::vector<std::int64_t> gather_bytes(const Communicator& communicator, std::size_t mine) {
  const auto value = static_cast<std::int64_t>(mine);
  Communicator::Bytes bytes(sizeof(value));
  std::memcpy(bytes.data(), &value, sizeof(value));
  std::vector<std::int64_t> all;
  for (const auto& part : communicator.gather(bytes)) {
    all.emplace_back();
    std::memcpy(&all.back(), part.data(), sizeof(value));
  }
  return all;
}

// The account summed over the ranks.
std::vector<std::pair<std::string, GlobalIndex>> sum_account(const Communicator& communicator,
                                                             const MemoryAccount& account) {
  std::vector<Real> bytes;
  for (const auto& item : account) bytes.push_back(static_cast<Real>(item.second));
  communicator.sum(bytes);
  std::vector<std::pair<std::string, GlobalIndex>> sums;
  for (std::size_t i = 0; i < account.size(); ++i)
    sums.emplace_back(account[i].first, static_cast<GlobalIndex>(bytes[i]));
  return sums;
}

void report_memory(const Communicator& communicator, const MemoryAccount& account, std::size_t largest_account,
                   MemoryWatch& watch, MemoryReport& report) {
  report.account = sum_account(communicator, account);
  largest_account = std::max(largest_account, total_bytes(account));
  report.before_bytes = gather_bytes(communicator, watch.before());
  report.steady_bytes = gather_bytes(communicator, largest_account);
  report.has_phases = !communicator.any(!watch.has_phases());
  const std::map<std::string, std::size_t> peaks = watch.peaks();
  std::size_t highest = 0;
  std::vector<Real> most;
  for (const auto& [phase, peak] : peaks) {
    highest = std::max(highest, peak);
    most.push_back(static_cast<Real>(peak));
    most.push_back(static_cast<Real>(peak) / static_cast<Real>(std::max<std::size_t>(watch.before() + largest_account, 1)));
  }
  report.peak_bytes = gather_bytes(communicator, highest);
  communicator.max(most);
  std::size_t next = 0;
  for (const auto& [phase, peak] : peaks) {
    report.phases.push_back({phase, static_cast<GlobalIndex>(most[next]), most[next + 1]});
    report.peak_over_steady = std::max(report.peak_over_steady, most[next + 1]);
    next += 2;
  }
}

// Time is that of a stage.
void report_traffic(const Communicator& communicator, Timers& timers, const char* stage, FileTraffic traffic,
                    std::vector<std::pair<std::string, FileTraffic>>& all, const char* name) {
  if (traffic.files == 0) return;
  traffic.seconds = communicator.max(timers.seconds()[timers.stage(stage)]);
  all.emplace_back(name, traffic);
}

}  // namespace

template <int Dim>
RunReport make_report(State<Dim>& state, const std::vector<std::unique_ptr<Effect<Dim>>>& effects,
                      const RunTotals& totals, const std::string& scene_hash) {
  const Communicator& communicator = state.communicator();
  RunReport report;
  report.version = version();
  report.scene_hash = scene_hash;
  report.ranks = communicator.size();
  report.dimension = Dim;
  report.precision = state.precision;
  report.particles = count_particles(state);
  report.nodes = communicator.sum(static_cast<GlobalIndex>(state.topology().owned()) * nodes_per_block<Dim>);
  report.steps = state.step - totals.first_step;
  report.time = state.time;
  report.wall_seconds = communicator.max(totals.loop_seconds);
  const Real step_seconds = communicator.max(totals.step_seconds);
  if (step_seconds > 0)
    report.particle_steps_per_second_per_core =
        static_cast<Real>(totals.particle_steps) / step_seconds / communicator.size();
  report.rebalances = state.distribution.rebalances();
  if (report.particles > 0) report.bytes_per_particle = totals.peak_bytes / static_cast<Real>(report.particles);
  report_memory(communicator, memory_account(state, effects), totals.largest_account, state.memory, report.memory);
  report_traffic(communicator, state.timers, "output", totals.frames, report.files, "frames");
  report_traffic(communicator, state.timers, "checkpoint", totals.checkpoints, report.files, "checkpoints");
  report_traffic(communicator, state.timers, "restart", totals.restart, report.files, "restart");

  const std::vector<Spread> stages = over_ranks(communicator, state.timers.seconds());
  for (std::size_t i = 0; i < stages.size(); ++i)
    report.stages.push_back({state.timers.names()[i], stages[i]});

  std::vector<Real> per_step(totals.step_traffic.begin(), totals.step_traffic.end());
  for (Real& count : per_step) count /= static_cast<Real>(std::max<GlobalIndex>(1, report.steps));
  const std::vector<Spread> traffic = over_ranks(communicator, per_step);
  for (std::size_t i = 0; i < traffic.size(); ++i)
    report.traffic_per_step.push_back({traffic_names[i], traffic[i]});
  const auto of_all_ranks = [&](const char* name) {
    const auto count = std::find(traffic_names.begin(), traffic_names.end(), std::string_view(name));
    return traffic[static_cast<std::size_t>(count - traffic_names.begin())].mean * communicator.size();
  };
  report.halo_messages_per_step = of_all_ranks("halo_messages");
  report.halo_bytes_per_step = of_all_ranks("halo_bytes");
  report.messages_per_step = report.halo_messages_per_step + of_all_ranks("sort_messages");
  report.bytes_per_step = report.halo_bytes_per_step + of_all_ranks("sort_bytes");
  const std::vector<Spread> halo = over_ranks(communicator, {static_cast<Real>(state.halo().neighbours()),
                                                             static_cast<Real>(state.halo().ghost_nodes())});
  report.neighbours = halo[0];
  report.ghost_nodes = halo[1];
  report.imbalance = state.distribution.imbalance();
  for (const auto& [name, work] : state.solvers) {
    report.solver_iterations[name] = work.iterations;
    if (work.largest_residual > 0) report.solver_residuals[name] = work.largest_residual;
    report.solver_unknowns[name] = static_cast<Real>(work.unknowns) / static_cast<Real>(std::max<GlobalIndex>(1, work.solves));
  }
  state.guards["particles_removed_outside_domain"] += state.distribution.take_removed();
  if (state.distribution.any_open())
    state.guards["particles_left_through_open_sides"] += state.distribution.take_left();
  state.guards["particles_put_back_onto_wall"] += state.distribution.take_kept();
  for (const auto& [name, count] : state.guards) report.guards[name] = communicator.sum(count);
  return report;
}

namespace {

Real largest_mb(const std::vector<std::int64_t>& bytes) {
  return bytes.empty() ? 0 : static_cast<Real>(*std::max_element(bytes.begin(), bytes.end())) / 1e6;
}

}  // namespace

std::string closing_table(const RunReport& report) {
  std::string text = fmt::format("\n{:<20}{:>10}{:>10}{:>10}{:>9}\n", "stage [s]", "min", "mean", "max", "share");
  for (const auto& [name, time] : report.stages)
    text += fmt::format("{:<20}{:>10.3f}{:>10.3f}{:>10.3f}{:>8.1f}%\n", name, time.min, time.mean, time.max,
                        report.wall_seconds > 0 ? 100 * time.mean / report.wall_seconds : 0.0);
  text += fmt::format(
      "{} steps of {} particles on {} ranks in {:.2f} s: {:.3g} M particle-steps/s per core, {:.0f} bytes per particle\n"
      "per step: {:.1f} messages, {:.4g} kB between ranks ({:.1f}, {:.4g} kB of them halo); imbalance {:.3f}\n",
      report.steps, report.particles, report.ranks, report.wall_seconds,
      report.particle_steps_per_second_per_core / 1e6, report.bytes_per_particle, report.messages_per_step,
      report.bytes_per_step / 1e3, report.halo_messages_per_step, report.halo_bytes_per_step / 1e3, report.imbalance);
  for (const auto& [name, traffic] : report.files)
    text += fmt::format("{}: {} file{}, {:.4g} MB in {:.3g} s, {:.3g} GB/s\n", name, traffic.files,
                        traffic.files == 1 ? "" : "s", static_cast<Real>(traffic.bytes) / 1e6, traffic.seconds,
                        traffic.gb_per_second());
  const MemoryReport& memory = report.memory;
  text += fmt::format("memory of a rank: {:.4g} MB before the run, {:.4g} MB of arrays; peak {:.2f} times that",
                      largest_mb(memory.before_bytes), largest_mb(memory.steady_bytes), memory.peak_over_steady);
  for (std::size_t i = 0; memory.has_phases && i < memory.phases.size(); ++i)
    text += fmt::format("{}{} {:.2f}", i ? ", " : " (", memory.phases[i].name, memory.phases[i].over_steady);
  text += memory.has_phases ? ")\n" : "\n";
  for (const auto& [name, count] : report.solver_iterations) {
    const Real unknowns = report.solver_unknowns.at(name);
    text += fmt::format("solver {}: {} iterations, {:.2f} per step{}\n", name, count,
                        report.steps > 0 ? static_cast<Real>(count) / static_cast<Real>(report.steps) : 0.0,
                        unknowns > 0 ? fmt::format(", for {:.4g} unknowns on average", unknowns) : std::string());
  }
  for (const auto& [name, count] : report.guards)
    if (count > 0) text += fmt::format("guard {}: {} times\n", name, count);
  return text;
}

namespace {

template <int Dim>
std::string with_plasticity(const Material<Dim>& material) {
  return material.plasticity() ? fmt::format("{} with {}", material.model(), material.plasticity()) : material.model();
}

}  // namespace

template <int Dim>
std::string explain(State<Dim>& state, const std::vector<std::unique_ptr<Effect<Dim>>>& effects) {
  const Communicator& communicator = state.communicator();
  const Real particles = static_cast<Real>(count_particles(state));
  const GlobalIndex nodes =
      communicator.sum(static_cast<GlobalIndex>(state.topology().owned()) * nodes_per_block<Dim>);
  std::string text = fmt::format("{} dimensions, {} precision, {} ranks\n", Dim,
                                 state.precision == Precision::double_precision ? "double" : "single",
                                 communicator.size());
  text += fmt::format("{} particles, {} active nodes (unknowns of an implicit solve: up to {} each)\n",
                      static_cast<GlobalIndex>(particles), nodes, Dim);
  for (int a = 0; a < Dim; ++a)
    if (state.geometry().periodic(a))
      text += fmt::format("periodic in {}: after {:.6g} m\n", "xyz"[a], state.geometry().period(a));
  for (int side = 0; side < 2 * Dim; ++side)
    if (state.distribution.options().open[side])
      text += fmt::format("open at {}: what leaves there is deleted\n", domain_side_name(side));
  for (std::size_t b = 0; b < state.bodies.size(); ++b) {
    const Body<Dim>& body = state.bodies[b];
    const GlobalIndex count = communicator.sum(static_cast<GlobalIndex>(body.real_particles()));
    text += fmt::format("body \"{}\": {} particles of {} ({}), {} bytes each:", body.name, count,
                        state.material_of(b).name(), with_plasticity(state.material_of(b)),
                        body.particles.bytes_per_particle());
    for (FieldId f = 0; f < body.particles.count(); ++f) {
      const FieldTraits& t = body.particles.traits(f);
      if (body.particles.has(f)) text += fmt::format(" {}[{}]", t.name, t.components);
    }
    text += "\n";
  }
  text += fmt::format("transfer: {} kernel, {}{}, {} forces\n", state.transfer.kernel_name(), state.transfer.scheme_name(),
                      state.transfer.increments() ? fmt::format(" with a share of {}", state.transfer.flip_blend) : "",
                      state.transfer.forces_name());
  const int width = state.precision == Precision::double_precision ? 8 : 4;
  int per_node = 0;
  for (FieldId f = 0; f < state.fields.count(); ++f) per_node += width * state.fields.traits(f).components;
  text += fmt::format("grid: {} bytes per node:", per_node);
  for (FieldId f = 0; f < state.fields.count(); ++f) {
    const GridFieldTraits& t = state.fields.traits(f);
    text += fmt::format(" {}[{}]{}{}", t.name, t.components, t.sums_ghosts ? " summed" : "",
                        t.fills_ghosts ? " filled" : "");
  }
  text += "\n";
  text += state.distribution.decomposition().describe() + "\n";
  if (effects.empty()) text += "no effects\n";
  for (const auto& effect : effects) text += "effect " + effect->explain() + "\n";
  const auto account = sum_account(communicator, memory_account(state, effects));
  GlobalIndex total = 0;
  for (const auto& [holder, bytes] : account) total += bytes;
  text += fmt::format("memory: {:.4g} MB over all ranks, {:.1f} bytes per particle (solvers grow with the first solve)\n",
                      static_cast<Real>(total) / 1e6, static_cast<Real>(total) / particles);
  for (const auto& [holder, bytes] : account)
    if (bytes > 0)
      text += fmt::format("  {:<40}{:>12.1f} kB{:>9.2f} per particle\n", holder, static_cast<Real>(bytes) / 1e3,
                          static_cast<Real>(bytes) / particles);
  const std::vector<GlobalIndex> halo = {communicator.sum(state.halo().ghost_nodes()),
                                         communicator.sum(state.halo().shared_nodes())};
  text += fmt::format("halo: {} ghost nodes over all ranks, imbalance {:.3f}\n", halo[0], state.distribution.imbalance());
  return text;
}

#define MPM_INSTANTIATE(Dim)                                                                                      \
  template Traffic traffic<Dim>(const State<Dim>&);                                                               \
  template MemoryAccount memory_account<Dim>(const State<Dim>&, const std::vector<std::unique_ptr<Effect<Dim>>>&); \
  template RunReport make_report<Dim>(State<Dim>&, const std::vector<std::unique_ptr<Effect<Dim>>>&,               \
                                      const RunTotals&, const std::string&);                                       \
  template std::string explain<Dim>(State<Dim>&, const std::vector<std::unique_ptr<Effect<Dim>>>&);
MPM_INSTANTIATE(2)
MPM_INSTANTIATE(3)
#undef MPM_INSTANTIATE

}  // namespace mpm
