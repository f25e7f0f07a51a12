#include "mpm_hpc/effects/boundary/rigid_motion.hpp"

#include <fmt/format.h>

namespace mpm {

template <int Dim>
RigidMotion<Dim>::RigidMotion(const Options& options) : options_(options) {
  const Vec<3>& w = options.angular_velocity;
  if constexpr (Dim == 2) {
    angular_speed_ = w[2];
    spin_ << 0, -w[2], w[2], 0;
  } else {
    angular_speed_ = w.norm();
    spin_ << 0, -w[2], w[1], w[2], 0, -w[0], -w[1], w[0], 0;
  }
}

template <int Dim>
RigidMotion<Dim> RigidMotion<Dim>::read(Parameters& p, const Shape<Dim>& shape) {
  Options options;
  p.vector<Dim>("velocity", options.velocity, {.unit = "m/s", .doc = "Of the centre."});
  RealOptions rotation{.unit = "rad/s", .doc = "About the centre, counter-clockwise."};
  if constexpr (Dim == 2) {
    p.real("angular_velocity", options.angular_velocity[2], rotation);
  } else {
    rotation.doc = "About the centre, right-handed.";
    p.vector<3>("angular_velocity", options.angular_velocity, rotation);
  }
  const bool given = p.vector<Dim>("center", options.center,
                                   {.unit = "m", .doc = "Default: the middle of the shape's bounding box."});
  options.ramp = Ramp::read(p);
  if (!given && shape) {
    const BoundingBox<Dim> bounds = shape.bounds();
    if (bounds.is_finite() && !bounds.is_empty()) {
      options.center = 0.5 * (bounds.lower + bounds.upper);
    } else if (!options.angular_velocity.isZero(0)) {
      p.error_at("angular_velocity",
                 "the shape is unbounded and has no middle to turn about; give center = [...].");
    }
  }
  return RigidMotion(options);
}

template <int Dim>
Pose<Dim> RigidMotion<Dim>::pose(Real t) const {
  Pose<Dim> pose;
  if (at_rest()) return pose;
  const Real progress = options_.ramp.progress(t);
  pose.offset = progress * options_.velocity;
  if (angular_speed_ != 0) {
    // The axis is of no account in 2D.
    pose.rotation = rotation_matrix<Dim>(angular_speed_ * progress, options_.angular_velocity);
    pose.offset += options_.center - pose.rotation * options_.center;
  }
  return pose;
}

template <int Dim>
RigidStep<Dim> RigidMotion<Dim>::step(Real t, Real dt) const {
  const Real factor = options_.ramp.mean(t, dt);
  const Pose<Dim> now = pose(t);
  return {now, factor * options_.velocity, factor * spin_, now.from_shape(options_.center)};
}

template <int Dim>
std::string RigidMotion<Dim>::describe() const {
  if (at_rest()) return "at rest";
  std::string text = fmt::format("moving with {:.6g} m/s", options_.velocity.norm());
  if (angular_speed_ != 0) text += fmt::format(" and turning with {:.6g} rad/s", angular_speed_);
  return text;
}

template class RigidMotion<2>;
template class RigidMotion<3>;

}  // namespace mpm
