#include "transfer_kernels_impl.hpp"

namespace mpm {

template TransferKernels<2, float> kernels_of<QuadraticKernel>(const TransferOptions&);
template TransferKernels<2, double> kernels_of<QuadraticKernel>(const TransferOptions&);
template TransferKernels<3, float> kernels_of<QuadraticKernel>(const TransferOptions&);
template TransferKernels<3, double> kernels_of<QuadraticKernel>(const TransferOptions&);

}  // namespace mpm
