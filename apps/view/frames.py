"""The frames of a run folder, and how numbers are written."""
import json
import re
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

UNITS = {"phase": "1", "velocity": "m/s", "speed": "m/s", "stress": "Pa", "von_mises": "Pa", "pressure": "Pa",
         "displacement": "m", "density": "kg/m^3", "temperature": "K", "mass": "kg"}


class ViewError(Exception):
    """A sentence for the user, and the exit code that goes with it."""

    def __init__(self, sentence, code=2):
        super().__init__(sentence)
        self.code = code


def si_prefix(largest, unit):
    """Factor and prefixed unit that bring `largest` [unit] between 1 and 1000."""
    words = "" if unit == "1" else unit.replace("^2", "²").replace("^3", "³").replace("*", " ")
    if not np.isfinite(largest) or largest <= 0:
        return 1.0, words
    exponent = int(3 * np.floor(np.log10(largest * (1 + 1e-9)) / 3))
    prefixes = {-12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G", 12: "T"}
    if exponent in prefixes and re.match(r"(?!kg|m\^|K$)[A-Za-z]", unit):
        return 10.0 ** -exponent, prefixes[exponent] + words
    if -6 < exponent < 6:
        return 1.0, words
    return 10.0 ** -exponent, f"$10^{{{exponent}}}$ {words}".strip()


def with_unit(name, unit):
    return name.replace("_", " ") + (f" [{unit}]" if unit else "")


def time_label(frame, last_time):
    if frame.time is None:
        return f"frame {frame.number}"
    factor, unit = si_prefix(last_time, "s")
    return f"t = {frame.time * factor:.{2 if last_time * factor < 100 else 1}f} {unit}"


@dataclass
class Frame:
    number: int
    path: Path
    time: float  # [s], None when the folder has no series file


def find_frames(folder):
    if not folder.is_dir():
        raise ViewError(f"there is no folder {folder}: give the output folder of a run")
    times = {path.name: None for path in sorted(folder.glob("frame_*.hdf"))}
    series = folder / "frames.hdf.series"
    if series.exists():
        try:
            times = {entry["name"]: float(entry["time"]) for entry in json.loads(series.read_text())["files"]}
        except (ValueError, KeyError, TypeError) as fault:
            raise ViewError(f"{series} is not a file series: {fault}", 4) from fault
    if not times:
        raise ViewError(f"{folder} holds no frames (frame_000000.hdf ...): set output.every in the scene")
    return [Frame(int(re.findall(r"\d+", name)[-1]), folder / name, time) for name, time in times.items()]


def choose_frames(frames, choice):
    by_number = {frame.number: frame for frame in frames}
    if choice in ("all", "last"):
        return frames if choice == "all" else frames[-1:]
    if every := re.fullmatch(r"every=([1-9]\d*)", choice):
        return frames[::int(every[1])]
    if not re.fullmatch(r"\d+(,\d+)*", choice):
        raise ViewError(f"--frames {choice} is not one of: all, last, N,M,..., every=K")
    numbers = [int(number) for number in choice.split(",")]
    if missing := [number for number in numbers if number not in by_number]:
        raise ViewError(f"there is no frame {missing[0]}: the last one is {frames[-1].number}")
    return [by_number[number] for number in numbers]


def read_frame(frame, names=()):
    """Points (n x 3), {name: n x components} of those named that exist, {name: (components, unit)} of all."""
    try:
        with h5py.File(frame.path, "r") as file:
            data = file["VTKHDF/PointData"]
            listing = {}
            for name, values in data.items():
                unit = values.attrs.get("units", UNITS.get(name, "1"))
                unit = unit.decode() if isinstance(unit, bytes) else str(unit)
                listing[name] = (int(np.prod(values.shape[1:])), unit)
            points = file["VTKHDF/Points"][()].astype(float)
            return points, {name: data[name][()].reshape(len(points), listing[name][0])
                            for name in names if name in data}, listing
    except (OSError, KeyError, RuntimeError, ValueError) as fault:
        raise ViewError(f"{frame.path} cannot be read as a VTKHDF frame: {fault}", 4) from fault
