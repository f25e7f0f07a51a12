// The refusal of a processor that lacks what the program was built for.
#include "mpm_hpc/base/processor.hpp"

#include <gtest/gtest.h>

#include <string>

using namespace mpm;

namespace {

std::string refusal(InstructionSets built, InstructionSets available, std::size_t size = 1024) {
  std::string text(size, '?');
  text.resize(describe_missing(built, available, text.data(), size));
  return text;
}

constexpr InstructionSets avx2 = bit_of(InstructionSet::AVX) | bit_of(InstructionSet::AVX2) | bit_of(InstructionSet::FMA),
                          avx512 = avx2 | bit_of(InstructionSet::AVX512F) | bit_of(InstructionSet::AVX512VL);

TEST(Processor, WithAllSetsIsAccepted) {
  EXPECT_EQ(refusal(avx512, avx512), "");
  EXPECT_EQ(refusal(avx2, avx512), "");
  EXPECT_EQ(refusal(0, 0), "");
}

TEST(Processor, LackingSetsIsToldWhichAndWhatToDo) {
  EXPECT_EQ(refusal(avx512, avx2),
            "mpm_hpc: error: the program was built for a processor with avx512f, avx512vl, which this one lacks; configure "
            "with -DMPM_ARCH=x86-64-v3 and build again, or build on this machine\n");
  EXPECT_EQ(refusal(avx2, 0),
            "mpm_hpc: error: the program was built for a processor with avx, avx2, fma, which this one lacks; configure "
            "with -DMPM_ARCH=x86-64 and build again, or build on this machine\n");
  EXPECT_EQ(refusal(avx512, 0, 20), "mpm_hpc: error: the ");
}

TEST(Processor, OfThisTestHasWhatTheProgramWasBuiltFor) {
  const std::string widest = widest_registers();
#if defined(__AVX512F__)
  EXPECT_EQ(widest, "avx512");
#elif defined(__AVX2__)
  EXPECT_EQ(widest, "avx2");
#else
  EXPECT_EQ(widest, "baseline");
#endif
}

}  // namespace
