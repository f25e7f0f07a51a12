#include "mpm_hpc/effects/phase_field/phase_field.hpp"

#include <algorithm>

#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/effects/material_columns.hpp"
#include "mpm_hpc/math/bspline.hpp"
#include "mpm_hpc/transfer/lanes.hpp"
#include "mpm_hpc/transfer/scalar_transfer.hpp"

namespace mpm {

namespace {

// The entries of H are (l0/h)^2 times those of M, and so is their rounding, which c collects because it never rises: entries in
// single precision leave 4e-6 after 287 steps of branching_plate_2d at l0 = 8 h, entries in double 1e-7.
bool single_entries_suffice(double tolerance, double length_in_cells) {
  return tolerance >= 1e-6 * std::max(1.0, length_in_cells * length_in_cells);
}
constexpr double broken = 0.1;                 // c below which a particle counts as broken
constexpr double cracked_equilibrium = 1e-3;   // c at which the driving energy holds an initial crack on the grid

}  // namespace

template <int Dim>
PhaseField<Dim>::PhaseField(Parameters& p) {
  where_ = p.where();
  p.optional_real("length_scale", length_,
                  {.unit = "m",
                   .min = 0,
                   .min_exclusive = true,
                   .doc = "Regularisation length l0, half of the AT2 length of most papers; default half a grid spacing."});
  p.optional_real("mobility", mobility_,
                  {.unit = "1/s",
                   .min = 0,
                   .min_exclusive = true,
                   .doc = "Mobility M_c of the crack evolution; without it the rate-independent equation is solved."});
  p.real("residual", residual_,
         {.min = 0, .max = 1, .max_exclusive = true, .doc = "Share r of the tensile stiffness that a broken particle keeps."});
  // Without mobility the solution doesn't depend on c^n, and increments would add the smoothing of c^n at each step: the
  // flanks of a crack would sink until it fills the plate. With a mobility, taking values would smooth c at each step.
  std::string update = "auto";
  p.choice("update", update, {"auto", "increment", "value"},
           "Return of c to the particles, always without healing: by the grid's increment as in CD-MPM, or by its value; "
           "auto takes increments with a mobility and values without.");
  by_increment_ = update == "increment" || (update == "auto" && mobility_);
  std::string history = "current";
  p.choice("history", history, {"current", "maximum"},
           "Energy that drives the crack: the current tensile energy, or its running maximum.");
  running_maximum_ = history == "maximum";
  std::string reaction = "consistent";
  p.choice("reaction", reaction, {"consistent", "lumped"},
           "The driving term on the grid: acting on c at the particles, or lumped onto the nodes as in CD-MPM, where an open "
           "crack breaks all that shares a node with it.");
  lumped_ = reaction == "lumped";
  p.boolean("corrected_toughness", corrected_,
            {.doc = "Divide the toughness by 1 + k h/l0, so that a crack costs fracture_toughness per area on this grid."});
  std::string shape = "profile";
  const bool chosen = p.choice("corrected_for", shape, {"profile", "running_crack"},
           "The crack whose cost k is: the profile of one broken row of particles (quadratic kernel: 0.16, lumped 0.40), or what "
           "a running crack breaks (0.32, lumped 0.46).");
  if (chosen && !corrected_)
    p.error_at("corrected_for", "corrected_toughness = false leaves nothing to correct; take one of the two out.");
  crack_shape_ = shape == "profile" ? CrackShape::profile : CrackShape::running;
  p.choice("operator", operator_, {"auto", "stencil", "matrix_free", "assembled"},
           "How M + H is applied: from numbers on the nodes, by sweeps over the particles, or as a PETSc matrix for other "
           "preconditioners; auto takes stencil, and assembled for a -phase_pc_type that needs it.");
  p.real("tolerance", solver_options_.relative_tolerance,
         {.min = 0,
          .min_exclusive = true,
          .max = 1,
          .max_exclusive = true,
          .doc = "Relative tolerance of the solve; from 1e-6 on, and (l0/h)^2 times that where l0 > h, the stencil is kept in single precision."});
  Real active_tolerance = 1e-6;
  p.real("active_tolerance", active_tolerance,
         {.min = 0,
          .max = 0.1,
          .doc = "Largest error of c from solving only where particles are driven or damaged, and around; 0 solves everywhere."});
  active_ = ActiveSet<Dim>(active_tolerance);
  p.integer("max_iterations", solver_options_.max_iterations, {.min = 1, .doc = "Largest number of PCG iterations."});
  p.integer("passes", passes_,
            {.min = 1,
             .doc = "Implicit and quasi-static steps: how often at most the velocities and the cracks are solved in turn."});
  p.real("pass_tolerance", pass_tolerance_,
         {.min = 0,
          .min_exclusive = true,
          .max = 1,
          .doc = "Largest change of c at a particle from one pass to the next that ends the passes; default 1e-3."});
  p.section_list("crack", SectionOptions("A region that is broken from the start."), [this](Parameters& q, int) {
    cracks_.push_back({q.where(), {}});
    declare_shape<Dim>(q, "shape", cracks_.back().shape, true, "Particles inside start with c = 0.");
  });
}

template <int Dim>
std::string PhaseField<Dim>::explain() const {
  std::string bodies;
  for (const BodyPart& part : parts_) bodies += fmt::format("{}{}", bodies.empty() ? "" : ", ", part.body);
  const PhaseLaw& law = parts_.front().law;
  return fmt::format("phase_field: fracture of bodies {}; l0 = {:.4g} m, {}, r = {:.3g}, G_c in the equations = {:.4g} "
                     "J/m^2{}, operator {}",
                     bodies, law.length,
                     mobility_ ? fmt::format("mobility {:.4g} 1/s", *mobility_) : std::string("rate-independent"),
                     law.residual, law.toughness,
                     corrected_ ? fmt::format(" (over 1 + k h/l0 with k = {:.2f}, {})", crack_cost_,
                                              crack_shape_ == CrackShape::profile ? "the profile of one broken row"
                                                                                  : "what a running crack breaks")
                                : std::string(),
                     operator_);
}

template <int Dim>
void PhaseField<Dim>::declare_fields(State<Dim>& state) {
  const Real spacing = state.geometry().spacing(), length = length_.value_or(spacing / 2);
  const std::string preconditioner = LinearSolver::preconditioner_of_entries(PhaseSystem<Dim>::options_prefix);
  if (operator_ == "auto") operator_ = preconditioner.empty() ? "stencil" : "assembled";
  require(preconditioner.empty() || operator_ == "assembled",
          "{}: operator = \"{}\" has no entries for -{}pc_type {}; take operator = \"assembled\" or the preconditioner jacobi",
          where_, operator_, PhaseSystem<Dim>::options_prefix, preconditioner);
  crack_cost_ = corrected_ ? crack_cost(state.transfer.kernel, lumped_, crack_shape_) : 0;
  part_of_body_.assign(state.bodies.size(), -1);
  std::vector<typename PhaseSystem<Dim>::Part> system_parts;
  for (std::size_t b = 0; b < state.bodies.size(); ++b) {
    const Material<Dim>& material = state.material_of(b);
    if (!material.can_fracture()) continue;
    require_ability(material, MaterialAbility::split_energy, "effect.phase_field");
    FieldSet& f = state.bodies[b].particles;
    const ScalarType real = real_type(state.precision);
    BodyPart part;
    part.body = b;
    part.law.length = length;
    part.law.residual = residual_;
    part.law.inverse_mobility = mobility_ ? 1 / *mobility_ : 0;
    part.law.toughness = corrected_toughness(material.fracture_toughness(), spacing, part.law.length, crack_cost_);
    part.phase = f.add({.name = "phase", .units = "1", .type = real, .in_output = true, .initial = 1});
    if (operator_ == "matrix_free") {
      part.conductivity = f.add({.name = "phase_conductivity", .units = "m^5", .type = real});
      if (!lumped_) part.reaction = f.add({.name = "phase_reaction", .units = "m^3", .type = real});
    }
    // With cracks from the start the column is the floor of the driving energy that keeps them open on the grid.
    part.history = running_maximum_ || !cracks_.empty()
                       ? f.add({.name = "phase_history", .units = "J/m^3", .type = real})
                       : no_field;
    state.degradation[b] = {part.phase, residual_};
    part_of_body_[b] = static_cast<int>(parts_.size());
    system_parts.push_back({b, part.conductivity, part.reaction});
    parts_.push_back(part);
  }
  require(!parts_.empty(),
          "{}: effect.phase_field is on but no body can fracture; give a body's material a fracture_toughness, or take "
          "the effect out",
          where_);
  using Form = typename PhaseSystem<Dim>::Form;
  const Form form = operator_ == "matrix_free" ? Form::particles : operator_ == "stencil" ? Form::stencil : Form::matrix;
  // Without mobility and with the reaction at the particles, M_ii and r_i are the volume.
  using Sums = typename PhaseSystem<Dim>::Sums;
  const Sums sums = lumped_ ? Sums::all : mobility_ || by_increment_ || form == Form::particles ? Sums::with_phase : Sums::volume;
  using Entries = typename PhaseSystem<Dim>::Entries;
  const bool single_entries =
      form == Form::stencil && single_entries_suffice(solver_options_.relative_tolerance, length / spacing);
  system_ = std::make_unique<PhaseSystem<Dim>>(state, form, sums,
                                               single_entries ? Entries::single : Entries::as_run, solver_options_);
  system_->set_parts(std::move(system_parts), &active_);
}

template <int Dim>
void PhaseField<Dim>::initialise(State<Dim>& state) {
  std::vector<Real> particles(cracks_.size(), 0);
  with_precision(state.precision, [&](auto zero) {
    using T = decltype(zero);
    for (const BodyPart& part : parts_) {
      const FieldSet& f = state.bodies[part.body].particles;
      T* phase = f.template data<T>(part.phase);
      for (Index p = 0; p < f.size(); ++p) {
        Vec<Dim> x;
        for (int a = 0; a < Dim; ++a) x[a] = f.template data<Real>(core::position, a)[p];
        bool cracked = false;
        for (std::size_t n = 0; n < cracks_.size(); ++n)
          if (cracks_[n].shape.contains(x)) {
            cracked = true;
            ++particles[n];
          }
        phase[p] = cracked ? T(0) : T(1);
        if (cracked) f.template data<T>(part.history)[p] = static_cast<T>(part.law.energy_for(cracked_equilibrium));
      }
    }
  });
  state.communicator().sum(particles);
  for (std::size_t n = 0; n < cracks_.size(); ++n)
    require(particles[n] > 0,
            "{}: the crack holds no particle of a body that can fracture; make it at least {:.3g} m wide, move it onto the "
            "body, or refine grid.spacing",
            cracks_[n].where, state.geometry().spacing());
}

template <int Dim>
void PhaseField<Dim>::join(StepHooks<Dim>& hooks) {
  if (hooks.implicit) {
    hooks.staggered.push_back(staggered());
    return;
  }
  require(passes_ == 1,
          "{}: passes = {} needs time.integrator = \"implicit\" or \"quasi_static\"; an explicit step has one pass",
          where_, passes_);
  hooks.before_p2g.push_back([this](State<Dim>& s) { begin(s); });
  hooks.on_p2g.push_back([this](State<Dim>& s, std::size_t b, const std::vector<int>& r) { scatter(s, b, r); });
  hooks.on_grid.push_back([this](State<Dim>& s) { solve(s); });
  hooks.on_g2p.push_back([this](State<Dim>& s, std::size_t b, const std::vector<int>& r) { update(s, b, r); });
}

// What a particle gives to the system, from its present deformation and phase.
template <int Dim>
template <class T>
class PhaseField<Dim>::Source final : public ValueSource<T> {
 public:
  Source(const State<Dim>& state, const BodyPart& part, bool running_maximum, bool lumped)
      : material_(state.material_of(part.body)),
        law_(part.law),
        running_maximum_(running_maximum),
        lumped_(lumped) {
    const FieldSet& f = state.bodies[part.body].particles;
    columns_ = material_columns<T>(state, part.body);
    volume_ = f.template data<T>(core::volume);
    phase_ = f.template data<T>(part.phase);
    conductivity_ = part.conductivity == no_field ? nullptr : f.template data<T>(part.conductivity);
    reaction_ = part.reaction == no_field ? nullptr : f.template data<T>(part.reaction);
    history_ = part.history == no_field ? nullptr : f.template data<T>(part.history);
  }

