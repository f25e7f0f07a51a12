// Compiled as the rest of the program is.
#include "mpm_hpc/base/processor.hpp"

namespace mpm {

namespace {

constexpr InstructionSets compiled_for() {
  InstructionSets sets = 0;
#ifdef __AVX__
  sets |= bit_of(InstructionSet::AVX);
#endif
#ifdef __AVX2__
  sets |= bit_of(InstructionSet::AVX2);
#endif
#ifdef __BMI__
  sets |= bit_of(InstructionSet::BMI);
#endif
#ifdef __BMI2__
  sets |= bit_of(InstructionSet::BMI2);
#endif
#ifdef __FMA__
  sets |= bit_of(InstructionSet::FMA);
#endif
#ifdef __F16C__
  sets |= bit_of(InstructionSet::F16C);
#endif
#ifdef __LZCNT__
  sets |= bit_of(InstructionSet::LZCNT);
#endif
#ifdef __MOVBE__
  sets |= bit_of(InstructionSet::MOVBE);
#endif
#ifdef __AVX512F__
  sets |= bit_of(InstructionSet::AVX512F);
#endif
#ifdef __AVX512BW__
  sets |= bit_of(InstructionSet::AVX512BW);
#endif
#ifdef __AVX512CD__
  sets |= bit_of(InstructionSet::AVX512CD);
#endif
#ifdef __AVX512DQ__
  sets |= bit_of(InstructionSet::AVX512DQ);
#endif
#ifdef __AVX512VL__
  sets |= bit_of(InstructionSet::AVX512VL);
#endif
#ifdef __AVX512IFMA__
  sets |= bit_of(InstructionSet::AVX512IFMA);
#endif
#ifdef __AVX512VBMI__
  sets |= bit_of(InstructionSet::AVX512VBMI);
#endif
#ifdef __AVX512VBMI2__
  sets |= bit_of(InstructionSet::AVX512VBMI2);
#endif
#ifdef __AVX512VNNI__
  sets |= bit_of(InstructionSet::AVX512VNNI);
#endif
#ifdef __AVX512BITALG__
  sets |= bit_of(InstructionSet::AVX512BITALG);
#endif
#ifdef __AVX512VPOPCNTDQ__
  sets |= bit_of(InstructionSet::AVX512VPOPCNTDQ);
#endif
#ifdef __AVX512BF16__
  sets |= bit_of(InstructionSet::AVX512BF16);
#endif
#ifdef __AVXVNNI__
  sets |= bit_of(InstructionSet::AVXVNNI);
#endif
#ifdef __GFNI__
  sets |= bit_of(InstructionSet::GFNI);
#endif
  return sets;
}

}  // namespace

// Known before the program's first instruction.
constinit const InstructionSets built_for = compiled_for();

}  // namespace mpm
