#!/usr/bin/python3
"""Does everything wrong that a user can do, and has runs fail, on one rank and on three: mpm_hpc must end
with the right exit code and one sentence that helps, must leave alone what it has no business with, and must
never hang.

    check_faults.py [NAME...]     all cases, or those whose name contains one of the words
    check_faults.py --self-test   programs with planted misbehaviour, each of which must be noticed
"""
import math
import re
import shutil
import sys
import tempfile
from pathlib import Path

sys.dont_write_bytecode = True
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))
import mpm_program as mpm  # noqa: E402
from fault_cases import Case, DISC, changed, scene_case, try_all, try_case  # noqa: E402
from physics_fault_cases import physics_cases  # noqa: E402

try:
    import h5py
except ImportError:
    h5py = None

SECOND_DISC = """\
[[body]]
name = "other"
material = "rubber"
shape = {type = "sphere", center = [0.7, 0.3], radius = 0.15}
particles_per_cell = 4
velocity = [-0.1, 0.1]
"""
BALL = """\
dimension = 3
[domain]
lower = [0, 0, 0]
upper = [1, 1, 1]
[grid]
spacing = 0.1
[time]
end = 0.1
[output]
every = 0.05
[material.rubber]
model = "neo_hookean"
youngs_modulus = 1000
poisson_ratio = 0.3
density = 1000
[[body]]
name = "disc"
material = "rubber"
shape = {type = "sphere", center = [0.5, 0.5, 0.5], radius = 0.2}
particles_per_cell = 8
"""
PLATE = """\
dimension = 2
[domain]
lower = [0, 0]
upper = [1, 1]
[grid]
spacing = 0.05
[time]
end = 0.005
[output]
every = 0.0025
[material.glass]
model = "split_neo_hookean"
youngs_modulus = 1000
poisson_ratio = 0.3
density = 1
fracture_toughness = 1
[[body]]
name = "plate"
material = "glass"
shape = {type = "box", lower = [0.2, 0.2], upper = [0.8, 0.8]}
particles_per_cell = 4
[effect.phase_field]
[[effect.phase_field.crack]]
shape = {type = "box", lower = [0.1, 0.45], upper = [0.5, 0.55]}
[[effect.traction]]
shape = {type = "box", lower = [0.1, 0.7], upper = [0.9, 0.9]}
traction = [0, 5]
area = 0.6
"""


# --- scenes with a fault ------------------------------------------------------------------------------------

def write_mesh(faces):
    """Writes faces of a tetrahedron as solid.stl."""
    corners = [(.3, .3, .3), (.8, .3, .3), (.3, .8, .3), (.3, .3, .8)]

    def write(folder):
        text = ""
        for face in faces:
            vertices = "".join("vertex %g %g %g\n" % corners[c] for c in face)
            text += f"facet normal 0 0 0\nouter loop\n{vertices}endloop\nendfacet\n"
        (folder / "solid.stl").write_text(f"solid t\n{text}endsolid t\n")
    return write


