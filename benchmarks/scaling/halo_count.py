"""Counts the halo of mpm_hpc from nothing but the owners of the blocks and the rule of reach, to the byte."""
import numpy as np

BLOCK_SIDE = 4  # nodes per block and direction
MARGIN = 2 * BLOCK_SIDE  # cells of the grid before the domain
BELOW, ABOVE = 1, 3  # planes of nodes that a block's particles reach beyond it: one cell of drift, the quadratic stencil
MAX_TABLE = 1 << 21  # entries of the owner table
NODE_COMPONENTS = 4  # momentum and mass; velocity and mass on the way back
PHASE_SUMS = 2  # volume, and volume times c


def blocks_of_grid(domain_cells):
    return tuple((cells + 2 * MARGIN) // BLOCK_SIDE + 1 for cells in domain_cells)


def coarsening(blocks):
    """k: the owner table has one entry for each cube of 2^k blocks, so that it keeps its limit."""
    shift = 0
    while np.prod([((n - 1) >> shift) + 1 for n in blocks], dtype=float) > MAX_TABLE:
        shift += 1
    return shift


def occupied_blocks(domain_cells, first_cell, cells):
    """Which blocks hold particles of a full cuboid, 8 per cell: base nodes lie from one before the first cell on."""
    occupied = np.zeros(blocks_of_grid(domain_cells), bool)
    occupied[tuple(slice((MARGIN + f - 1) // BLOCK_SIDE, (MARGIN + f + n - 1) // BLOCK_SIDE + 1)
                   for f, n in zip(first_cell, cells))] = True
    return occupied


def owners_of_blocks(table, blocks):
    """The owner of each block from the owner table of a run."""
    shift = coarsening(blocks)
    coarse = tuple(((n - 1) >> shift) + 1 for n in blocks)
    index = np.ix_(*(np.arange(n) >> shift for n in blocks))
    return np.asarray(table).reshape(coarse)[index]


def curve_places(places, levels):
    """Places on Hilbert's curve through 2^levels blocks in each direction (Skilling 2004) of blocks, one in each row."""
    x = [np.array(column, np.int64) for column in np.transpose(places)]
    bits = [1 << level for level in range(levels - 1, 0, -1)]
    for bit in bits:
        for axis in x:
            turned = (axis & bit) != 0
            swapped = np.where(turned, 0, (x[0] ^ axis) & (bit - 1))
            axis ^= swapped  # the first axis is swapped with itself, that is, not at all
            x[0] ^= np.where(turned, bit - 1, swapped)
    for before, axis in zip(x, x[1:]):
        axis ^= before
    turned = np.zeros_like(x[0])
    for bit in bits:
        turned ^= np.where(x[-1] & bit, bit - 1, 0)
    result = np.zeros_like(x[0])
    for level in range(levels - 1, -1, -1):
        for axis in x:
            result = result << 1 | (axis ^ turned) >> level & 1
    return result


def curve_levels(blocks):
    return int(max(blocks) - 1).bit_length()


def owners_on_curve(cuts, blocks):
    """The owner of each block from the cuts of a run."""
    places = curve_places(np.stack(np.unravel_index(np.arange(np.prod(blocks)), blocks), axis=1), curve_levels(blocks))
    return np.searchsorted(cuts, places, side="right").reshape(blocks)


def reach_masks():
    """{offset of a neighbour: its nodes that are reached, a bit for each}."""
    masks = {}
    for offset in np.ndindex(3, 3, 3):
        mask = 0
        for number, node in enumerate(np.ndindex((BLOCK_SIDE,) * 3)):
            place = [n + BLOCK_SIDE * (o - 1) for n, o in zip(node, offset)]
            if all(-BELOW <= p < BLOCK_SIDE + ABOVE for p in place):
                mask |= 1 << number
        masks[tuple(o - 1 for o in offset)] = mask
    return masks


def ghosts(owners, occupied):
    """(rank, owner of the ghosts, ghost nodes, ghost blocks) of each pair of ranks that share nodes, as four arrays."""
    shape = owners.shape
    places = np.argwhere(occupied)
    holders = owners[occupied].astype(np.int64)
    keys, masks = [], []
    for offset, mask in reach_masks().items():
        if not mask:
            continue
        target = np.ravel_multi_index((places + offset).T, shape)
        abroad = owners.ravel()[target] != holders
        keys.append(holders[abroad] * owners.size + target[abroad])
        masks.append(np.full(np.count_nonzero(abroad), mask, np.uint64))
    keys, masks = np.concatenate(keys), np.concatenate(masks)
    if not len(keys):
        return (np.zeros(0, int),) * 4
    order = np.argsort(keys, kind="stable")
    keys, masks = keys[order], masks[order]
    starts = np.flatnonzero(np.r_[True, keys[1:] != keys[:-1]])
    merged = np.bitwise_or.reduceat(masks, starts)
    nodes = np.unpackbits(merged.view(np.uint8).reshape(-1, 8), axis=1).sum(1)
    rank, block = np.divmod(keys[starts], owners.size)
    pairs, inverse = np.unique(np.stack([rank, owners.ravel()[block]]), axis=1, return_inverse=True)
    return pairs[0], pairs[1], np.bincount(inverse.ravel(), nodes).astype(int), np.bincount(inverse.ravel())


def cube_ghosts(side):
    """Ghost nodes of a rank whose nodes fill a cube of so many per direction, among others like it."""
    return (side + BELOW + ABOVE) ** 3 - side ** 3


def active_rings(tolerance=1e-6):
    """Exchanges of a flag per block in which the rate-independent phase field finds where to solve: c decays by the factor f
    per cell with f + 1/f - 2 = (h / 2 l0)^2 and l0 = h / 2, to half of the tolerance; the kernels reach two cells further."""
    return -(-(2 + int(np.ceil(np.log(2 / tolerance) / np.arccosh(1.5)))) // BLOCK_SIDE) if tolerance else 0


def traffic_per_step(phase, iterations_per_step=0.0, sorts_per_step=0.0, rings=0):
    """Values per ghost node and flags per ghost block that travel in a step, and the messages to each neighbour. With the
    phase field (rate-independent, stencil operator): its volume and diagonal join the sum, c joins the fill; the solver applies
    the operator once more than it iterates, each time with one fill and one sum; after a sort the sums of the last phase
    travel once."""
    if not phase:
        return 2 * NODE_COMPONENTS, 0, 2
    applications = iterations_per_step + 1
    return (2 * NODE_COMPONENTS + 3 + 2 * applications + PHASE_SUMS * sorts_per_step, rings,
            2 + 2 * applications + sorts_per_step + rings)
