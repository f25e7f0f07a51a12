// The blocks where the phase field has to be solved: those whose particles are driven or damaged, and their surroundings.
#pragma once

#include <functional>
#include <vector>

#include "mpm_hpc/effects/state.hpp"
#include "mpm_hpc/math/bspline.hpp"

namespace mpm {

// Elsewhere c stays as it is, 1 but for less than the tolerance: what drives it there is below half of the tolerance, and
// what reaches it from the blocks that are solved has decayed to the other half.
template <int Dim>
class ActiveSet {
 public:
  // Largest error of c. 0: all blocks are active.
  explicit ActiveSet(Real tolerance) : tolerance_(tolerance) {}

  Real threshold() const { return tolerance_ / 2; }
  // Cells that a disturbance of c takes to decay to the threshold, by the decay length L_s over the grid spacing
  // (verification.md section 9: L_s = 2 l0 sqrt(M_c dt / (1 + M_c dt))).
  int reach(KernelKind kernel, Real decay_length) const;

  // Asks `is_driven(range)` of the ranges of the given bodies until a block is known to be active, and adds all
  // blocks within `reach` cells. Collective.
  using IsDriven = std::function<bool(const BlockRange&)>;
  struct Candidate {
    std::size_t body;
    IsDriven is_driven;
  };
  void find(State<Dim>& state, const std::vector<Candidate>& candidates, int reach);

  // Those of a body's ranges that lie in active blocks.
  std::vector<int> select(const Body<Dim>& body, const std::vector<int>& ranges) const;

  std::size_t allocated_bytes() const {
    return active_.capacity() + wider_.capacity() + occupied_.capacity();
  }

 private:
  Real tolerance_;
  std::vector<char> active_, wider_, occupied_;  // by slot
};

}  // namespace mpm
