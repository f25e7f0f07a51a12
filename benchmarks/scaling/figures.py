"""The pictures of scaling studies and of the performance model."""
import matplotlib

from results import NO_EFFICIENCY

matplotlib.use("Agg")
from matplotlib import pyplot as plt  # noqa: E402  (the backend is chosen first)
from matplotlib.ticker import FuncFormatter, NullFormatter, NullLocator  # noqa: E402

COLOURS = {"strong": "#1f5a93", "weak": "#b5541c"}
SERIES = ["#1f5a93", "#b5541c", "#4d8a3c", "#7a4b94", "#8f8f8f", "#c29b2b", "#3aa0a0", "#c0447a", "#333333"]
plt.rcParams.update({"font.size": 10, "axes.linewidth": 0.8, "legend.frameon": False, "axes.grid": True,
                     "grid.alpha": 0.3, "figure.figsize": (5.2, 3.8), "savefig.dpi": 110})


def rank_axis(axes, ranks):
    axes.set_xscale("log")
    axes.set_xlabel("ranks")
    if len(ranks) <= 12:
        axes.set_xticks(ranks)
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.xaxis.set_minor_locator(NullLocator())
        axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_xlim(min(ranks) / 1.25, max(ranks) * 1.25)


def finish(figure, path):
    figure.tight_layout()
    figure.savefig(path, metadata={"Software": None})
    plt.close(figure)
    return path


def split(points):
    kinds = [kind for kind in COLOURS if any(point["kind"] == kind for point in points)]
    return {kind: [point for point in points if point["kind"] == kind] for kind in kinds}


def warn_of_crowded(axes, points):
    crowded = sorted({point["ranks"] for point in points if point["crowded"]})
    if crowded:
        axes.text(0.5, 0.03, f"{', '.join(map(str, crowded))} ranks:\n{NO_EFFICIENCY}", transform=axes.transAxes,
                  ha="center", va="bottom", color="#8c1420", fontsize=9)


def draw_speed(folder, points, quantity, title, ideal):
    figure, axes = plt.subplots()
    for kind, row in split(points).items():
        row = [point for point in row if quantity in point]
        if not row:
            continue
        ranks, values = [point["ranks"] for point in row], [point[quantity] for point in row]
        spread = [point["efficiency_spread"] * value for point, value in zip(row, values)]
        axes.errorbar(ranks, values, yerr=spread, marker="o", capsize=3, color=COLOURS[kind], label=kind)
        axes.plot(ranks, [ideal(point, row[0]) for point in row], color="#8f8f8f", lw=1, ls="--")
    rank_axis(axes, sorted({point["ranks"] for point in points}))
    axes.set_ylabel(title)
    axes.set_ylim(0, 1.1 * max([1.0, *(point[quantity] for point in points if quantity in point)]))
    warn_of_crowded(axes, points)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="upper left" if quantity == "speed_up" else "lower left")
    return finish(figure, folder / f"{quantity}.png")


def draw_counts(folder, points, name, quantities, title, scale=1.0):
    figure, axes = plt.subplots()
    for kind, row in split(points).items():
        for quantity, style, words in quantities:
            axes.plot([point["ranks"] for point in row], [point[quantity] * scale for point in row], style, marker="o",
                      color=COLOURS[kind], label=f"{kind}{words}")
    rank_axis(axes, sorted({point["ranks"] for point in points}))
    axes.set_ylabel(title)
    axes.legend()
    return finish(figure, folder / f"{name}.png")


def draw_stage_shares(folder, points):
    row = [point for point in points if not point["crowded"]]
    figure, axes = plt.subplots()
    stages = list(dict.fromkeys(name for point in row for name in point["stage_shares"]))
    bottom = [0.0] * len(row)
    for colour, stage in zip(SERIES, stages):
        heights = [100 * point["stage_shares"].get(stage, 0) for point in row]
        if max(heights, default=0) < 0.05:
            continue
        axes.bar(range(len(row)), heights, bottom=bottom, label=stage, color=colour, width=0.7)
        bottom = [low + height for low, height in zip(bottom, heights)]
    axes.set_xticks(range(len(row)))
    axes.set_xticklabels([f"{point['kind']}\n{point['ranks']}" for point in row])
    axes.set_ylabel("share of the step [%]")
    axes.grid(axis="x", visible=False)
    if row:
        axes.legend(loc="center left", bbox_to_anchor=(1, 0.5), fontsize=9)
    crowded = sorted({point["ranks"] for point in points if point["crowded"]})
    if crowded:
        axes.set_title(f"without {', '.join(map(str, crowded))} ranks: more ranks than cores", fontsize=9, color="#8c1420")
    return finish(figure, folder / "stage_shares.png")


