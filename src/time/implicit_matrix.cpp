#include <algorithm>

#include "mpm_hpc/time/implicit_system.hpp"

namespace mpm {

// The tangent's rows: the block of two nodes stands at the first of them in lexicographic order.
template <int Dim>
void ImplicitSystem<Dim>::assemble(State<Dim>& state) {
  constexpr int block = Dim * Dim;
  using Block = Eigen::Matrix<Real, Dim, Dim, Eigen::RowMajor>;
  GridFields& fields = state.fields;
  const StencilProducts<Dim>& products = *products_.front();
  const int reach = products.reach(), width = 2 * reach + 1, per_node = products.tangent_blocks() * block;
  state.halo().sum(fields, {stencil_});
  Real* number = fields.template data<Real>(row_number_);
  Real* projector = fields.template data<Real>(projector_);
  std::fill_n(number, fields.nodes(), -1.0);
  fields.zero(projector_);
  const GlobalIndex first_row = solver_.first_row();
  for (std::size_t r = 0; r < rows_.size(); ++r)
    number[rows_[r]] = static_cast<Real>(first_row + static_cast<GlobalIndex>(r));
  for (const Constraint& c : constraints_) {
    Real* values = projector + rows_[c.row] * (block + 1);
    values[0] = 1;
    Eigen::Map<Block>(values + 1) = c.projector;
  }
  state.distribution.row_halo().fill(fields, {stencil_, row_number_, projector_});
  const Real* stencil = fields.template data<Real>(stencil_);

  matrix_.starts.assign(1, 0);
  matrix_.columns.clear();
  matrix_.values.clear();
  struct Coupled {
    GlobalIndex column;
    int offset;
    std::size_t node;
  };
  std::vector<Coupled> coupled;
  const int offsets = Dim == 2 ? width * width : width * width * width, middle = offsets / 2;
  for (std::size_t r = 0; r < rows_.size(); ++r) {
    const std::size_t node = rows_[r];
    const Slot* around = state.topology().neighbours(static_cast<Slot>(node / nodes_per_block<Dim>));
    const IntVec<Dim> place = node_in_block<Dim>(static_cast<int>(node % nodes_per_block<Dim>));
    const GlobalIndex row = first_row + static_cast<GlobalIndex>(r);
    // PETSc counts what it needs from the order of the columns.
    coupled.clear();
    for (int n = 0; n < offsets; ++n) {
      IntVec<Dim> offset;
      for (int a = Dim - 1, rest = n; a >= 0; --a, rest /= width) offset[a] = rest % width - reach;
      const std::size_t other = node_around<Dim>(around, place + offset);
      if (other == no_node || number[other] < 0) continue;
      const auto column = static_cast<GlobalIndex>(number[other]);
      if (storage_ == BlockStorage::full || column >= row) coupled.push_back({column, n, other});
    }
    std::sort(coupled.begin(), coupled.end(),
              [](const Coupled& a, const Coupled& b) { return a.column < b.column; });
    for (const auto& [column, n, other] : coupled) {
      Block K;
      if (n >= middle) {
        K = Eigen::Map<const Block>(stencil + node * per_node + (n - middle) * block);
      } else {
        K = Eigen::Map<const Block>(stencil + other * per_node + (middle - n) * block).transpose();
      }
      K *= dt_ * dt_;
      if (n == middle) {
        if (options_.inertia) K.diagonal().array() += mass_[r];
        if (const int c = constraint_of_row_[r]; c >= 0) {
          const Mat<Dim>& P = constraints_[c].projector;
          K = (P * K * P + constraints_[c].scale * (Mat<Dim>::Identity() - P)).eval();
        }
      } else {
        const Real *here = projector + node * (block + 1), *there = projector + other * (block + 1);
        if (here[0] > 0) K = (Eigen::Map<const Block>(here + 1) * K).eval();
        if (there[0] > 0) K = (K * Eigen::Map<const Block>(there + 1)).eval();
        if (K.isZero(0)) continue;
      }
      matrix_.columns.push_back(static_cast<int>(column));
      matrix_.values.insert(matrix_.values.end(), K.data(), K.data() + block);
    }
    matrix_.starts.push_back(static_cast<int>(matrix_.columns.size()));
  }
  solver_.assemble(matrix_, storage_);
}

template void ImplicitSystem<2>::assemble(State<2>&);
template void ImplicitSystem<3>::assemble(State<3>&);

}  // namespace mpm
