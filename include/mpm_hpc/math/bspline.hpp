// B-spline kernels of the transfer (physics.md section 1): weights and gradients of the nodes of one stencil in one
// direction, for numbers and packs.
#pragma once

#include "mpm_hpc/math/row.hpp"
#include "mpm_hpc/math/simd.hpp"

namespace mpm {

enum class KernelKind { linear, quadratic, cubic };

// fx is the distance of the particle from the first node of its stencil, in grid spacings; that node is
// floor(xi - shift). inverse_inertia is h^2 D_p^-1, where D_p = sum_i w_ip (x_i - x_p)(x_i - x_p)^T is isotropic; inertia
// is its diagonal over h^2 in one direction, for any place. gradient_stiffness is the largest sum_i (h w_i')^2 / w_i over
// all places: what inverse_inertia is to MLS forces, it is to those of grad w (the linear kernel has no bound next to a
// node; 4 is its value in the middle of a cell).
struct LinearKernel {
  static constexpr const char* name = "linear";
  static constexpr int support = 2;
  static constexpr double shift = 0;
  static constexpr bool has_inertia = false;  // D_p depends on the position and vanishes on nodes
  static constexpr double gradient_stiffness = 4;

  template <class S>
  static S inertia(const S& fx) {
    return fx * (broadcast<S>(1.0) - fx);
  }
  // A particle on a node has a slope with the next node, which it gives no weight: at the edge of a body that node would have
  // neither mass nor velocity, and particles would deform as if it stood still. So it gets a trace, less than a rounding error,
  // whose momentum over its mass is the particle's velocity.
  static constexpr double trace = 0x1p-60;
  template <class S>
  static void weights(const S& fx, S* w) {
    w[0] = broadcast<S>(1.0) - fx;
    w[1] = fx + broadcast<S>(trace);
  }
  // Derivatives by fx; divide by h for grad w.
  template <class S>
  static void gradients(const S&, S* g) {
    g[0] = broadcast<S>(-1.0);
    g[1] = broadcast<S>(1.0);
  }
};

struct QuadraticKernel {
  static constexpr const char* name = "quadratic";
  static constexpr int support = 3;
  static constexpr double shift = 0.5;
  static constexpr bool has_inertia = true;
  static constexpr double inverse_inertia = 4;
  static constexpr double gradient_stiffness = 6;

  template <class S>
  static S inertia(const S&) {
    return broadcast<S>(1 / inverse_inertia);
  }
  template <class S>
  static void weights(const S& fx, S* w) {
    const S a = broadcast<S>(1.5) - fx, b = fx - broadcast<S>(1.0), c = fx - broadcast<S>(0.5);
    w[0] = broadcast<S>(0.5) * a * a;
    w[1] = broadcast<S>(0.75) - b * b;
    w[2] = broadcast<S>(0.5) * c * c;
  }
  // The weights of one particle in one register, a 0 behind them.
  template <class T>
  static Quad<T> weight_quad(T fx) {
    const Quad<T> d = fx - Quad<T>{1.5, 1, 0.5, 0};
    return Quad<T>{0, 0.75, 0, 0} + Quad<T>{0.5, -1, 0.5, 0} * d * d;
  }
  template <class S>
  static void gradients(const S& fx, S* g) {
    g[0] = fx - broadcast<S>(1.5);
    g[1] = broadcast<S>(2.0) - broadcast<S>(2.0) * fx;
    g[2] = fx - broadcast<S>(0.5);
  }
};

struct CubicKernel {
  static constexpr const char* name = "cubic";
  static constexpr int support = 4;
  static constexpr double shift = 1;
  static constexpr bool has_inertia = true;
  static constexpr double inverse_inertia = 3;
  static constexpr double gradient_stiffness = 3.2;

  template <class S>
  static S inertia(const S&) {
    return broadcast<S>(1 / inverse_inertia);
  }
  template <class S>
  static void weights(const S& fx, S* w) {
    const S one = broadcast<S>(1.0), two = broadcast<S>(2.0), sixth = broadcast<S>(1.0 / 6);
    const S a = two - fx, b = fx - one;  // distances from nodes 0 (outer side) and 1
    const S c = two - fx, d = fx - one;
    w[0] = sixth * a * a * a;
    w[1] = broadcast<S>(2.0 / 3) - b * b + broadcast<S>(0.5) * b * b * b;
    w[2] = broadcast<S>(2.0 / 3) - c * c + broadcast<S>(0.5) * c * c * c;
    w[3] = sixth * d * d * d;
  }
  template <class S>
  static void gradients(const S& fx, S* g) {
    const S b = fx - broadcast<S>(1.0), c = broadcast<S>(2.0) - fx, half = broadcast<S>(0.5);
    g[0] = -half * c * c;
    g[1] = broadcast<S>(1.5) * b * b - broadcast<S>(2.0) * b;
    g[2] = broadcast<S>(2.0) * c - broadcast<S>(1.5) * c * c;
    g[3] = half * b * b;
  }
};

// Gradients per spacing of the scalar fields that effects solve for: scale times slopes, whose sum over the nodes is 0.
template <class Kernel>
struct ScalarSlopes {
  // h D_p^-1 w_n (x_n - x_p) = scale w_n d_n with d_n the distance to node n in spacings; where D_p is singular on nodes, the
  // weights' derivatives, which are the same numbers between nodes.
  static constexpr double scale = [] {
    if constexpr (Kernel::has_inertia) {
      return Kernel::inverse_inertia;
    } else {
      return 1.0;
    }
  }();

  // From the weights w and centre = 1 - fx.
  template <class Scalar, class S>
  static void of(const S& centre, const S* w, S* g) {
    if constexpr (Kernel::has_inertia) {
      for (int n = 0; n < Kernel::support; ++n) g[n] = w[n] * (centre + static_cast<Scalar>(n - 1));
    } else {
      Kernel::gradients(S(static_cast<Scalar>(1) - centre), g);
    }
  }
};

// f(LinearKernel()), f(QuadraticKernel()) or f(CubicKernel()).
template <class F>
decltype(auto) with_kernel(KernelKind kind, F&& f) {
  switch (kind) {
    case KernelKind::linear: return f(LinearKernel());
    case KernelKind::cubic: return f(CubicKernel());
    default: return f(QuadraticKernel());
  }
}

}  // namespace mpm
