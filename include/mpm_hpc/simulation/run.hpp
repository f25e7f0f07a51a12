// One run of a scene of known dimension: the loop over steps and what happens between them.
#pragma once

#include <memory>
#include <optional>

#include "mpm_hpc/io/checkpoint.hpp"
#include "mpm_hpc/io/frames.hpp"
#include "mpm_hpc/io/history.hpp"
#include "mpm_hpc/simulation/progress.hpp"
#include "mpm_hpc/simulation/report.hpp"
#include "mpm_hpc/simulation/setup.hpp"
#include "mpm_hpc/simulation/simulation.hpp"
#include "mpm_hpc/time/integrator.hpp"

namespace mpm {

template <int Dim>
class Run {
 public:
  // Declares the state; throws UserError. Collective, like all members.
  Run(const Communicator& communicator, Scene<Dim> scene, const RunOptions& options);

  // Seeds the particles or reads the checkpoint. Nothing has been written so far.
  void prepare();
  // To the end or a stop. Throws NumericalFailure after a checkpoint.
  ExitCode run();

  State<Dim>& state() { return state_; }
  const std::vector<std::unique_ptr<Effect<Dim>>>& effects() const { return scene_.effects; }
  std::string explanation() { return explain(state_, scene_.effects); }

 private:
  // Something that happens at whole multiples of an interval, at the start and at the end.
  struct Event {
    Real every = 0;  // 0: only start and end
    Real next = 0;
    void plan_after(Real time);
    bool due(Real time, Real dt) const;
  };

  void refuse_unused_options(bool solvers_ran);
  void restart();
  Real next_event() const;  // time of the next one, the end included [s]
  Real choose_step();
  void loop();
  void happen(bool last);
  FrameOptions frame_options() const;
  void write_frame();
  void write_history();
  CheckpointState checkpoint_state();
  void save_checkpoint();
  std::filesystem::path save_failed_state();
  void finish(ExitCode code, const std::string& reason);
  std::map<std::string, std::vector<Real>> state_numbers();
  void restore_numbers(const std::map<std::string, std::vector<Real>>& numbers);
  void measure_memory();
  void count_file(FileTraffic& traffic, const std::filesystem::path& file);

  Communicator communicator_;
  Scene<Dim> scene_;
  RunOptions options_;
  State<Dim> state_;
  std::unique_ptr<Integrator<Dim>> integrator_;
  std::filesystem::path folder_;
  Real end_ = 0;
  Event frame_, history_, checkpoint_;
  std::unique_ptr<FrameWriter<Dim>> frames_;
  std::unique_ptr<HistoryWriter> history_file_;
  std::unique_ptr<Progress> progress_;
  RunTotals totals_;
  GlobalIndex particles_ = 0;
  Real written_frame_ = -1, written_row_ = -1, written_checkpoint_ = -1;  // times of the last ones
};

}  // namespace mpm
