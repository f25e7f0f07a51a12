// Picks the P2G and G2P of a B-spline, and instantiates them.
#pragma once

#include "grid_to_particle_impl.hpp"
#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/transfer/transfer_kernels.hpp"
#include "particle_to_grid_impl.hpp"

namespace mpm {

template <class Kernel, int Dim, class T>
TransferKernels<Dim, T> kernels_of(const TransferOptions& options) {
  const auto of_form = []<class Form>(Form) -> TransferKernels<Dim, T> {
    if constexpr (Kernel::has_inertia || (Form::classical && !Form::modes)) {
      return {&particle_to_grid<Kernel, Form, Dim, T>, &grid_to_particle<Kernel, Form, Dim, T>};
    } else {
      throw LogicError("these transfers don't exist for this kernel");
    }
  };
  const auto of_scheme = [&]<Scheme scheme>() {
    return options.forces == Forces::mls ? of_form(TransferForm<scheme, Forces::mls>())
                                         : of_form(TransferForm<scheme, Forces::classical>());
  };
  switch (options.scheme) {
    case Scheme::pic: return of_scheme.template operator()<Scheme::pic>();
    case Scheme::rpic: return of_scheme.template operator()<Scheme::rpic>();
    case Scheme::flip: return of_scheme.template operator()<Scheme::flip>();
    case Scheme::polypic: return of_scheme.template operator()<Scheme::polypic>();
    default: return of_scheme.template operator()<Scheme::apic>();
  }
}

}  // namespace mpm