def scene_cases():
    sphere = 'shape = {type = "sphere", center = [0.5, 0.5, 0.5], radius = 0.2}'
    mesh = 'shape = {type = "mesh", file = "solid.stl"}'
    disc = "center = [0.3, 0.3], radius = 0.15"
    return [
        scene_case("unknown key", ['"densty"', 'did you mean "density"'], ("density =", "densty =")),
        scene_case("unknown effect", ['"gravty"', 'did you mean "gravity"'],
                   ("[[body]]", "[effect.gravty]\nacceleration = [0, 1]\n[[body]]"), at="[effect.gravty]"),
        scene_case("wrong type", ["spacing must be a number", "true"], ("spacing = 0.05", "spacing = true")),
        scene_case("unit of another dimension", ["in kg", "m is expected"],
                   ("spacing = 0.05", 'spacing = "0.05 kg"')),
        scene_case("negative density", ["density = -1000", "positive density"],
                   ("density = 1000", "density = -1000")),
        scene_case("poisson ratio of one half", ["poisson_ratio = 0.5", "below 0.5"],
                   ("poisson_ratio = 0.3", "poisson_ratio = 0.5")),
        scene_case("NaN", ["velocity", "nan is not finite", "ordinary number"],
                   ("velocity = [0.1, 0.1]", "velocity = [nan, 0.1]")),
        scene_case("infinity", ["youngs_modulus", "inf is not finite", "ordinary number"],
                   ("youngs_modulus = 1000", "youngs_modulus = inf")),
        scene_case("body outside the domain", ['body "disc"', r"at \([^)]*\) m", "enlarge domain"],
                   (disc, "center = [0.95, 0.3], radius = 0.15"), at="[[body]]"),
        scene_case("empty body", ['body "disc" has no particles', "enlarge it or refine grid.spacing"],
                   (disc, "center = [0.3, 0.3], radius = 1e-6"), at="[[body]]"),
        scene_case("empty crack", ["crack holds no particle", "refine grid.spacing"],
                   ("lower = [0.1, 0.45], upper = [0.5, 0.55]", "lower = [0.1, 0.4999], upper = [0.5, 0.5001]"),
                   scene=PLATE, at="[[effect.phase_field.crack]]"),
        scene_case("missing mesh", ["solid.stl", "check the path"], (sphere, mesh), scene=BALL),
        scene_case("mesh with a hole", ["solid.stl", "not watertight: 3 open edges", "close the holes"],
                   (sphere, mesh), scene=BALL, prepare=write_mesh([(0, 2, 1), (0, 1, 3), (0, 3, 2)])),
        scene_case("unknown field of the frames", ['"velcity"', 'did you mean "velocity"'],
                   ("[output]", '[output]\nfields = ["velcity"]'), at="fields ="),
        scene_case("TOML syntax", ["TOML"], ("spacing = 0.05", "spacing = = 0.05")),
        scene_case("fixed step too large", [r"time\.dt = 0\.5 s", "unstable", "lower it"],
                   ("end = 0.5", "end = 0.5\ndt = 0.5"), at="dt = 0.5"),
        Case("override at fault", 2, [r"--set material\.rubber\.density", "positive density"],
             arguments=("--set", "material.rubber.density=-1")),
        Case("override of an unknown key", 2, [r"--set grid\.spcing", 'did you mean "spacing"'],
             arguments=("--set", "grid.spcing=0.1")),
    ]


# --- command line and output folder -------------------------------------------------------------------------

def put_run(runs):
    """Puts a finished run into the folder `out`."""
    def prepare(folder):
        shutil.copytree(runs["disc"], folder / "out")
        (folder / "out" / "notes.txt").write_text("mine")
    return prepare


def run_was_replaced(folder, outcome, ranks):
    steps = mpm.report(folder / "out")["steps"]
    left = sorted(mpm.checkpoints(folder / "out"))
    return ([f"{steps} steps in run.json, expected 3"] if steps != 3 else []) + (
        [f"checkpoints {left}, expected that of step 3"] if left != [3] else []) + (
        [] if (folder / "out" / "notes.txt").read_text() == "mine" else ["notes.txt was changed"])


