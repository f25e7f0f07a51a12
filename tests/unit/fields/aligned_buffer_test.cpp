#include "mpm_hpc/fields/aligned_buffer.hpp"

#include <gtest/gtest.h>

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
