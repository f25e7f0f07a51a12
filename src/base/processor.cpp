// Compiled for any x86-64 processor, and with the C library alone: an inline function of the standard library might be
// taken from a file that is compiled for more.
#include "mpm_hpc/base/processor.hpp"

#include <string.h>
#include <unistd.h>

namespace mpm {

namespace {

constexpr const char* names[] = {
#define MPM_SET(macro, name) name,
    MPM_INSTRUCTION_SETS(MPM_SET)
#undef MPM_SET
};

struct Text {
  char* data;
  std::size_t size, length = 0;
  void add(const char* what) {
    const std::size_t room = size - length, wanted = strlen(what), count = wanted < room ? wanted : room;
    memcpy(data + length, what, count);
    length += count;
  }
};

#ifdef __x86_64__
InstructionSets available() {
  __builtin_cpu_init();
  InstructionSets sets = 0;
#define MPM_SET(macro, name) \
  if (__builtin_cpu_supports(name)) sets |= bit_of(InstructionSet::macro);
  MPM_INSTRUCTION_SETS(MPM_SET)
#undef MPM_SET
  return sets;
}

// Before any constructor of the program's own, which might already use what is missing.
[[gnu::constructor(101)]] void refuse_foreign_processor() {
  char text[1024];
  const std::size_t length = describe_missing(built_for, available(), text, sizeof(text));
  if (length == 0) return;
  constexpr int user_error = 2;  // as in ExitCode
  [[maybe_unused]] const ssize_t written = write(STDERR_FILENO, text, length);
  _exit(user_error);
}
#endif

}  // namespace

const char* widest_registers() {
  if (built_for & bit_of(InstructionSet::AVX512F)) return "avx512";
  return built_for & bit_of(InstructionSet::AVX2) ? "avx2" : "baseline";
}

std::size_t describe_missing(InstructionSets built, InstructionSets available, char* out, std::size_t size) {
  const InstructionSets missing = built & ~available;
  if (missing == 0) return 0;
  Text text{out, size};
  text.add("mpm_hpc: error: the program was built for a processor with ");
  const char* separator = "";
  for (std::size_t i = 0; i < sizeof(names) / sizeof(names[0]); ++i)
    if (missing >> i & 1) {
      text.add(separator);
      text.add(names[i]);
      separator = ", ";
    }
  const InstructionSets avx2 = bit_of(InstructionSet::AVX2) | bit_of(InstructionSet::FMA);
  text.add(", which this one lacks; configure with ");
  text.add((available & avx2) == avx2 ? "-DMPM_ARCH=x86-64-v3" : "-DMPM_ARCH=x86-64");
  text.add(" and build again, or build on this machine\n");
  return text.length;
}

}  // namespace mpm
