#!/usr/bin/python3
"""The same scene twice, after a restart, and on other numbers of ranks: what must be equal bit by bit, and
what to 1e-10.

    check_restart.py              an impact in 2D and in 3D, with re-balancing, and a crack
    check_restart.py --self-test  results with planted differences, each of which must be noticed
"""
import math
import re
import shutil
import struct
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

sys.dont_write_bytecode = True
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))
import mpm_program as mpm  # noqa: E402

try:
    import h5py
except ImportError:
    h5py = None

AT_ONCE = 2  # runs
STEPS = 200
TOLERANCE = 1e-10
RANKS = (1, 2, 3, 4, 8)
CURVE_RANKS = {"2_curve": 2, "3_curve": 3, "8_curve": 8}
SPEED = 0.2  # [m/s] of either body

# Two bodies that meet off centre, deform, turn and part within STEPS steps.
IMPACT = """\
dimension = {dimension}
[domain]
lower = {lower}
upper = {upper}
[grid]
spacing = {spacing}
[time]
end = 100
[output]
every = {every}
history_every = {history_every}
checkpoint_every = {checkpoint_every}
[parallel]
rebalance_threshold = 1.02
[material.rubber]
model = "neo_hookean"
youngs_modulus = 1000
poisson_ratio = 0.3
density = 1000
[[body]]
name = "left"
material = "rubber"
shape = {{type = "sphere", center = {left}, radius = 0.15}}
particles_per_cell = {particles_per_cell}
velocity = {velocity}
[[body]]
name = "right"
material = "rubber"
shape = {{type = "sphere", center = {right}, radius = 0.15}}
particles_per_cell = {particles_per_cell}
velocity = {opposite}
"""
IMPACTS = {
    2: IMPACT.format(dimension=2, lower=[-0.5] * 2, upper=[1.5] * 2, spacing=0.025, every=0.4,
                     history_every=0.04, checkpoint_every=0.75, left=[0.3, 0.47], right=[0.64, 0.53],
                     particles_per_cell=4, velocity=[SPEED, 0], opposite=[-SPEED, 0]),
    3: IMPACT.format(dimension=3, lower=[-0.5] * 3, upper=[1.5] * 3, spacing=0.05, every=0.8,
                     history_every=0.08, checkpoint_every=1.5, left=[0.3, 0.47, 0.5],
                     right=[0.66, 0.53, 0.52], particles_per_cell=8, velocity=[SPEED, 0, 0],
                     opposite=[-SPEED, 0, 0]),
}


def partitioned_by(name, scene):
    return scene.replace("[parallel]\n", f"[parallel]\npartitioner = \"{name}\"\n")


# A notched plate torn until the notch grows; rows and checkpoints fall on different steps.
CRACK = """\
dimension = 2
[domain]
lower = [0, 0]
upper = [1, 1]
[grid]
spacing = 0.04
[time]
end = 0.04
[output]
every = 0.01
history_every = 0.001
checkpoint_every = 0.0213
[parallel]
rebalance_threshold = 1.02
[material.glass]
model = "split_neo_hookean"
youngs_modulus = 1000
poisson_ratio = 0.2
density = 1
fracture_toughness = 1
[[body]]
name = "plate"
material = "glass"
shape = {type = "box", lower = [0.2, 0.2], upper = [0.8, 0.8]}
particles_per_cell = 4
[effect.phase_field]
[[effect.phase_field.crack]]
shape = {type = "box", lower = [0.1, 0.45], upper = [0.4, 0.55]}
[[effect.traction]]
shape = {type = "box", lower = [0.1, 0.75], upper = [0.9, 0.9]}
traction = [0, 25]
area = 0.6
[[effect.traction]]
shape = {type = "box", lower = [0.1, 0.1], upper = [0.9, 0.25]}
traction = [0, -25]
area = 0.6
"""

wrong = []


def expect(what, found, expected, ok):
    """Prints what was found beside what was expected."""
    print(f"{'ok   ' if ok else 'WRONG'} {what}: found {found}, expected {expected}", flush=True)
    if not ok:
        wrong.append(what)


