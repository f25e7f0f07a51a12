// The pair of transfers that a scene has chosen.
#pragma once

#include "mpm_hpc/transfer/grid_to_particle.hpp"

namespace mpm {

template <int Dim, class T>
struct TransferKernels {
  void (*to_grid)(const TransferGrid<Dim, T>&, const Body<Dim>&, const std::vector<int>& ranges,
                  const StressSource<Dim, T>&, Real dt);
  void (*to_particles)(const TransferGrid<Dim, T>&, Body<Dim>&, const std::vector<int>& ranges, Real dt,
                       UpdateSink<Dim, T>&);
};

// Throws LogicError for a combination that why_undefined() refuses.
template <int Dim, class T>
TransferKernels<Dim, T> transfer_kernels(const TransferOptions& options);

}  // namespace mpm
