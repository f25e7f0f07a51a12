#include "mpm_hpc/io/run_json.hpp"

#include <nlohmann/json.hpp>

#include "mpm_hpc/io/text_file.hpp"
#include "mpm_hpc/io/together.hpp"

namespace mpm {

namespace {

using Json = nlohmann::ordered_json;

Json memory_json(const MemoryReport& memory) {
  Json account = Json::object(), phases = Json::object();
  for (const auto& [holder, bytes] : memory.account) account[holder] = bytes;
  if (memory.has_phases)
    for (const auto& phase : memory.phases)
      phases[phase.name] = Json{{"peak_bytes", phase.peak_bytes}, {"peak_over_steady", phase.over_steady}};
  return Json{{"before_bytes", memory.before_bytes},
              {"array_bytes", memory.steady_bytes},
              {"peak_over_steady", memory.peak_over_steady},
              {"phases", phases},
              {"account", account}};
}

}  // namespace

std::string run_json_text(const RunReport& report) {
  const auto spread = [](const Spread& s) { return Json{{"min", s.min}, {"mean", s.mean}, {"max", s.max}}; };
  Json stages = Json::object(), traffic = Json::object();
  for (const auto& [name, time] : report.stages) stages[name] = spread(time);
  for (const auto& [name, count] : report.traffic_per_step) traffic[name] = spread(count);
  Json json;
  json["version"] = report.version;
  json["scene_hash"] = report.scene_hash;
  json["ranks"] = report.ranks;
  json["dimension"] = report.dimension;
  json["precision"] = report.precision == Precision::single_precision ? "single" : "double";
  json["particles"] = report.particles;
  json["nodes"] = report.nodes;
  json["steps"] = report.steps;
  json["time"] = report.time;
  json["wall_seconds"] = report.wall_seconds;
  json["particle_steps_per_second_per_core"] = report.particle_steps_per_second_per_core;
  json["bytes_per_particle"] = report.bytes_per_particle;
  json["peak_rss_bytes"] = report.memory.peak_bytes;
  json["memory"] = memory_json(report.memory);
  json["stages"] = stages;
  Json files = Json::object();
  for (const auto& [name, traffic] : report.files)
    files[name] = Json{{"files", traffic.files},
                       {"bytes", traffic.bytes},
                       {"seconds", traffic.seconds},
                       {"gb_per_second", traffic.gb_per_second()}};
  json["files"] = files;
  json["messages_per_step"] = report.messages_per_step;
  json["bytes_per_step"] = report.bytes_per_step;
  json["halo_messages_per_step"] = report.halo_messages_per_step;
  json["halo_bytes_per_step"] = report.halo_bytes_per_step;
  json["traffic_per_step"] = traffic;
  json["neighbours"] = spread(report.neighbours);
  json["ghost_nodes"] = spread(report.ghost_nodes);
  json["rebalances"] = report.rebalances;
  json["imbalance"] = report.imbalance;
  json["solver_iterations"] = report.solver_iterations;
  json["solver_unknowns"] = report.solver_unknowns;
  if (!report.solver_residuals.empty()) json["solver_residuals"] = report.solver_residuals;
  json["guards"] = report.guards;
  json["exit"] = Json{{"code", static_cast<int>(report.exit_code)}, {"reason", report.exit_reason}};
  // A reason may quote a file name that is no UTF-8.
  return json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

void write_run_json(const Communicator& communicator, const std::filesystem::path& file,
                    const RunReport& report) {
  on_root(communicator, [&] { replace_text_file(file, run_json_text(report)); });
}

}  // namespace mpm