def command_line_cases(runs):
    plain = ("--output", "out")
    petsc = dict(scene=PLATE, starts=True)
    return [
        Case("missing scene file", 2, ["nowhere.toml", "no such scene file"],
             scene_argument=("nowhere.toml",)),
        Case("folder as scene", 2, ["folder", r"\.toml"], scene_argument=("folder",),
             prepare=lambda folder: (folder / "folder").mkdir()),
        Case("no scene", 2, ["scene", "--help"], scene_argument=()),
        Case("unknown option", 2, ["--bogus", "--help"], arguments=("--bogus",)),
        Case("wrong value of an option", 2, ["--steps", "abc"], arguments=("--steps", "abc")),
        Case("unread PETSc option", 2, ["-phase_ksp_rtoll", "--help"],
             arguments=("-phase_ksp_rtoll", "1e-3")),
        Case("output below a file", 4, ["scene.toml/out", "--output"],
             arguments=("--output", "scene.toml/out")),
        Case("existing run", 2, ["out", "holds a run", "--output", "--force"], arguments=plain,
             prepare=put_run(runs)),
        Case("existing run, forced", 0, arguments=(*plain, "--force", "--steps", "3"), prepare=put_run(runs),
             starts=True, after=run_was_replaced),
        Case("validate", 0, arguments=(*plain, "--validate"), prepare=put_run(runs)),
        Case("explain", 0, arguments=(*plain, "--explain"), prepare=put_run(runs)),
        Case("describe", 0, arguments=("--describe",), scene_argument=()),
        Case("describe as JSON", 0, arguments=("--describe", "--json"), scene_argument=()),
        Case("help", 0, arguments=("--help",), scene_argument=()),
        Case("PETSc does not converge", 3, [r"step \d+", "not converge in 1 iterations", "-phase_ksp_max_it"],
             arguments=(*plain, "-phase_ksp_max_it", "1", "-phase_ksp_rtol", "1e-14"), after=failed_state,
             **petsc),
        Case("unknown type for PETSc", 2, ["-phase_pc_type", "nonsense"], scene=PLATE,
             arguments=(*plain, "-phase_pc_type", "nonsense")),
        Case("wrong number for PETSc", 2, ["-phase_ksp_max_it", "abc"], scene=PLATE,
             arguments=(*plain, "-phase_ksp_max_it", "abc")),
        Case("preconditioner that wants a matrix", 2, ["operator", "assembled"], scene=PLATE,
             arguments=(*plain, "-phase_pc_type", "gamg", "--set", "effect.phase_field.operator=stencil")),
        Case("PETSc options that a solve reads", 0, arguments=(*plain, "-phase_ksp_converged_reason",
             "-phase_pc_type", "gamg", "-phase_mg_levels_ksp_type", "chebyshev"), **petsc),
    ]


# --- checkpoints --------------------------------------------------------------------------------------------

NAME = "checkpoint_000000040.h5"


def checkpoint_case(name, words, make, scene=DISC, code=4):
    """`make` (source folder, place for the file) writes the checkpoint that the run is to start from."""
    def prepare(folder):
        (folder / "out").mkdir()
        make(folder / "out")
    return Case(f"checkpoint: {name}", code, words, scene, prepare=prepare,
                arguments=("--output", "out", "--until", "1", "--restart", f"out/{NAME}"))


