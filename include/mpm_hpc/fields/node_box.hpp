// Boxes of nodes: how many they hold, and the offsets within one around a node.
#pragma once

#include "mpm_hpc/base/types.hpp"

namespace mpm {

// Nodes of a box with this number of them along each side.
template <int Dim>
constexpr int box_nodes(int side) {
  return Dim == 2 ? side * side : side * side * side;
}

// Calls f(number, offset) for the offsets of up to `reach` nodes along each direction, in lexicographic order from 0 on; that of
// no offset is the middle one.
template <int Dim, class F>
void for_offsets(int reach, F&& f) {
  const int width = 2 * reach + 1;
  for (int n = 0; n < box_nodes<Dim>(width); ++n) {
    IntVec<Dim> offset;
    for (int a = Dim - 1, rest = n; a >= 0; --a, rest /= width) offset[a] = rest % width - reach;
    f(n, offset);
  }
}

}  // namespace mpm
