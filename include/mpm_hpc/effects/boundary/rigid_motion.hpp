// Prescribed motion of a rigid shape as a function of time.
#pragma once

#include <string>

#include "mpm_hpc/effects/boundary/ramp.hpp"
#include "mpm_hpc/math/shape.hpp"

namespace mpm {

// Where a shape stands: X -> rotation X + offset maps its points as the scene gives them to their present
// place.
template <int Dim>
struct Pose {
  Mat<Dim> rotation = Mat<Dim>::Identity();
  Vec<Dim> offset = Vec<Dim>::Zero();

  Vec<Dim> to_shape(const Vec<Dim>& x) const { return rotation.transpose() * (x - offset); }
  Vec<Dim> from_shape(const Vec<Dim>& x) const { return rotation * x + offset; }
};

// The motion during one time step: the pose at its start and the mean velocity over it.
template <int Dim>
struct RigidStep {
  Pose<Dim> pose;
  Vec<Dim> linear = Vec<Dim>::Zero();  // velocity of the centre [m/s]
  Mat<Dim> spin = Mat<Dim>::Zero();    // spin * r = angular velocity x r
  Vec<Dim> center = Vec<Dim>::Zero();  // its present place

  Vec<Dim> velocity_at(const Vec<Dim>& x) const { return linear + spin * (x - center); }
};

// Constant velocity of a centre and constant angular velocity about it, both times the factor of a ramp.
template <int Dim>
class RigidMotion {
 public:
  struct Options {
    Vec<Dim> velocity = Vec<Dim>::Zero();      // [m/s]
    Vec<3> angular_velocity = Vec<3>::Zero();  // [rad/s]; in 2D only its z component counts
    Vec<Dim> center = Vec<Dim>::Zero();        // at rest [m]
    Ramp ramp;
  };

  RigidMotion() = default;
  explicit RigidMotion(const Options& options);

  // Reads velocity, angular_velocity (a number in 2D), center (default: the middle of the shape's bounding
  // box) and the ramp. Throws UserError for a rotation of an unbounded shape without a centre.
  static RigidMotion read(Parameters& p, const Shape<Dim>& shape);

  const Options& options() const { return options_; }
  bool at_rest() const { return options_.velocity.isZero(0) && angular_speed_ == 0; }

  Pose<Dim> pose(Real t) const;
  // The mean velocity takes the centre exactly from the pose at t to that at t + dt; for dt = 0 it is the
  // velocity at t.
  RigidStep<Dim> step(Real t, Real dt) const;

  // "at rest" or its velocities, for --explain.
  std::string describe() const;

 private:
  Options options_;
  Real angular_speed_ = 0;            // [rad/s], signed in 2D
  Mat<Dim> spin_ = Mat<Dim>::Zero();  // at full speed [1/s]
};

}  // namespace mpm
