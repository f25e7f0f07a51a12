// The shuffles between the order of the lane stages and that of the row stages.
#include "mpm_hpc/math/row.hpp"

#include <gtest/gtest.h>

#include "mpm_hpc/math/simd.hpp"

using namespace mpm;

namespace {

template <class T>
void expect_transposes() {
  constexpr int W = pack_width<T>, stride = 6;
  alignas(64) T packs[4][W], back[4][W] = {}, quads[W * stride];
  for (int c = 0; c < 4; ++c)
    for (int l = 0; l < W; ++l) packs[c][l] = static_cast<T>(100 * c + l);
  std::fill_n(quads, W * stride, T(-1));
  packs_to_quads<T, W>(packs[0], packs[1], packs[2], packs[3], quads, stride);
  for (int l = 0; l < W; ++l)
    for (int c = 0; c < stride; ++c) EXPECT_EQ(quads[l * stride + c], c < 4 ? packs[c][l] : T(-1));
  quads_to_packs<T, W>(quads, stride, back[0], back[1], back[2], back[3]);
  for (int c = 0; c < 4; ++c)
    for (int l = 0; l < W; ++l) EXPECT_EQ(back[c][l], packs[c][l]);
}

template <class T>
void expect_sums() {
  alignas(64) T values[4][16], sums[16];
  for (int r = 0; r < 4; ++r)
    for (int i = 0; i < 16; ++i) values[r][i] = static_cast<T>((7 * r + 3 * i * i) % 32);
  store_sums(Row<T>::load(values[0]), Row<T>::load(values[1]), Row<T>::load(values[2]), Row<T>::load(values[3]), sums);
  for (int r = 0; r < 4; ++r) {
    const Quad<T> sum = Row<T>::load(values[r]).sum();
    for (int c = 0; c < 4; ++c) {
      EXPECT_EQ(sums[4 * r + c], values[r][c] + values[r][4 + c] + values[r][8 + c] + values[r][12 + c]);
      EXPECT_EQ(sum[c], sums[4 * r + c]);
    }
  }
}

// Nodes First, First + 1, ... of a row by themselves, against the row as numbers.
template <class T, int First, int Nodes>
void expect_part() {
  using Part = RowPart<T, Nodes>;
  alignas(64) T row[4][16], sums[16], out[16];
  for (int r = 0; r < 4; ++r)
    for (int i = 0; i < 16; ++i) row[r][i] = static_cast<T>((5 * r + 3 * i * i) % 32 - 7);
  const auto load = [&row](int r) { return Part::load(row[r] + 4 * First); };
  const Quad<T> quad{2, -3, 5, 7};
  (Part::template spread<First>(quad) * load(0) + T(4) * Part::repeat(quad) - load(1)).store(out);
  for (int n = 0; n < Nodes; ++n)
    for (int c = 0; c < 4; ++c)
      EXPECT_EQ(out[4 * n + c], quad[First + n] * row[0][4 * (First + n) + c] + 4 * quad[c] - row[1][4 * (First + n) + c]);
  std::fill_n(sums, 16, T(100));
  store_sums<true>(load(0), load(1), load(2), load(3), sums);
  store_sums(load(3), load(2), load(1), load(0), out);
  for (int r = 0; r < 4; ++r)
    for (int c = 0; c < 4; ++c) {
      T sum = 0;
      for (int n = First; n < First + Nodes; ++n) sum += row[r][4 * n + c];
      EXPECT_EQ(sums[4 * r + c], 100 + sum);
      EXPECT_EQ(out[4 * (3 - r) + c], sum);
      EXPECT_EQ(load(r).sum()[c], sum);
    }
}
template <class T>
void expect_parts() {
  expect_part<T, 0, 4>();
  expect_part<T, 0, 2>();
  expect_part<T, 2, 2>();
  expect_part<T, 0, 1>();
  expect_part<T, 2, 1>();
}

TEST(Row, Parts) {
  expect_parts<double>();
  expect_parts<float>();
}

TEST(Row, PartsOfAStencilAreAllItsNodesOnce) {
  const auto nodes = []<class T, int Support>(T, std::integral_constant<int, Support>) {
    int next = 0;
    for_each_part<T, Support>([&next](auto part) {
      EXPECT_EQ(part.first, next);
      next += static_cast<int>(sizeof(typename decltype(part)::Row) / sizeof(Quad<T>));
    });
    return next;
  };
  // Nodes behind the support have no weight.
  const auto enough = [&](auto zero, auto support) {
    EXPECT_GE(nodes(zero, support), support);
    EXPECT_LE(nodes(zero, support), row_nodes);
  };
  enough(0.0, std::integral_constant<int, 2>());
  enough(0.0, std::integral_constant<int, 3>());
  enough(0.0, std::integral_constant<int, 4>());
  enough(0.0f, std::integral_constant<int, 2>());
  enough(0.0f, std::integral_constant<int, 3>());
  enough(0.0f, std::integral_constant<int, 4>());
}

TEST(Row, PacksBecomeQuadsAndBack) {
  expect_transposes<double>();
  expect_transposes<float>();
}

TEST(Row, SumsOverNodes) {
  expect_sums<double>();
  expect_sums<float>();
}

}  // namespace
