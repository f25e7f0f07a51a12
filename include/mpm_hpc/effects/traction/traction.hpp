// Force per area on a loaded surface, carried by the layer of particles beneath it.
#pragma once

#include "mpm_hpc/effects/boundary/ramp.hpp"
#include "mpm_hpc/effects/effect.hpp"
#include "mpm_hpc/math/shape.hpp"

namespace mpm {

// A dead load: the particles that lie in a region at the start share the force traction * area in proportion
// to their initial volume, for all times and in a fixed direction. Sharing a given area, rather than dividing
// by a given layer thickness, makes the total force exact whatever the sampling.
template <int Dim>
class Traction final : public Effect<Dim> {
 public:
  explicit Traction(Parameters& p);

  std::string explain() const override;
  void declare_fields(State<Dim>& state) override;
  void initialise(State<Dim>& state) override;
  void join(StepHooks<Dim>& hooks) override;
  void save(std::map<std::string, std::vector<Real>>& numbers) const override;
  void restore(const std::map<std::string, std::vector<Real>>& numbers) override;

 private:
  void measure(State<Dim>& state);
  void load(State<Dim>& state);
  void account(State<Dim>& state);
  template <class F>
  void for_loaded(State<Dim>& state, F&& f) const;

  std::string name_;  // of its particle column: 1 for particles that carry the load, 0 for others
  std::string where_shape_, where_bodies_;
  Shape<Dim> shape_;
  std::vector<std::string> body_names_;   // empty: all
  Vec<Dim> traction_ = Vec<Dim>::Zero();  // [Pa]
  Real area_ = 0;                         // [m^2]; in 2D per unit of depth, [m]
  Ramp ramp_;
  std::vector<FieldId> marks_;  // by body
  Real volume_ = 0;             // initial, of the loaded layer [m^3]; 0 until measured
};

}  // namespace mpm
