#!/usr/bin/python3
"""Stops, kills and hinders runs from outside, on one rank and on three: a signal must end with a checkpoint
and exit code 75, a crash must leave one from which the run goes on as if nothing had happened, a full disk
must end with exit code 4.

    check_interruptions.py [NAME...]     all cases, or those whose name contains one of the words
"""
import os
import signal
import sys
import time
from pathlib import Path

sys.dont_write_bytecode = True
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))
import mpm_program as mpm  # noqa: E402
from fault_cases import Case, DISC, changed, judge, try_all  # noqa: E402

SAVED_EVERY = 0.5  # [s]
# Runs until it is stopped: a disc that turns in the middle.
ENDLESS = changed(DISC, ("end = 0.5", "end = 1e9"), ("center = [0.3, 0.3]", "center = [0.5, 0.5]"),
                  ("velocity = [0.1, 0.1]", "angular_velocity = 0.1"))[0]


def is_under_way(folder):
    return (folder / "frames.hdf.series").exists()


def signal_flow(number, target):
    """target: "mpirun", "all" ranks, or the "last" rank only."""
    def flow(case, folder, ranks):
        out = folder / "out"
        program = mpm.Program([*case.scene_argument, *case.arguments], ranks, folder)
        started = program.wait_for(lambda: is_under_way(out))
        time.sleep(0.3)
        processes = [program.process.pid] if target == "mpirun" else program.rank_processes()
        for pid in processes[-1:] if target == "last" else processes:
            os.kill(pid, number)
        outcome = program.finish()
        complaints = judge(case, outcome, ranks)
        if not started or outcome.hung:
            return outcome, complaints + ["it did not come to the first step"] * (not started)
        complaints += stopped_cleanly(out)
        again = mpm.run(["scene.toml", "--output", "out", "--steps", "5", "--restart",
                         mpm.checkpoints(out).get(mpm.report(out)["steps"], "none")], ranks, folder)
        if again.code != 0:
            complaints.append(f"the restart ends with {again.code}: {again.err}")
        return outcome, complaints
    return flow


def stopped_cleanly(out):
    report, steps = mpm.report(out), sorted(mpm.checkpoints(out))
    complaints = []
    if report["exit"]["code"] != 75 or "signal" not in report["exit"]["reason"]:
        complaints.append(f"run.json says {report['exit']}, expected code 75 and a signal")
    if report["steps"] not in steps:
        complaints.append(f"checkpoints of the steps {steps}, expected one of step {report['steps']}")
    if mpm.history(out)[-1]["step"] != report["steps"]:
        complaints.append(f"the history ends at step {mpm.history(out)[-1]['step']:g}, not {report['steps']}")
    return complaints


def crash_flow(case, folder, ranks):
    """Kills a run, damages its newest checkpoint, goes on from the one before, as an unbroken run does."""
    out, seen = folder / "out", set()
    program = mpm.Program([*case.scene_argument, *case.arguments], ranks, folder)
    started = program.wait_for(lambda: seen.update(mpm.checkpoints(out)) or len(seen) >= 3)
    for pid in program.rank_processes()[-1:]:
        os.kill(pid, signal.SIGKILL)
    crashed = program.finish()
    complaints = [] if started else ["it never wrote a third checkpoint"]
    if crashed.hung or crashed.code == 0:
        complaints.append(f"the killed run: exit code {crashed.code}, hung: {crashed.hung}")
    left = mpm.checkpoints(out)
    if len(left) < 2:
        return crashed, complaints + [f"{len(left)} checkpoints are left, expected 2"]
    *_, older, newest = sorted(left)
    time_of = {int(row["step"]): row["time"] for row in mpm.history(out)}
    until = round(time_of[older] / SAVED_EVERY + 4) * SAVED_EVERY

    def go_on(step, output, *more):
        return mpm.run(["scene.toml", "--output", output, "--restart", left[step], *more], ranks, folder)

    whole = go_on(newest, "elsewhere", "--steps", "1")
    if whole.code != 0:
        complaints.append(f"the newest checkpoint of the killed run can't be used: {whole.code} {whole.err}")
    left[newest].write_bytes(left[newest].read_bytes()[:-1000])
    before = mpm.snapshot(out)
    complaints += judge(Case("", 4, [left[newest].name, "cut short", "restart from the checkpoint before"]),
                        go_on(newest, "out", "--until", until), ranks)
    if mpm.snapshot(out) != before:
        complaints.append("the refused restart changed the folder")
    outcome = go_on(older, "out", "--until", until)
    complaints += judge(case, outcome, ranks)
    unbroken = mpm.run(["scene.toml", "--output", "unbroken", "--until", until], ranks, folder)
    if unbroken.code != 0:
        return outcome, complaints + [f"the unbroken run ends with {unbroken.code}: {unbroken.err}"]
    expected = {path.name: path.read_bytes() for path in (folder / "unbroken").iterdir()}
    found = {path.name: path.read_bytes() for path in out.iterdir()}
    if found.keys() != expected.keys():
        complaints.append(f"files {sorted(found)}, expected {sorted(expected)}")
    differing = [name for name, content in sorted(expected.items())
                 if name != "run.json" and found.get(name) != content]
    if differing:
        complaints.append(f"not as in the unbroken run: {', '.join(differing)}")
    return outcome, complaints


