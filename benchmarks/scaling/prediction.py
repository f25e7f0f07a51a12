"""The performance model: seconds of a step from measured compute, counted messages and bytes, latency and bandwidth."""
from dataclasses import dataclass, fields

import numpy as np

import halo_count
from block_scene import PARTICLES_PER_CELL

VALUE = 8  # bytes of a number in double precision
PARTICLE_COLUMNS = 216  # bytes of a migrating elastic particle
OWNER_ENTRY = 16  # bytes of a block and its weight, or its owner, on the way to and from rank 0


@dataclass
class Machine:
    """What the machine is taken to be; every one is an option of the program."""
    latency: float = 1.5e-6  # [s] of a message, also of one stage of a reduction
    bandwidth: float = 12.5e9  # [B/s] of a node, shared by its ranks
    ranks_per_node: int = 64
    memory_bandwidth: float = 400e9  # [B/s] of a node, shared by its ranks
    cache: float = 5e6  # [B] of a rank: its own and its share of what is common
    overlap: float = 0.0  # share of the halo that the interior hides; 0: a bound from above


@dataclass
class Program:
    """Who divides the blocks, and which limits hold."""
    partitioner: str  # metis and bisection run on rank 0, the curve is cut by all ranks
    table_entries: float = halo_count.MAX_TABLE
    pipelined_solver: bool = False  # -phase_ksp_type pipecg: its reductions overlap with the operator
    hidden_step_size: bool = False  # the all-reduce of the step size overlaps with the next P2G


PROGRAMS = {"METIS on rank 0": Program("metis"), "bisection on rank 0": Program("bisection"),
            "curve": Program("curve", np.inf), "curve, reductions hidden": Program("curve", np.inf, True, True)}


def interpolate(x, table):
    """Linear in the logarithm of x between the rows (x, value), constant beyond them."""
    xs, ys = zip(*sorted(table))
    return float(np.interp(np.log(x), np.log(xs), ys))


