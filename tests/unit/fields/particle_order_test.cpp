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

TYPED_TEST(Order, RunsGoThroughAllParticlesBlockByBlock) {
  constexpr int Dim = TypeParam::value;
  for (const int count : {0, 1, 255, 256, 257, 3000}) {
    this->seed(count, Precision::double_precision);
    Index next = 0;
    for_each_run(this->body, this->grid, this->shift, [&](const BlockRun<Dim>& run) {
      ASSERT_EQ(run.begin, next);
      ASSERT_LT(run.begin, run.end);
      next = run.end;
      for (Index p = run.begin; p < run.end; ++p) {
        ASSERT_EQ(run.padding, this->body.is_padding(p));
        if (run.padding) continue;
        const IntVec<Dim> base = this->base(p);
        for (int a = 0; a < Dim; ++a) ASSERT_EQ(run.block[a], base[a] / block_side);
        ASSERT_EQ(run.cells[p - run.begin], this->cell(base));
      }
    });
    EXPECT_EQ(next, count);
  }
}

// Against std::sort of what each particle's place is.
TYPED_TEST(Order, SortsByBlockAndCellAndPadsEachBlock) {
  constexpr int Dim = TypeParam::value;
  for (const Precision precision : {Precision::double_precision, Precision::single_precision})
    for (const OrderWithinCell within : {OrderWithinCell::stable, OrderWithinCell::canonical}) {
      this->seed(4000, precision);
      using Place = std::tuple<BlockKey, int, GlobalIndex, GlobalIndex>;  // key, cell, order in the cell, identity
      std::vector<Place> expected;
      for (Index p = 0; p < 4000; ++p) {
        if (this->body.is_padding(p)) continue;
        IntVec<Dim> block = this->base(p);
        const int cell = this->cell(block);
        for (int a = 0; a < Dim; ++a) block[a] /= block_side;
        const GlobalIndex id = this->body.particles.template data<GlobalIndex>(core::id)[p];
        expected.emplace_back(block_key<Dim>(block), cell, within == OrderWithinCell::stable ? p : id, id);
      }
      std::sort(expected.begin(), expected.end());

      const int pad = padding_width(precision);
      const std::vector<BlockKey> keys = order_particles(this->body, this->grid, this->shift, pad, within);
      const FieldSet& fields = this->body.particles;
      std::size_t next = 0;
      Index end = 0;
      ASSERT_EQ(keys.size(), this->body.ranges.size());
      for (std::size_t r = 0; r < keys.size(); ++r) {
        const BlockRange& range = this->body.ranges[r];
        EXPECT_EQ(range.slot, static_cast<Slot>(r));
        ASSERT_EQ(range.begin, end);
        ASSERT_EQ(range.begin % pad, 0);
        ASSERT_EQ(range.end % pad, 0);
        end = range.end;
        for (Index p = range.begin; p < range.end; ++p) {
          const GlobalIndex id = fields.template data<GlobalIndex>(core::id)[p];
          const Real mass = precision == Precision::double_precision ? fields.template data<double>(core::mass)[p]
                                                                     : fields.template data<float>(core::mass)[p];
          if (next < expected.size() && std::get<0>(expected[next]) == keys[r]) {
            ASSERT_EQ(id, std::get<3>(expected[next]));
            ASSERT_EQ(mass, 1 + id);
            ASSERT_EQ(this->cell(this->base(p)), std::get<1>(expected[next]));
            ++next;
          } else {  // behind the last particle of its block, and at its place
            ASSERT_EQ(id, padding_id);
            ASSERT_EQ(mass, 0);
            ASSERT_LT(range.end - p, pad);
            ASSERT_EQ(this->base(p), this->base(p - 1));
          }
        }
      }
      EXPECT_EQ(next, expected.size());
      EXPECT_EQ(end, fields.size());
    }
}

}  // namespace
}  // namespace mpm
