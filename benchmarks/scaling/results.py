"""Makes one point per kind and rank count from the run.json files of a scaling study."""
import csv
import json
import statistics
from pathlib import Path

NO_EFFICIENCY = "more ranks than cores: no efficiency"


class ScalingError(Exception):
    """A sentence for the user, and the exit code that goes with it."""

    def __init__(self, sentence, code=2):
        super().__init__(sentence)
        self.code = code


def read_json(path):
    try:
        return json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as fault:
        raise ScalingError(f"{path} can't be read: {fault.strerror}", 4) from fault
    except ValueError as fault:
        raise ScalingError(f"{path} is no JSON file: {fault}", 4) from fault


def median_and_spread(values):
    """Median, and half of the distance from the smallest to the largest over the median."""
    middle = statistics.median(values)
    return middle, (max(values) - min(values)) / 2 / middle if middle else 0.0


def stage_shares(report):
    """{stage: share of the time in stages}, over the mean of the ranks; the phase solve lies inside the effects."""
    seconds = {name: time["mean"] for name, time in report["stages"].items()}
    if "phase solve" in seconds:
        seconds["effects"] = max(0.0, seconds["effects"] - seconds["phase solve"])
    for name in ("history", "output", "checkpoint"):
        seconds.pop(name, None)
    total = sum(seconds.values())
    return {name: time / total for name, time in seconds.items()} if total else {}


def per_rank(report, *names):
    """Mean and largest value of a rank and step."""
    traffic = report["traffic_per_step"]
    return sum(traffic[name]["mean"] for name in names), sum(traffic[name]["max"] for name in names)


def point_of(entries, reports, cores):
    """One point from the reports of its repeats."""
    first = reports[0]
    messages, most_messages = per_rank(first, "halo_messages", "sort_messages")
    volume, most_volume = per_rank(first, "halo_bytes", "sort_bytes")
    point = {
        "kind": entries[0]["kind"], "ranks": first["ranks"], "particles": first["particles"], "steps": first["steps"],
        "repeats": len(reports), "cores": cores, "crowded": first["ranks"] > cores,
        "messages_per_rank_and_step": messages, "most_messages_of_a_rank": most_messages,
        "bytes_per_rank_and_step": volume, "most_bytes_of_a_rank": most_volume,
        "bytes_per_step": first["bytes_per_step"], "collectives_per_step": per_rank(first, "collectives")[0],
        "solver_reductions_per_step": per_rank(first, "solver_reductions")[0],
        "solver_iterations_per_step": sum(first["solver_iterations"].values()) / first["steps"],
        "steps_per_sort": 1 / sorts if (sorts := per_rank(first, "sorts")[0]) else None,
        "neighbours": first["neighbours"]["mean"], "ghost_nodes": first["ghost_nodes"]["mean"],
        "imbalance": first["imbalance"], "bytes_per_particle": first["bytes_per_particle"],
    }
    if not point["crowded"]:
        rates = [report["particle_steps_per_second_per_core"] for report in reports]
        point["rates"] = rates
        point["particle_steps_per_second_per_core"], point["spread"] = median_and_spread(rates)
        point["stage_shares"] = {name: statistics.median(stage_shares(report).get(name, 0) for report in reports)
                                 for name in stage_shares(first)}
        point["sort_seconds_per_step"] = statistics.median(
            report["stages"]["sort and migrate"]["mean"] / report["steps"] for report in reports)
        point["halo_wait_seconds_per_step"] = statistics.median(per_rank(report, "halo_wait_seconds")[0]
                                                                for report in reports)
    return point


def add_efficiency(points):
    """Against the smallest rank count of the same kind, pair by pair of the same turn."""
    for kind in {point["kind"] for point in points}:
        row = [point for point in points if point["kind"] == kind and not point["crowded"]]
        for point in row:
            ratios = [rate / base for rate, base in zip(point["rates"], row[0]["rates"])]
            point["efficiency"], point["efficiency_spread"] = median_and_spread(ratios)
            point["efficiency_base"] = row[0]["ranks"]
            if kind == "strong":
                point["speed_up"] = point["efficiency"] * point["ranks"] / row[0]["ranks"]


def gather(folder):
    study = read_json(folder / "plan.json")
    groups = {}
    for entry in study["runs"]:
        path = folder / entry["folder"] / "run.json"
        if not path.exists():
            raise ScalingError(f"the run {entry['folder']} has left no run.json: it is not finished, or it failed", 1)
        report = read_json(path)
        if report["exit"]["code"]:
            raise ScalingError(f"the run {entry['folder']} ended with code {report['exit']['code']}: "
                               f"{report['exit']['reason']}", 1)
        if report["ranks"] != entry["ranks"]:
            raise ScalingError(f"the run {entry['folder']} had {report['ranks']} ranks in place of {entry['ranks']}: "
                               "the launcher doesn't start them", 1)
        if entry["particles"] not in (None, report["particles"]):
            raise ScalingError(f"the run {entry['folder']} has {report['particles']} particles in place of "
                               f"{entry['particles']}", 1)
        groups.setdefault((entry["kind"], entry["ranks"]), []).append((entry, report))
    points = [point_of([entry for entry, _ in group], [report for _, report in group], study["cores"])
              for group in groups.values()]
    points.sort(key=lambda point: (point["kind"], point["ranks"]))
    add_efficiency(points)
    return points


def write(folder, points):
    (folder / "results.json").write_text(json.dumps(points, indent=1) + "\n", encoding="utf-8")
    columns = [name for name in dict.fromkeys(key for point in points for key in point)
               if name not in ("rates", "stage_shares")]
    with open(folder / "results.csv", "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns, restval="", extrasaction="ignore")
        writer.writeheader()
        writer.writerows(points)


def table(points):
    lines = [f"{'kind':<8}{'ranks':>6}{'particles':>12}{'M/s/core':>10}{'spread':>8}{'efficiency':>12}"
             f"{'messages':>10}{'kB':>9}{'imbalance':>11}"]
    for point in points:
        speed = f"{'-':>10}{'-':>8}{'-':>12}"
        if not point["crowded"]:
            speed = (f"{point['particle_steps_per_second_per_core'] / 1e6:>10.2f}{100 * point['spread']:>7.1f}%"
                     f"{point['efficiency']:>12.3f}")
        lines.append(f"{point['kind']:<8}{point['ranks']:>6}{point['particles']:>12}{speed}"
                     f"{point['messages_per_rank_and_step']:>10.1f}{point['bytes_per_rank_and_step'] / 1e3:>9.1f}"
                     f"{point['imbalance']:>11.3f}   {NO_EFFICIENCY if point['crowded'] else ''}".rstrip())
    return "\n".join(lines)