# --- comparisons --------------------------------------------------------------------------------------------

def rows_of(folder):
    """The rows of history.csv as they are written, by their step."""
    lines = (folder / "history.csv").read_bytes().splitlines()
    return lines[0], {int(float(line.split(b",")[0])): line for line in lines[1:]}


def differing_datasets(first, second):
    """Names of the datasets and attributes of two checkpoints that differ; without h5py the whole files."""
    if not h5py:
        return [] if first.read_bytes() == second.read_bytes() else ["the file"]

    def content(path):
        found = {}
        with h5py.File(path) as file:
            def visit(name, thing):
                found.update({f"{name}@{key}": bytes(memoryview(value).cast("B")) if hasattr(value, "dtype")
                              else value for key, value in thing.attrs.items()})
                if isinstance(thing, h5py.Dataset):
                    found[name] = (str(thing.dtype), thing.shape, thing[()].tobytes())
            visit("/", file)
            file.visititems(visit)
        return found
    a, b = content(first), content(second)
    return sorted(name for name in a.keys() | b.keys() if a.get(name) != b.get(name))


def expect_same_bits(what, first, second, after=None):
    """history.csv (rows after a step only, if given) and the last checkpoint of two runs."""
    (header, rows), (other_header, other_rows) = rows_of(first), rows_of(second)
    if after is not None:
        rows, other_rows = ({s: r for s, r in part.items() if s > after} for part in (rows, other_rows))
    differ = sorted(s for s in rows.keys() | other_rows.keys() if rows.get(s) != other_rows.get(s))
    found = f"{len(rows)} equal rows"
    if differ:
        found = f"differences from step {differ[0]} on in {len(differ)} rows"
    if differ and rows.get(differ[0]) and other_rows.get(differ[0]):
        cells = zip(header.split(b","), rows[differ[0]].split(b","), other_rows[differ[0]].split(b","))
        found += "".join(f"; {n.decode()}: {a.decode()} and {b.decode()}" for n, a, b in cells if a != b)
    expect(f"{what}, history.csv", found, "the same bytes", not differ and rows and header == other_header)
    step, other = max(mpm.checkpoints(first)), max(mpm.checkpoints(second))
    differ = differing_datasets(mpm.checkpoints(first)[step], mpm.checkpoints(second)[other])
    expect(f"{what}, checkpoint of step {step}", f"step {other}, differing: {', '.join(differ) or 'nothing'}",
           "the same content", step == other and not differ)


def frames_are_same(first, second):
    names = sorted(path.name for path in first.glob("frame*"))
    differ = [name for name in names
              if not (second / name).exists() or (first / name).read_bytes() != (second / name).read_bytes()]
    return names and not differ, ", ".join(differ) or f"{len(names)} equal files"


def expect_close(what, first, second, scales):
    """Rows of two histories: mass exact, columns of `scales` = {pattern: scale} to TOLERANCE of the scale."""
    rows, others = mpm.history(first), mpm.history(second)
    # A run that was restarted has no rows from before.
    rows = [row for row in rows if row["step"] >= others[0]["step"]]
    steps, other_steps = [row["step"] for row in rows], [row["step"] for row in others]
    if steps != other_steps:
        expect(f"{what}, steps of the rows", other_steps, steps, False)
        return
    masses = {row["mass"] for row in rows + others}
    expect(f"{what}, mass", f"{sorted(masses)}", "one and the same number", len(masses) == 1)
    for pattern, scale in {**scales, "time": rows[-1]["time"]}.items():
        names = [name for name in rows[0] if re.fullmatch(pattern, name)]
        apart = [abs(a[name] - b[name]) / scale for a, b in zip(rows, others) for name in names]
        worst = max(apart) if all(map(math.isfinite, apart)) else math.inf
        expect(f"{what}, {pattern} in {len(rows)} rows", f"{worst:.1e}", f"at most {TOLERANCE:g}",
               worst <= TOLERANCE)


