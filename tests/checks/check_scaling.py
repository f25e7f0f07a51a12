#!/usr/bin/python3
"""Checks the scaling command on tiny blocks (points, refusals, Slurm, no efficiency with more ranks than cores) and that the
performance model predicts every message and byte of runs on 1, 2 and 3 ranks."""
import contextlib
import csv
import io
import json
import os
import sys
import tempfile
from pathlib import Path

import numpy as np

sys.dont_write_bytecode = True
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))
import mpm_program as mpm  # noqa: E402

FOLDER = mpm.SOURCE / "benchmarks" / "scaling"
scaling, model = mpm.load_script(FOLDER / "scaling"), mpm.load_script(FOLDER / "model")
import halo_count  # noqa: E402  (in FOLDER)
import measure  # noqa: E402
from block_scene import Block, near_cubic  # noqa: E402

LAUNCHER = " ".join(mpm.MPIRUN)
NO_EFFICIENCY = "more ranks than cores: no efficiency"
failures = []


def expect(truth, words):
    if not truth:
        failures.append(words)
        print(f"FAILED: {words}")


def call(program, *arguments):
    """Exit code, output and errors of a program that runs in this process."""
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as err:
        try:
            code = program.main([str(argument) for argument in arguments])
        except SystemExit as ended:
            code = ended.code
    return code, out.getvalue(), err.getvalue()


def study(*arguments):
    return call(scaling, "--program", mpm.BINARIES / "mpm_hpc", "--launcher", LAUNCHER, "--steps", 4, *arguments)


def check_points(folder):
    code, out, err = study("--ranks", "1,2,3", "--cores", 2, "--particles", 4000, "--particles-per-rank", 1000, "--repeats",
                           1, "--output", folder)
    expect(code == 0, f"three rank counts run: {code}, {err}")
    if code:
        return
    points = {(point["kind"], point["ranks"]): point for point in json.loads((folder / "results.json").read_text())}
    expect(sorted(points) == [(kind, ranks) for kind in ("strong", "weak") for ranks in (1, 2, 3)], f"points {points}")
    for (kind, ranks), point in points.items():
        particles = 8 * 8 ** 3 if kind == "strong" else 1000 * ranks  # the cube of cells nearest to 500 cells; 5^3 cells
        expect(point["particles"] == particles, f"{kind} {ranks}: {point['particles']} particles, expected {particles}")
        timed = {"efficiency", "particle_steps_per_second_per_core", "rates", "stage_shares", "speed_up"} & set(point)
        expect(bool(timed) == (ranks < 3), f"{kind} {ranks}: times only up to 2 ranks: {sorted(timed)}")
        expect((point["bytes_per_rank_and_step"] > 0) == (ranks > 1) and point["imbalance"] >= 1,
               f"{kind} {ranks}: bytes and imbalance are there")
    expect(points["strong", 1]["efficiency"] == 1 and points["strong", 1]["speed_up"] == 1, "one rank is the base")
    refused = [line for line in out.splitlines() if NO_EFFICIENCY in line]
    expect(len(refused) == 2 and all(line.split()[1] == "3" and " - " in line for line in refused),
           f"the table refuses an efficiency of 3 ranks: {out}")
    with open(folder / "results.csv", newline="", encoding="utf-8") as file:
        expect([row["efficiency"] != "" for row in csv.DictReader(file)] == [True, True, False] * 2, "so does the CSV")
    for name in ("speed_up", "efficiency", "stage_shares", "message_bytes", "imbalance"):
        expect((folder / f"{name}.png").stat().st_size > 5000, f"{name}.png is drawn")


def check_slurm(folder, tools):
    """With an sbatch that runs the job at once."""
    (tools / "sbatch").write_text('#!/bin/bash\nwhile [[ $1 == --* ]]; do [[ $1 == --ntasks=* ]] && n=${1#*=}; shift; done\n'
                                  'export SLURM_SUBMIT_DIR=$PWD MPM_LAUNCH="$MPM_LAUNCH -n $n"; bash "$@" >/dev/null\n')
    (tools / "sbatch").chmod(0o755)
    path, os.environ["PATH"] = os.environ["PATH"], f"{tools}:{os.environ['PATH']}"
    code, _, err = study("--ranks", "2", "--strong", "--particles", 1000, "--repeats", 1, "--slurm", "--submit", "--output",
                         folder)
    os.environ["PATH"] = path
    expect(code == 0 and "--ntasks=2" in (folder / "submit.sh").read_text(), f"jobs are submitted: {code}, {err}")
    code, out, err = call(scaling, "--collect", folder)
    expect(code == 0 and "1.000" in out, f"and collected: {code}, {err}")


