// A region whose material moves with a prescribed velocity: clamps and loading grips.
#pragma once

#include <array>

#include "mpm_hpc/effects/boundary/reaction.hpp"
#include "mpm_hpc/effects/boundary/rigid_motion.hpp"

namespace mpm {

// The region moves along with its velocity; only the chosen components of the nodes' velocity are prescribed.
template <int Dim>
class Grip final : public Effect<Dim> {
 public:
  explicit Grip(Parameters& p);

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

  Reaction<Dim> reaction_;
  Shape<Dim> shape_;
  RigidMotion<Dim> motion_;
  std::array<bool, Dim> prescribed_;
};

}  // namespace mpm
