"""Cases in which something goes wrong, and how they are run and judged: for the scripts in tests/checks."""
import re
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Callable, Optional

import mpm_program as mpm

RANKS = (1, 3)
AT_ONCE = 2  # runs

DISC = """\
dimension = 2
[domain]
lower = [0, 0]
upper = [1, 1]
[grid]
spacing = 0.05
[time]
end = 0.5
[output]
every = 0.25
[material.rubber]
model = "neo_hookean"
youngs_modulus = 1000
poisson_ratio = 0.3
density = 1000
[[body]]
name = "disc"
material = "rubber"
shape = {type = "sphere", center = [0.3, 0.3], radius = 0.15}
particles_per_cell = 4
velocity = [0.1, 0.1]
"""


def changed(scene, *edits):
    """The scene with texts replaced, and the line (from 1) on which the last replacement begins."""
    line = 0
    for old, new in edits:
        assert scene.count(old) == 1, f"{old!r} occurs {scene.count(old)} times in the scene"
        line = scene[:scene.index(old)].count("\n") + 1
        scene = scene.replace(old, new)
    return scene, line


@dataclass
class Case:
    """One way to start the program and what must come of it."""
    name: str
    code: int
    words: list = field(default_factory=list)  # patterns that the error sentence must match
    scene: str = DISC
    line: int = 0  # of the scene, if one is at fault
    arguments: tuple = ()
    starts: bool = False  # whether it comes to the first step, so that there is output
    prepare: Optional[Callable] = None  # (folder): puts further files there
    after: Optional[Callable] = None  # (folder, outcome, ranks): returns complaints
    scene_argument: tuple = ("scene.toml",)
    flow: Optional[Callable] = None  # (case, folder, ranks): in place of a run; returns its like
    ranks: tuple = RANKS


def scene_case(name, words, *edits, scene=DISC, at=None, **more):
    """A scene with the fault on the line of the last edit, or on the line that begins with `at`."""
    text, line = changed(scene, *edits)
    if at:
        line = text[:text.index(at)].count("\n") + 1
    return Case(name, 2, words, text, line, **more)


def error_sentence(outcome, ranks):
    """The sentence and complaints about everything else on stderr."""
    lines = [line for line in outcome.err.splitlines() if line.strip()]
    ours = [line for line in lines if "mpm_hpc:" in line]
    complaints = []
    if len(ours) != 1 or not ours[0].startswith("mpm_hpc: error: "):
        complaints.append(f"{len(ours)} lines of mpm_hpc on stderr, expected one 'mpm_hpc: error: ...'")
    if ranks == 1 and len(lines) > len(ours):
        complaints.append("more than the error sentence on stderr")  # with more ranks mpirun speaks too
    for word in ("MPI_ABORT", "PETSC ERROR", "HDF5-DIAG", "what():", "Segmentation", "Aborted"):
        if word in outcome.err:
            complaints.append(f"stderr has {word}")
    return ours[0] if ours else "", complaints


def judge(case, outcome, ranks):
    """Complaints about the exit code and the error sentence."""
    if outcome.hung:
        return ["it hung and was killed"]
    complaints = [] if outcome.code == case.code else [f"exit code {outcome.code}, expected {case.code}"]
    if case.code in (0, 75):
        if "mpm_hpc:" in outcome.err:
            complaints.append("an error sentence, though nothing is wrong")
        return complaints
    sentence, more = error_sentence(outcome, ranks)
    complaints += more
    for pattern in case.words:
        if not re.search(pattern, sentence):
            complaints.append(f"the sentence lacks '{pattern}'")
    if case.line and not re.search(rf"scene\.toml:{case.line}\b", sentence):
        complaints.append(f"the sentence lacks the place scene.toml:{case.line}")
    return complaints


def try_case(case, ranks, program=None, limit=None):
    """Returns (outcome, complaints)."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "scene.toml").write_text(case.scene, encoding="utf-8")
        if case.prepare:
            case.prepare(folder)
        if case.flow:
            return case.flow(case, folder, ranks)
        before = mpm.snapshot(folder)
        arguments = [*case.scene_argument, *case.arguments]
        outcome = mpm.run(arguments, ranks, folder, program, limit)
        complaints = judge(case, outcome, ranks)
        if not case.starts:
            now = mpm.snapshot(folder)
            for path in sorted(before.keys() | now.keys()):
                if path not in before:
                    complaints.append(f"{path} was created")
                elif before[path] != now.get(path):
                    complaints.append(f"{path} was changed or removed")
        if case.after and not outcome.hung:
            try:
                complaints += case.after(folder, outcome, ranks)
            except (OSError, ValueError, KeyError, IndexError) as error:
                complaints.append(f"what it left behind can't be read: {error!r}")
        return outcome, complaints


def tell(case, ranks, outcome, complaints):
    words = f"exit code {outcome.code}, expected {case.code}"
    sentence = next((line for line in outcome.err.splitlines() if "mpm_hpc:" in line), "")
    print(f"{'WRONG' if complaints else 'ok   '} {case.name}, {ranks} ranks: {words}. {sentence}", flush=True)
    for complaint in complaints:
        print(f"      {complaint}")
    if complaints and (outcome.hung or outcome.code != case.code or not sentence):
        print(f"      stderr: {outcome.err[-1500:]}", flush=True)


def try_all(cases, wanted):
    """Runs the cases whose name contains one of the wanted words, or all. Returns the exit code."""
    began = time.monotonic()
    jobs = [(case, ranks) for case in cases for ranks in case.ranks
            if not wanted or any(word in case.name for word in wanted)]
    with ThreadPoolExecutor(AT_ONCE) as pool:
        results = list(pool.map(lambda job: (job, *try_case(*job)), jobs))
    wrong = 0
    for (case, ranks), outcome, complaints in results:
        tell(case, ranks, outcome, complaints)
        wrong += bool(complaints)
    print(f"{len(results)} runs with faults, {wrong} wrong, {time.monotonic() - began:.0f} s")
    return 1 if wrong or not results else 0
