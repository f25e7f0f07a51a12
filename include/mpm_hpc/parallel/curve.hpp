// Pieces of Hilbert's curve through the blocks, one per rank: owners of all space in one number per rank.
#pragma once

#include <vector>

#include "mpm_hpc/fields/grid_geometry.hpp"
#include "mpm_hpc/parallel/communicator.hpp"
#include "mpm_hpc/parallel/partition.hpp"

namespace mpm {

// Place of a block on Hilbert's curve through 2^levels blocks in each direction, all of whose neighbours are neighbours in
// space: Skilling (2004), Programming the Hilbert curve, AIP Conf. Proc. 707, 381, eq. and listing AxestoTranspose.
template <int Dim>
GlobalIndex curve_place(IntVec<Dim> block, int levels);

// Levels that hold all blocks of a grid.
template <int Dim>
int curve_levels(const IntVec<Dim>& blocks);

// Piece r holds the places from cut r - 1 up to the one before cut r; the first piece has no beginning, the last no end.
using CurveCuts = std::vector<GlobalIndex>;

int piece_of(const CurveCuts& cuts, GlobalIndex place);

// Cuts into pieces of about equal weight: each block goes to the piece in which the middle of its weight comes to lie, so no
// piece exceeds the mean by more than the heaviest block. `local_weights`: (place, weight) of this rank, sorted; several
// ranks may hold weight of one block. Few and short messages where the ranks' places follow one another, as they do when the
// ranks own pieces already; else the cuts are searched for, at one sum of `pieces` numbers over the ranks per halving of the
// places. Without weight, piece 0 holds everything. Collective.
CurveCuts cut_curve(const Communicator& communicator, const BlockWeights& local_weights, int pieces);

// Largest weight of a piece over the mean; 1 if there is no weight. Collective.
Real max_over_mean(const Communicator& communicator, const BlockWeights& local_weights,
                   const CurveCuts& cuts);

}  // namespace mpm
