// A force on all material, given by formulas of place and time.
#pragma once

#include "mpm_hpc/effects/effect.hpp"
#include "mpm_hpc/math/formula.hpp"

namespace mpm {

// Acts at the particles, dv_p = dt b(x_p, t, X_p), with b in x, y, z (the present place), t, and X, Y, Z (the place at the
// start), so that it may follow the material, as in manufactured solutions. Particles carry their place at the start only
// if a formula uses it.
template <int Dim>
class BodyForce final : public Effect<Dim> {
 public:
  explicit BodyForce(Parameters& p);

  std::string explain() const override;
  void declare_fields(State<Dim>& state) override;
  void initialise(State<Dim>& state) override;
  void join(StepHooks<Dim>& hooks) override;
  MemoryAccount memory() const override;

 private:
  // The formulas': the present place, t, and the place at the start.
  static constexpr int variables = 2 * Dim + 1;

  template <class F>
  void for_particles(State<Dim>& state, F&& f) const;
  void load(State<Dim>& state);
  void account(State<Dim>& state);

  Formulas acceleration_;  // [m/s^2]
  bool uses_start_ = false;
  bool at_end_ = false;  // of a step: backward Euler and equilibria take the load there
  std::string where_, where_bodies_;
  std::vector<std::string> body_names_;  // empty: all
  std::vector<char> loaded_;             // by body
  std::vector<FieldId> start_;           // column of X by body
  std::vector<Vec<Dim>> impulses_;       // of the step under way, in the order of for_particles() [N s]
};

}  // namespace mpm
