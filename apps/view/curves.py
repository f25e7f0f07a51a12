"""Curves over time, from history.csv and the frames."""
import csv
import re

import numpy as np
from matplotlib import pyplot as plt

from view.frames import ViewError, read_frame, si_prefix, with_unit
from view.pages import Page

BROKEN = 0.1  # a particle with less phase counts as broken, as in history.csv
PANELS = [("energy", r".*_energy|plastic_work|external_work|energy_residual"),
          ("momentum", r"momentum_[xyz]"), ("angular momentum", r"angular_momentum_[xyz]"),
          ("reaction", r"reaction_.*"),
          ("broken volume fraction", r"broken_fraction"), ("smallest phase", r"min_phase"),
          ("largest speed", r"max_speed"), ("smallest volume ratio J", r"min_J"), ("time step", r"dt"),
          ("solver iterations", r".*_iterations"), ("load imbalance", r"imbalance")]


def read_history(path):
    """{column name: (unit, values)}"""
    with open(path, newline="") as file:
        rows = [row for row in csv.reader(file) if row]
    if len(rows) > 1 and len(rows[-1]) < len(rows[0]):
        rows.pop()  # a run that goes on may be writing this row
    heads = [re.fullmatch(r"\s*(\S+)\s*(?:\[(.*)\])?\s*", cell) for cell in rows[0]] if rows else []
    try:
        table = np.array(rows[1:], float).reshape(-1, len(heads))
        return {head[1]: (head[2] or "1", table[:, i]) for i, head in enumerate(heads)}
    except (ValueError, TypeError) as fault:
        raise ViewError(f"{path} is not a table of numbers below a line of names: {fault}", 4) from fault


def draw_curves(axes, title, time, curves, styles=("-",)):
    """`curves`: {name: (unit, values)} with one unit; `time`: (factor, unit, values); the lines take turns in `styles`."""
    unit = next(iter(curves.values()))[0]
    finite = np.abs(np.concatenate([values for _, values in curves.values()]))
    factor, label = si_prefix(np.max(finite[np.isfinite(finite)], initial=0), unit)
    colours = plt.get_cmap("tab10")
    for number, (name, (_, values)) in enumerate(curves.items()):
        residual = name.endswith("residual")
        words = re.sub(r"_energy$|^(angular_)?momentum_|^reaction_|_iterations$", "", name).replace("_", " ")
        axes.plot(time[2] * time[0], values * factor, label=words, linewidth=1.2 if residual else 1.8,
                  color="black" if residual else colours(number % 10), linestyle="--" if residual else styles[number % len(styles)])
    axes.set(xlabel=f"time [{time[1]}]", xlim=(time[0] * time[2].min(), time[0] * time[2].max() or 1))
    axes.set_title(with_unit(title, label), loc="left", fontsize=13, fontweight="bold")
    axes.grid(color="#dddddd", linewidth=0.7)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    if len(curves) > 1:
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.03), handlelength=1.4)


def draw_column_of_runs(page, name, histories):
    """One curve per run: `histories` is {run: columns of read_history}."""
    for run, columns in histories.items():
        if "time" not in columns or name not in columns:
            known = ", ".join(column for column in columns if column not in ("step", "time"))
            raise ViewError(f"the history of {run} has no column {name}: it has {known}")
    times = np.unique(np.concatenate([columns["time"][1] for columns in histories.values()]))
    curves = {run: (columns[name][0], np.interp(times, columns["time"][1], columns[name][1], right=np.nan))
              for run, columns in histories.items()}
    time = (*si_prefix(times.max(), "s"), times)
    draw_curves(page.axes(90, 65, 1050, 200), name.replace("_", " "), time, curves,
                styles=("-", "--", "-.", ":"))


def draw_history(path, source):
    columns = read_history(source)
    if "time" not in columns or not len(columns["time"][1]):
        raise ViewError(f"{source} has no column time or no rows")
    panels = []
    for title, pattern in PANELS:
        curves = {name: column for name, column in columns.items() if re.fullmatch(pattern, name)}
        if curves:
            panels.append((title, curves))
    rows = -(-len(panels) // 2)
    page = Page(1500, 300 * rows + 10)
    times = columns["time"][1]
    time = (*si_prefix(times.max(), columns["time"][0]), times)
    for number, (title, curves) in enumerate(panels):
        width = 500 if len(curves) > 1 else 630  # the legend stands to the right
        axes = page.axes(75 + number % 2 * 750, 70 + 300 * (rows - 1 - number // 2), width, 190)
        draw_curves(axes, title, time, curves)
    page.save(path)


def write_crack_tip(folder, frames):
    """The furthest broken particle along x in each frame, and its speed by central differences."""
    tips = np.full((len(frames), 4), np.nan)  # position, number of broken particles
    for row, frame in zip(tips, frames):
        points, fields, _ = read_frame(frame, ["phase"])
        broken = points[fields["phase"][:, 0] < BROKEN]
        row[3] = len(broken)
        if len(broken):
            row[:3] = broken[broken[:, 0].argmax()]
    times = np.array([frame.time for frame in frames], float)
    seen = np.isfinite(tips[:, 0])
    speed = np.full(len(frames), np.nan)
    if seen.sum() > 1:
        speed[seen] = np.gradient(tips[seen, 0], times[seen])
    path = folder / "crack_tip.csv"
    with open(path, "w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["frame", "time [s]", *(f"tip_{axis} [m]" for axis in "xyz"), "broken_particles",
                        "tip_speed [m/s]"])
        for frame, time, tip, value in zip(frames, times, tips, speed):
            time, x, y, z, value = (f"{number:.9g}" for number in (time, *tip[:3], value))
            table.writerow([frame.number, time, x, y, z, int(tip[3]), value])
    print(f"wrote {path}")
    page = Page(900, 760)
    time = (*si_prefix(times.max(), "s"), times)
    draw_curves(page.axes(90, 450, 770, 260), "crack tip position x", time, {"tip_x": ("m", tips[:, 0])})
    draw_curves(page.axes(90, 70, 770, 260), "crack tip speed", time, {"speed": ("m/s", speed)})
    page.save(folder / "crack_tip.png")
