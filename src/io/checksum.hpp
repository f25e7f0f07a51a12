// A checksum that ranks can compute in parts and add up, whatever the parts are.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <type_traits>

namespace mpm {

// Finalizer of SplitMix64 (Steele, Lea, Flood 2014, DOI 10.1145/2660193.2660195); a bijection.
constexpr std::uint64_t mixed_bits(std::uint64_t z) {
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
  return z ^ (z >> 31);
}

// Sum over elements of mix(element xor f(place)), modulo 2^64; `first` is the place of words[0] in the whole.
// A change of one element always changes the sum, other damage goes unnoticed with probability 2^-64.
template <class Word>
std::uint64_t checksum(const Word* words, std::size_t count, std::uint64_t first) {
  static_assert(std::is_unsigned_v<Word>);
  constexpr std::uint64_t golden = 0x9e3779b97f4a7c15u;
  std::uint64_t sum = 0;
  for (std::size_t i = 0; i < count; ++i)
    sum += mixed_bits(static_cast<std::uint64_t>(words[i]) ^ ((first + i + 1) * golden));
  return sum;
}

// Elements of `width` bytes.
inline std::uint64_t checksum(const void* data, std::size_t count, int width, std::uint64_t first) {
  if (width == 8) return checksum(static_cast<const std::uint64_t*>(data), count, first);
  if (width == 4) return checksum(static_cast<const std::uint32_t*>(data), count, first);
  return checksum(static_cast<const unsigned char*>(data), count, first);
}

}  // namespace mpm