  // Whether c of a particle in the range would differ from 1 by more than the threshold if it were homogeneous, or differs
  // already; the latter only matters if the equation knows of c^n.
  bool is_driven(const BlockRange& range, Real threshold, bool with_phase) const {
    const T low = with_phase ? static_cast<T>(1 - threshold) : T(0);
    alignas(64) T energy[chunk_particles];
    for (Index begin = range.begin; begin < range.end; begin += chunk_particles) {
      const Index end = std::min<Index>(begin + chunk_particles, range.end);
      driving_energy(begin, end, energy);
      T most = 0, least = 1;
      for (Index p = begin; p < end; ++p) {
        most = std::max(most, energy[p - begin]);
        least = std::min(least, phase_[p]);
      }
      if (law_.drive(static_cast<Real>(most)) > threshold || least < low) return true;
    }
    return false;
  }

  void values(Index begin, Index end, T* const* q, T* conductivity, T* reaction) override {
    using S = Pack<T>;
    using System = PhaseSystem<Dim>;
    T* energy = q[System::drive];
    driving_energy(begin, end, energy);
    for (Index p = begin; p < end; p += pack_width<T>) {
      const Index i = p - begin;
      Tensor<S, Dim> F;
      for (int c = 0; c < Dim * Dim; ++c) {
        F.m[c] = load<S>(columns_.F[c] + p);
        prefetch_next_chunk(columns_.F[c], p);
      }
      prefetch_next_chunk(volume_, p);
      prefetch_next_chunk(phase_, p);
      const S volume = determinant(F) * load<S>(volume_ + p), phase = load<S>(phase_ + p);
      const S k = volume * static_cast<T>(law_.conductivity());
      const S drive = volume * law_.drive(load<S>(energy + i));
      store(q[System::volume] + i, volume);
      store(q[System::phase] + i, S(volume * phase));
      store(q[System::drive] + i, drive);
      store(reaction + i, lumped_ ? S::Zero() : drive);
      if (reaction_) store(reaction_ + p, drive);
      store(conductivity + i, k);
      if (conductivity_) store(conductivity_ + p, k);
    }
  }

