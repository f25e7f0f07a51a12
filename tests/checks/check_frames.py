"""Reads frames as ParaView does: with h5py, and with VTK's vtkHDFReader.

    check_frames.py              frames that test_mpi writes on three ranks (environment as under ctest)
    check_frames.py FOLDER...    frames of any run

Prints what it finds and compares it with what it expects. Without h5py or VTK that part is skipped, with a
line that says so.
"""
import json
import math
import os
import pathlib
import subprocess
import sys
import tempfile

try:
    import h5py
    import numpy
except ImportError:
    h5py = None
try:
    import vtk
    from vtk.util.numpy_support import vtk_to_numpy
except ImportError:
    vtk = None

failures = 0


def check(what, found, expected):
    """Prints both values; NaN equals NaN, as a column that a body lacks is NaN there."""
    global failures
    if h5py and isinstance(expected, numpy.ndarray):
        same = numpy.array_equal(found, expected, equal_nan=expected.dtype.kind == "f")
        text = "%d values, first %s" % (expected.size, expected.ravel()[:3])
        found = "the same" if same else "%s" % (found,)
    else:
        same, text = found == expected, expected
    print("  %s %s: found %s, expected %s" % ("ok  " if same else "FAIL", what, found, text))
    failures += not same


def frames_of(folder):
    """The frames that the index lists, with their times."""
    series = json.loads((folder / "frames.hdf.series").read_text())
    check("file-series-version", series["file-series-version"], "1.0")
    frames = [(folder / entry["name"], entry["time"]) for entry in series["files"]]
    times = [time for _, time in frames]
    check("times ascend", times == sorted(set(times)), True)
    check("listed files", sorted(path.name for path, _ in frames),
          sorted(path.name for path in folder.glob("frame_*.hdf")))
    return frames


def check_with_h5py(path, time):
    """The layout that the VTKHDF 1.0 specification asks for. Returns the coordinates and the point arrays."""
    with h5py.File(path, "r") as file:
        root = file["VTKHDF"]
        check("Type", bytes(root.attrs["Type"]), b"UnstructuredGrid")
        check("Type is a fixed-length ASCII string",
              tuple(h5py.check_string_dtype(root.attrs.get_id("Type").dtype)), ("ascii", 16))
        check("Version", list(root.attrs["Version"]), [1, 0])
        points = root["NumberOfPoints"][()]
        total = int(points.sum())
        check("NumberOfCells", root["NumberOfCells"][()], points)
        check("NumberOfConnectivityIds", root["NumberOfConnectivityIds"][()], points)
        check("Points", (root["Points"].shape, root["Points"].dtype.str), ((total, 3), "<f8"))
        check("Types", root["Types"][()], numpy.ones(total, "u1"))
        parts = [numpy.arange(n) for n in points]
        check("Connectivity", root["Connectivity"][()], numpy.concatenate(parts))
        check("Offsets", root["Offsets"][()], numpy.concatenate([numpy.arange(n + 1) for n in points]))
        check("TimeValue", float(root["FieldData/TimeValue"][0]), time)
        arrays = {name: data[()] for name, data in root["PointData"].items()}
        for name, data in arrays.items():
            check("rows of " + name, len(data), total)
        return root["Points"][()], arrays


def check_with_vtk(path, expected):
    """What ParaView shows: the same points, one vertex each, and the same arrays."""
    points, arrays = expected
    reader = vtk.vtkHDFReader()
    check("vtkHDFReader can read it", bool(reader.CanReadFile(str(path))), True)
    reader.SetFileName(str(path))
    reader.Update()
    grid = reader.GetOutput()
    check("points in VTK", grid.GetNumberOfPoints(), len(points))
    check("cells in VTK", grid.GetNumberOfCells(), len(points))
    if len(points) == 0:
        return
    data = grid.GetPointData()
    names = [data.GetArrayName(i) for i in range(data.GetNumberOfArrays())]
    check("arrays in VTK", sorted(names), sorted(arrays))
    check("kind of the cells in VTK", {grid.GetCellType(i) for i in (0, len(points) // 2, len(points) - 1)},
          {vtk.VTK_VERTEX})
    check("point of the last cell in VTK", grid.GetCell(len(points) - 1).GetPointId(0), len(points) - 1)
    check("coordinates in VTK", vtk_to_numpy(grid.GetPoints().GetData()), points)
    for name, values in arrays.items():
        check(name + " in VTK", vtk_to_numpy(data.GetArray(name)), values)


def check_folder(folder):
    frames = frames_of(folder)
    for path, time in frames:
        print(path.name)
        expected = check_with_h5py(path, time)
        if vtk:
            check_with_vtk(path, expected)
    return frames


def sample(folder):
    """Frames of test_mpi, and what tests/mpi/io_test_bodies.hpp says about their particles."""
    environment = dict(os.environ, MPM_FRAME_SAMPLE=str(folder))
    command = os.environ["MPM_MPIRUN"].split() + ["-n", "3", os.environ["MPM_BIN_DIR"] + "/test_mpi",
                                                  "--gtest_filter=IoFrames.Sample"]
    subprocess.run(command, env=environment, check=True, stdout=subprocess.DEVNULL)
    plate = [i for i in range(5003) if i % 7 != 3 and not 1000 <= i < 1900]
    ball = [2**40 + i for i in range(977) if i % 5 != 0]
    for name in ("contiguous", "compressed"):
        print("== " + name)
        frames = check_folder(folder / name)
        check("times", [time for _, time in frames], [0, 0.25])
        _, arrays = check_with_h5py(*frames[-1])
        check("identities", numpy.sort(arrays["id"]), numpy.array(plate + ball))
        check("bodies", numpy.bincount(arrays["body"]), numpy.array([len(plate), len(ball)]))
        check("phase outside the ball", set(map(math.isnan, arrays["phase"][arrays["body"] == 0])), {True})
        check("stress of the ball", arrays["stress"][arrays["body"] == 1][0],
              numpy.array([10, 11, 0, 12, 13, 0, 0, 0, 0], "f4"))
        check("a column that is not written by default", "deformation_gradient" in arrays, False)
    print("== empty")
    check_folder(folder / "empty")


def main():
    if not h5py:
        print("SKIPPED: /usr/bin/python3 has no h5py (Debian: python3-h5py)")
        return 0
    if not vtk:
        print("SKIPPED the part with VTK: /usr/bin/python3 has no vtk (Debian: python3-vtk9)")
    if len(sys.argv) > 1:
        for folder in sys.argv[1:]:
            check_folder(pathlib.Path(folder))
    else:
        with tempfile.TemporaryDirectory() as folder:
            sample(pathlib.Path(folder))
    print("%d failures" % failures)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