def draw_scaling(folder, points):
    paths = []
    if any("speed_up" in point for point in points):
        paths.append(draw_speed(folder, points, "speed_up", "speed-up",
                                lambda point, base: point["ranks"] / base["ranks"]))
    paths.append(draw_speed(folder, points, "efficiency", "parallel efficiency", lambda point, base: 1.0))
    paths.append(draw_stage_shares(folder, points))
    paths.append(draw_counts(folder, points, "message_bytes",
                             [("bytes_per_rank_and_step", "-", ", mean"), ("most_bytes_of_a_rank", "--", ", largest")],
                             "sent by a rank in a step [kB]", 1e-3))
    paths.append(draw_counts(folder, points, "imbalance", [("imbalance", "-", "")], "largest over mean load of a rank"))
    return paths


# ---- the performance model

STYLES = {"METIS on rank 0": ":", "bisection on rank 0": "-.", "curve": "-", "curve, reductions hidden": "--"}


def rows_of(rows, case, phase, program):
    return [row for row in rows if (row["case"], row["phase"], row["program"]) == (case, phase, program)]


def draw_predicted(folder, name, rows, cases, title):
    """Efficiency over ranks, elastic and with the phase field, by who divides the blocks."""
    figure, panels = plt.subplots(1, 2, figsize=(8.6, 3.8), sharey=True)
    for axes, phase in zip(panels, (False, True)):
        for colour, (case, words) in zip(SERIES, cases.items()):
            for program, style in STYLES.items():
                row = rows_of(rows, case, phase, program)
                axes.plot([r["ranks"] for r in row], [r["efficiency"] for r in row], style, color=colour,
                          label=f"{words}{program}")
        axes.set_xscale("log")
        axes.set_xlabel("ranks")
        axes.set_ylim(0, 1.05)
        axes.set_title("phase field" if phase else "elastic", fontsize=10)
    panels[0].set_ylabel(title)
    panels[0].legend(fontsize=7, loc="lower left")
    return finish(figure, folder / f"{name}.png")


def draw_terms(folder, rows):
    programs = list(STYLES)[:3]
    figure, panels = plt.subplots(1, len(programs), figsize=(10.6, 3.8), sharey=True)
    for axes, program in zip(panels, programs):
        row = rows_of(rows, "weak", False, program)
        for colour, term in zip(SERIES, row[0]["terms"]):
            points = [(r["ranks"], 1e3 * r["terms"][term]) for r in row if r["terms"][term] > 0]
            if points:
                axes.plot(*zip(*points), color=colour, label=term, marker="." if len(points) < 3 else "")
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xlabel("ranks")
        axes.set_title(f"weak, elastic, {program}", fontsize=10)
    panels[0].set_ylabel("time per step [ms]")
    panels[0].set_ylim(1e-3, 1e3)
    panels[0].legend(fontsize=8, ncol=2, loc="upper left")
    return finish(figure, folder / "model_terms.png")


def draw_partition(folder, model):
    figure, axes = plt.subplots()
    ranks = [16, 128, 1024, 8192, 100000]
    for colour, blocks in zip(SERIES, (2 ** 15, 2 ** 18, 2 ** 21)):
        fitted = [parts for parts in ranks if parts <= blocks]
        axes.plot(fitted, [model.metis_seconds(blocks, parts) for parts in fitted], color=colour,
                  label=f"{blocks} blocks, fit")
        near = [row for row in model.parameters["partition"]["metis"] if 0.5 < row["blocks"] / blocks < 2]
        axes.plot([row["parts"] for row in near], [row["seconds"] for row in near], "o", color=colour)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("parts")
    axes.set_ylabel("METIS on rank 0 [s]")
    axes.legend(fontsize=8)
    return finish(figure, folder / "model_partition.png")


def draw_model(folder, rows, model):
    strong = {case: f"$10^{{{case[-2:].lstrip('0')}}}$ particles, " for case in dict.fromkeys(r["case"] for r in rows)
              if case.startswith("strong")}
    return [draw_predicted(folder, "model_strong", rows, strong, "efficiency, strong scaling"),
            draw_predicted(folder, "model_weak", rows, {"weak": ""}, "efficiency, weak scaling"),
            draw_terms(folder, rows), draw_partition(folder, model)]
