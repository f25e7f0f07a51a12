"""What is drawn, and in which colours."""
import tomllib
from dataclasses import dataclass

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, ListedColormap, Normalize

from view.frames import ViewError, si_prefix, with_unit

COMPONENTS = {2: ["x", "y"], 3: ["x", "y", "z"], 4: ["xx", "xy", "yx", "yy"],
              6: ["xx", "yy", "zz", "xy", "yz", "xz"],  # the order of VTK's symmetric tensors
              9: ["xx", "xy", "xz", "yx", "yy", "yz", "zx", "zy", "zz"]}
CRACK_COLOURS = LinearSegmentedColormap.from_list(  # from broken to intact, lightness rises evenly
    "crack", ["#26060d", "#540b18", "#8c1420", "#c4412f", "#e08a63", "#e6c4ad", "#dde1e6"])


@dataclass
class Quantity:
    """A scalar per particle, made from one stored field."""
    source: str
    label: str
    unit: str
    evaluate: object  # array of the source (n x components) -> n values


def magnitude(values):
    return np.sqrt(np.square(values, dtype=float).sum(1))


def von_mises(stress):
    stress = stress.astype(float)
    xx, yy, zz, xy, yz, xz = stress.T if stress.shape[1] == 6 else stress[:, [0, 4, 8, 1, 5, 2]].T
    return np.sqrt(((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2) / 2 + 3 * (xy ** 2 + yz ** 2 + xz ** 2))


def choose_quantity(listing, name, component):
    derived = {}
    if listing.get("stress", (0,))[0] in (6, 9):
        derived["von_mises"] = Quantity("stress", "von_mises", listing["stress"][1], von_mises)
    if "velocity" in listing:
        derived["speed"] = Quantity("velocity", "speed", listing["velocity"][1], magnitude)
    known = sorted(set(listing) | set(derived))
    name = name or next((n for n in ("phase", "von_mises", "speed", "body") if n in known), None)
    if name not in known:
        what = f"there is no field {name}" if name else "the frames hold none of the default fields"
        raise ViewError(f"{what}: choose with --field one of {', '.join(known) or '(none)'}")
    if name not in listing:
        return derived[name]
    count, unit = listing[name]
    if component is None:
        if count == 1:
            return Quantity(name, name, unit, lambda values: values[:, 0])
        return Quantity(name, f"|{name}|", unit, magnitude)
    names = COMPONENTS.get(count, [])
    if component not in names:
        raise ViewError(f"{name} has no component {component}: it has {', '.join(names) or 'only one'}")
    column = names.index(component)
    return Quantity(name, f"{name}_{component}", unit, lambda values: values[:, column])


class Colours:
    """The common colour scale of all frames."""

    def __init__(self, quantity, statistics, limits, colour_map, body_names=()):
        self.body_names = body_names
        lows, highs, minima, maxima = np.array(statistics).T
        low, high = lows.min(), highs.max()
        self.bodies = quantity.source == "body"
        if self.bodies:
            low, high, count = minima.min() - 0.5, maxima.max() + 0.5, int(maxima.max() - minima.min()) + 1
            self.map = ListedColormap([plt.get_cmap("tab10")(i % 10) for i in range(count)])
        elif quantity.source == "phase":
            low, high, self.map = 0.0, 1.0, CRACK_COLOURS
        elif low < 0 < high:
            low, high, self.map = -max(-low, high), max(-low, high), plt.get_cmap("coolwarm")
        else:
            low, high = (0.0, high) if 0 <= low < 0.5 * high else (low, high)
            self.map = plt.get_cmap("viridis")
        low, high = limits or (low, high)
        if not high > low:
            low, high = low - 0.5 * (abs(low) or 1), low + 0.5 * (abs(low) or 1)
        if colour_map:
            self.map = plt.get_cmap(colour_map)
        self.low, self.high = low, high
        slack = 1e-6 * (high - low)
        below, above = bool(minima.min() < low - slack), bool(maxima.max() > high + slack)
        self.extend = ("neither", "min", "max", "both")[below + 2 * above]
        self.factor, unit = si_prefix(max(abs(low), abs(high)), quantity.unit)
        label = "phase (0 = broken)" if quantity.source == "phase" else quantity.label
        self.label = with_unit(label, unit)

    def rgb(self, values):
        size = self.map.N
        table = self.map(np.arange(size))[:, :3].astype(np.float32)
        table = np.vstack([table, [[1.0, 0.0, 1.0]]]).astype(np.float32)  # magenta for what is not a number
        position = (np.asarray(values, float) - self.low) / (self.high - self.low) * size
        index = np.clip(np.nan_to_num(position, posinf=size), 0, size - 1).astype(np.int64)
        return table[np.where(np.isnan(position), size, index)]

    def draw_bar(self, axes):
        scale = Normalize(self.low * self.factor, self.high * self.factor)
        bar = plt.colorbar(ScalarMappable(scale, self.map), cax=axes, extend=self.extend)
        bar.set_label(self.label)
        bar.outline.set_linewidth(0.8)
        if self.bodies and self.high - self.low < 20:
            numbers = np.arange(np.ceil(self.low), self.high).astype(int)
            names = [self.body_names[i] if 0 <= i < len(self.body_names) else str(i) for i in numbers]
            bar.set_ticks(numbers, labels=names, **({"rotation": 90, "va": "center"} if self.body_names else {}))


def read_body_names(folder):
    """The names of the bodies in the order of their numbers; none for a run without its scene."""
    try:
        bodies = tomllib.loads((folder / "scene.toml").read_text()).get("body", [])
        return [str(body.get("name", f"body_{number}")) for number, body in enumerate(bodies)]
    except (OSError, ValueError, AttributeError):
        return []
