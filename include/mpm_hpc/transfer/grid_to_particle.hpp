// G2P: velocity and its gradient from the nodes to the particles, and their motion.
#pragma once

#include "mpm_hpc/transfer/particle_to_grid.hpp"

namespace mpm {

// Maxima over a run of particles after G2P.
struct KinematicLimits {
  Real speed = 0;            // |v| [m/s]
  Real speed_component = 0;  // max_a |v_a| [m/s]; bounds the drift
  Real gradient = 0;         // max absolute row sum of C [1/s]
  Real acceleration = 0;     // |v_new - v_old| / dt [m/s^2]

  void include(const KinematicLimits& other) {
    speed = std::max(speed, other.speed);
    speed_component = std::max(speed_component, other.speed_component);
    gradient = std::max(gradient, other.gradient);
    acceleration = std::max(acceleration, other.acceleration);
  }
};

// Learns of each chunk after its particles have moved, while they are still in cache: deforms them, collects step limits.
template <int Dim, class T>
class UpdateSink {
 public:
  virtual ~UpdateSink() = default;
  // gradient[a * Dim + b][p - begin] = d v_a / d x_b [1/s] at the particles; aligned to a cache line.
  virtual void updated(Index begin, Index end, const KinematicLimits& limits, const T* const* gradient) = 0;
};

// For each particle of the given ranges what the form says (transfer_form.hpp; physics.md section 1): for APIC and MLS
// v_p = sum_i w_ip v_i, C_p = D_p^-1 sum_i w_ip v_i (x_i - x_p)^T. In all of them x_p <- x_p + dt sum_i w_ip v_i. What the
// gradient does to the deformation is the sink's.
template <class Kernel, class Form = ApicMls, int Dim, class T>
void grid_to_particle(const TransferGrid<Dim, T>& grid, Body<Dim>& body, const std::vector<int>& ranges, Real dt,
                      UpdateSink<Dim, T>& sink);

}  // namespace mpm
