#include "mpm_hpc/simulation/run.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>

#include "mpm_hpc/io/output_folder.hpp"
#include "mpm_hpc/io/text_file.hpp"
#include "mpm_hpc/simulation/diagnostics.hpp"
#include "mpm_hpc/simulation/stop_signal.hpp"
#include "mpm_hpc/solvers/linear_solver.hpp"
#include "mpm_hpc/solvers/petsc_session.hpp"

namespace mpm {

namespace {

using Clock = std::chrono::steady_clock;

Real seconds_since(Clock::time_point start) { return std::chrono::duration<Real>(Clock::now() - start).count(); }

// Times closer than this share of a step are the same: sums of steps carry rounding errors.
constexpr Real time_tolerance = 1e-9;

}  // namespace

template <int Dim>
void Run<Dim>::Event::plan_after(Real time) {
  next = every > 0 ? (std::floor(time / every * (1 + 1e-12) + 1e-9) + 1) * every : std::numeric_limits<Real>::infinity();
}

template <int Dim>
bool Run<Dim>::Event::due(Real time, Real dt) const {
  return time >= next - time_tolerance * dt;
}

template <int Dim>
Run<Dim>::Run(const Communicator& communicator, Scene<Dim> scene, const RunOptions& options)
    : communicator_(communicator), scene_(std::move(scene)), options_(options) {
  declare_state(communicator_, scene_, state_);
  integrator_ = make_integrator(scene_, state_, join_effects(scene_));
  refuse_unused_options(false);
  end_ = options_.until.value_or(scene_.time.end);
  const OutputOptions& output = scene_.output;
  frame_.every = output.every;
  history_.every = output.history_every.value_or(output.every / 10);
  checkpoint_.every = output.checkpoint_every.value_or(0);
}

// PETSc reads some options of a solver at its first solve only, so those wait until the first step is done.
template <int Dim>
void Run<Dim>::refuse_unused_options(bool solvers_ran) {
  for (const std::string& option : PetscSession::unused_options()) {
    const bool late = !state_.solvers.empty() || LinearSolver::knows_prefix(option);
    require(late && !solvers_ran,
            "the option {} is neither one of mpm_hpc nor read by PETSc in this scene; see mpm_hpc --help", option);
  }
}

template <int Dim>
void Run<Dim>::prepare() {
  auto m = state_.memory.phase(options_.restart ? "restart" : "start-up");
  if (options_.restart) {
    restart();
  } else {
    create_particles(scene_, state_);
    integrator_->initialise(state_);
  }
  FrameWriter<Dim>::check_fields(frame_options(), state_.bodies, derived_fields(state_));
  particles_ = count_particles(state_);
  totals_.first_step = state_.step;
  const Real stable = integrator_->stable_step(state_);
  if (scene_.time.dt)
    require(*scene_.time.dt <= stable,
            "{}: time.dt = {:.4g} s is unstable at t = {:.4g} s: the {} allows {:.4g} s; lower it, or leave it out for an "
            "adaptive step",
            scene_.time.dt_where, *scene_.time.dt, state_.time, integrator_->bound_by(), stable);
  require(std::isfinite(stable) || scene_.time.max_dt || scene_.time.dt,
          "{}: nothing limits the time step (no stiffness, no motion); give time.max_dt or time.dt",
          scene_.time.end_where);
  measure_memory();
}

// Only rank 0 looks at the disk.
template <int Dim>
void Run<Dim>::count_file(FileTraffic& traffic, const std::filesystem::path& file) {
  std::error_code ignored;
  const std::uintmax_t bytes = communicator_.root() ? std::filesystem::file_size(file, ignored) : 0;
  ++traffic.files;
  if (!ignored) traffic.bytes += static_cast<GlobalIndex>(bytes);
}

template <int Dim>
void Run<Dim>::restart() {
  auto s = state_.timers.scope("restart");
  count_file(totals_.restart, *options_.restart);
  const CheckpointState saved = read_checkpoint(communicator_, *options_.restart, state_.bodies, state_.precision);
  Decomposition<Dim>& decomposition = state_.distribution.decomposition();
  if (saved.ranks == communicator_.size()) decomposition.restore(saved.owners, saved.curve_cuts, saved.ranks);
  state_.step = saved.step;
  state_.time = saved.time;
  state_.dt = saved.dt;
  restore_numbers(saved.numbers);
  s.stop();
  sort_particles(state_, OrderWithinCell::canonical);
  require(state_.time < end_, "{}: the checkpoint {} is at t = {:.6g} s, at or past the end at {:.6g} s; raise time.end or "
          "give a later --until",
          scene_.time.end_where, options_.restart->string(), state_.time, end_);
}

template <int Dim>
std::map<std::string, std::vector<Real>> Run<Dim>::state_numbers() {
  std::map<std::string, std::vector<Real>> numbers;
  for (auto& effect : scene_.effects) effect->save(numbers);
  const StepLimits& l = state_.limits;
  numbers["limits"] = {l.kinematic.speed, l.kinematic.speed_component, l.kinematic.gradient, l.kinematic.acceleration,
                       l.signal_speed,    l.stiffness_speed,           l.min_jacobian,      l.viscosity};
  if (std::isfinite(state_.step_limit)) numbers["step_limit"] = {state_.step_limit};
  state_.ledger.consolidate(communicator_);
  for (const auto& [name, value] : state_.ledger.entries()) numbers["ledger:" + name] = {communicator_.sum(value)};
  state_.guards["particles_removed_outside_domain"] += state_.distribution.take_removed();
  if (state_.distribution.any_open())
    state_.guards["particles_left_through_open_sides"] += state_.distribution.take_left();
  state_.guards["particles_put_back_onto_wall"] += state_.distribution.take_kept();
  for (const auto& [name, count] : state_.guards)
    numbers["guard:" + name] = {static_cast<Real>(communicator_.sum(count))};
  return numbers;
}

template <int Dim>
void Run<Dim>::restore_numbers(const std::map<std::string, std::vector<Real>>& numbers) {
  for (auto& effect : scene_.effects) effect->restore(numbers);
  StepLimits& l = state_.limits;
  if (const auto it = numbers.find("limits"); it != numbers.end() && it->second.size() == 8) {
    const std::vector<Real>& v = it->second;
    l.kinematic = {v[0], v[1], v[2], v[3]};
    l.signal_speed = v[4];
    l.stiffness_speed = v[5];
    l.min_jacobian = v[6];
    l.viscosity = v[7];
  }
  if (const auto it = numbers.find("step_limit"); it != numbers.end() && it->second.size() == 1)
    state_.step_limit = it->second[0];
  for (const auto& [name, values] : numbers) {
    if (name.starts_with("ledger:")) state_.ledger[name.substr(7)] = communicator_.root() ? values[0] : 0;
    if (name.starts_with("guard:"))
      state_.guards[name.substr(6)] = communicator_.root() ? static_cast<GlobalIndex>(values[0]) : 0;
  }
}

template <int Dim>
void Run<Dim>::measure_memory() {
  const std::size_t mine = total_bytes(memory_account(state_, scene_.effects));
  totals_.largest_account = std::max(totals_.largest_account, mine);
  totals_.peak_bytes = std::max(totals_.peak_bytes, communicator_.sum(static_cast<Real>(mine)));
}

template <int Dim>
FrameOptions Run<Dim>::frame_options() const {
  FrameOptions options;
  options.fields = scene_.output.fields;
  options.where = scene_.output.fields_where;
  options.precision = scene_.output.precision == "double" ? Precision::double_precision : Precision::single_precision;
  options.deflate = scene_.output.compression;
  return options;
}

template <int Dim>
void Run<Dim>::write_frame() {
  auto s = state_.timers.scope("output");
  auto m = state_.memory.phase("frame");
  if (!frames_) frames_ = std::make_unique<FrameWriter<Dim>>(communicator_, folder_, frame_options());
  frames_->write(state_.step, state_.time, state_.bodies, derived_fields(state_));
  count_file(totals_.frames, frames_->last());
  written_frame_ = state_.time;
}

template <int Dim>
void Run<Dim>::write_history() {
  auto s = state_.timers.scope("history");
  const std::vector<HistoryValue> row = history_row(state_, scene_.effects);
  measure_memory();
  if (!history_file_) {
    std::vector<HistoryColumn> columns;
    for (const HistoryValue& v : row) columns.push_back({v.name, v.unit});
    std::optional<GlobalIndex> continued;
    if (options_.restart) continued = totals_.first_step;
    history_file_ = std::make_unique<HistoryWriter>(communicator_, folder_ / "history.csv", columns, continued);
  }
  std::vector<Real> values;
  for (const HistoryValue& v : row) values.push_back(v.value);
  // The row of the restart's own step is already in the file.
  if (!(options_.restart && state_.step == totals_.first_step)) history_file_->write(values);
  written_row_ = state_.time;
}

template <int Dim>
CheckpointState Run<Dim>::checkpoint_state() {
  CheckpointState saved;
  saved.step = state_.step;
  saved.time = state_.time;
  saved.dt = state_.dt;
  saved.code_version = version();
  saved.scene_text = scene_.text;
  saved.numbers = state_numbers();
  saved.owners = state_.distribution.decomposition().owners();
  saved.curve_cuts = state_.distribution.decomposition().cuts();
  return saved;
}

template <int Dim>
void Run<Dim>::save_checkpoint() {
  auto s = state_.timers.scope("checkpoint");
  auto m = state_.memory.phase("checkpoint");
  count_file(totals_.checkpoints,
             write_checkpoint(communicator_, folder_, checkpoint_state(), state_.bodies, state_.precision));
  written_checkpoint_ = state_.time;
}

// Frames, history and checkpoints that are due; all of them at the end.
template <int Dim>
void Run<Dim>::happen(bool last) {
  const Real time = state_.time, dt = state_.dt;
  const bool checkpoint_due =
      scene_.output.checkpoint && (last || checkpoint_.due(time, dt)) && written_checkpoint_ != time;
  // The particles take the order that a restart gives them, so that the run that goes on equals the one that restarts.
  // Sorting may delete particles that left the domain, so it comes before anything is counted or written.
  if (checkpoint_due) {
    auto s = state_.timers.scope("sort and migrate");
    sort_particles(state_, OrderWithinCell::canonical);
  }
  if ((last || history_.due(time, dt)) && written_row_ != time) write_history();
  if (scene_.output.frames && (last || frame_.due(time, dt)) && written_frame_ != time) write_frame();
  if (checkpoint_due) save_checkpoint();
  if (history_.due(time, dt)) history_.plan_after(time);
  if (frame_.due(time, dt)) frame_.plan_after(time);
  if (checkpoint_.due(time, dt)) checkpoint_.plan_after(time);
}

template <int Dim>
Real Run<Dim>::next_event() const {
  return std::min({end_, frame_.next, history_.next, checkpoint_.next});
}

// The stable step, shortened so that events and the end are hit exactly; a fixed step is taken as it is.
template <int Dim>
Real Run<Dim>::choose_step() {
  const Real stable = integrator_->stable_step(state_);
  if (scene_.time.dt) {
    if (*scene_.time.dt <= stable) return *scene_.time.dt;
    state_.guards["fixed_dt_was_unstable_and_shortened"] += communicator_.root();
    return stable;
  }
  Real dt = std::min(stable, scene_.time.max_dt.value_or(std::numeric_limits<Real>::infinity()));
  const Real left = next_event() - state_.time;
  if (left <= dt * (1 + time_tolerance)) return left;
  return left < 2 * dt ? left / 2 : dt;  // two halves rather than a whole step and a tiny one
}

template <int Dim>
void Run<Dim>::loop() {
  const Clock::time_point began = Clock::now();
  frame_.plan_after(state_.time);
  history_.plan_after(state_.time);
  checkpoint_.plan_after(state_.time);
  if (!options_.restart) {
    write_history();
    if (scene_.output.frames) write_frame();
  }
  written_checkpoint_ = options_.restart ? state_.time : -1;
  const std::int64_t steps = std::min(options_.steps.value_or(std::numeric_limits<std::int64_t>::max()),
                                      scene_.time.max_steps.value_or(std::numeric_limits<std::int64_t>::max()));
  bool finished = false;
  while (!finished) {
    const Real target = next_event();
    state_.dt = choose_step();
    state_.stop_requested = stop_was_requested();
    state_.observed = state_.time + state_.dt >= target - time_tolerance * state_.dt ||
                      state_.step + 1 - totals_.first_step >= steps || state_.stop_requested;
    const Traffic before = traffic(state_);
    const Clock::time_point step_began = Clock::now();
    integrator_->step(state_);
    totals_.step_seconds += seconds_since(step_began);
    const Traffic after = traffic(state_);
    for (std::size_t i = 0; i < after.size(); ++i) totals_.step_traffic[i] += after[i] - before[i];
    totals_.particle_steps += particles_;
    if (std::abs(state_.time - target) < time_tolerance * state_.dt) state_.time = target;
    finished = state_.time >= end_ - time_tolerance * state_.dt || state_.step - totals_.first_step >= steps ||
               state_.stop_requested;
    if (state_.step == totals_.first_step + 1) refuse_unused_options(true);
    happen(finished);
    totals_.loop_seconds = seconds_since(began);
    if (!state_.inertia) progress_->log(state_.step, state_.time, state_.dt, integrator_->solved());
    progress_->report(state_.step, state_.time, state_.dt, integrator_->bound_by(), integrator_->solved());
  }
}

template <int Dim>
void Run<Dim>::finish(ExitCode code, const std::string& reason) {
  RunReport report = make_report(state_, scene_.effects, totals_, text_hash(scene_.text));
  report.exit_code = code;
  report.exit_reason = reason;
  write_run_json(communicator_, folder_ / "run.json", report);
  progress_->say(closing_table(report) + reason);
}

// The particles as they are: a failed state can't be sorted.
template <int Dim>
std::filesystem::path Run<Dim>::save_failed_state() {
  const std::filesystem::path folder = folder_ / "failed";
  prepare_output_folder(communicator_, {folder, true, {}});
  return write_checkpoint(communicator_, folder, checkpoint_state(), state_.bodies, state_.precision);
}

template <int Dim>
ExitCode Run<Dim>::run() {
  folder_ = options_.output.value_or(options_.scene.stem());
  OutputFolderRequest request{folder_, options_.force, {}};
  if (options_.restart) request.restart = RestartPoint{*options_.restart, state_.time};
  prepare_output_folder(communicator_, request);
  write_text_file(communicator_, folder_ / "scene.toml", scene_.text);
  progress_ = std::make_unique<Progress>(communicator_.root(), state_.time, end_);
  progress_->say(fmt::format("{}{}{} particles on {} ranks, into {}", scene_.title, scene_.title.empty() ? "" : ": ",
                             particles_, communicator_.size(), folder_.string()));
  if (state_.distribution.decomposition().on_curve())
    progress_->say("  " + state_.distribution.decomposition().describe());
  for (const auto& effect : scene_.effects) progress_->say("  " + effect->explain());
  try {
    loop();
  } catch (const NumericalFailure& failure) {
    const std::string what = fmt::format("step {}, t = {:.6g} s: {}", state_.step, state_.time, failure.what());
    // Beside the good checkpoints, which it must not push out.
    std::string where = "no checkpoint could be written";
    try {
      where = "the state is in " + save_failed_state().string();
    } catch (const Error&) {
    }
    finish(ExitCode::numerical_failure, what);
    throw NumericalFailure(fmt::format("{} ({})", what, where));
  } catch (const FileError& failure) {
    try {
      finish(ExitCode::file_failure, failure.what());
    } catch (const FileError&) {
      // The same disk is full for the report.
    }
    throw;
  }
  const bool stopped = state_.stop_requested;
  finish(stopped ? ExitCode::stopped_by_signal : ExitCode::done,
         stopped ? "stopped by a signal after a checkpoint" : "done");
  return stopped ? ExitCode::stopped_by_signal : ExitCode::done;
}

template class Run<2>;
template class Run<3>;

}  // namespace mpm