def expect_same_places(what, first, second):
    """Positions [m] in the last checkpoints, particle by particle."""
    if not h5py:
        return
    tables = []
    for folder in (first, second):
        found = mpm.checkpoints(folder)
        with h5py.File(found[max(found)]) as file:
            tables.append([(body["id"][()].ravel().tolist(), body["position"][()].tolist())
                           for body in file["bodies"].values()])
    apart = [math.dist(x, y) if i == j else math.inf for (ids, a), (others, b) in zip(*tables)
             for i, j, x, y in zip(ids, others, a, b)]
    sizes = [sum(len(ids) for ids, _ in table) for table in tables]
    worst = max(apart) if all(map(math.isfinite, apart)) and len(set(sizes)) == 1 else math.inf
    expect(f"{what}, places of {sizes[0]} particles", f"{worst:.1e} m apart", f"at most {TOLERANCE:g}",
           worst <= TOLERANCE)


def impact_scales(folder):
    """What the columns are relative to: the sums of |m v|, of |x| |m v| (up to 1 m away), and the energy."""
    start = mpm.history(folder)[0]
    momentum = start["mass"] * SPEED
    return {"momentum_.": momentum, "angular_momentum_.": momentum,
            "(kinetic|elastic)_energy": start["kinetic_energy"]}


# --- runs ---------------------------------------------------------------------------------------------------

class Runs:
    """Runs of scenes in one folder, by name, two at a time."""

    def __init__(self, folder):
        self.folder = folder

    def make(self, wanted):
        """wanted: {name: (scene text, ranks, further arguments)}"""
        with ThreadPoolExecutor(AT_ONCE) as pool:
            for name, outcome in zip(wanted, pool.map(self.one, wanted.items())):
                if outcome.code != 0 or outcome.hung:
                    raise SystemExit(f"WRONG the run {name} ends with exit code {outcome.code} (hung: "
                                     f"{outcome.hung}), expected 0:\n{outcome.err}")

    def one(self, item):
        name, (scene, ranks, arguments) = item
        file = self.folder / f"{name}.toml"
        file.write_text(scene, encoding="utf-8")
        return mpm.run([file.name, *arguments], ranks, self.folder)

    def __getitem__(self, name):
        return self.folder / name

    def first_checkpoint(self, name):
        found = mpm.checkpoints(self[name])
        return min(found), found[min(found)]


def owners_changed(folder):
    """Whether the blocks' owners in the last two checkpoints differ: None if that can't be read."""
    paths = list(mpm.checkpoints(folder).values())
    if not h5py or len(paths) < 2:
        return None
    tables = []
    for path in paths:
        with h5py.File(path) as file:
            tables.append(file["owners"][()].tolist() + file["curve_cuts"][()].tolist())
    return tables[0] != tables[-1]


def check_contact(dimension, folder):
    rows = mpm.history(folder)
    share = max(row["elastic_energy"] for row in rows) / rows[0]["kinetic_energy"]
    expect(f"{dimension}D impact, largest elastic energy over kinetic energy at the start", f"{share:.3f}",
           "more than 0.1, so the bodies are in contact", share > 0.1)
    expect(f"{dimension}D impact, steps", int(rows[-1]["step"]), STEPS, rows[-1]["step"] == STEPS)


def check_rebalancing(dimension, runs):
    acted = {}
    for ranks in [*RANKS[1:], *CURVE_RANKS]:
        report = mpm.report(runs[f"impact{dimension}_n{ranks}"])
        acted[ranks] = report.get("rebalances", owners_changed(runs[f"impact{dimension}_n{ranks}"]))
    if all(value is None for value in acted.values()):
        print("SKIPPED whether re-balancing acted: no number in run.json, and no h5py to compare the owners")
        return
    expect(f"{dimension}D impact, re-balancing by ranks", acted, "it acted on some", any(acted.values()))


