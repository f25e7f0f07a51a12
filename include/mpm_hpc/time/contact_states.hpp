// Which contacts of an implicit step are closed, and whether they stick: found by solving again until nothing changes.
#pragma once

#include "mpm_hpc/effects/boundary/constraints.hpp"
#include "mpm_hpc/effects/boundary/reaction.hpp"
#include "mpm_hpc/time/implicit_system.hpp"

namespace mpm {

// Each demand of a boundary on a node is open, slides or sticks. Separating surfaces push and never pull; with friction a
// contact sticks while the tangential impulse is less than the coefficient times the normal one, and else slides against this
// impulse, whose size is that of the solve before (a lagged Coulomb law).
template <int Dim>
class ContactStates {
 public:
  // The states to begin with: closed where the material approaches; with friction sliding without it in motion, sticking in
  // equilibrium.
  void begin(const std::vector<NodeConstraint<Dim>>& constraints, const ImplicitSystem<Dim>& system,
             bool inertia);
  // Tells the system what holds, and the friction of those that slide.
  void apply(ImplicitSystem<Dim>& system) const;
  // Looks at the solution; returns how many states changed on this rank. Late passes let no sliding contact stick any more,
  // so that the states come to rest.
  GlobalIndex update(const ImplicitSystem<Dim>& system, const Communicator& communicator, int pass);
  // What each boundary gave to this rank's nodes, in the order of `reactions`. Work is impulse times the velocity at the end.
  std::vector<Exchange<Dim>> exchanges(const ImplicitSystem<Dim>& system,
                                       const std::vector<Reaction<Dim>*>& reactions) const;

 private:
  enum class Motion { open, slides, sticks };
  struct Touch {
    NodeConstraint<Dim> demand;
    int row;
    Motion motion;
    Vec<Dim> friction = Vec<Dim>::Zero();  // impulse while it slides [N s]
  };
  // Contacts of one node stand together.
  template <class F>
  void for_nodes(F&& f) const;
  // Orthonormal directions that the contacts [first, last) of a node hold, and how many each holds with those before it.
  struct Held {
    Mat<Dim> basis = Mat<Dim>::Zero();
    int count = 0;
    Vec<Dim> velocity = Vec<Dim>::Zero();
    std::array<int, Dim> owner{};  // contact of each direction
  };
  Held held(std::size_t first, std::size_t last) const;

  std::vector<Touch> contacts_;
};

}  // namespace mpm
