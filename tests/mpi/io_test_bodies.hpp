// Bodies for the tests of files: every value is a formula of the particle's identity, so that any rank can
// check any particle it gets, however the particles were spread when they were written.
#pragma once

#include <gtest/gtest.h>

#include <cstring>
#include <functional>
#include <string>
#include <vector>

#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/fields/body.hpp"
#include "mpm_hpc/parallel/communicator.hpp"

namespace mpm::test {

inline constexpr GlobalIndex plate_slots = 5003, ball_slots = 977, ball_first = GlobalIndex{1} << 40;

// Every seventh and a whole range of identities are missing, as after deletions.
inline bool plate_has(GlobalIndex id) { return id % 7 != 3 && (id < 1000 || id >= 1900); }
inline bool ball_has(GlobalIndex id) { return (id - ball_first) % 5 != 0; }

inline std::vector<GlobalIndex> plate_ids() {
  std::vector<GlobalIndex> ids;
  for (GlobalIndex id = 0; id < plate_slots; ++id)
    if (plate_has(id)) ids.push_back(id);
  return ids;
}
inline std::vector<GlobalIndex> ball_ids() {
  std::vector<GlobalIndex> ids;
  for (GlobalIndex id = ball_first; id < ball_first + ball_slots; ++id)
    if (ball_has(id)) ids.push_back(id);
  return ids;
}

// Rank 1 owns nothing when there are other ranks; the others get interleaved, unordered particles.
inline int owner_of(GlobalIndex id, int ranks) {
  const int owner = static_cast<int>((id * 7919 + id / 13) % ranks);
  return ranks > 1 && owner == 1 ? 0 : owner;
}

// Exact in float: small multiples of 1/8.
inline Real value_of(GlobalIndex id, const std::string& column, int component) {
  int name = 0;
  for (const char c : column) name = (3 * name + c) % 257;
  return static_cast<Real>(id % 4096) + 0.125 * component + 16 * name;
}

template <int Dim>
std::vector<Body<Dim>> bodies_without_particles(Precision precision) {
  std::vector<Body<Dim>> bodies;
  for (const char* name : {"plate", "ball / 2.", "nothing left"}) bodies.emplace_back(name, 0, precision);
  bodies[1].particles.add({.name = "phase", .units = "1", .type = real_type(precision), .in_output = true});
  bodies[1].particles.add(
      {.name = "age", .units = "1", .type = ScalarType::int64, .components = 2, .in_output = true});
  return bodies;
}

inline void set_value(const FieldSet& set, FieldId f, int c, Index p, Real value) {
  switch (set.traits(f).type) {
    case ScalarType::float32:
      set.data<float>(f, c)[p] = static_cast<float>(value);
      break;
    case ScalarType::float64:
      set.data<double>(f, c)[p] = value;
      break;
    case ScalarType::int64:
      set.data<GlobalIndex>(f, c)[p] = static_cast<GlobalIndex>(value);
  }
}

inline Real get_value(const FieldSet& set, FieldId f, int c, Index p) {
  switch (set.traits(f).type) {
    case ScalarType::float32:
      return set.data<float>(f, c)[p];
    case ScalarType::float64:
      return set.data<double>(f, c)[p];
    default:
      return static_cast<Real>(set.data<GlobalIndex>(f, c)[p]);
  }
}

inline Real expected_value(const FieldSet& set, FieldId f, int c, GlobalIndex id) {
  const Real value = value_of(id, set.traits(f).name, c);
  return set.traits(f).type == ScalarType::int64 ? static_cast<Real>(static_cast<GlobalIndex>(value)) : value;
}

// This rank's particles among `ids`, in descending order, with a padding entry full of nonsense after every
// third.
inline void fill(FieldSet& set, const std::vector<GlobalIndex>& ids, int rank, int ranks) {
  std::vector<GlobalIndex> mine;
  for (auto id = ids.rbegin(); id != ids.rend(); ++id) {
    if (owner_of(*id, ranks) != rank) continue;
    mine.push_back(*id);
    if (mine.size() % 4 == 3) mine.push_back(padding_id);
  }
  set.resize(static_cast<Index>(mine.size()));
  for (Index p = 0; p < set.size(); ++p) {
    for (FieldId f = 1; f < set.count(); ++f)
      for (int c = 0; c < set.traits(f).components; ++c)
        set_value(set, f, c, p, mine[p] < 0 ? -7e6 : expected_value(set, f, c, mine[p]));
    set.data<GlobalIndex>(core::id)[p] = mine[p];
  }
}

template <int Dim>
std::vector<Body<Dim>> test_bodies(const Communicator& communicator, Precision precision) {
  std::vector<Body<Dim>> bodies = bodies_without_particles<Dim>(precision);
  fill(bodies[0].particles, plate_ids(), communicator.rank(), communicator.size());
  fill(bodies[1].particles, ball_ids(), communicator.rank(), communicator.size());
  return bodies;
}

// The text of the Error of this kind that all ranks must get, with the same words; "" and a failure
// otherwise.
template <class Kind>
std::string text_on_all_ranks(const Communicator& communicator, const std::function<void()>& action) {
  std::string text;
  try {
    action();
    ADD_FAILURE() << "no exception";
  } catch (const Kind& error) {
    text = error.what();
  } catch (const std::exception& error) {
    ADD_FAILURE() << "another exception: " << error.what();
  }
  std::string of_root = text;
  communicator.broadcast(of_root);
  EXPECT_EQ(text, of_root);
  return text;
}

}  // namespace mpm::test
