"""Measures what the performance model starts from: compute per particle on one rank, sorting included, and exact counts."""
import json
import os
import resource
import shlex
import statistics
import subprocess
import tempfile
from pathlib import Path

import h5py

import halo_count
from block_scene import FREE_CELLS, PARTICLES_PER_CELL, Block
from results import ScalingError, read_json


def run(program, block, folder, ranks=1, launcher="mpirun --oversubscribe --bind-to none"):
    """run.json of a block, and the CPU seconds of its process where there is only one."""
    scene = Path(folder) / "block.toml"
    scene.write_text(block.scene(), encoding="utf-8")
    start = [] if ranks == 1 else [*shlex.split(launcher), "-n", str(ranks)]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    outcome = subprocess.run([*start, str(program), str(scene), "--steps", str(block.steps), "--output",
                              str(Path(folder) / "run"), "--force"], capture_output=True, text=True, errors="replace",
                             env={"OMPI_MCA_mpi_yield_when_idle": "1", **os.environ}, check=False)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if outcome.returncode:
        lines = [line for line in outcome.stderr.splitlines() if line.startswith("mpm_hpc")] or ["no message"]
        raise ScalingError(f"{program} ended with code {outcome.returncode} on {ranks} ranks: {lines[0]}",
                           outcome.returncode if outcome.returncode in (2, 3, 4) else 1)
    report = read_json(Path(folder) / "run" / "run.json")
    if report["particles"] != block.particles:
        raise ScalingError(f"the block has {report['particles']} particles in place of {block.particles}", 1)
    return report, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def seconds_per_particle(program, side, phase, repeats, folder):
    """CPU seconds of a particle and step on one rank: of a long run less those of a short one, so that set-up drops out and
    other programs disturb little. Also run.json of the long one."""
    long_steps = max(30, min(200, int(1.2e7 / (PARTICLES_PER_CELL * side ** 3))))
    found = []
    for _ in range(repeats):
        seconds = []
        for steps in (5, 5 + long_steps):
            report, spent = run(program, Block((side,) * 3, phase, True, steps), folder)
            seconds.append(spent)
        found.append((seconds[1] - seconds[0]) / long_steps / report["particles"])
    return statistics.median(found), report


def measure_compute(program, sides, repeats, tell):
    """The parts "compute" and "sort" of the parameters."""
    compute, sort = {}, {}
    with tempfile.TemporaryDirectory() as folder:
        for name, phase in (("elastic", False), ("phase", True)):
            rates, iterations = [], 0.0
            for side in sides:
                seconds, report = seconds_per_particle(program, side, phase, repeats, folder)
                rates.append({"particles": report["particles"], "seconds_per_particle": seconds})
                iterations = max(iterations, sum(report["solver_iterations"].values()) / report["steps"])
                tell(f"{name}, {report['particles']} particles: {1e-6 / seconds:.1f} M particle-steps/s")
            compute[name] = {"rates": rates, "bytes_per_particle": report["bytes_per_particle"]}
            if phase:
                compute[name]["iterations_per_step"] = iterations
            if not phase:
                sort = {"steps_per_sort": 1 / report["traffic_per_step"]["sorts"]["mean"]}
    return compute, sort


def counted_and_predicted(program, block, ranks, launcher):
    """Messages and bytes of a run of so few steps that nothing is sorted, counted by the program and predicted from the
    owners that its checkpoint holds."""
    with tempfile.TemporaryDirectory() as folder:
        report, _ = run(program, block, folder, ranks, launcher)
        [checkpoint] = (Path(folder) / "run").glob("checkpoint_*.h5")
        with h5py.File(checkpoint, "r") as file:
            table, cuts = file["owners"][()], file["curve_cuts"][()]
    domain = block.domain_cells()
    occupied = halo_count.occupied_blocks(domain, (FREE_CELLS,) * 3, block.cells)
    owners = (halo_count.owners_of_blocks(table, occupied.shape) if len(table)
              else halo_count.owners_on_curve(cuts, occupied.shape))
    pairs, _, nodes, blocks = halo_count.ghosts(owners, occupied)
    iterations = sum(report["solver_iterations"].values()) / block.steps
    # The phase field's sums of the phase travel once, before the first solve.
    values, flags, messages = halo_count.traffic_per_step(block.phase, iterations, 1 / block.steps,
                                                          halo_count.active_rings() if block.cracked else 0)
    return {"ranks": ranks, "phase": block.phase, "cells": block.cells, "iterations": iterations,
            "counted_messages": report["messages_per_step"], "counted_bytes": report["bytes_per_step"],
            "predicted_messages": messages * len(pairs),
            "predicted_bytes": 8.0 * values * int(nodes.sum()) + flags * int(blocks.sum())}


def save(path, parameters):
    Path(path).write_text(json.dumps(parameters, indent=1) + "\n", encoding="utf-8")
