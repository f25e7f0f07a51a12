// Random numbers as a function of a counter, the same on every rank.
#pragma once

#include <cstdint>

#include "mpm_hpc/base/types.hpp"

namespace mpm {

// SplitMix64 (Steele, Lea and Flood 2014): a bijection of 64 bits that passes BigCrush as a counter-based
// generator.
inline std::uint64_t mixed(std::uint64_t x) {
  x += 0x9e3779b97f4a7c15ULL;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ULL;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebULL;
  return x ^ (x >> 31);
}

// Uniform in [0, 1).
inline Real uniform(std::uint64_t counter) { return static_cast<Real>(mixed(counter) >> 11) * 0x1p-53; }

}  // namespace mpm