 private:
  void driving_energy(Index begin, Index end, T* energy) const {
    material_.energy_plus(columns_, begin, end, energy);
    if (history_)
      for (Index p = begin; p < end; ++p) energy[p - begin] = std::max(history_[p], energy[p - begin]);
    if (running_maximum_) std::copy(energy, energy + (end - begin), history_ + begin);
  }

  const Material<Dim>& material_;
  const PhaseLaw& law_;
  bool running_maximum_, lumped_;
  MaterialColumns<Dim, T> columns_;
  const T *volume_, *phase_;
  T *conductivity_, *reaction_, *history_;
};

template <int Dim>
void PhaseField<Dim>::begin(State<Dim>& state) {
  find_active(state);
  system_->begin(state, parts_.front().law.memory(state.dt));
}

template <int Dim>
void PhaseField<Dim>::find_active(State<Dim>& state) {
  with_precision(state.precision, [&](auto zero) {
    using T = decltype(zero);
    std::vector<typename ActiveSet<Dim>::Candidate> candidates;
    for (const BodyPart& part : parts_)
      candidates.push_back({part.body, [this, source = Source<T>(state, part, running_maximum_, lumped_)](
                                           const BlockRange& range) { return source.is_driven(range, active_.threshold(), mobility_ || by_increment_);
                                           }});
    active_.find(state, candidates, active_.reach(state.transfer.kernel, parts_.front().law.decay_length(state.dt) / state.geometry().spacing()));
  });
}

template <int Dim>
void PhaseField<Dim>::scatter(State<Dim>& state, std::size_t body, const std::vector<int>& ranges) {
  if (part_of_body_[body] < 0) return;
  auto s = state.timers.scope("phase sweep");
  with_precision(state.precision, [&](auto zero) {
    using T = decltype(zero);
    Source<T> source(state, parts_[part_of_body_[body]], running_maximum_, lumped_);
    system_->scatter(state, body, active_.select(state.bodies[body], ranges), source);
  });
}

template <int Dim>
void PhaseField<Dim>::solve(State<Dim>& state) {
  auto s = state.timers.scope("phase solve");
  if (system_->starts_from_values(state)) sum_phase(state);
  crack_energy_ = 0;
  crack_energy_known_ = state.observed && !by_increment_;
  const int iterations = system_->solve(state, by_increment_ ? PhaseSystem<Dim>::Result::increment : PhaseSystem<Dim>::Result::value);
  SolverWork& work = state.solvers["phase_field"];
  ++work.solves;
  work.iterations += iterations;
  work.unknowns += system_->unknowns();
  iterations_since_row_ += iterations;
}

namespace {

// c <- max(0, min(c, c + sum w (c^{n+1} - c^n))), or with sum w c^{n+1} as the second: what is broken doesn't heal.
template <class T, int Dim>
struct NoHealing final : ValueSink<T> {
  T* phase;
  const T* volume;
  T kept;           // 1 if the result is an increment, 0 if a value
  const PhaseLaw* law;
  Real energy = 0;  // of the cracks, if a gradient comes with the values
  void values(Index begin, Index end, const T* result, const T* const* gradient) override {
    for (Index p = begin; p < end; ++p)
      phase[p] = std::max(T(0), std::min(phase[p], kept * phase[p] + result[p - begin]));
    if (gradient) energy += law->template energy<Dim>(end - begin, volume + begin, phase + begin, gradient);
  }
};

}  // namespace

template <int Dim>
void PhaseField<Dim>::update(State<Dim>& state, std::size_t body, const std::vector<int>& ranges) {
  if (part_of_body_[body] < 0) return;
  auto s = state.timers.scope("phase gather");
  const ScalarGrid<Dim> grid{state.geometry(), state.topology()};
  with_precision(state.precision, [&](auto zero) {
    using T = decltype(zero);
    NoHealing<T, Dim> sink;
    const BodyPart& part = parts_[part_of_body_[body]];
    const FieldSet& f = state.bodies[body].particles;
    sink.phase = f.template data<T>(part.phase);
    sink.volume = f.template data<T>(core::volume);
    sink.kept = by_increment_ ? T(1) : T(0);
    sink.law = &part.law;
    const T* result = state.fields.template data<T>(system_->result());
    const std::vector<int> active = active_.select(state.bodies[body], ranges);
    with_kernel(state.transfer.kernel, [&](auto kernel) {
      if (crack_energy_known_) {
        gather_scalar<decltype(kernel)>(grid, state.bodies[body], active, result, sink);
      } else {
        gather_value<decltype(kernel)>(grid, state.bodies[body], active, result, sink);
      }
    });
    crack_energy_ += sink.energy;
  });
}

template <int Dim>
void PhaseField<Dim>::history(State<Dim>& state, std::vector<HistoryValue>& row) {
  const Real energy = crack_energy(state);
  Real broken_volume = 0, volume = 0, smallest = 1;
  with_precision(state.precision, [&](auto zero) {
    using T = decltype(zero);
    for (const BodyPart& part : parts_) {
      const FieldSet& f = state.bodies[part.body].particles;
      const T *V = f.template data<T>(core::volume), *c = f.template data<T>(part.phase);
      for (Index p = 0; p < f.size(); ++p) {
        volume += V[p];
        if (c[p] < static_cast<T>(broken)) broken_volume += V[p];
        smallest = std::min(smallest, static_cast<Real>(c[p]));
      }
    }
  });
  const Real total = state.communicator().sum(volume);
  const Real iterations = state.communicator().root() ? iterations_since_row_ : 0;
  row.push_back({"fracture_energy", "J", energy});
  row.push_back({"broken_fraction", "1", total > 0 ? broken_volume / total : 0});
  row.push_back({"min_phase", "1", smallest, HistoryValue::Kind::min});
  row.push_back({"krylov_iterations", "1", iterations});
  iterations_since_row_ = 0;
}

template <int Dim>
void PhaseField<Dim>::save(std::map<std::string, std::vector<Real>>& numbers) const {
  numbers["phase_field_iterations"] = {iterations_since_row_};
}

template <int Dim>
void PhaseField<Dim>::restore(const std::map<std::string, std::vector<Real>>& numbers) {
  if (const auto it = numbers.find("phase_field_iterations"); it != numbers.end()) iterations_since_row_ = it->second[0];
}

template class PhaseField<2>;
template class PhaseField<3>;

}  // namespace mpm
