// A rigid body, at rest or in prescribed motion, that the material can't enter.
#pragma once

#include "mpm_hpc/effects/boundary/contact.hpp"
#include "mpm_hpc/effects/boundary/reaction.hpp"
#include "mpm_hpc/effects/boundary/rigid_motion.hpp"

namespace mpm {

// The contact condition holds for the velocity relative to the obstacle, on the nodes inside the shape in its
// pose at the start of the step.
template <int Dim>
class Obstacle final : public Effect<Dim> {
 public:
  explicit Obstacle(Parameters& p);

  std::string explain() const override;
  void declare_fields(State<Dim>& state) override;
  void join(StepHooks<Dim>& hooks) override;
  void history(State<Dim>& state, std::vector<HistoryValue>& row) override { reaction_.history(state, row); }
  void save(std::map<std::string, std::vector<Real>>& numbers) const override { reaction_.save(numbers); }
  void restore(const std::map<std::string, std::vector<Real>>& numbers) override {
    reaction_.restore(numbers);
  }
  MemoryAccount memory() const override { return reaction_.memory(); }

 private:
  void act(State<Dim>& state);
  template <class F>
  void for_touched(State<Dim>& state, F&& f) const;

  Reaction<Dim> reaction_;
  Shape<Dim> shape_;
  Contact contact_;
  RigidMotion<Dim> motion_;
};

}  // namespace mpm
