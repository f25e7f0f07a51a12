"""What METIS, asked in the words of src/parallel/decomposition.cpp, makes of a cube of blocks: seconds, balance, halo.
Beside it recursive coordinate bisection and equal pieces of Hilbert's curve, as the program cuts it."""
import ctypes
import time

import numpy as np

import halo_count

SEED, UFACTOR = 8, 16  # places in METIS's list of options (metis.h)
RANKS_PER_NODE = 64


def face_graph(side):
    """The blocks of a cube and their face neighbours, in METIS's compressed form."""
    number = np.arange(side ** 3, dtype=np.int32).reshape((side,) * 3)
    pairs = [np.stack([np.moveaxis(number, a, 0)[:-1].ravel(), np.moveaxis(number, a, 0)[1:].ravel()])
             for a in range(3)]
    edges = np.concatenate([*pairs, *(pair[::-1] for pair in pairs)], axis=1)
    order = np.lexsort((edges[1], edges[0]))
    starts = np.r_[0, np.cumsum(np.bincount(edges[0], minlength=side ** 3))].astype(np.int32)
    return starts, np.ascontiguousarray(edges[1][order], dtype=np.int32)


def partition(side, parts):
    """Part of each block of a cube, and the CPU seconds of METIS."""
    metis = ctypes.CDLL("libmetis.so.5")
    starts, adjacent = face_graph(side)
    blocks = side ** 3
    # METIS adds weights up in 32 bits: 2000 for each block, as the program gives, would overflow past 2^31 / 2000 blocks.
    vertex_weights = np.full(blocks, min(2000, 2 ** 27 // blocks), np.int32)
    edge_weights = np.ones(len(adjacent), np.int32)
    options, part = np.zeros(40, np.int32), np.zeros(blocks, np.int32)
    pointer = lambda array: array.ctypes.data_as(ctypes.c_void_p)  # noqa: E731
    metis.METIS_SetDefaultOptions(pointer(options))
    options[SEED], options[UFACTOR] = 1, 10
    numbers = [ctypes.byref(ctypes.c_int32(value)) for value in (blocks, 1, parts, 0)]
    method = metis.METIS_PartGraphRecursive if parts <= 16 else metis.METIS_PartGraphKway
    began = time.process_time()
    status = method(numbers[0], numbers[1], pointer(starts), pointer(adjacent), pointer(vertex_weights), None,
                    pointer(edge_weights), numbers[2], None, None, pointer(options), numbers[3], pointer(part))
    seconds = time.process_time() - began
    if status != 1:
        raise RuntimeError(f"METIS ended with status {status}")
    return part, seconds


def by_bisection(side, parts):
    """Halves of the longest direction, again and again: recursive coordinate bisection of equal weights."""
    places = np.stack(np.unravel_index(np.arange(side ** 3), (side,) * 3), axis=1)
    part = np.empty(side ** 3, np.int32)
    waiting = [(np.arange(side ** 3), 0, parts)]
    while waiting:
        blocks, first, count = waiting.pop()
        if count == 1:
            part[blocks] = first
            continue
        here = places[blocks]
        along = int(np.argmax(np.ptp(here, axis=0)))
        order = np.lexsort((*here.T[::-1], here[:, along]))
        below = count // 2
        cut = min(max(round(len(blocks) * below / count), below), len(blocks) - (count - below))
        waiting += [(blocks[order[:cut]], first, below), (blocks[order[cut:]], first + below, count - below)]
    return part


def along_curve(side, parts):
    """Equal pieces of Hilbert's curve through the blocks: what the ranks work out together from a running sum."""
    blocks = np.stack(np.unravel_index(np.arange(side ** 3), (side,) * 3), axis=1)
    part = np.empty(side ** 3, np.int32)
    part[np.argsort(halo_count.curve_places(blocks, halo_count.curve_levels((side,))))] = (
        (2 * np.arange(side ** 3) + 1) * parts // (2 * side ** 3))
    return part


def quality(side, part, parts):
    """Halo of the parts over that of cubes of the same size, neighbours (both of parts that lie away from the surface of the
    cube), and the share of the halo that leaves a node when nodes take consecutive parts."""
    owners = np.pad(part.reshape((side,) * 3), 1, mode="edge")
    occupied = np.pad(np.ones((side,) * 3, bool), 1)
    rank, owner, nodes, _ = halo_count.ghosts(owners, occupied)
    mean_side = halo_count.BLOCK_SIDE * (side ** 3 / parts) ** (1 / 3)
    per_rank = np.bincount(rank, nodes, minlength=parts)
    at_surface = np.zeros(parts, bool)
    cube = part.reshape((side,) * 3)
    for axis in range(3):
        for end in (0, -1):
            at_surface[np.unique(np.take(cube, end, axis))] = True
    inner = ~at_surface
    result = {"largest_surface": float(per_rank.max() / halo_count.cube_ghosts(mean_side))}
    if inner.sum() >= 8:
        result |= {"surface": float(per_rank[inner].mean() / halo_count.cube_ghosts(mean_side)),
                   "neighbours": float(np.bincount(rank, minlength=parts)[inner].mean())}
    if parts >= 4 * RANKS_PER_NODE:
        abroad = nodes[rank // RANKS_PER_NODE != owner // RANKS_PER_NODE].sum()
        result["off_node"] = float(abroad / nodes.sum())
    return result


def measure(cases, tell=print):
    """One row per (blocks per direction, parts), for METIS with its seconds, bisection and the curve."""
    methods = {"metis": partition, "bisection": lambda *case: (by_bisection(*case), None),
               "curve": lambda *case: (along_curve(*case), None)}
    rows = {method: [] for method in methods}
    for side, parts in cases:
        for method, cut in methods.items():
            part, seconds = cut(side, parts)
            row = {"blocks": side ** 3, "parts": parts,
                   "imbalance": float(np.bincount(part, minlength=parts).max() * parts / side ** 3)}
            if seconds is not None:
                row["seconds"] = seconds
            if side ** 3 <= 1 << 19:
                row |= quality(side, part, parts)
            rows[method].append(row)
            tell(f"{side ** 3} blocks, {parts} parts by {method}: {row.get('seconds', float('nan')):.2f} s, imbalance "
                 f"{row['imbalance']:.3f}, halo {row.get('surface', float('nan')):.2f} of cubes'")
    return rows


# No powers of two, which both methods cut into perfect cubes.
CASES = [(20, 100), (33, 60), (33, 500), (33, 2000), (33, 8000), (48, 1000), (63, 60), (63, 500), (63, 4000), (63, 16000),
         (63, 62000), (72, 30000), (72, 100000), (100, 20000), (100, 100000), (127, 1000), (127, 100000)]
