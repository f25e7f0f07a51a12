#!/usr/bin/python3
"""Opens frames in ParaView: the series with its times, a single frame, every array; and draws pictures.

    check_paraview_slow.py              two scenes on two ranks, in 2D with the phase field and in 3D
    check_paraview_slow.py FOLDER       the same, and keeps runs and pictures in an empty or new folder
    check_paraview_slow.py --self-test  frames with planted faults, each of which must be noticed

Exit code 77: skipped. Debian's python3-paraview and python3-vtk9 can't be installed beside each other.
"""
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

SKIPPED = 77
sys.dont_write_bytecode = True
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))

# Columns of the point arrays that each scene must show.
SCENES = {
    "branching_plate_2d": (
        ["--until", "1e-5", "--set", "output.every=5e-6"], "phase",
        {"body": 1, "id": 1, "jacobian": 1, "phase": 1, "velocity": 3, "von_mises": 1}),
    "elastic_impact_3d": (
        ["--until", "0.4", "--set", "output.every=0.2", "--set", "grid.spacing=0.03",
         "--set", 'output.fields=["velocity", "deformation_gradient", "von_mises"]'], "von_mises",
        {"body": 1, "deformation_gradient": 9, "velocity": 3, "von_mises": 1}),
}

# --- within pvbatch -----------------------------------------------------------------------------------------


def what_paraview_shows(request):
    """{"version": ..., path: {"reader": ..., "times": [...], "frames": [...]}}; draws the last time."""
    from paraview import simple
    answer = {"version": str(simple.GetParaViewVersion())}
    for path, colour, picture in request:
        reader = simple.OpenDataFile(path)
        reader.UpdatePipelineInformation()
        times = list(reader.TimestepValues)
        frames = []
        for time in times or [0]:
            reader.UpdatePipeline(time)
            shown = reader.GetDataInformation()
            frames.append({
                "points": shown.GetNumberOfPoints(), "cells": shown.GetNumberOfCells(),
                "bounds": shown.GetBounds(), "time": reader.FieldData["TimeValue"].GetRange()[0],
                "arrays": {array.Name: [array.GetRange(c) for c in range(array.GetNumberOfComponents())]
                           for array in reader.PointData.values()}})
        answer[path] = {"reader": type(reader).__name__, "times": times, "frames": frames}
        view = simple.CreateView("RenderView")
        view.ViewSize, view.ViewTime, view.OrientationAxesVisibility = [900, 500], (times or [0])[-1], 0
        view.UseFXAA = 0
        view.GetRenderWindow().SetMultiSamples(0)  # colours of the field only
        view.UseColorPaletteForBackground, view.Background = 0, [1, 1, 1]
        display = simple.Show(reader, view)
        display.SetRepresentationType("Points")
        display.PointSize = 3
        simple.ColorBy(display, ("POINTS", colour))
        display.RescaleTransferFunctionToDataRange(False)
        if frames[-1]["bounds"][5] > frames[-1]["bounds"][4]:
            view.CameraPosition, view.CameraViewUp = [-0.5, -1, 0.6], [0, 0, 1]
        view.ResetCamera()
        simple.SaveScreenshot(picture, view)
    return answer


if sys.argv[1:2] == ["--within-pvbatch"]:
    Path(sys.argv[3]).write_text(json.dumps(what_paraview_shows(json.loads(sys.argv[2]))))
    sys.exit(0)

# --- the check ----------------------------------------------------------------------------------------------

import mpm_program as mpm  # noqa: E402

failures = []


def check(what, found, expected):
    same = found == expected
    print("  %s %s: found %s%s" % ("ok  " if same else "FAIL", what, found,
                                   "" if same else ", expected %s" % (expected,)))
    if not same:
        failures.append(what)


def ask_paraview(request):
    """What what_paraview_shows() answers to [path, colour, picture]..., or pvbatch's words if it fails."""
    with tempfile.TemporaryDirectory() as folder:
        answer = Path(folder) / "answer.json"
        # Not xvfb-run: shortly after another one ended, its pvbatch may find no server.
        server = subprocess.Popen(["Xvfb", "-displayfd", "1", "-screen", "0", "1280x1024x24"],
                                  stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
                                  text=True)
        try:
            display = ":" + server.stdout.readline().strip()
            done = subprocess.run(
                ["pvbatch", __file__, "--within-pvbatch", json.dumps(request), str(answer)],
                env=dict(mpm.ENVIRONMENT, DISPLAY=display, LIBGL_ALWAYS_SOFTWARE="1"), timeout=600,
                stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                errors="replace", check=False)
        finally:
            server.terminate()
            server.wait()
        return json.loads(answer.read_text()) if answer.exists() else done.stdout


def check_arrays(path, time, points, columns, shown):
    """One frame as ParaView shows it against the file that must be behind it."""
    with h5py.File(path, "r") as file:
        arrays = {name: data[()].reshape(len(data), -1) for name, data in file["VTKHDF/PointData"].items()}
        places = file["VTKHDF/Points"][()]
    print(" %s at %g s" % (path.name, time))
    check("points and cells", [shown["points"], shown["cells"]], [points, points])
    check("TimeValue", shown["time"], time)
    check("bounds", shown["bounds"], [f(places[:, c]) for c in range(3) for f in (numpy.min, numpy.max)])
    check("arrays", {name: len(ranges) for name, ranges in shown["arrays"].items()}, columns)
    unfit = [name for name, data in arrays.items() if not numpy.isfinite(data).all()]
    check("arrays with NaN or infinity", unfit, [])
    for name, ranges in shown["arrays"].items():
        check("ranges of " + name, ranges, [[float(a.min()), float(a.max())] for a in arrays[name].T])


