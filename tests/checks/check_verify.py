#!/usr/bin/python3
"""Checks that mpm_verify makes a report of figures and curves, tells what fails, and refuses an empty folder."""
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

SOURCE = Path(os.environ.get("MPM_SOURCE_DIR", Path(__file__).resolve().parents[2]))
PROGRAM = SOURCE / "apps" / "mpm_verify"
failures = []


def expect(truth, words):
    if not truth:
        failures.append(words)
        print(f"FAILED: {words}")


def line(name, value, inside=True, short="", ranks=1):
    return json.dumps({"section": "3 waves", "name": name, "value": value, "unit": "s", "expected": "2 within 1 %",
                       "inside": inside, "short_because": short, "ranks": ranks})


def report(folder, *lines):
    figures = folder / "figures"
    figures.mkdir(exist_ok=True)
    for n, text in enumerate(lines):
        (figures / f"A.b_{n}.jsonl").write_text(text + "\n")
    done = subprocess.run([PROGRAM, "--figures", figures, "--output", folder / "report"], capture_output=True, text=True,
                          check=False)
    path = folder / "report" / "report.md"
    return done, path.read_text() if path.is_file() else ""


def main():
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        done, _ = report(folder)
        expect(done.returncode == 2 and "no verification test" in done.stderr, "an empty folder is refused in a sentence")
        (folder / "figures" / "A.b_1.wave.csv").write_text("# log\nspacing,error,reference\n0.1,0.2,0.3\n0.2,0.4,0.5\n")
        (folder / "figures" / "A.b_3.wave.csv").write_text("# log\nspacing,error\n")
        done, text = report(folder, line("period", 2.001), line("period", 2.002, ranks=3),
                            line("loss", 1, False, "the grid is coarse"))
        expect(done.returncode == 0, f"what is right or falls short for a known reason is no failure: {done}")
        expect("| period | 2 within 1 % | 2.001 | 2.002 | s | ok |" in text, "both rank counts stand in one line")
        expect("falls short: the grid is coarse" in text, "a shortfall keeps its reason")
        expect("![wave](wave.png)" in text and (folder / "report" / "wave.png").stat().st_size > 5000, "the curve is drawn")
        done, text = report(folder, line("period", 3, False))
        expect(done.returncode == 1 and "**fails**" in text and "period" in done.stdout, "a failure is named and fails")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
