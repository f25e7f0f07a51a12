#!/usr/bin/python3
"""Checks what benchmarks/compare/compare decides from canned figures, and that it cleans up after itself."""
import contextlib
import io
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

sys.dont_write_bytecode = True
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))
import mpm_program as mpm  # noqa: E402

compare = mpm.load_script(mpm.SOURCE / "benchmarks" / "compare" / "compare")
failures = []


def expect(truth, words):
    if not truth:
        failures.append(words)
        print(f"FAILED: {words}")


def check_decision():
    rates = {
        "same": [(10e6, 10e6), (9e6, 9e6), (8e6, 8e6)],
        "9 % slower": [(10e6, 10.9e6)] * 3,
        "12 % slower": [(10e6, 11.2e6)] * 3,
        "faster": [(20e6, 10e6)] * 3,
        # The machine slows down to a third from turn to turn; the ratio of a turn doesn't.
        "machine drifts": [(30e6, 30e6), (20e6, 20.2e6), (10e6, 9.9e6)],
        "one bad turn": [(10e6, 10e6), (3e6, 10e6), (10e6, 10e6)],
        # Both medians are 10, yet this commit loses two turns of three.
        "loses turns": [(10e6, 20e6), (4e6, 10e6), (12e6, 9e6)],
    }
    rows = {row["case"]: row for row in compare.judge(rates, 10)}
    slower = [case for case, row in rows.items() if row["slower"]]
    expect(slower == ["12 % slower", "loses turns"], f"slower past 10 %: {slower}")
    expect(rows["faster"]["ratio"] == 2 and abs(rows["12 % slower"]["ratio"] - 1 / 1.12) < 1e-12, "ratios are this over other")
    expect([row["case"] for row in compare.judge(rates, 200) if row["slower"]] == [], "the limit counts")
    text = compare.table(list(rows.values()), 10)
    expect("slower by more than 10 %: 12 % slower, loses turns" in text and text.count("SLOWER") == 2, f"table: {text}")


def check_reading():
    rows = [{"name": f"step/double/{law}/elastic/64k/iterations:1/manual_time", "production": rate}
            for law, rate in (("neo_hookean", 2e7), ("fixed_corotated", 1e7))]
    text = json.dumps({"context": {}, "benchmarks": rows})
    expect(compare.production(text, "step/double/fixed_corotated/elastic/64k") == 1e7, "the case's own figure is read")
    for wrong in (text, "no JSON", "{}"):
        try:
            compare.production(wrong, "step/double/fixed_corotated/elastic/6")
            expect(False, "a missing case is an error")
        except compare.CompareError as fault:
            expect("no figure for the case" in str(fault), f"a missing case is named: {fault}")


def git(folder, *arguments):
    return subprocess.run(["git", "-c", "user.name=check", "-c", "user.email=check@localhost", *arguments], cwd=folder,
                          capture_output=True, text=True, check=True).stdout


def check_worktree(folder):
    git(folder, "init", "-q")
    (folder / "file").write_text("one")
    git(folder, "add", "file")
    git(folder, "commit", "-qm", "one")
    (folder / "file").write_text("two")
    compare.SOURCE = folder
    for interruption in (None, KeyboardInterrupt, compare.CompareError("x")):
        with contextlib.suppress(KeyboardInterrupt, compare.CompareError):
            with compare.Worktree(compare.commit_of("HEAD")) as other:
                expect((other / "file").read_text() == "one", "the other commit's file is there")
                if interruption:
                    raise interruption
        expect(not other.parent.exists() and len(git(folder, "worktree", "list").splitlines()) == 1,
               f"the worktree is gone after {interruption!r}")


def check_refusals(folder):
    for words, arguments in [("there is no commit nothing", ["nothing"]), ("above 0", ["HEAD", "--limit", "0"]),
                             ("no folder", ["HEAD", "--scratch", str(folder / "absent")])]:
        with contextlib.redirect_stderr(io.StringIO()) as err:
            code = compare.main(arguments)
        expect(code == 2 and words in err.getvalue() and err.getvalue().count("\n") == 1,
               f"{arguments} ends with 2 and '{words}': {code}, {err.getvalue()}")


def main():
    check_decision()
    check_reading()
    if shutil.which("git"):
        for name in [name for name in os.environ if name.startswith("GIT_")]:
            del os.environ[name]  # a hook's would point at its own repository
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name) / "repository"
            folder.mkdir()
            check_worktree(folder)
            check_refusals(folder)
    print(f"compare: {len(failures)} failures")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
