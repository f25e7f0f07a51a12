#include "id_slices.hpp"

#include <algorithm>
#include <cstring>
#include <limits>
#include <map>

namespace mpm {

namespace {

// A round moves about a thirty-second of a rank's particles, but no more than memory that malloc keeps at
// hand for the next round; smaller pieces would be written too slowly.
std::uint64_t rows_per_piece(std::uint64_t largest_rank, int bytes_per_particle) {
  const std::uint64_t most = std::max<std::uint64_t>((std::uint64_t{1} << 24) / bytes_per_particle, 1);
  return std::min(std::max<std::uint64_t>(largest_rank / 32, 1 << 12), most);
}

}  // namespace

IdSlices::IdSlices(const Communicator& communicator, const FieldSet& particles, FieldId id)
    : communicator_(communicator), particles_(particles), id_(id) {
  const GlobalIndex* ids = particles.data<GlobalIndex>(id);
  GlobalIndex count = 0, highest = -1, lowest = std::numeric_limits<GlobalIndex>::max();
  for (Index p = 0; p < particles.size(); ++p) {
    if (ids[p] < 0) continue;
    ++count;
    highest = std::max(highest, ids[p]);
    lowest = std::min(lowest, ids[p]);
  }
  total_ = static_cast<std::uint64_t>(communicator.sum(count));
  if (total_ == 0) return;
  highest = communicator.max(highest);
  lowest_ = -communicator.max(-lowest);

  const std::uint64_t ranks = static_cast<std::uint64_t>(communicator.size());
  const std::uint64_t largest = static_cast<std::uint64_t>(communicator.max(count));
  const std::uint64_t per_piece = rows_per_piece(largest, particles.bytes_per_particle());
  rounds_ = static_cast<int>((total_ + ranks * per_piece - 1) / (ranks * per_piece));
  const std::uint64_t pieces = ranks * static_cast<std::uint64_t>(rounds_);

  // Where identities are missing, slices of equal width would hold few rows: cut by counts instead.
  const GlobalIndex range = highest - lowest_ + 1;
  const GlobalIndex most_buckets =
      std::clamp<GlobalIndex>(static_cast<GlobalIndex>(16 * pieces), 1 << 12, 1 << 20);
  bucket_width_ = (range + most_buckets - 1) / most_buckets;
  std::vector<Real> counts(bucket(highest) + 1);
  for (Index p = 0; p < particles.size(); ++p)
    if (ids[p] >= 0) ++counts[bucket(ids[p])];
  communicator.sum(counts);

  piece_of_bucket_.resize(counts.size());
  first_row_.assign(pieces + 1, total_);
  std::uint64_t row = 0;
  for (std::size_t b = 0; b < counts.size(); ++b) {
    const std::uint64_t piece = std::min(row * pieces / total_, pieces - 1);
    piece_of_bucket_[b] = static_cast<std::int32_t>(piece);
    first_row_[piece] = std::min(first_row_[piece], row);
    row += static_cast<std::uint64_t>(counts[b]);
  }

  round_start_.assign(rounds_ + 1, 0);
  const auto round_of = [&](Index p) { return piece_of_bucket_[bucket(ids[p])] % rounds_; };
  for (Index p = 0; p < particles.size(); ++p)
    if (ids[p] >= 0) ++round_start_[round_of(p) + 1];
  for (int r = 0; r < rounds_; ++r) round_start_[r + 1] += round_start_[r];
  order_.resize(count);
  std::vector<std::size_t> next = round_start_;
  for (Index p = 0; p < particles.size(); ++p)
    if (ids[p] >= 0) order_[next[round_of(p)]++] = p;
}

IdSlices::Piece IdSlices::piece(int round) const {
  const GlobalIndex* ids = particles_.data<GlobalIndex>(id_);
  std::map<int, std::vector<Index>> leaving;
  for (std::size_t i = round_start_[round]; i < round_start_[round + 1]; ++i)
    leaving[piece_of_bucket_[bucket(ids[order_[i]])] / rounds_].push_back(order_[i]);
  std::map<int, Communicator::Bytes> outgoing;
  for (const auto& [target, particles] : leaving) particles_.pack(particles, outgoing[target]);

  Piece piece;
  auto own = outgoing.extract(communicator_.rank());
  piece.messages = communicator_.exchange(outgoing);
  if (own) piece.messages.emplace_back(communicator_.rank(), std::move(own.mapped()));
  outgoing.clear();
  std::size_t id_offset = 0;
  for (FieldId f = 0; f < id_; ++f)
    id_offset +=
        static_cast<std::size_t>(bytes_of(particles_.traits(f).type)) * particles_.traits(f).components;
  const std::size_t stride = particles_.bytes_per_particle();
  std::size_t arrived = 0;
  for (const auto& [source, bytes] : piece.messages) arrived += bytes.size() / stride;
  piece.rows.reserve(arrived);
  for (const auto& [source, bytes] : piece.messages)
    for (std::size_t at = 0; at < bytes.size(); at += stride) {
      GlobalIndex id = 0;
      std::memcpy(&id, &bytes[at + id_offset], sizeof(id));
      piece.rows.emplace_back(id, &bytes[at]);
    }
  std::sort(piece.rows.begin(), piece.rows.end());
  piece.first_row = first_row_[static_cast<std::size_t>(communicator_.rank()) * rounds_ + round];
  return piece;
}

}  // namespace mpm
