// Brings particles into the order of their identities, slice by slice, without holding them twice.
#pragma once

#include <cstdint>
#include <utility>
#include <vector>

#include "mpm_hpc/fields/field_set.hpp"
#include "mpm_hpc/parallel/communicator.hpp"

namespace mpm {

// Identities may have gaps. All particles, ordered by identity, are rows 0 to total() - 1; each round gives
// each rank one contiguous piece of them.
class IdSlices {
 public:
  // The column `id` holds identities, negative ones are padding. Collective.
  IdSlices(const Communicator& communicator, const FieldSet& particles, FieldId id);

  struct Piece {
    std::uint64_t first_row = 0;
    // Identity and packed particle (as FieldSet::pack leaves it), in order.
    std::vector<std::pair<GlobalIndex, const char*>> rows;
    std::vector<std::pair<int, Communicator::Bytes>> messages;  // what the rows point into
  };

  std::uint64_t total() const { return total_; }
  int rounds() const { return rounds_; }
  // Collective.
  Piece piece(int round) const;

 private:
  std::size_t bucket(GlobalIndex id) const {
    return static_cast<std::size_t>((id - lowest_) / bucket_width_);
  }

  const Communicator& communicator_;
  const FieldSet& particles_;
  FieldId id_;
  std::uint64_t total_ = 0;
  int rounds_ = 0;
  GlobalIndex lowest_ = 0, bucket_width_ = 1;
  std::vector<std::int32_t> piece_of_bucket_;  // pieces count rank by rank: rank * rounds + round
  std::vector<std::uint64_t> first_row_;       // of each piece
  std::vector<Index> order_;                   // this rank's particles by round
  std::vector<std::size_t> round_start_;       // in order_
};

}  // namespace mpm
