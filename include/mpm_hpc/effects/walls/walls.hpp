// Contact conditions on the sides of the domain.
#pragma once

#include <array>
#include <optional>

#include "mpm_hpc/effects/boundary/contact.hpp"
#include "mpm_hpc/effects/boundary/reaction.hpp"

namespace mpm {

// Acts on the nodes on and beyond each side's plane; where sides meet, one after the other in the order
// x_min, x_max, y_min, ...
template <int Dim>
class Walls final : public Effect<Dim> {
 public:
  explicit Walls(Parameters& p);

  std::string explain() const override;
  void declare_fields(State<Dim>& state) override;
  void join(StepHooks<Dim>& hooks) override;
  void history(State<Dim>& state, std::vector<HistoryValue>& row) override { reaction_.history(state, row); }
  void save(std::map<std::string, std::vector<Real>>& numbers) const override { reaction_.save(numbers); }
  void restore(const std::map<std::string, std::vector<Real>>& numbers) override {
    reaction_.restore(numbers);
  }

 private:
  void act(State<Dim>& state);
  void constrain(State<Dim>& state, NodeConstraints<Dim>& constraints);

  std::array<std::optional<Contact>, 2 * Dim> sides_;  // x_min, x_max, y_min, ...
  std::array<std::string, 2 * Dim> where_;             // their places in the scene
  Reaction<Dim> reaction_;
};

}  // namespace mpm