def check_impact(dimension, runs):
    def name(ranks):
        return runs[f"impact{dimension}_n{ranks}"]

    what = f"{dimension}D impact"
    check_contact(dimension, name(1))
    check_rebalancing(dimension, runs)
    expect_same_bits(f"{what}, twice on 3 ranks", name(3), runs[f"impact{dimension}_again"])
    same, found = frames_are_same(name(3), runs[f"impact{dimension}_again"])
    expect(f"{what}, twice on 3 ranks, frames", found, "the same bytes", same)
    scales = impact_scales(name(1))
    for ranks in [*RANKS[1:], *CURVE_RANKS]:
        expect_close(f"{what} on {ranks} ranks and on 1", name(1), name(ranks), scales)
        expect_same_places(f"{what} on {ranks} ranks and on 1", name(1), name(ranks))
    step, _ = runs.first_checkpoint(f"impact{dimension}_n2")
    expect(f"{what}, step of the restart", step, f"between 0 and {STEPS}", 0 < step < STEPS)
    expect_same_bits(f"{what}, restart 2 -> 2 ranks", name(2), runs[f"impact{dimension}_2to2"], step)
    expect_close(f"{what}, restart 2 -> 3 ranks", name(2), runs[f"impact{dimension}_2to3"], scales)
    expect_same_places(f"{what}, restart 2 -> 3 ranks", name(2), runs[f"impact{dimension}_2to3"])
    step, _ = runs.first_checkpoint(f"impact{dimension}_n3_curve")
    expect_same_bits(f"{what}, restart 3 -> 3 ranks on the curve", name("3_curve"), runs[f"impact{dimension}_curve_3to3"], step)
    for target in ("curve_3to2", "metis_3to3"):
        expect_close(f"{what}, restart from the curve, {target}", name("3_curve"), runs[f"impact{dimension}_{target}"], scales)
        expect_same_places(f"{what}, restart from the curve, {target}", name("3_curve"), runs[f"impact{dimension}_{target}"])
    expect_close(f"{what}, restart 4 -> 1 ranks", name(4), runs[f"impact{dimension}_4to1"], scales)
    expect_same_places(f"{what}, restart 4 -> 1 ranks", name(4), runs[f"impact{dimension}_4to1"])


def check_crack(runs):
    rows = mpm.history(runs["crack"])
    start, end = rows[0]["broken_fraction"], rows[-1]["broken_fraction"]
    expect("crack, broken share of the volume", f"{start:.4f} at the start, {end:.4f} at the end", "growth",
           0 < start < end)
    expect_same_bits("crack, twice on 2 ranks", runs["crack"], runs["crack_again"])
    step, _ = runs.first_checkpoint("crack")
    last = rows[-1]["step"]
    expect("crack, step of the restart", step, f"between 0 and {last:g}", 0 < step < last)
    expect_same_bits("crack, restart 2 -> 2 ranks", runs["crack"], runs["crack_restarted"], step)


def main():
    began = time.monotonic()
    if not h5py:
        print("SKIPPED for want of h5py (Debian: python3-h5py): single particles, datasets, owners of blocks")
    with tempfile.TemporaryDirectory() as folder:
        runs = Runs(Path(folder))
        steps = ("--steps", STEPS)
        wanted = {"crack": (CRACK, 2, ()), "crack_again": (CRACK, 2, ())}
        for dimension, scene in IMPACTS.items():
            wanted[f"impact{dimension}_again"] = (scene, 3, steps)
            wanted.update({f"impact{dimension}_n{ranks}": (scene, ranks, steps) for ranks in RANKS})
            wanted.update({f"impact{dimension}_n{name}": (partitioned_by("curve", scene), ranks, steps) for name, ranks in CURVE_RANKS.items()})
        runs.make(wanted)
        step, checkpoint = runs.first_checkpoint("crack")
        wanted = {"crack_restarted": (CRACK, 2, ("--restart", checkpoint))}
        for dimension, scene in IMPACTS.items():
            for source, target in ((2, 2), (2, 3), (4, 1)):
                step, checkpoint = runs.first_checkpoint(f"impact{dimension}_n{source}")
                wanted[f"impact{dimension}_{source}to{target}"] = (
                    scene, target, ("--restart", checkpoint, "--steps", STEPS - step))
            step, checkpoint = runs.first_checkpoint(f"impact{dimension}_n3_curve")
            further = ("--restart", checkpoint, "--steps", STEPS - step)
            wanted.update({f"impact{dimension}_curve_3to3": (partitioned_by("curve", scene), 3, further),
                           f"impact{dimension}_curve_3to2": (partitioned_by("curve", scene), 2, further),
                           f"impact{dimension}_metis_3to3": (partitioned_by("metis", scene), 3, further)})
        runs.make(wanted)
        for dimension in IMPACTS:
            check_impact(dimension, runs)
        check_crack(runs)
    print(f"{len(wrong)} wrong, {time.monotonic() - began:.0f} s")
    return 1 if wrong else 0


