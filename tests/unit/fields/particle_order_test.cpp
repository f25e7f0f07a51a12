#include "mpm_hpc/fields/particle_order.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <random>
#include <tuple>
#include <vector>

namespace mpm {
namespace {

template <class N>
class Order : public ::testing::Test {
 public:
  static constexpr int Dim = N::value;
  static constexpr Real shift = 0.5;
  using V = Vec<Dim>;

  // Particles all over a small domain, of which each fifth is padding and may be anywhere; mass = 1 + id.
  void seed(int count, Precision precision) {
    body = Body<Dim>("body", 0, precision);
    FieldSet& fields = body.particles;
    fields.resize(count);
    for (FieldId f = 0; f < fields.count(); ++f)
      for (int c = 0; c < fields.traits(f).components; ++c)
        std::memset(fields.raw(f, c), 0, static_cast<std::size_t>(bytes_of(fields.traits(f).type)) * count);
    std::uniform_real_distribution<Real> unit;
    for (Index p = 0; p < count; ++p) {
      const bool padding = p % 5 == 3;
      fields.template data<GlobalIndex>(core::id)[p] = padding ? padding_id : count - p;
      for (int a = 0; a < Dim; ++a)
        fields.template data<Real>(core::position, a)[p] = padding ? 1e6 * (unit(random) - 0.5) : side * unit(random);
      with_precision(precision, [&](auto zero) {
        fields.template data<decltype(zero)>(core::mass)[p] = static_cast<decltype(zero)>(1 + count - p);
      });
    }
  }
  IntVec<Dim> base(Index p) const {
    V x;
    for (int a = 0; a < Dim; ++a) x[a] = body.particles.template data<Real>(core::position, a)[p];
    return base_node(grid, x, shift);
  }
  static int cell(const IntVec<Dim>& node) {
    int number = 0;
    for (int a = 0; a < Dim; ++a) number = block_side * number + node[a] % block_side;
    return number;
  }

  static constexpr Real side = 11;
  std::mt19937 random{5};
  GridGeometry<Dim> grid{V::Zero(), V::Constant(side), 0.9};
  Body<Dim> body{"body", 0, Precision::double_precision};
};

using Dimensions = ::testing::Types<std::integral_constant<int, 2>, std::integral_constant<int, 3>>;
TYPED_TEST_SUITE(Order, Dimensions);

// Against the definition, bit by bit.
TYPED_TEST(Order, KeysInterleaveTheBitsOfTheCoordinates) {
  constexpr int Dim = TypeParam::value;
  for (int n = 0; n < 20000; ++n) {
    IntVec<Dim> block;
    for (int a = 0; a < Dim; ++a) block[a] = static_cast<std::int32_t>(this->random() >> (32 - key_bits + n % key_bits));
    BlockKey expected = 0;
    for (int bit = 0; bit < key_bits; ++bit)
      for (int a = 0; a < Dim; ++a)
        expected |= static_cast<BlockKey>((block[a] >> bit) & 1) << (bit * Dim + Dim - 1 - a);
    ASSERT_EQ(block_key<Dim>(block), expected);
    ASSERT_EQ(block_of_key<Dim>(expected), block);
  }
}

}  // namespace
}  // namespace mpm
