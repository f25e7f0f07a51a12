#include <algorithm>

#include "mpm_hpc/fields/node_box.hpp"
#include "mpm_hpc/time/implicit_system.hpp"

namespace mpm {

// The same for all tangents of a step.
template <int Dim>
void ImplicitSystem<Dim>::find_neighbours(const State<Dim>& state, const Real* number) {
  first_neighbours_.assign(1, 0);
  for (std::size_t r = 0; r < rows_.size(); ++r) {
    const std::size_t node = rows_[r];
    const Slot* around = state.topology().neighbours(static_cast<Slot>(node / nodes_per_block<Dim>));
    const IntVec<Dim> place = node_in_block<Dim>(static_cast<int>(node % nodes_per_block<Dim>));
    for_offsets<Dim>(products_.front()->reach(), [&](int n, const IntVec<Dim>& offset) {
      const std::size_t other = node_around<Dim>(around, place + offset);
      if (other == no_node || number[other] < 0) return;
      if (storage_ == BlockStorage::symmetric && number[other] < number[node]) return;
      neighbours_.push_back({static_cast<std::int32_t>(other), n});
    });
    // PETSc counts what it needs from the order of the columns.
    std::sort(neighbours_.begin() + static_cast<std::ptrdiff_t>(first_neighbours_.back()), neighbours_.end(),
              [number](const Neighbour& a, const Neighbour& b) { return number[a.node] < number[b.node]; });
    first_neighbours_.push_back(neighbours_.size());
  }
  matrix_.places.clear();
  if (storage_ != BlockStorage::entries) return;
  for (const std::size_t node : rows_) {
    const IntVec<Dim> first = state.topology().first_node(static_cast<Slot>(node / nodes_per_block<Dim>));
    const Vec<Dim> place = state.geometry().node_position(
        first + node_in_block<Dim>(static_cast<int>(node % nodes_per_block<Dim>)));
    matrix_.places.insert(matrix_.places.end(), place.begin(), place.end());
  }
}

// The tangent's rows: the block of two nodes stands at the first of them in lexicographic order.
template <int Dim>
void ImplicitSystem<Dim>::assemble(State<Dim>& state) {
  constexpr int block = Dim * Dim;
  using Block = Eigen::Matrix<Real, Dim, Dim, Eigen::RowMajor>;
  GridFields& fields = state.fields;
  const StencilProducts<Dim>& products = *products_.front();
  const int per_node = products.tangent_blocks() * block;
  const int middle = box_nodes<Dim>(2 * products.reach() + 1) / 2;
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
  if (neighbours_.empty()) find_neighbours(state, number);

  auto rows = state.timers.scope("Newton rows");
  matrix_.starts.assign(1, 0);
  matrix_.columns.clear();
  matrix_.values.clear();
  for (std::size_t r = 0; r < rows_.size(); ++r) {
    const std::size_t node = rows_[r];
    for (std::size_t k = first_neighbours_[r]; k < first_neighbours_[r + 1]; ++k) {
      const auto other = static_cast<std::size_t>(neighbours_[k].node);
      const int n = neighbours_[k].offset;
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
      matrix_.columns.push_back(static_cast<int>(number[other]));
      matrix_.values.insert(matrix_.values.end(), K.data(), K.data() + block);
    }
    matrix_.starts.push_back(static_cast<int>(matrix_.columns.size()));
  }
  rows.stop();
  auto entries = state.timers.scope("Newton matrix");
  solver_.assemble(matrix_, storage_);
}

template void ImplicitSystem<2>::assemble(State<2>&);
template void ImplicitSystem<3>::assemble(State<3>&);

}  // namespace mpm