# --- self-test ----------------------------------------------------------------------------------------------

COLUMNS = "step [1],time [s],mass [kg],momentum_x [kg m/s],kinetic_energy [J]"
ROWS = [[0, 0.0, 70.0, 0.1, 1.4], [10, 0.1, 70.0, 0.1, 1.3], [20, 0.2, 70.0, 0.1, 1.2]]


def write_result(folder, rows, payload=b"state", step=20):
    folder.mkdir()
    text = "\n".join([COLUMNS, *(",".join(f"{cell:.17g}" for cell in row) for row in rows)])
    (folder / "history.csv").write_text(text + "\n")
    if h5py:
        with h5py.File(folder / f"checkpoint_{step:09d}.h5", "w") as file:
            file.attrs["step"] = step
            file["bodies/0/velocity"] = list(payload)
    else:
        (folder / f"checkpoint_{step:09d}.h5").write_bytes(payload)


def with_cell(row, column, value):
    rows = [list(cells) for cells in ROWS]
    rows[row][column] = value
    return rows


def next_up(value):
    return struct.unpack("<d", struct.pack("<q", struct.unpack("<q", struct.pack("<d", value))[0] + 1))[0]


def self_test():
    """Each entry: the second result, whether it has the same bits, whether it is close."""
    scales = {"momentum_.": 14.0, "kinetic_energy": 1.4}
    entries = [
        (dict(rows=ROWS), True, True),
        (dict(rows=with_cell(1, 4, next_up(1.3))), False, True),
        (dict(rows=with_cell(1, 3, 0.1 + 14e-11)), False, True),
        (dict(rows=with_cell(2, 3, 0.1 + 30e-10)), False, False),
        (dict(rows=with_cell(1, 4, 1.3 * (1 + 1e-9))), False, False),
        (dict(rows=with_cell(2, 2, next_up(70.0))), False, False),
        (dict(rows=with_cell(2, 0, 21)), False, False),
        (dict(rows=with_cell(1, 1, 0.1 + 1e-9)), False, False),
        (dict(rows=ROWS[:2]), False, False),
        (dict(rows=ROWS, payload=b"stbte"), False, True),
        (dict(rows=ROWS, step=21), False, True),
        (dict(rows=with_cell(1, 4, math.nan)), False, False),
    ]
    missed = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_result(folder / "first", ROWS)
        for entry, same, close in entries:
            write_result(folder / "second", **entry)
            wrong.clear()
            expect_same_bits("planted", folder / "first", folder / "second")
            found_same = not wrong
            wrong.clear()
            expect_close("planted", folder / "first", folder / "second", scales)
            found_close = not wrong
            if (found_same, found_close) != (same, close):
                print(f"MISSED {entry}: same {found_same}, close {found_close}, expected {same}, {close}")
                missed += 1
            shutil.rmtree(folder / "second")
    print(f"self-test: {len(entries)} results, {missed} judged wrongly")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(self_test() if sys.argv[1:] == ["--self-test"] else main())
