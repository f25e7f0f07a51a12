// Phase-field fracture (PFF-MPM, physics.md section 5): a field c on the particles of bodies with a toughness, driven by
// the tensile energy, smoothed by a solve on the grid, and weakening the stress.
#pragma once

#include <memory>
#include <optional>

#include "mpm_hpc/base/parameters.hpp"
#include "mpm_hpc/effects/effect.hpp"
#include "mpm_hpc/effects/phase_field/active_set.hpp"
#include "mpm_hpc/effects/phase_field/crack_cost.hpp"
#include "mpm_hpc/effects/phase_field/phase_law.hpp"
#include "mpm_hpc/effects/phase_field/phase_system.hpp"
#include "mpm_hpc/math/shape.hpp"

namespace mpm {

template <int Dim>
class PhaseField final : public Effect<Dim> {
 public:
  explicit PhaseField(Parameters& p);

  std::string explain() const override;
  bool uses_toughness() const override { return true; }
  void declare_fields(State<Dim>& state) override;
  void initialise(State<Dim>& state) override;
  void join(StepHooks<Dim>& hooks) override;
  void history(State<Dim>& state, std::vector<HistoryValue>& row) override;
  void save(std::map<std::string, std::vector<Real>>& numbers) const override;
  void restore(const std::map<std::string, std::vector<Real>>& numbers) override;
  MemoryAccount memory() const override {
    MemoryAccount account = system_ ? system_->memory() : MemoryAccount();
    account.emplace_back("phase_field/active set", active_.allocated_bytes());
    return account;
  }

 private:
  // What the effect knows of a body that can fracture.
  struct BodyPart {
    std::size_t body;
    PhaseLaw law;
    FieldId phase, conductivity = no_field, reaction = no_field;
    FieldId history = no_field;  // lower bound of the driving energy
  };
  template <class T>
  class Source;
  template <class T>
  class PhaseOnly;

  StaggeredField<Dim> staggered();
  void pass(State<Dim>& state);
  void begin(State<Dim>& state);
  void find_active(State<Dim>& state);
  void scatter(State<Dim>& state, std::size_t body, const std::vector<int>& ranges);
  void solve(State<Dim>& state);
  void update(State<Dim>& state, std::size_t body, const std::vector<int>& ranges);
  void sum_phase(State<Dim>& state);
  Real crack_energy(State<Dim>& state);
  Real projected_crack_energy(State<Dim>& state);

  std::optional<Real> length_;  // l0 [m]; default h / 2
  std::optional<Real> mobility_;  // M_c [1/s]; none: rate-independent
  Real residual_ = 1e-3;
  bool running_maximum_ = false, corrected_ = true, lumped_ = false, by_increment_ = false;
  CrackShape crack_shape_ = CrackShape::profile;
  Real crack_cost_ = 0;  // k
  int passes_ = 1;  // of implicit steps
  Real pass_tolerance_ = 1e-3;
  std::string operator_ = "auto";
  LinearSolverOptions solver_options_;
  ActiveSet<Dim> active_{0};
  struct Crack {
    std::string where;  // in the scene file
    Shape<Dim> shape;
  };
  std::vector<Crack> cracks_;
  std::string where_;

  std::vector<BodyPart> parts_;
  std::vector<int> part_of_body_;  // -1: can't fracture
  std::unique_ptr<PhaseSystem<Dim>> system_;
  Real iterations_since_row_ = 0;
  // Of this rank's cracks after the last step, if the step was observed.
  Real crack_energy_ = 0;
  bool crack_energy_known_ = false;
};

}  // namespace mpm
