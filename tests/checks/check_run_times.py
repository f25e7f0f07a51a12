#!/usr/bin/python3
"""The gallery's table is made of what run.json says, and a run that doesn't fit is named."""
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

SCENES = Path(os.environ.get("MPM_SOURCE_DIR", Path(__file__).resolve().parents[2])) / "apps/scenes"
NAMES = sorted(path.stem for path in SCENES.glob("*.toml"))
PAGE = "# Gallery\n\n| scene | particles | steps |\n|---|---|---|\n| `old` | 1 | 2 |\n\nMore.\n"


def make_runs(folder, **odd):
    for i, name in enumerate(NAMES):
        told = {"ranks": 2, "particles": 1000 * (i + 1), "steps": 10 + i, "wall_seconds": 0.5 + 7 * i, "exit": {"code": 0}}
        told.update(odd.get(name, {}))
        (folder / name).mkdir(exist_ok=True)
        (folder / name / "run.json").write_text(json.dumps(told))


def run_times(folder):
    (folder / "page.md").write_text(PAGE)
    done = subprocess.run([SCENES / "run_times", folder, "--page", folder / "page.md"], capture_output=True, text=True,
                          check=False)
    return done.returncode, done.stderr, (folder / "page.md").read_text()


def main():
    wrong = []

    def expect(what, holds, seen):
        if not holds:
            wrong.append(f"{what}: {seen}")

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        make_runs(folder)
        code, _, page = run_times(folder)
        rows = [line for line in page.splitlines() if line.startswith("| `")]
        expect("a row for each scene", code == 0 and len(rows) == len(NAMES), page)
        expect("the first row", rows and rows[0] == f"| `{NAMES[0]}` | 1,000 | 10 | 0.5 s |", rows[:1])
        last = len(NAMES) - 1
        seconds = 0.5 + 7 * last
        expect("the last row", rows and rows[-1].endswith(f"| {int(seconds // 60)} min {seconds % 60:.0f} s |"), rows[-1:])
        expect("the rest of the page", page.startswith("# Gallery\n\n| scene |") and page.endswith("|\n\nMore.\n"), page)
        for odd, word in (({"ranks": 3}, "is of 3 ranks"), ({"exit": {"code": 3}}, "exit code 3")):
            make_runs(folder, **{NAMES[1]: odd})
            code, text, page = run_times(folder)
            expect(word, code == 1 and word in text and page == PAGE, text)
        make_runs(folder)
        (folder / NAMES[2] / "run.json").unlink()
        code, text, _ = run_times(folder)
        expect("a missing run", code == 1 and f"{NAMES[2]}/run.json is missing" in text, text)
    print("\n".join(wrong) or f"table of {len(NAMES)} scenes as expected")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
