#include "mpm_hpc/base/memory.hpp"

#include <gtest/gtest.h>

#include <cstdlib>
#include <cstring>

namespace mpm {
namespace {

constexpr std::size_t block = std::size_t{64} << 20;
// Linux counts resident pages by processor and adds them up now and then: its figures are some hundred kilobytes old.
constexpr std::size_t late = block / 64;

// Takes and returns memory that the system sees at once.
void touch_block() {
  char* bytes = static_cast<char*>(std::malloc(block));
  ASSERT_NE(bytes, nullptr);
  std::memset(bytes, 1, block);
  asm volatile("" : : "r"(bytes) : "memory");
  std::free(bytes);
}

TEST(MemoryAccount, AddsUp) { EXPECT_EQ(total_bytes({{"a", 3}, {"b/c", 4}}), 7u); }

TEST(MemoryWatch, FindsThePhaseThatPeaks) {
  return_freed_memory();
  MemoryWatch watch;
  if (resident_memory().now == 0) GTEST_SKIP() << "this system doesn't tell its resident memory";
  {
    auto outer = watch.phase("outer");
    watch.begin();
    touch_block();
    watch.end("inner");
  }
  watch.begin();
  watch.end("idle");
  const auto peaks = watch.peaks();
  EXPECT_GE(peaks.at("inner") + late, watch.before() + block);
  EXPECT_GE(peaks.at("outer"), peaks.at("inner"));
  if (!watch.has_phases()) GTEST_SKIP() << "this process can't restart its peak";
  EXPECT_LT(peaks.at("idle"), watch.before() + block / 2);
  EXPECT_LT(peaks.at(MemoryWatch::steps), watch.before() + block / 2);
}

}  // namespace
}  // namespace mpm
