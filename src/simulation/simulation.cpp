#include "mpm_hpc/simulation/simulation.hpp"

#include <csignal>

#include "mpm_hpc/io/text_file.hpp"
#include "mpm_hpc/io/together.hpp"
#include "mpm_hpc/scene/scene.hpp"
#include "mpm_hpc/simulation/run.hpp"
#include "mpm_hpc/simulation/stop_signal.hpp"

namespace mpm {

namespace {

volatile std::sig_atomic_t stop_flag = 0;

template <int Dim>
ExitCode run_in(const Communicator& communicator, Parameters& parameters, const RunOptions& options) {
  Run<Dim> run(communicator, read_scene<Dim>(parameters), options);
  run.prepare();
  if (options.explain) {
    const std::string text = run.explanation();
    if (communicator.root()) std::printf("%s", text.c_str());
  }
  if (options.validate && communicator.root()) std::printf("%s is valid\n", options.scene.string().c_str());
  if (options.explain || options.validate) return ExitCode::done;
  return run.run();
}

}  // namespace

void request_stop() { stop_flag = 1; }
bool stop_was_requested() { return stop_flag != 0; }
std::string version() { return MPM_VERSION; }

ExitCode run_scene(const Communicator& communicator, const RunOptions& options) {
  // Rank 0 reads the file; all ranks parse the same text and so find the same faults.
  std::string text;
  on_root(communicator, [&] {
    std::error_code ignored;
    require(std::filesystem::is_regular_file(options.scene, ignored),
            "{}: there is no such scene file; give the path of a .toml file", options.scene.string());
    text = read_text_file(options.scene);
  });
  communicator.broadcast(text);
  Parameters parameters = Parameters::read_text(text, options.scene.string(), options.overrides);
  return read_dimension(parameters) == 2 ? run_in<2>(communicator, parameters, options)
                                         : run_in<3>(communicator, parameters, options);
}

std::string describe_scene(int dimension, bool json) {
  Parameters parameters = Parameters::describe();
  read_dimension(parameters);
  if (dimension == 2) {
    read_scene<2>(parameters);
  } else {
    read_scene<3>(parameters);
  }
  return json ? parameters.describe_json_schema() : parameters.describe_text();
}

}  // namespace mpm
