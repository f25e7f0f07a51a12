// What tests that compare ranks share: reproducible numbers and lists of all ranks.
#pragma once

#include <cstdint>
#include <cstring>
#include <vector>

#include "mpm_hpc/parallel/communicator.hpp"

namespace mpm::test {

// A number in 1..2^20 that depends on all arguments.
template <class... Parts>
std::int64_t hash_of(Parts... parts) {
  std::uint64_t h = 0x9E3779B97F4A7C15ull;
  ((h = (h ^ static_cast<std::uint64_t>(parts)) * 0xBF58476D1CE4E5B9ull, h ^= h >> 29), ...);
  return static_cast<std::int64_t>(h >> 44) + 1;
}

// The concatenation of all ranks' lists, on all ranks; with `ranks`, whose each entry is.
template <class T>
std::vector<T> gather_all(const std::vector<T>& mine, std::vector<int>* ranks = nullptr) {
  const Communicator world = Communicator::world();
  std::vector<char> bytes(mine.size() * sizeof(T));
  if (!bytes.empty()) std::memcpy(bytes.data(), mine.data(), bytes.size());
  std::vector<char> all, whose;
  int rank = 0;
  for (const auto& part : world.gather(bytes)) {
    all.insert(all.end(), part.begin(), part.end());
    whose.insert(whose.end(), part.size() / sizeof(T), static_cast<char>(rank++));
  }
  world.broadcast(all);
  world.broadcast(whose);
  if (ranks) ranks->assign(whose.begin(), whose.end());
  std::vector<T> result(all.size() / sizeof(T));
  if (!all.empty()) std::memcpy(static_cast<void*>(result.data()), all.data(), all.size());
  return result;
}

}  // namespace mpm::test
