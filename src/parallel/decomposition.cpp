#include "mpm_hpc/parallel/decomposition.hpp"

#include <algorithm>

#include "bytes.hpp"
#include "mpm_hpc/base/error.hpp"

namespace mpm {

template <int Dim>
Decomposition<Dim>::Decomposition(const GridGeometry<Dim>& grid, Partitioner partitioner)
    : grid_(grid),
      partitioner_(partitioner),
      on_curve_(partitioner == Partitioner::curve),
      levels_(curve_levels<Dim>(grid.blocks())),
      why_curve_("as the scene asks") {
  // Nodes one and a half spacings inside of the upper side, the farthest that have images, are to count as inside.
  for (int a = 0; a < Dim; ++a)
    last_home_[a] = std::max(first_home_, (grid.margin + grid.cells()[a] - 2) / block_side);
  for (shift_ = 0;; ++shift_) {
    entries_ = 1;
    for (int a = 0; a < Dim; ++a) {
      counts_[a] = ((grid.blocks()[a] - 1) >> shift_) + 1;
      entries_ *= counts_[a];
    }
    if (entries_ <= max_entries) break;
  }
}

template <int Dim>
bool Decomposition<Dim>::choose(const Communicator& communicator, GlobalIndex occupied) {
  if (partitioner_ != Partitioner::automatic || !empty()) return false;
  const bool before = on_curve_;
  const int ranks = communicator.size();
  on_curve_ = false;
  if (ranks > most_table_ranks) {
    on_curve_ = true;
    why_curve_ = fmt::format("since there are more than {} ranks", most_table_ranks);
  } else if (shift_ > 0 && ranks > 1) {
    const GlobalIndex entries = communicator.sum(occupied);
    on_curve_ = entries < least_entries * ranks;
    if (on_curve_)
      why_curve_ = fmt::format("since coarse blocks of {} cells a side would leave a rank {:.1f} of them, fewer than {}",
                               block_side << shift_, static_cast<Real>(entries) / ranks, least_entries);
  }
  return on_curve_ != before;
}

template <int Dim>
bool Decomposition<Dim>::partition(const Communicator& communicator, const Weights& local_weights, Real gain) {
  return on_curve_ ? cut(communicator, local_weights, gain) : partition_table(communicator, local_weights, gain);
}

template <int Dim>
bool Decomposition<Dim>::cut(const Communicator& communicator, const Weights& local_weights, Real gain) {
  CurveCuts cuts = cut_curve(communicator, local_weights, communicator.size());
  if (cut_ && !(max_over_mean(communicator, local_weights, cuts) <
                max_over_mean(communicator, local_weights, cuts_) - gain))
    return false;
  cuts_ = std::move(cuts);
  cut_ = true;
  return true;
}

template <int Dim>
void Decomposition<Dim>::restore(const std::vector<std::int32_t>& owners, const CurveCuts& cuts, int ranks) {
  const bool curve = owners.empty();
  const bool fits = curve ? static_cast<int>(cuts.size()) == ranks - 1
                          : static_cast<GlobalIndex>(owners.size()) == entries_;
  const bool asked_for =
      partitioner_ == Partitioner::automatic || curve == (partitioner_ == Partitioner::curve);
  if (!fits || !asked_for) return;
  if (curve && partitioner_ == Partitioner::automatic) why_curve_ = "as in the checkpoint";
  on_curve_ = cut_ = curve;
  owners_ = owners;
  cuts_ = cuts;
}

template <int Dim>
std::string Decomposition<Dim>::describe() const {
  if (on_curve_)
    return fmt::format("partition: pieces of Hilbert's curve through the blocks of {} cells a side, {}", block_side,
                       why_curve_);
  const std::string_view by = partitioner_ == Partitioner::metis       ? "METIS"
                              : partitioner_ == Partitioner::bisection ? "bisection"
                                                                       : "bisection or METIS";
  return fmt::format("partition: by {}, table of {} coarse blocks of {} cells a side", by, entries_,
                     block_side << shift_);
}

template <int Dim>
bool Decomposition<Dim>::partition_table(const Communicator& communicator, const Weights& local_weights, Real gain) {
  const int ranks = communicator.size();
  // Rank 0 learns the occupied blocks and their weights, and tells all of them the new owners.
  Weights all, weights;
  for (const auto& bytes : communicator.gather(to_bytes(local_weights))) {
    const Weights part = from_bytes<std::pair<GlobalIndex, Real>>(bytes);
    all.insert(all.end(), part.begin(), part.end());
  }
  std::stable_sort(all.begin(), all.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  for (const auto& [block, weight] : all) {
    if (weights.empty() || weights.back().first != block) weights.push_back({block, 0});
    weights.back().second += weight;
  }
  std::vector<GlobalIndex> answer;  // block, owner, block, owner, ..., whether they are new
  if (communicator.root()) {
    const std::vector<int> owners =
        renamed_parts(weights, partition_blocks<Dim>(partitioner_, counts_, weights, ranks), owners_, ranks);
    bool better = owners_.empty();
    if (!better) {
      std::vector<int> present;
      for (const auto& w : weights) present.push_back(owners_[w.first]);
      better = max_over_mean(weights, owners, ranks) < max_over_mean(weights, present, ranks) - gain;
    }
    if (better)
      for (std::size_t i = 0; i < weights.size(); ++i) {
        answer.push_back(weights[i].first);
        answer.push_back(owners[i]);
      }
    answer.push_back(better);
  }
  Communicator::Bytes bytes = to_bytes(answer);
  communicator.broadcast(bytes);
  answer = from_bytes<GlobalIndex>(bytes);
  if (!answer.back()) return false;
  Weights blocks;
  std::vector<int> owners;
  for (std::size_t i = 0; i + 2 < answer.size(); i += 2) {
    blocks.push_back({answer[i], 0.0});
    owners.push_back(static_cast<int>(answer[i + 1]));
  }
  owners_ = owners_of_all<Dim>(counts_, blocks, owners);
  return true;
}

template <int Dim>
Real Decomposition<Dim>::imbalance(const Communicator& communicator, Real load) const {
  const Real mean = communicator.sum(load) / communicator.size();
  return mean > 0 ? communicator.max(load) / mean : 1.0;
}

template class Decomposition<2>;
template class Decomposition<3>;

}  // namespace mpm
