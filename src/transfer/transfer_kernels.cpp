#include "mpm_hpc/transfer/transfer_kernels.hpp"

#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/transfer/lanes.hpp"

namespace mpm {

// In a source file per kernel.
template <class Kernel, int Dim, class T>
TransferKernels<Dim, T> kernels_of(const TransferOptions& options);

void throw_drifted_out() {
  throw LogicError("a particle drifted out of its block's tile: the particles were not sorted in time");
}

std::string why_undefined(const TransferOptions& options) {
  if (options.kernel != KernelKind::linear) return {};
  if (options.scheme == Scheme::polypic)
    return "PolyPIC needs the moments of the kernel, which vanish on nodes for the linear one; take kernel = \"quadratic\" or "
           "\"cubic\", or scheme = \"apic\"";
  if (options.forces == Forces::mls)
    return "MLS forces need D_p^-1, which is infinite on nodes for the linear kernel; take forces = \"classical\", or kernel = "
           "\"quadratic\" or \"cubic\"";
  return {};
}

template <int Dim, class T>
TransferKernels<Dim, T> transfer_kernels(const TransferOptions& options) {
  return with_kernel(options.kernel, [&](auto kernel) { return kernels_of<decltype(kernel), Dim, T>(options); });
}

template TransferKernels<2, float> transfer_kernels(const TransferOptions&);
template TransferKernels<2, double> transfer_kernels(const TransferOptions&);
template TransferKernels<3, float> transfer_kernels(const TransferOptions&);
template TransferKernels<3, double> transfer_kernels(const TransferOptions&);

}  // namespace mpm
