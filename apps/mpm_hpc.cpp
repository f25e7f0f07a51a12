// mpirun -n N mpm_hpc scene.toml: the command line, and one exit code for all ranks.
#include <mpi.h>

#include <CLI/CLI.hpp>
#include <csignal>
#include <cstdio>
#include <exception>

#include "mpm_hpc/base/memory.hpp"
#include "mpm_hpc/base/processor.hpp"
#include "mpm_hpc/simulation/simulation.hpp"
#include "mpm_hpc/solvers/petsc_session.hpp"

namespace {

struct CommandLine {
  mpm::RunOptions run;
  bool describe = false, json = false, version = false;
  int dimension = 3;
  std::vector<std::string> petsc;
};

// Returns an exit code if the program ends here (help, or a wrong option).
std::optional<int> parse(int argc, char** argv, bool speaks, CommandLine& line) {
  CLI::App app{"Material point simulation with dynamic fracture on MPI ranks."};
  app.footer("Options of the form -phase_ksp_type go to PETSc. Exit codes: 0 done, 2 user error, 3 numerical failure, "
             "4 file failure, 75 stopped by a signal after a checkpoint.");
  // CLI11's own validators print the range of the type.
  const CLI::Validator not_negative(
      [](std::string& text) {
        return text.find_first_not_of("0123456789") == std::string::npos ? "" : text + " is not a number of steps";
      },
      "COUNT"),
      positive(
          [](std::string& text) {
            double value = 0;
            return CLI::detail::lexical_cast(text, value) && value > 0 ? "" : text + " is not a positive time in s";
          },
          "SECONDS");
  std::string scene, output, restart;
  std::int64_t steps = -1;
  double until = -1;
  app.add_option("scene", scene, "Scene file (TOML)");
  app.add_option("--set", line.run.overrides, "Override a key of the scene: key.path=value")->allow_extra_args(false);
  app.add_option("--output,-o", output, "Output folder; default: the scene's name in the working directory");
  app.add_option("--restart", restart, "Go on from this checkpoint");
  app.add_option("--steps", steps, "End after so many steps")->check(not_negative);
  app.add_option("--until", until, "End at this time [s], in place of time.end")->check(positive);
  app.add_flag("--force", line.run.force, "Replace a run that is in the output folder");
  app.add_flag("--validate", line.run.validate, "Check the scene and stop before the first step");
  app.add_flag("--explain", line.run.explain, "Tell what the scene builds and what it costs");
  app.add_flag("--describe", line.describe, "Print every key of a scene with its unit, default and meaning");
  app.add_flag("--json", line.json, "With --describe: a JSON schema");
  app.add_option("--dimension", line.dimension, "With --describe: 2 or 3 (default)")->check(CLI::Range(2, 3));
  app.add_flag("--version", line.version, "Print the version");
  // PETSc's options have one dash and a long name, which CLI11 would take for a cluster of short flags.
  std::vector<std::string> own;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    const bool petsc = word.size() > 2 && word[0] == '-' && word[1] != '-' && std::isalpha(word[1]) && word != "-o" &&
                       word.rfind("-o=", 0) != 0;
    if (!petsc) {
      own.push_back(word);
      continue;
    }
    line.petsc.push_back(word);
    const bool has_value = i + 1 < argc && (argv[i + 1][0] != '-' || std::isdigit(argv[i + 1][1])) &&
                           std::string(argv[i + 1]).find(".toml") == std::string::npos;
    if (has_value) line.petsc.push_back(argv[++i]);
  }
  std::reverse(own.begin(), own.end());
  try {
    app.parse(own);
    if (scene.empty() && !line.describe && !line.version)
      throw CLI::RequiredError("a scene file: mpm_hpc scene.toml");
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) {
      if (speaks) app.exit(error);
      return 0;
    }
    if (speaks) std::fprintf(stderr, "mpm_hpc: error: %s; see mpm_hpc --help\n", error.what());
    return static_cast<int>(mpm::ExitCode::user_error);
  }
  line.run.scene = scene;
  if (!output.empty()) line.run.output = output;
  if (!restart.empty()) line.run.restart = restart;
  if (steps >= 0) line.run.steps = steps;
  if (until > 0) line.run.until = until;
  return std::nullopt;
}

int run(const mpm::Communicator& communicator, const CommandLine& line) {
  if (line.version) {
    if (communicator.root()) std::printf("mpm_hpc %s (%s)\n", mpm::version().c_str(), mpm::widest_registers());
    return 0;
  }
  if (line.describe) {
    if (communicator.root()) std::printf("%s\n", mpm::describe_scene(line.dimension, line.json).c_str());
    return 0;
  }
  const mpm::PetscSession petsc(line.petsc);
  return static_cast<int>(mpm::run_scene(communicator, line.run));
}

}  // namespace

int main(int argc, char** argv) {
  mpm::return_freed_memory();
  MPI_Init(&argc, &argv);
  for (const int signal : {SIGTERM, SIGUSR1, SIGINT}) std::signal(signal, [](int) { mpm::request_stop(); });
  std::signal(SIGXFSZ, SIG_IGN);  // a full quota is an error of the write, not the end of the process
  int code = 0;
  {
    const mpm::Communicator communicator = mpm::Communicator::world();
    CommandLine line;
    try {
      if (const std::optional<int> ended = parse(argc, argv, communicator.root(), line)) {
        code = *ended;
      } else {
        code = run(communicator, line);
      }
    } catch (const mpm::Error& error) {
      // Thrown by all ranks together; one speaks.
      if (communicator.root()) std::fprintf(stderr, "mpm_hpc: error: %s\n", error.what());
      code = static_cast<int>(error.code());
    } catch (const std::exception& error) {
      // Known to this rank only: the others may be waiting for it.
      std::fprintf(stderr, "mpm_hpc: rank %d: %s; this is a fault of the program or of the machine\n",
                   communicator.rank(), error.what());
      communicator.abort(1);
    }
  }
  MPI_Finalize();
  return code;
}
