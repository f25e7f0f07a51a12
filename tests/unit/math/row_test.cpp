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

TEST(Row, PacksBecomeQuadsAndBack) {
  expect_transposes<double>();
  expect_transposes<float>();
}

TEST(Row, SumsOverNodes) {
  expect_sums<double>();
  expect_sums<float>();
}

}  // namespace
