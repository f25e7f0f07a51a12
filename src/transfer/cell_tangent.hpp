// The blocks K_ij of the tangent of one cell, whose particles share their nodes.
#pragma once

#include <algorithm>
#include <cstring>

#include "mpm_hpc/fields/node_box.hpp"
#include "mpm_hpc/math/tensor.hpp"

namespace mpm {

// For nodes i <= j of the stencil and with g and A as in stencil_products.hpp,
//   K_ij[a][b] = sum_p sum_d (sum_c g_ip[c] A_p[ac][bd]) g_jp[d].
// The inner sums are half_[p, d][i, a, b]; the outer one is a product of matrices, whose rows (i, a, b) behind j are left out.
template <int Dim, int Support>
class CellTangent {
 public:
  static constexpr int nodes = box_nodes<Dim>(Support);
  static constexpr int block = Dim * Dim, lanes = pack_width<Real>;

  void clear() { std::fill(std::begin(K_), std::end(K_), 0.0); }
  // The first `count` lanes of a batch: g_ip[c] at g[(i * Dim + c) * lanes + p], A_p at tangent[..][first + p].
  // meanwhile(i, end) is called for all nodes, some at a time, so that memory for them can be fetched.
  template <class F>
  void add(const Real* g, const Real* const* tangent, Index first, int count, F&& meanwhile) {
    for (int p = 0; p < count; ++p) add_half(g + p, tangent, first + p, half_ + p * Dim * stride);
    for (int j = 0; j < nodes; j += Support) {
      meanwhile(j, j + Support);
      const int vectors = ((j + Support) * block + lanes - 1) / lanes;
      int v = 0;
      for (; v + at_once <= vectors; v += at_once) add_product<at_once>(g, j, v, count);
      static_assert(at_once == 4);
      if (vectors - v == 3) add_product<3>(g, j, v, count);
      if (vectors - v == 2) add_product<2>(g, j, v, count);
      if (vectors - v == 1) add_product<1>(g, j, v, count);
    }
  }
  // Adds K_ij, [a * Dim + b], to `to`.
  void add_block(int i, int j, Real* to) const {
    Real sum[block], more[block];
    std::memcpy(sum, to, sizeof(sum));
    std::memcpy(more, K_ + j * stride + i * block, sizeof(more));
#pragma GCC unroll 16
    for (int k = 0; k < block; ++k) sum[k] += more[k];
    std::memcpy(to, sum, sizeof(sum));
  }

 private:
  static constexpr int stride = (nodes * block + lanes - 1) / lanes * lanes;
  static constexpr int pieces = (block + lanes - 1) / lanes;  // vectors for a block
  static constexpr int at_once = 4;                           // vectors of a row
  using V __attribute__((vector_size(lanes * sizeof(Real)))) = Real;

  static V load(const Real* from) {
    V v;
    std::memcpy(&v, from, sizeof(v));
    return v;
  }
  static void put(Real* to, const V& v) { std::memcpy(to, &v, sizeof(v)); }

  void add_half(const Real* g, const Real* const* tangent, Index p, Real* half) {
    for (int d = 0; d < Dim; ++d) {
      alignas(64) Real A[Dim][pieces * lanes] = {};  // [c][a * Dim + b]
      for (int c = 0; c < Dim; ++c)
        for (int a = 0; a < Dim; ++a)
          for (int b = 0; b < Dim; ++b)
            A[c][a * Dim + b] = tangent[SymTensor<Real, block>::index(a * Dim + c, b * Dim + d)][p];
      V of[Dim][pieces];
      for (int c = 0; c < Dim; ++c)
        for (int k = 0; k < pieces; ++k) of[c][k] = load(A[c] + k * lanes);
      // What a last vector writes behind its block is written over by the next one.
      Real* out = half + d * stride;
      for (int i = 0; i < nodes; ++i)
        for (int k = 0; k < pieces; ++k) {
          V sum = g[i * Dim * lanes] * of[0][k];
          for (int c = 1; c < Dim; ++c) sum += g[(i * Dim + c) * lanes] * of[c][k];
          put(out + i * block + k * lanes, sum);
        }
    }
  }

  // Vectors [v, v + Count) of the columns [j, j + Support).
  template <int Count>
  void add_product(const Real* g, int j, int v, int particles) {
    Real* K = K_ + j * stride + v * lanes;
    const Real* half = half_ + v * lanes;
    V sum[Support][Count];
#pragma GCC unroll 4
    for (int s = 0; s < Support; ++s)
#pragma GCC unroll 4
      for (int k = 0; k < Count; ++k) sum[s][k] = load(K + s * stride + k * lanes);
    for (int p = 0; p < particles; ++p)
#pragma GCC unroll 3
      for (int d = 0; d < Dim; ++d, half += stride) {
        V h[Count];
#pragma GCC unroll 4
        for (int k = 0; k < Count; ++k) h[k] = load(half + k * lanes);
#pragma GCC unroll 4
        for (int s = 0; s < Support; ++s)
#pragma GCC unroll 4
          for (int k = 0; k < Count; ++k) sum[s][k] += g[((j + s) * Dim + d) * lanes + p] * h[k];
      }
#pragma GCC unroll 4
    for (int s = 0; s < Support; ++s)
#pragma GCC unroll 4
      for (int k = 0; k < Count; ++k) put(K + s * stride + k * lanes, sum[s][k]);
  }

  alignas(64) Real K_[nodes * stride];
  alignas(64) Real half_[lanes * Dim * stride + pieces * lanes];
};

}  // namespace mpm
