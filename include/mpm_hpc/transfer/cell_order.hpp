// The particles of a block in the order of the cells in which they are now, between two sorts of the columns.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

namespace mpm {

// Particles of one cell share their stencil's nodes, so kernels that sum a cell at a time keep the sums in registers.
// A counting sort of indices, stable, so that sums don't depend on anything but the particles' order.
template <int Cells>
class CellOrder {
 public:
  // cell_of(p) in [0, Cells) for p in [0, count), count < 65536.
  template <class CellOf>
  void build(int count, CellOf&& cell_of) {
    start_.fill(0);
    for (int p = 0; p < count; ++p) ++start_[cell_of(p) + 1];
    for (int c = 0; c < Cells; ++c) start_[c + 1] = static_cast<std::uint16_t>(start_[c + 1] + start_[c]);
    if (order_.size() < static_cast<std::size_t>(count)) order_.resize(count);
    next_ = start_;
    for (int p = 0; p < count; ++p) order_[next_[cell_of(p)]++] = static_cast<std::uint16_t>(p);
  }

  // f(cell, particles, count) for each cell that has particles, in ascending order.
  template <class F>
  void for_each_cell(F&& f) const {
    for (int c = 0; c < Cells; ++c)
      if (start_[c + 1] > start_[c]) f(c, order_.data() + start_[c], start_[c + 1] - start_[c]);
  }

 private:
  std::array<std::uint16_t, Cells + 1> start_, next_;
  std::vector<std::uint16_t> order_;
};

}  // namespace mpm