def check_picture(path):
    """Background around the particles, and the colours of a field on them."""
    with Image.open(path) as image:
        colours = image.convert("RGB").getcolors(1 << 24)
    pixels = sum(count for count, _ in colours)
    share = 1 - {colour: count for count, colour in colours}.get((255, 255, 255), 0) / pixels
    print(" %s: %.0f %% covered, %d colours" % (path.name, 100 * share, len(colours)))
    check("share of the picture that is covered", 0.1 < share < 0.9, True)
    check("at least 20 colours", len(colours) >= 20, True)


def check_run(folder, colour, columns):
    series = json.loads((folder / "frames.hdf.series").read_text())["files"]
    frames = [(folder / entry["name"], entry["time"]) for entry in series]
    points = mpm.report(folder)["particles"]
    single = str(frames[-1][0])
    request = [[str(folder / "frames.hdf.series"), colour, str(folder / "series.png")],
               [single, colour, str(folder / "single.png")]]
    answer = ask_paraview(request)
    if isinstance(answer, str):
        print(answer)
        return check("ParaView opens the frames", False, True)
    for path, _, picture in request:
        shown = answer[path]
        expected = frames[-1:] if path == single else frames
        print("%s in ParaView %s" % (path, answer["version"]))
        check("reader", shown["reader"], "VTKHDFReader")
        if path != single:
            check("times", shown["times"], [time for _, time in frames])
        check("frames shown", len(shown["frames"]), len(expected))
        for (file, time), frame in zip(expected, shown["frames"]):
            check_arrays(file, time, points, columns, frame)
        check_picture(Path(picture))


def run_scene(name, folder, arguments):
    scene = mpm.SOURCE / "apps/scenes" / (name + ".toml")
    outcome = mpm.run([scene, "--output", folder, *arguments], 2, folder.parent, limit=300 * mpm.SLOWDOWN)
    if outcome.code != 0:
        sys.exit("%s ended with exit code %d:\n%s%s" % (name, outcome.code, outcome.out, outcome.err))


def check_scenes(folder):
    for name, (arguments, colour, columns) in SCENES.items():
        print("== " + name)
        run_scene(name, folder / name, arguments)
        check_run(folder / name, colour, columns)
    print("%d failures" % len(failures))
    return 1 if failures else 0


# --- self-test ----------------------------------------------------------------------------------------------


def rename_array(folder):
    with h5py.File(folder / "frame_000001.hdf", "r+") as file:
        file.move("VTKHDF/PointData/jacobian", "VTKHDF/PointData/jacobien")


def plant_nan(folder):
    with h5py.File(folder / "frame_000001.hdf", "r+") as file:
        file["VTKHDF/PointData/velocity"][0] = numpy.nan


def lose_points(folder):
    with h5py.File(folder / "frame_000001.hdf", "r+") as file:
        for count in ("NumberOfPoints", "NumberOfCells", "NumberOfConnectivityIds"):
            file["VTKHDF/" + count][-1] -= 1


def swap_frames(folder):
    series = folder / "frames.hdf.series"
    series.write_text(series.read_text().replace("000000", "x").replace("000001", "000000")
                      .replace("x", "000001"))


def cut_frame(folder):
    os.truncate(folder / "frame_000001.hdf", 10000)


def self_test():
    plans = [  # what is done to the folder, the colour of the picture, and the check that must fail
        (lambda folder: None, "phase", None), (rename_array, "phase", "arrays"),
        (plant_nan, "phase", "arrays with NaN or infinity"), (lose_points, "phase", "points and cells"),
        (swap_frames, "phase", "TimeValue"), (cut_frame, "phase", "ParaView opens the frames"),
        (lambda folder: None, "body", "at least 20 colours")]
    missed = []
    with tempfile.TemporaryDirectory() as name:
        sound = Path(name) / "sound"
        run_scene("branching_plate_2d", sound, ["--until", "2e-6", "--set", "output.every=2e-6"])
        for number, (damage, colour, expected) in enumerate(plans):
            folder = Path(name) / str(number)
            shutil.copytree(sound, folder)
            damage(folder)
            failures.clear()
            check_run(folder, colour, SCENES["branching_plate_2d"][2])
            if (expected not in failures) if expected else failures:
                missed.append("%d: %s, expected %s" % (number, failures, expected))
    print("self-test: %d faults planted, %d things wrong" % (len(plans) - 1, len(missed)), *missed, sep="\n")
    return 1 if missed else 0


def main():
    if sys.argv[1:] == ["--self-test"]:
        return self_test()
    if len(sys.argv) > 1:
        Path(sys.argv[1]).mkdir(parents=True, exist_ok=True)
        return check_scenes(Path(sys.argv[1]).resolve())
    with tempfile.TemporaryDirectory() as folder:
        return check_scenes(Path(folder))


if __name__ == "__main__":
    try:
        import h5py
        import numpy
        from PIL import Image
    except ImportError as error:
        print("SKIPPED: %s (Debian: python3-h5py, python3-numpy, python3-pil)" % error)
        sys.exit(SKIPPED)
    if not shutil.which("pvbatch") or not shutil.which("Xvfb"):
        print("SKIPPED: pvbatch or Xvfb isn't there (Debian: paraview, python3-paraview, xvfb)")
        sys.exit(SKIPPED)
    trial = ask_paraview([])
    if "No module named 'paraview'" in trial:
        print("SKIPPED: pvbatch is there without its Python modules (Debian: python3-paraview)")
        sys.exit(SKIPPED)
    sys.exit(main())