def vanish_flow(case, folder, ranks):
    """Takes the output folder away from under a run."""
    program = mpm.Program([*case.scene_argument, *case.arguments], ranks, folder)
    started = program.wait_for(lambda: mpm.checkpoints(folder / "out"))
    if started:
        (folder / "out").rename(folder / "gone")
    outcome = program.finish()
    return outcome, judge(case, outcome, ranks) + ([] if started else ["it never wrote a checkpoint"])


def full_flow(case, folder, ranks):
    """A disk that takes the frames but not the larger checkpoint: files of 32 blocks of 512 bytes at most."""
    outcome = mpm.Program([*case.scene_argument, *case.arguments], ranks, folder,
                          prelude="export OMPI_MCA_btl=self,tcp; trap '' XFSZ; ulimit -f 32").finish()
    complaints = judge(case, outcome, max(ranks, 2))  # mpirun speaks on one rank too
    names = sorted(path.name for path in (folder / "out").iterdir())
    if names != ["frame_000000.hdf", "frames.hdf.series", "history.csv", "run.json", "scene.toml"]:
        complaints.append(f"left behind: {names}, expected what was good before, and run.json")
    elif mpm.report(folder / "out")["exit"]["code"] != 4:
        complaints.append(f"run.json says {mpm.report(folder / 'out')['exit']}, expected code 4")
    return outcome, complaints


def machine_cases():
    out = ("--output", "out")
    saving = changed(ENDLESS, ("every = 0.25", f"every = 0.5\nhistory_every = 0.125\n"
                                               f"checkpoint_every = {SAVED_EVERY}"))[0]
    early = changed(DISC, ("every = 0.25", "every = 0.25\ncheckpoint_every = 0.1"))[0]
    # SIGTERM to mpirun is left out: mpirun gives its ranks one second and then kills them.
    targets = [("SIGTERM", "all", (1, 3)), ("SIGTERM", "last", (3,)), ("SIGUSR1", "all", (1, 3)),
               ("SIGUSR1", "last", (3,)), ("SIGUSR1", "mpirun", (3,))]
    return [Case(f"{name} to {target}", 75, scene=ENDLESS, arguments=out, ranks=ranks,
                 flow=signal_flow(getattr(signal, name), target)) for name, target, ranks in targets] + [
        Case("kill -9 and restart", 0, scene=saving, arguments=out, flow=crash_flow),
        Case("output folder vanishes", 4, [r"out/\w+"], scene=saving, arguments=out, flow=vanish_flow),
        Case("disk full", 4, ["can't write out/checkpoint_", "File too large"], scene=early, arguments=out,
             flow=full_flow),
    ]


if __name__ == "__main__":
    sys.exit(try_all(machine_cases(), sys.argv[1:]))
