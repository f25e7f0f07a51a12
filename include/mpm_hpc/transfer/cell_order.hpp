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
  // order() is filled up to a multiple of this, the widest pack.
  static constexpr int filled = 16;

  // cell_of(p) in [0, Cells) for p in [0, count), count < 65536.
  template <class CellOf>
  void build(int count, CellOf&& cell_of) {
    // Two streams, because neighbours in the order are mostly of one cell, and each would wait for the other's counter.
    const int half = count / 2;
    count_.fill({0, 0});
    for (int p = 0; p < half; ++p) {
      ++count_[cell_of(p)][0];
      ++count_[cell_of(half + p)][1];
    }
    if (count % 2 != 0) ++count_[cell_of(count - 1)][1];
    int sum = 0;
    for (int c = 0; c < Cells; ++c) {
      start_[c] = static_cast<std::uint16_t>(sum);
      const int first = count_[c][0], second = count_[c][1];
      count_[c] = {static_cast<std::uint16_t>(sum), static_cast<std::uint16_t>(sum + first)};
      sum += first + second;
    }
    start_[Cells] = static_cast<std::uint16_t>(sum);
    if (order_.size() < static_cast<std::size_t>(count)) order_.resize((count + filled - 1) / filled * filled);
    for (int p = 0; p < half; ++p) {
      order_[count_[cell_of(p)][0]++] = static_cast<std::uint16_t>(p);
      order_[count_[cell_of(half + p)][1]++] = static_cast<std::uint16_t>(half + p);
    }
    if (count % 2 != 0) order_[count_[cell_of(count - 1)][1]++] = static_cast<std::uint16_t>(count - 1);
  }

  // The particles, cell by cell; what it is filled up with are particles too, but any.
  const std::uint16_t* order() const { return order_.data(); }

  // f(cell, begin, end) for each cell that has particles, in ascending order; they are those at [begin, end) of order().
  template <class F>
  void for_each_cell(F&& f) const {
    for (int c = 0; c < Cells; ++c)
      if (start_[c + 1] > start_[c]) f(c, start_[c], start_[c + 1]);
  }

 private:
  std::array<std::uint16_t, Cells + 1> start_;
  std::array<std::array<std::uint16_t, 2>, Cells> count_;  // then the next place, of either stream
  std::vector<std::uint16_t> order_;
};

}  // namespace mpm