def check_refusals(folder, finished):
    (folder / "wrong.toml").write_text(Block((4, 4, 4)).scene().replace("spacing = 0.01", "spacing = -1"))
    for words, wanted, *arguments in [
            ("neither elastic nor phase", 2, "--scene", "nothing", "--output", folder / "a"),
            ("fixed number of particles", 2, "--scene", folder / "wrong.toml", "--weak", "--output", folder / "b"),
            ("holds a study already", 2, "--output", finished),
            ("no program", 2, "--program", folder / "absent", "--output", folder / "c"),
            ("holds no study", 2, "--collect", folder),
            ("spacing = -1", 2, "--scene", folder / "wrong.toml", "--ranks", "1", "--output", folder / "d")]:
        code, _, err = study(*arguments)
        one_line = err.splitlines()[-1:] and err.splitlines()[-1].startswith("scaling: ")
        expect(code == wanted and one_line and words in err, f"'{words}' and {wanted}: {code}, {err}")
    code, _, err = study("--ranks", "0")
    expect(code == 2 and "above 0" in err, f"no ranks are refused: {code}, {err}")


def check_counts():
    for phase, ranks, partitioner in ((False, 1, "auto"), (False, 3, "auto"), (False, 3, "curve"), (True, 2, "auto")):
        block = Block((16, 12, 12), phase, True, 6, True, cracked=phase, partitioner=partitioner)
        row = measure.counted_and_predicted(mpm.BINARIES / "mpm_hpc", block, ranks, LAUNCHER)
        for what in ("messages", "bytes"):
            counted, predicted = row[f"counted_{what}"], row[f"predicted_{what}"]
            print(f"{'phase field' if phase else 'elastic'}, {ranks} ranks, {partitioner}: {counted} {what} per step counted, "
                  f"{predicted} predicted")
            expect(abs(counted - predicted) < 1e-6 and (counted > 0) == (ranks > 1), f"{what} on {ranks} ranks are exact")
        expect(not phase or row["iterations"] > 0, "the phase solve iterates, so that its traffic counts")


def check_cubes():
    """27 cubes of 2^3 blocks: the one in the middle has the halo of the closed form and 26 neighbours."""
    place = np.arange(6) // 2
    owners = np.pad(9 * place[:, None, None] + 3 * place[None, :, None] + place[None, None, :], 1, mode="edge")
    rank, _, nodes, blocks = halo_count.ghosts(owners, np.pad(np.ones((6, 6, 6), bool), 1))
    expect(nodes[rank == 13].sum() == halo_count.cube_ghosts(8) == 12 ** 3 - 8 ** 3 and (rank == 13).sum() == 26,
           f"halo of a cube: {nodes[rank == 13].sum()}")
    expect(blocks[rank == 13].sum() == 4 ** 3 - 2 ** 3, f"blocks around a cube: {blocks[rank == 13].sum()}")
    expect([near_cubic(n) for n in (1, 2, 8, 12, 7)] == [(1, 1, 1), (2, 1, 1), (2, 2, 2), (3, 2, 2), (7, 1, 1)],
           "ranks are arranged as near to a cube as can be")


def check_prediction(folder):
    code, out, err = call(model, "--output", folder)
    expect(code == 0, f"the model predicts: {code}, {err}")
    rows = json.loads((folder / "model.json").read_text())["rows"]
    expect({row["ranks"] for row in rows} >= {1, 100000}, "from 1 to 100000 ranks")
    for row in rows:
        ok = 0 < row["efficiency"] <= 1.0001 and all(seconds >= 0 for seconds in row["terms"].values())
        expect(ok, f"a sensible row: {row}")
    # A faster network never makes a step longer.
    code, _, _ = call(model, "--output", folder, "--latency", 0, "--bandwidth", 1e15)
    faster = json.loads((folder / "model.json").read_text())["rows"]
    expect(all(new["seconds_per_step"] <= old["seconds_per_step"] for new, old in zip(faster, rows)), "network is monotonic")
    code, _, err = call(model, "--bandwidth", 0)
    expect(code == 2 and "must be positive" in err, f"no bandwidth is refused: {code}, {err}")


def main():
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "tools").mkdir()
        check_cubes()
        check_points(folder / "study")
        check_slurm(folder / "slurm", folder / "tools")
        check_refusals(folder, folder / "study")
        check_counts()
        check_prediction(folder / "model")
    print(f"scaling and model: {len(failures)} failures")
    return 1 if failures else 0


if __name__ == "__main__":
    os.environ.update({name: value for name, value in mpm.ENVIRONMENT.items() if name not in os.environ})
    sys.exit(main())
