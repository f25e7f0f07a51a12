// What instruction sets the program was built for, against those that the processor has.
#pragma once

#include <cstddef>

namespace mpm {

// Name by the compiler's macro and by __builtin_cpu_supports, of all sets that x86-64-v3, x86-64-v4 or -march=native may
// bring and that a compiler uses unasked.
#define MPM_INSTRUCTION_SETS(X)                                                                                   \
  X(AVX, "avx")                                                                                                   \
  X(AVX2, "avx2")                                                                                                 \
  X(BMI, "bmi")                                                                                                   \
  X(BMI2, "bmi2")                                                                                                 \
  X(FMA, "fma")                                                                                                   \
  X(F16C, "f16c")                                                                                                 \
  X(LZCNT, "lzcnt")                                                                                               \
  X(MOVBE, "movbe")                                                                                               \
  X(AVX512F, "avx512f")                                                                                           \
  X(AVX512BW, "avx512bw")                                                                                         \
  X(AVX512CD, "avx512cd")                                                                                         \
  X(AVX512DQ, "avx512dq")                                                                                         \
  X(AVX512VL, "avx512vl")                                                                                         \
  X(AVX512IFMA, "avx512ifma")                                                                                     \
  X(AVX512VBMI, "avx512vbmi")                                                                                     \
  X(AVX512VBMI2, "avx512vbmi2")                                                                                   \
  X(AVX512VNNI, "avx512vnni")                                                                                     \
  X(AVX512BITALG, "avx512bitalg")                                                                                 \
  X(AVX512VPOPCNTDQ, "avx512vpopcntdq")                                                                           \
  X(AVX512BF16, "avx512bf16")                                                                                     \
  X(AVXVNNI, "avxvnni")                                                                                           \
  X(GFNI, "gfni")

enum class InstructionSet {
#define MPM_SET(macro, name) macro,
  MPM_INSTRUCTION_SETS(MPM_SET)
#undef MPM_SET
};

// One bit per InstructionSet.
using InstructionSets = unsigned long;
constexpr InstructionSets bit_of(InstructionSet set) { return InstructionSets{1} << static_cast<int>(set); }

// Of the whole program.
extern const InstructionSets built_for;

// "avx512", "avx2" or "baseline": the widest registers that the program uses.
const char* widest_registers();

// Writes the sentence that refuses a processor with only `available` sets to a program built for `built`: what it lacks and
// what to do, cut to the given size. Returns its length, 0 if nothing is missing.
std::size_t describe_missing(InstructionSets built, InstructionSets available, char* text, std::size_t size);

}  // namespace mpm