def checkpoint_cases(runs):
    def newest(run):
        found = mpm.checkpoints(runs[run])
        return found[max(found)]

    def from_bytes(edit):
        return lambda folder: (folder / NAME).write_bytes(edit(newest("disc").read_bytes()))

    def flipped(data):
        """The velocity of the last particle; h5py tells where it is, else it is taken from the middle."""
        place = len(data) // 2
        if h5py:
            with h5py.File(newest("disc")) as file:
                column = next(d for d in file["bodies"].values())["velocity"]
                place = column.id.get_offset() + column.id.get_storage_size() - 1
        return data[:place] + bytes([data[place] ^ 1]) + data[place + 1:]

    def with_h5(edit, start=True):
        def make(folder):
            path = folder / NAME
            if start:
                shutil.copy(newest("disc"), path)
            with h5py.File(path, "a") as file:
                edit(file)
        return make

    def copied(run):
        return lambda folder: shutil.copy(newest(run), folder / NAME)

    name = re.escape(f"out/{NAME}")
    again = "restart from the checkpoint before it or from a copy"
    cases = [
        checkpoint_case("missing", [name, "does not exist", r"checkpoint_\*\.h5"], lambda folder: None),
        checkpoint_case("damaged", [name, "damaged", "checksum", again], from_bytes(flipped)),
        checkpoint_case("truncated", [name, "cut short", again], from_bytes(lambda d: d[:len(d) // 2])),
        checkpoint_case("head cut off", [name, again], from_bytes(lambda d: d[:20])),
        checkpoint_case("empty", [name, "empty", again], from_bytes(lambda d: b"")),
        checkpoint_case("foreign", [name, "no HDF5 file"], from_bytes(lambda d: b"No checkpoint.\n" * 99)),
        checkpoint_case("of another dimension", [name, "of a 3D run, the scene is 2D"], copied("ball")),
        checkpoint_case("of other bodies", [name, 'has no body "other"'], copied("disc"), DISC + SECOND_DISC),
        checkpoint_case("of another precision", [name, "precision"], copied("disc"),
                        changed(DISC, ("dimension = 2", 'dimension = 2\nprecision = "single"'))[0]),
        checkpoint_case("of a later time", [name, r"time\.end"], copied("late"), code=2),
    ]
    if h5py:
        cases += [
            checkpoint_case("foreign HDF5", [name, "no checkpoint of mpm_hpc"],
                            with_h5(lambda file: file.create_dataset("x", data=[1.0]), start=False)),
            checkpoint_case("from the future", [name, "newer version of mpm_hpc", "that version or a newer"],
                            with_h5(lambda file: file.attrs.modify("format_version", 1000))),
            checkpoint_case("never completed", [name, "never completed"],
                            with_h5(lambda file: file.attrs.modify("complete", 0))),
        ]
    return cases


# --- particles that leave, numbers that explode -------------------------------------------------------------

def failed_state(folder, outcome, ranks):
    """After a numerical failure: a complete checkpoint beside the good ones, and the reason in run.json."""
    complaints = []
    found = list(mpm.checkpoints(folder / "out" / "failed").values())
    if len(found) != 1:
        complaints.append(f"{len(found)} checkpoints in out/failed, expected 1")
    elif found[0].name not in outcome.err:
        complaints.append(f"the sentence doesn't name {found[0].name}")
    elif h5py:
        with h5py.File(found[0]) as file:
            if file.attrs["complete"] != 1:
                complaints.append("the checkpoint in out/failed is not complete")
    end = mpm.report(folder / "out")["exit"]
    if end["code"] != 3 or end["reason"] not in outcome.err or not end["reason"]:
        complaints.append(f"run.json says {end}, expected code 3 and the reason that stderr gives")
    return complaints


def left_domain(folder, outcome, ranks):
    """The particle and the place that the sentence names: one of the scene's, and outside."""
    complaints = failed_state(folder, outcome, ranks)
    named = re.search(r'particle (\d+) of body "disc".* at \(([^,]*), ([^)]*)\) m', outcome.err)
    particles = mpm.history(folder / "out")[0]["particles"]
    if not named:
        complaints.append("no particle and place in the sentence")
    elif not 0 <= int(named[1]) < particles or all(0 <= float(named[i]) <= 1 for i in (2, 3)):
        complaints.append(f"particle {named[1]} of {particles:g} at ({named[2]}, {named[3]}) is not outside")
    return complaints


def counted(guard, loses):
    """The guard in run.json against the number of particles in history.csv."""
    def after(folder, outcome, ranks):
        rows = mpm.history(folder / "out")
        lost = rows[0]["particles"] - rows[-1]["particles"]
        times = mpm.report(folder / "out")["guards"][guard]
        mass = rows[-1]["mass"] / rows[0]["mass"]
        left = rows[-1]["particles"] / rows[0]["particles"]
        complaints = []
        if times <= 0 or lost != (times if loses else 0):
            complaints.append(f"{guard} = {times} in run.json, but {lost:g} particles fewer in history.csv")
        if not math.isclose(mass, left, rel_tol=1e-12):
            complaints.append(f"{mass} of the mass is left, but {left} of the particles")
        return complaints
    return after


def failure_cases():
    leaving = changed(DISC, ("velocity = [0.1, 0.1]", "velocity = [1, 0.3]"), ("end = 0.5", "end = 0.7"))[0]
    crash = changed(DISC + SECOND_DISC, ("center = [0.7, 0.3]", "center = [0.65, 0.3]"))[0]

    def faster(speed):
        return changed(crash, ("velocity = [0.1, 0.1]", f"velocity = [{speed}, 0]"),
                       ("velocity = [-0.1, 0.1]", f"velocity = [-{speed}, 0]"))[0]

    begun = dict(arguments=("--output", "out"), starts=True)
    deleting, keeping = (changed(leaving, ("[grid]", f'on_leave = "{policy}"\n[grid]'))[0]
                         for policy in ("delete", "keep"))
    named = [r"step \d+", r't = \S+ s', r'particle \d+ of body "(disc|other)"', r"at \([^)]*\) m"]
    return [
        Case("particle leaves: stop", 3, [*named[:2], "left the domain", "enlarge the domain", "on_leave"],
             leaving, after=left_domain, **begun),
        Case("particle leaves: delete", 0, scene=deleting,
             after=counted("particles_removed_outside_domain", True), **begun),
        Case("particle leaves: keep", 0, scene=keeping,
             after=counted("particles_put_back_onto_wall", False), **begun),
        *(Case(f"impact at {speed} wave speeds", 3, [*named, "try|enlarge"], faster(speed),
               after=failed_state, **begun) for speed in ("1e3", "1e9")),
    ]


# --- the whole ----------------------------------------------------------------------------------------------

def make_runs(folder):
    """Finished runs that the cases start from. Returns {name: folder}."""
    scenes = {"disc": DISC, "ball": BALL, "late": changed(DISC, ("end = 0.5", "end = 1.5"))[0]}
    runs = {}
    for name, scene in scenes.items():
        (folder / f"{name}.toml").write_text(scene, encoding="utf-8")
        outcome = mpm.run([f"{name}.toml"], 1, folder)
        if outcome.code != 0:
            raise SystemExit(f"the run {name} without a fault ends with {outcome.code}:\n{outcome.err}")
        runs[name] = folder / name
    return runs


def main(wanted):
    if not h5py:
        print("SKIPPED for want of h5py (Debian: python3-h5py): checkpoints that are foreign HDF5, from the "
              "future, or incomplete")
    with tempfile.TemporaryDirectory() as name:
        runs = make_runs(Path(name))
        cases = scene_cases() + physics_cases() + command_line_cases(runs) + checkpoint_cases(runs) + failure_cases()
        return try_all(cases, wanted)


# --- self-test ----------------------------------------------------------------------------------------------

SENTENCE = 'echo "mpm_hpc: error: scene.toml:15:1: densty; did you mean density?" >&2'
# What the program does, and the complaint that must come of it; None: it does all right.
BEHAVIOURS = [
    (f"{SENTENCE}; exit 2", None),
    (f"{SENTENCE}; exit 3", "exit code 3, expected 2"),
    (f"{SENTENCE}; exit 0", "exit code 0, expected 2"),
    (f"{SENTENCE}; kill -SEGV $$", "exit code -11, expected 2"),
    (f"{SENTENCE}; {SENTENCE}; exit 2", "2 lines of mpm_hpc on stderr"),
    (f"{SENTENCE}; echo PETSC ERROR >&2; exit 2", "more than the error sentence"),
    ("exit 2", "0 lines of mpm_hpc on stderr"),
    ('echo "mpm_hpc: error: scene.toml:14:1: densty; did you mean density?" >&2; exit 2', "lacks the place"),
    ('echo "mpm_hpc: error: scene.toml:15:1: densty is unknown" >&2; exit 2', "lacks 'did you mean"),
    (f"mkdir out; {SENTENCE}; exit 2", "out was created"),
    (f"echo x > run.json; {SENTENCE}; exit 2", "run.json was created"),
    (f"echo x >> scene.toml; {SENTENCE}; exit 2", "scene.toml was changed"),
    (f"{SENTENCE}; sleep 30", "it hung"),
]


def self_test():
    case = scene_case("unknown key", ["densty", "did you mean"], ("density =", "densty ="))
    missed = 0
    with tempfile.TemporaryDirectory() as name:
        program = Path(name) / "program"
        for behaviour, expected in BEHAVIOURS:
            program.write_text(f"#!/bin/sh\n{behaviour.replace('sleep', 'exec sleep')}\n")
            program.chmod(0o755)
            _, complaints = try_case(case, 1, program, limit=2)
            noticed = any(expected in complaint for complaint in complaints) if expected else not complaints
            if not noticed:
                print(f"WRONG: '{behaviour}' gave {complaints}, expected {expected}")
                missed += 1
    right = sum(expected is None for _, expected in BEHAVIOURS)
    print(f"self-test: {len(BEHAVIOURS) - right} faults planted, {missed} things wrong")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(self_test() if sys.argv[1:] == ["--self-test"] else main(sys.argv[1:]))
