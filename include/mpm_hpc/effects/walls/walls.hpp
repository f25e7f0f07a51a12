// Contact conditions on the sides of the domain.
#pragma once

#include <array>
#include <optional>

#include "mpm_hpc/effects/boundary/contact.hpp"
#include "mpm_hpc/effects/boundary/reaction.hpp"
#include "mpm_hpc/effects/walls/mirrors.hpp"

namespace mpm {

// Slip and sticky sides are mirrors: the particles behave as if there were others beyond, moving as their images, so that the
// velocity is linear up to the side and vanishes there by interpolation. The nodes beyond and their images inside get the
// common velocity that keeps the momentum of this motion, before obstacles and grips act on them; after those the nodes beyond
// follow once more, so that nothing takes the material off its wall.
//
// A side that isn't a mirror acts on the nodes on and beyond its plane, and comes last: one whose plane doesn't map nodes to
// nodes, of first order in the spacing, and `separate`, whose material is free to leave. A mirror would have to know of a
// column of nodes along the normal whether the wall pushes or would pull; by single nodes, contact would be open on some of
// the column and closed on others. Where sides meet, those that aren't mirrors act one after the other in the order x_min,
// x_max, y_min, ...
//
// Friction takes from the tangential momentum of a node and its images at most the coefficient times the normal impulse that the
// wall gave them in the step; over a column of nodes these impulses add up to that of the wall.
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
  MemoryAccount memory() const override {
    MemoryAccount account = reaction_.memory();
    account.emplace_back("walls/mirrored nodes", mirrors_.allocated_bytes());
    return account;
  }

 private:
  template <class T, class Acts, class F>
  void for_nodes_beyond(const State<Dim>& state, Acts&& acts, F&& f) const;
  void constrain(State<Dim>& state, NodeConstraints<Dim>& constraints);
  using Member = typename Mirrors<Dim>::Member;
  using Group = typename Mirrors<Dim>::Group;
  void find_mirrors(const GridGeometry<Dim>& grid);
  void reflect(State<Dim>& state);
  template <class T>
  Vec<Dim> mean(const Group& group, const T* masses, const T* velocities) const;
  template <class T>
  Vec<Dim> rubbed(const Group& group, const T* nodes, Vec<Dim> velocity) const;
  template <class T>
  void give(const Group& group, const T* masses, T* velocities, const Vec<Dim>& velocity, Real factor = 1);
  void finish(State<Dim>& state);
  template <class T>
  void touch(State<Dim>& state);
  template <class T>
  void follow(State<Dim>& state);

  std::array<std::optional<Contact>, 2 * Dim> sides_;  // x_min, x_max, y_min, ...
  std::array<std::string, 2 * Dim> where_;             // their places in the scene
  Mirrors<Dim> mirrors_;
  std::array<std::int32_t, 2 * Dim> limit_{};  // the first node on or beyond each plane, counted outwards
  Reaction<Dim> reaction_;
};

}  // namespace mpm
