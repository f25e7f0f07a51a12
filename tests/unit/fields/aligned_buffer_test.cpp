#include "mpm_hpc/fields/aligned_buffer.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <vector>

#include "mpm_hpc/fields/field_set.hpp"

namespace mpm {
namespace {

TEST(AlignedBuffer, IsStaggeredByCacheLinesInsideThePage) {
  for (const int lines : {0, 1, 63, 64, 70}) {
    AlignedBuffer buffer(1000, lines);
    EXPECT_EQ(reinterpret_cast<std::uintptr_t>(buffer.data()) % AlignedBuffer::page,
              lines % 64 * AlignedBuffer::line);
    EXPECT_GE(buffer.capacity(), 1000u);
  }
}

TEST(AlignedBuffer, KeepsItsPlaceForALittleMoreAndGivesBackWhatIsFarTooMuch) {
  constexpr std::size_t bytes = 10'000'000;
  AlignedBuffer buffer(bytes, 0);
  const void* place = buffer.data();
  EXPECT_LE(buffer.allocated(), bytes * 1.02);
  buffer.allocate(bytes + bytes / 100, 0);
  EXPECT_EQ(buffer.data(), place);
  buffer.allocate(bytes * 0.95, 0);
  EXPECT_EQ(buffer.data(), place);
  buffer.allocate(bytes / 2, 0);
  EXPECT_LE(buffer.allocated(), bytes * 0.52);
}

// In turns of gathering, a narrow column must not end up with a wide one's buffer.
TEST(FieldSet, GatheringLeavesEachColumnItsSize) {
  FieldSet fields;
  const FieldId wide = fields.add({.name = "position", .units = "m"}),
                narrow = fields.add({.name = "mass", .units = "kg", .type = ScalarType::float32});
  constexpr Index size = 1'000'000;
  fields.resize(size);
  std::fill_n(fields.data<double>(wide), size, 1.0);
  std::fill_n(fields.data<float>(narrow), size, 2.0f);
  for (int turn = 0; turn < 4; ++turn) fields.gather(std::vector<Index>(size, 7));
  EXPECT_LE(fields.allocated_bytes(wide), 8 * size * 1.02);
  EXPECT_LE(fields.allocated_bytes(narrow), 4 * size * 1.02);
  EXPECT_LE(fields.spare_bytes(), 12 * size * 1.02);
  fields.gather(std::vector<Index>(size / 2, 7));
  EXPECT_LE(fields.allocated_bytes(wide) + fields.allocated_bytes(narrow), 12 * (size / 2) * 1.13);
  EXPECT_EQ(fields.data<double>(wide)[0], 1.0);
  EXPECT_EQ(fields.data<float>(narrow)[0], 2.0f);
}

TEST(FieldSet, UnpacksWhatWasPacked) {
  FieldSet fields;
  const FieldId wide = fields.add({.name = "position", .units = "m", .components = 2}),
                narrow = fields.add({.name = "mass", .units = "kg", .type = ScalarType::float32});
  constexpr Index size = 1000;
  fields.resize(2 * size);
  std::vector<Index> from, to;
  for (Index p = 0; p < size; ++p) {
    fields.data<double>(wide, 0)[p] = p;
    fields.data<double>(wide, 1)[p] = -p;
    fields.data<float>(narrow)[p] = 0.5f * p;
    from.push_back(size - 1 - p);
    to.push_back(size + (7 * p) % size);  // 7 and 1000 have no common divisor
  }
  std::vector<char> bytes(3, 'x');
  fields.pack(from, bytes);
  ASSERT_EQ(bytes.size(), 3u + 20u * size);
  fields.unpack(bytes.data() + 3, to);
  for (Index p = 0; p < size; ++p) {
    EXPECT_EQ(fields.data<double>(wide, 0)[to[p]], from[p]);
    EXPECT_EQ(fields.data<double>(wide, 1)[to[p]], -from[p]);
    EXPECT_EQ(fields.data<float>(narrow)[to[p]], 0.5f * from[p]);
  }
}

#ifdef __SANITIZE_ADDRESS__
// The allocation is a page larger than what is asked for, and columns have room to grow.

TEST(AlignedBuffer, AddressSanitizerSeesItsEnds) {
  AlignedBuffer buffer(1001, 3);
  volatile char* bytes = static_cast<char*>(buffer.data());
  bytes[0] = bytes[1000] = 1;
  EXPECT_DEATH(bytes[1001] = 1, "use-after-poison");
  EXPECT_DEATH(bytes[-1] = 1, "use-after-poison");
  buffer.allocate(2001, 3);
  bytes = static_cast<char*>(buffer.data());
  bytes[2000] = 1;
  EXPECT_DEATH(bytes[2001] = 1, "use-after-poison");
}

TEST(AlignedBuffer, AddressSanitizerSeesTheEndOfAColumn) {
  FieldSet fields;
  const FieldId id = fields.add({.name = "mass", .units = "kg"});
  const auto ends_at = [&](Index size) {
    EXPECT_EQ(fields.size(), size);
    volatile double* mass = fields.data<double>(id);
    mass[size - 1] = 1;
    EXPECT_DEATH(mass[size] = 1, "use-after-poison") << "size " << size;
  };
  for (const Index size : {1000, 1010, 500, 2000}) {
    fields.resize(size);
    ends_at(size);
  }
  fields.gather(std::vector<Index>(300, 7));
  ends_at(300);
}
#endif

}  // namespace
}  // namespace mpm
