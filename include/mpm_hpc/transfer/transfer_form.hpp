// What a scene can choose about the transfers: the kernel, how velocities pass between particles and grid, and the form of
// the stress's forces.
#pragma once

#include <string>
#include <vector>

#include "mpm_hpc/base/types.hpp"
#include "mpm_hpc/math/bspline.hpp"

namespace mpm {

// What a particle keeps of the grid's velocity around it (physics.md section 1).
enum class Scheme {
  pic,     // its mean: v_p = sum_i w_ip v_i
  rpic,    // and the skew part of its gradient (Jiang et al. 2015)
  flip,    // its own velocity, plus the mean of the grid's changes, blended with PIC (Brackbill and Ruppel 1986)
  apic,    // its mean and gradient (Jiang et al. 2015)
  polypic  // and the products of the directions: the 2^Dim multilinear modes (Fu et al. 2017)
};

// Whether particles carry a velocity gradient from step to step.
constexpr bool is_affine(Scheme scheme) {
  return scheme == Scheme::apic || scheme == Scheme::rpic || scheme == Scheme::polypic;
}
// Whether the grid keeps the change of its velocities.
constexpr bool has_increments(Scheme scheme) { return scheme == Scheme::flip; }

enum class Forces {
  mls,       // f_i = -sum_p V0_p tau_p D_p^-1 w_ip (x_i - x_p), grad v_p = D_p^-1 sum_i w_ip v_i (x_i - x_p)^T
  classical  // f_i = -sum_p V0_p tau_p grad w_ip, grad v_p = sum_i v_i grad w_ip^T
};

// Their names in scenes, in the order of the enumerations.
inline const std::vector<std::string> kernel_names = {"linear", "quadratic", "cubic"};
inline const std::vector<std::string> scheme_names = {"pic", "rpic", "flip", "apic", "polypic"};
inline const std::vector<std::string> forces_names = {"mls", "classical"};

struct TransferOptions {
  KernelKind kernel = KernelKind::quadratic;
  Scheme scheme = Scheme::apic;
  Forces forces = Forces::mls;
  Real flip_blend = 0.99;  // a of v_p = a (v_p + sum_i w_ip (v_i - v_i^old)) + (1 - a) sum_i w_ip v_i

  const std::string& kernel_name() const { return kernel_names[static_cast<int>(kernel)]; }
  const std::string& scheme_name() const { return scheme_names[static_cast<int>(scheme)]; }
  const std::string& forces_name() const { return forces_names[static_cast<int>(forces)]; }
  bool affine() const { return is_affine(scheme); }
  bool increments() const { return has_increments(scheme); }
};

// Why this combination makes no sense and what does; empty if it is defined.
std::string why_undefined(const TransferOptions& options);

// The same, known to the compiler.
template <Scheme scheme_, Forces forces_>
struct TransferForm {
  static constexpr Scheme scheme = scheme_;
  static constexpr Forces forces = forces_;
  static constexpr bool affine = is_affine(scheme);
  static constexpr bool increments = has_increments(scheme);
  static constexpr bool modes = scheme == Scheme::polypic;
  static constexpr bool mls = forces == Forces::mls, classical = forces == Forces::classical;
};
using ApicMls = TransferForm<Scheme::apic, Forces::mls>;

// Products of two or more directions: xy, or xy, xz, yz, xyz.
template <int Dim>
inline constexpr int product_modes = Dim == 2 ? 1 : 4;

// k of the bound 2 h / sqrt(k lambda_max(A) / rho0) of a step in which a particle alone in its cell is stable. Without a
// gradient of its own it swings about half as wide a base: the bound is smaller by sqrt 2 (physics.md section 6).
inline Real isolated_stiffness(const TransferOptions& options) {
  return with_kernel(options.kernel, [&](auto kernel) {
    using Kernel = decltype(kernel);
    Real k = Kernel::gradient_stiffness;
    if constexpr (Kernel::has_inertia)
      if (options.forces == Forces::mls) k = Kernel::inverse_inertia;
    return options.affine() ? k : 2 * k;
  });
}

}  // namespace mpm
