#!/usr/bin/python3
"""Checks that mpm_view draws a tiny made-up run, finds the crack tip of it, and refuses wrong requests."""
import contextlib
import csv
import io
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
from PIL import Image

sys.dont_write_bytecode = True
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))
from mpm_program import load_script  # noqa: E402

SOURCE = Path(os.environ.get("MPM_SOURCE_DIR", Path(__file__).resolve().parents[2]))
TIMES = [0.0, 1e-6, 2e-6, 4e-6]
SPACING = 0.01  # [m]
TIPS = [None, 0.305, 0.505, 0.905]  # broken up to here along x [m], on particle positions

PROGRAM = str(SOURCE / "apps" / "mpm_view")
mpm_view = load_script(PROGRAM)

failures = []


def expect(truth, words):
    if not truth:
        failures.append(words)
        print(f"FAILED: {words}")


def start(*arguments):
    return subprocess.run([PROGRAM, *map(str, arguments)], capture_output=True, text=True, check=False)


def view(*arguments):
    """As start(), in this process, which saves the time to load the libraries."""
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as err:
        code = mpm_view.main([str(argument) for argument in arguments])
    return SimpleNamespace(returncode=code, stdout=out.getvalue(), stderr=err.getvalue())


def write_run(folder, depth):
    """A plate, or with depth > 1 a block, on a lattice, whose crack follows TIPS; in two partitions."""
    folder.mkdir()
    axis = (np.arange(100 if depth == 1 else 20) + 0.5) * SPACING
    layers = (np.arange(depth) + 0.5) * SPACING if depth > 1 else [0.0]
    points = np.stack(np.meshgrid(axis, axis, layers, indexing="ij"), -1).reshape(-1, 3)
    for number, tip in enumerate(TIPS):
        middle = axis[len(axis) // 2]
        broken = (points[:, 0] < (tip or -1) + 1e-9) & (np.abs(points[:, 1] - middle) < 1.5 * SPACING)
        with h5py.File(folder / f"frame_{number:06d}.hdf", "w") as file:
            group = file.create_group("VTKHDF")
            group["NumberOfPoints"] = [len(points) // 2, len(points) - len(points) // 2]
            group["Points"] = points
            data = group.create_group("PointData")
            data["phase"] = np.where(broken, 0.05, 1.0)
            data["velocity"] = np.stack([points[:, 1], -points[:, 0], 0 * points[:, 2]], 1)
            data["stress"] = np.outer(1e6 * points[:, 0], [0, 0, 0, 0, 1, 0, 0, 0, 0])
            data["id"] = np.arange(len(points))
            data["body"] = np.zeros(len(points), np.int32)
    files = [{"name": f"frame_{number:06d}.hdf", "time": time} for number, time in enumerate(TIMES)]
    (folder / "frames.hdf.series").write_text(json.dumps({"file-series-version": "1.0", "files": files}))
    (folder / "history.csv").write_text(
        "step [1],time [s],dt [s],kinetic_energy [J],energy_residual [J],momentum_x [kg m/s],min_phase [1]\n"
        "0,0,1e-8,1.0,0,1e-3,1\n1,2e-6,1e-8,1.5,1e-9,1e-3,0.5\n2,4e-6,1e-8,2.0,2e-9,1e-3,0.05\n")
    (folder / "run.json").write_text(json.dumps({"dimension": 2 if depth == 1 else 3}))


def check_plate(run):
    result = view(run, "--crack-tip", "--size", "600x500")
    expect(result.returncode == 0, f"a plate is drawn: exit {result.returncode}, {result.stderr}")
    names = [*(f"frame_{number:06d}.png" for number in range(4)), "contact_sheet.png", "animation.gif",
             "history.png", "crack_tip.csv", "crack_tip.png"]
    for name in names:
        path = run / "pictures" / name
        expect(path.exists() and path.stat().st_size > 100, f"{name} is written")
        expect(f"wrote {path}" in result.stdout.splitlines(), f"{name} is announced")
    if failures:
        return
    with Image.open(run / "pictures" / "frame_000003.png") as image:
        expect(image.size == (600, 500), f"--size 600x500 gives 600 x 500 pixels, was {image.size}")
        pixels = np.asarray(image.convert("RGB")).astype(int)[60:420, 70:490]
    dark = pixels.sum(2) < 200  # axes are lines one pixel wide, the crack is three particles high
    rows = np.flatnonzero(dark[:, 150:350].mean(1) > 0.95)
    expect(5 <= len(rows) <= 16 and np.ptp(rows) == len(rows) - 1, f"the crack is one dark band: {rows}")
    plate = dark | (np.abs(pixels - (221, 225, 230)).sum(2) < 12)  # the colours of broken and intact
    expect(plate[100:250, 150:350].mean() > 0.95, "the plate has no holes")
    with open(run / "pictures" / "crack_tip.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    tips = [float(row["tip_x [m]"]) for row in rows]
    expect(np.isnan(tips[0]) and np.allclose(tips[1:], TIPS[1:]), f"tips {tips}, expected {TIPS}")
    speed = float(rows[2]["tip_speed [m/s]"])  # the tip moves 0.2 m in each microsecond
    expect(abs(speed - 2e5) < 1, f"tip speed {speed}, expected 2e5")
    before = {name: (run / "pictures" / name).read_bytes() for name in names}
    view(run, "--crack-tip", "--size", "600x500")
    changed = [name for name in names if (run / "pictures" / name).read_bytes() != before[name]]
    expect(not changed, f"a second run gives the same bytes, not so: {changed}")


def check_block(run):
    result = view(run, "--frames", "1,3", "--field", "stress", "--component", "yy", "--hide-broken", "0.1",
                  "--slice", "y=0.1", "--view", "-60,30", "--size", "400x300",
                  "--no-history", "--no-animation")
    expect(result.returncode == 0, f"a block is drawn: exit {result.returncode}, {result.stderr}")
    written = sorted(path.name for path in (run / "pictures").glob("*"))
    expect(written == ["contact_sheet.png", "frame_000001.png", "frame_000003.png"], f"only these: {written}")
    result = view(run, "--frames", "0", "--box", "5", "6", "5", "6", "5", "6", "--pictures", run / "nothing")
    expect(result.returncode == 0, f"a view of no particle is drawn: exit {result.returncode}, {result.stderr}")


def check_comparison(folder, run):
    """Two runs side by side, with a curve each and the names of the bodies."""
    other = folder / "other"
    write_run(other, 1)
    pictures = folder / "compared"
    arguments = (run, other, "--frames", "1,3", "--pictures", pictures)
    result = view(*arguments)
    expect(result.returncode == 0, f"two runs are compared: exit {result.returncode}, {result.stderr}")
    written = sorted(path.name for path in pictures.glob("*"))
    expect(written == ["comparison.png"], f"a comparison is one picture: {written}")
    if failures:
        return
    with Image.open(pictures / "comparison.png") as image:
        without = image.height
    view(*arguments, "--column", "kinetic_energy")
    with Image.open(pictures / "comparison.png") as image:
        expect(image.height == without + 300, f"curves make the sheet 300 higher: {without} to {image.height}")
    (run / "scene.toml").write_text('[[body]]\nname = "plate"\n[[body]]\nmaterial = "glass"\n')
    names = mpm_view.read_body_names(run)
    expect(names == ["plate", "body_1"], f"names of the bodies: {names}")
    expect(mpm_view.read_body_names(other) == [], "a run without its scene has no names")


def check_refusals(folder, run):
    (folder / "empty").mkdir()
    for words, *arguments in [("no folder", folder / "missing"), ("no frames", folder / "empty"),
                              ("phase, speed, stress, velocity", run, "--field", "nothing"),
                              ("no component", run, "--field", "velocity", "--component", "xy"),
                              ("no frame 9", run, "--frames", "9"),
                              ("--column is for several", run, "--column", "dt"),
                              ("--crack-tip is for one", run, run, "--crack-tip"),
                              ("no column mass", run, run, "--column", "mass"),
                              ("takes 4 numbers", run, "--box", "0", "1", "0", "1", "0", "1"),
                              ("dimensions", run, folder / "block", "--frames", "0"),
                              ("three dimensions", run, "--slice", "z=0")]:
        result = (start if words == "no folder" else view)(*arguments)
        one_line = result.stderr.count("\n") == 1 and result.stderr.startswith("mpm_view: ")
        expect(result.returncode == 2 and one_line and words in result.stderr,
               f"{arguments[1:] or words} ends with 2 and '{words}': {result.returncode}, {result.stderr}")
    (run / "frame_000003.hdf").write_text("damaged")
    result = view(run)
    expect(result.returncode == 4 and "frame_000003.hdf" in result.stderr,
           f"a damaged frame ends with 4 and its name: {result.returncode}, {result.stderr}")


def main():
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_run(folder / "plate", 1)
        write_run(folder / "block", 20)
        check_plate(folder / "plate")
        check_block(folder / "block")
        check_comparison(folder, folder / "plate")
        check_refusals(folder, folder / "plate")
    print(f"mpm_view: {len(failures)} failures")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
