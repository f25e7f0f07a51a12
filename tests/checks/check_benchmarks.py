#!/usr/bin/python3
"""Runs every benchmark program at its smallest size on 1 and 2 ranks and looks for the promised counters.

What the numbers are is not checked: that takes a quiet machine.
"""
import json
import math
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))
from mpm_program import BINARIES, SOURCE, run

KERNEL = ["production", "reference", "ratio", "ns_per_particle", "bytes_moved", "memory_ns", "arithmetic_ns", "roofline_fraction"]
# Name of a program: what its cases promise, by how their names begin; every number is finite and above 0, but for those
# that may vanish.
PROMISED = {
    "bench_step": {"step/": ["production", "reference", "ratio", "bytes_per_particle", "steps_per_sort"],
                   "machine": ["triad_gb_per_s", "fma_gflops", "fma_single_gflops"]},
    "bench_transfer": {"p2g/": [*KERNEL, "flops"], "g2p/": [*KERNEL, "flops"], "sort/": KERNEL},
    "bench_schemes": {f"{kind}/": ["production", "usual", "ratio", "bytes_per_particle"]
                      for kind in ("linear", "quadratic", "cubic", "material")},
    "bench_materials": {"stress/": [*KERNEL, "flops", "cost_to_neo_hookean"], "polar/": [*KERNEL, "flops"]},
    "bench_phase_field": {"phase_": ["production", "reference", "ratio", "step_ratio_to_elastic", "phase_share",
                                     "solve_share", "linear_share", "driving_energy", "sweep", "assembly", "Krylov",
                                     "products", "gather", "iterations_per_solve", "reference_iterations", "difference"]},
    "bench_partition": {"table/": ["metis_cut", "metis_imbalance", "metis_seconds", "bisection_cut", "bisection_imbalance",
                                   "bisection_seconds", "curve_cut", "curve_imbalance", "curve_neighbours", "curve_seconds"],
                        "moved/": ["metis_moved", "bisection_moved", "metis_kept_imbalance", "bisection_kept_imbalance",
                                   "curve_kept_imbalance"],
                        "growth/": ["metis_seconds", "bisection_seconds", "metis_megabytes", "table_seconds",
                                    "naming_seconds", "curve_seconds", "curve_own_seconds", "curve_cut"],
                        "whole/": ["seconds", "curve_seconds", "first_cut_seconds"]},
    "bench_balance": {"balance/": ["on_rate", "metis_rate", "curve_rate", "off_rate", "ratio", "metis_ratio", "curve_ratio",
                                   "on_imbalance_max", "on_imbalance_mean", "off_imbalance_max"]},
    "bench_halo": {"halo/": ["halo_microseconds", "plain_microseconds", "ratio", "bytes_per_step", "messages_per_step",
                             "plain_messages_per_step", "gb_per_s", "share_of_step", "waited_share"]},
}
PROMISED["bench_newton"] = {
    "assembly/": ["unknowns", "ns_per_unknown", "plain_ns_per_unknown", "ratio", "blocks_ratio", "projected_over_exact",
                  "difference"],
    "iteration/": ["assembly_share", "residual_share", "line_search_share", "Krylov_share", "newton_iterations",
                   "krylov_per_newton"],
    "preconditioner/": ["newton_iterations", "krylov_iterations", "jacobi_krylov_iterations", "speed_over_jacobi"]}
PROMISED["bench_io"] = {kind: ["mb", "gb_per_s", "plain_gb_per_s", "over_plain"] for kind in ("frame/", "checkpoint/")}
MAY_VANISH = {"bytes_per_step", "messages_per_step", "plain_messages_per_step", "gb_per_s", "metis_megabytes",
              "arithmetic_ns", "products", "iterations_per_solve", "difference"}
# Cases that are left out where they would take long.
FILTERS = {("bench_phase_field", 1): "/2k", ("bench_phase_field", 2): "/2d_2k",
           ("bench_newton", 1): "nu_0.3/step_10/|^assembly|^iteration/", ("bench_newton", 2): "2d.*nu_0.3/step_10/|^assembly|^iteration/"}
SAME_SOLUTION = 1e-4  # the plain solve and the program's stop at 1e-6 each


def complaints(name, ranks, folder):
    filters = [f"--benchmark_filter={FILTERS[name, ranks]}"] if (name, ranks) in FILTERS else []
    outcome = run(["--small", "--benchmark_format=json", *filters], ranks, folder, BINARIES / name)
    if outcome.hung or outcome.code != 0:
        yield f"ended with {'a hang' if outcome.hung else outcome.code}: {outcome.err.strip()[-500:]}"
        return
    try:
        cases = json.loads(outcome.out)["benchmarks"]
    except (ValueError, KeyError) as error:
        yield f"prints no valid JSON: {error!r}: {outcome.out[:200]!r}"
        return
    for begin, counters in PROMISED[name].items():
        found = [case for case in cases if case["name"].startswith(begin)]
        if not found:
            yield f"has no case {begin}*"
        for case in found:
            if case.get("error_occurred"):
                yield f"{case['name']}: {case['error_message']}"
                continue
            if case.get("ranks") != ranks:
                yield f"{case['name']}: ran on {case.get('ranks')} ranks"
            for counter in counters:
                value = case.get(counter)
                if value is None or not math.isfinite(value) or value < 0 or (value == 0 and counter not in MAY_VANISH):
                    yield f"{case['name']}: {counter} = {value}"
            if case.get("difference", 0) > SAME_SOLUTION:
                yield f"{case['name']}: the program's solution is {case['difference']} away from the plain one"


def main():
    programs = sorted(path.stem for path in (SOURCE / "benchmarks").glob("bench_*.cpp"))
    if not any((BINARIES / name).exists() for name in programs):
        print("skipped: the benchmarks aren't built (MPM_BUILD_BENCHMARKS)")
        return 77
    failures = 0
    for name in programs:
        if name not in PROMISED:
            print(f"FAIL {name}: say in {Path(__file__).name} which counters it promises")
            failures += 1
            continue
        for ranks in (1, 2):
            with tempfile.TemporaryDirectory() as folder:
                found = list(complaints(name, ranks, folder))
            print(f"{'FAIL' if found else 'ok  '} {name} on {ranks} ranks", *found, sep="\n  " if found else "", flush=True)
            failures += bool(found)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