class Model:
    def __init__(self, parameters, machine):
        self.parameters, self.machine = parameters, machine
        rows = parameters["partition"]["metis"]
        # log seconds = a + b log blocks + c log parts, through the larger cases.
        large = [row for row in rows if row["seconds"] > 0.05]
        unknowns = np.array([[1, np.log(row["blocks"]), np.log(row["parts"])] for row in large])
        self.metis_fit = np.linalg.lstsq(unknowns, np.log([row["seconds"] for row in large]), rcond=None)[0]

    def of_partition(self, quantity, program, blocks_per_rank, ranks):
        """A quality of the partition, from the measured cases that are nearest in blocks per part and parts."""
        rows = [row for row in self.parameters["partition"][program.partitioner] if quantity in row]
        distance = np.array([np.log(row["blocks"] / row["parts"] / blocks_per_rank) ** 2 +
                             0.25 * np.log(row["parts"] / ranks) ** 2 for row in rows])
        weight = 1 / (distance + 1e-3) ** 2
        return float(weight @ [row[quantity] for row in rows] / weight.sum())

    def metis_seconds(self, blocks, parts):
        a, b, c = self.metis_fit
        return float(np.exp(a + b * np.log(blocks) + c * np.log(parts)))

    # ---- the terms of a step [s]

    def compute(self, particles, phase):
        """Of a rank with so many particles: as measured on one core, or as fast as the node's memory feeds all its cores."""
        case = self.parameters["compute"]["phase" if phase else "elastic"]
        m = self.machine
        seconds = particles * interpolate(particles, [(row["particles"], row["seconds_per_particle"]) for row in case["rates"]])
        in_cache = min(1.0, m.cache / (particles * case["bytes_per_particle"]))
        moved = (1 - in_cache) * case["bytes_moved_per_particle"] * particles
        return max(seconds, moved * m.ranks_per_node / m.memory_bandwidth)

    def halo(self, cells_side, blocks_per_rank, ranks, phase, program):
        """Seconds, bytes and messages of a rank."""
        m = self.machine
        if ranks == 1:
            return 0.0, 0.0, 0.0
        values, _, rounds = halo_count.traffic_per_step(
            phase, self.parameters["compute"]["phase"]["iterations_per_step"], 1 / self.parameters["sort"]["steps_per_sort"])
        nodes = halo_count.cube_ghosts(cells_side) * self.of_partition("surface", program, blocks_per_rank, ranks)
        bytes_sent = VALUE * values * nodes
        messages = rounds * min(ranks - 1, self.of_partition("neighbours", program, blocks_per_rank, ranks))
        carried = self.carried(bytes_sent, cells_side, ranks)
        return (1 - m.overlap) * (carried + messages * m.latency), bytes_sent, messages

    def carried(self, bytes_sent, cells_side, ranks):
        """Seconds until the bytes that each rank sends to its neighbours are there. Ranks of a node are taken to form a cube:
        what stays inside costs memory traffic, which is a read and a write on either side."""
        m = self.machine
        on_node = min(ranks, m.ranks_per_node)
        node_side = cells_side * on_node ** (1 / 3)
        abroad = halo_count.cube_ghosts(node_side) / (on_node * halo_count.cube_ghosts(cells_side))
        network = 0.0 if ranks <= m.ranks_per_node else abroad * bytes_sent * on_node / m.bandwidth
        return network + 4 * bytes_sent * on_node / m.memory_bandwidth

    def reductions(self, ranks, phase, program):
        stages = np.log2(ranks) if ranks > 1 else 0.0
        count = 0.0 if program.hidden_step_size else 1.0
        if phase:
            case = self.parameters["compute"]["phase"]
            count += (case["reductions_per_pipelined_solve"] if program.pipelined_solver else
                      case["reductions_per_solve"] + case["reductions_per_iteration"] * case["iterations_per_step"])
        return count * stages * self.machine.latency

    def sort(self, particles, ranks):
        """Of one sort, what ranks add to the ordering, which is part of compute: the particles that change ranks, and the
        reductions and rounds of exchange()."""
        m = self.machine
        if ranks == 1:
            return 0.0
        cells_side = (particles / PARTICLES_PER_CELL) ** (1 / 3)
        leaving = particles * min(1.0, 3 / cells_side)  # one cell of drift in each direction
        return (self.carried(leaving * PARTICLE_COLUMNS, cells_side, ranks)
                + self.parameters["sort"]["collectives"] * np.log2(ranks) * m.latency)

    def repartition(self, coarse_blocks, ranks, partitioner):
        """Of the curve the reductions and each rank's own work; else gather of weights, the partitioner and owners to all, at
        rank 0 and then on every rank."""
        if ranks == 1:
            return 0.0
        m = self.machine
        if partitioner == "curve":
            cost, size = self.parameters["curve"], VALUE * ranks
            on_node = min(ranks, m.ranks_per_node)
            vector = (2 * np.log2(ranks) * m.latency + 2 * size / m.bandwidth
                      + 4 * size * on_node / m.memory_bandwidth)
            return (cost["scalar_reductions"] * np.log2(ranks) * m.latency + cost["vector_reductions"] * vector
                    + cost["seconds_per_block"] * coarse_blocks / ranks + cost["seconds_per_piece"] * ranks)
        cost = self.parameters["owner_table"]
        seconds = (self.metis_seconds(coarse_blocks, ranks) if partitioner == "metis"
                   else cost["bisection_seconds_per_block_and_level"] * coarse_blocks * np.log2(ranks))
        traffic = 2 * OWNER_ENTRY * coarse_blocks / m.bandwidth + 2 * ranks * m.latency
        return seconds + coarse_blocks * cost["seconds_per_block"] + traffic

    # ---- a step

    def step(self, particles, ranks, phase, program):
        """{term: seconds} of the slowest rank of a cube of particles, and what they were made from."""
        sort = self.parameters["sort"]
        mean = particles / ranks
        blocks_side = (particles / PARTICLES_PER_CELL) ** (1 / 3) / halo_count.BLOCK_SIDE
        shift = 0
        while (blocks_side / 2 ** shift) ** 3 * sort["domain_over_body"] > program.table_entries:
            shift += 1
        coarse = max(1.0, (blocks_side / 2 ** shift) ** 3)
        per_rank = coarse / ranks
        if ranks == 1:
            imbalance = 1.0
        else:  # somebody owns the next whole number of blocks at least
            imbalance = max(np.ceil(per_rank) / per_rank, self.of_partition("imbalance", program, per_rank, ranks))
        largest = mean * imbalance
        cells_side = (mean / PARTICLES_PER_CELL) ** (1 / 3)
        halo, bytes_sent, messages = self.halo(cells_side, per_rank, ranks, phase, program)
        compute = self.compute(mean, phase)
        terms = {"compute": compute, "imbalance": self.compute(largest, phase) - compute, "halo": halo,
                 "reductions": self.reductions(ranks, phase, program),
                 "sort": self.sort(largest, ranks) / sort["steps_per_sort"], "re-balance": 0.0}
        # What can't be balanced, or moves on, is tried again after some sorts.
        once = self.repartition(coarse, ranks, program.partitioner)
        if imbalance > sort["rebalance_threshold"]:
            terms["re-balance"] = once / sort["steps_per_sort"] / sort["sorts_per_partition"]
        facts = {"imbalance": imbalance, "coarse_blocks": coarse, "bytes": bytes_sent, "messages": messages,
                 "partition_seconds": once,
                 "efficiency": self.compute(mean, phase) / sum(terms.values())}
        return terms, facts


def machine_options(parser):
    for field in fields(Machine):
        parser.add_argument("--" + field.name.replace("_", "-"), type=field.type, default=field.default)
