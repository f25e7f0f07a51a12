"""Starts mpm_hpc on some ranks and reads what it leaves behind: for the scripts in tests/checks."""
import csv
import importlib.machinery
import importlib.util
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections import namedtuple
from pathlib import Path

SOURCE = Path(os.environ.get("MPM_SOURCE_DIR", Path(__file__).resolve().parents[2]))
BINARIES = Path(os.environ.get("MPM_BIN_DIR", SOURCE / "build/release/bin"))
MPIRUN = os.environ.get("MPM_MPIRUN", "mpirun --oversubscribe --bind-to none").split()
SLOWDOWN = 5 if os.environ.get("MPM_SANITIZED") == "ON" else 1
TIME_LIMIT = 60 * SLOWDOWN  # [s] a run that takes longer hangs

# What ctest sets too, so that the scripts also work alone.
ENVIRONMENT = {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
               "OMPI_MCA_rmaps_base_oversubscribe": "1", "OMPI_MCA_mpi_yield_when_idle": "1",
               "OMPI_MCA_btl_vader_single_copy_mechanism": "none", **os.environ}

Outcome = namedtuple("Outcome", "code out err hung")  # code: of the program, or of mpirun


def load_script(path):
    """A program of Python as a module; its name need not end in .py."""
    path = Path(path)
    sys.path.insert(0, str(path.parent))
    loader = importlib.machinery.SourceFileLoader(path.name, str(path))
    module = importlib.util.module_from_spec(importlib.util.spec_from_loader(path.name, loader))
    sys.modules[path.name] = module
    loader.exec_module(module)
    return module


def children(pid):
    """Processes that a process started, by their parent in /proc."""
    found = []
    for entry in Path("/proc").glob("[0-9]*/stat"):
        try:
            parent = int(entry.read_text().rpartition(")")[2].split()[1])
        except (OSError, IndexError, ValueError):
            continue  # ended meanwhile
        if parent == pid:
            found.append(int(entry.parent.name))
    return sorted(found)


class Program:
    """mpm_hpc in the background; without mpirun on one rank, unless a shell's `prelude` goes before it."""

    def __init__(self, arguments, ranks, folder, program=None, prelude=None):
        command = [str(program or BINARIES / "mpm_hpc"), *map(str, arguments)]
        if prelude:
            command = ["sh", "-c", prelude + '; exec "$@"', "sh", *command]
        self.alone = ranks == 1 and not prelude
        # For Open MPI's files: an mpirun that starts while another one ends and removes the folder that they
        # share fails.
        self.session = tempfile.TemporaryDirectory(prefix="mpm_session_", ignore_cleanup_errors=True)
        self.process = subprocess.Popen(
            command if self.alone else [*MPIRUN, "-n", str(ranks), *command], cwd=folder,
            env=dict(ENVIRONMENT, OMPI_MCA_orte_tmpdir_base=self.session.name), stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, errors="replace")

    def rank_processes(self):
        return [self.process.pid] if self.alone else children(self.process.pid)

    def wait_for(self, condition):
        """Polls until the condition holds; False if the program ended or the time is up before."""
        end = time.monotonic() + TIME_LIMIT
        while time.monotonic() < end:
            if condition():
                return True
            if self.process.poll() is not None:
                return False
            time.sleep(0.02)
        return False

    def finish(self, limit=None):
        try:
            out, err = self.process.communicate(timeout=limit or TIME_LIMIT)
            return Outcome(self.process.returncode, out, err, False)
        except subprocess.TimeoutExpired:
            for pid in [*self.rank_processes(), self.process.pid]:
                try:
                    os.kill(pid, signal.SIGKILL)
                except ProcessLookupError:
                    pass
            out, err = self.process.communicate()
            return Outcome(self.process.returncode, out, err, True)
        finally:
            self.session.cleanup()


def run(arguments, ranks, folder, program=None, limit=None):
    return Program(arguments, ranks, folder, program).finish(limit)


def checkpoints(folder):
    """{step: path} of the checkpoints of a run."""
    return {int(path.stem.rpartition("_")[2]): path for path in sorted(Path(folder).glob("checkpoint_*.h5"))}


def history(folder):
    """Rows of history.csv as {name without its unit: number}."""
    with open(Path(folder) / "history.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.reader(file))
    names = [re.sub(r" \[.*\]$", "", name) for name in rows[0]]
    return [dict(zip(names, map(float, row))) for row in rows[1:]]


def report(folder):
    return json.loads((Path(folder) / "run.json").read_text(encoding="utf-8"))


def snapshot(folder):
    """Everything below a folder, with its content."""
    return {str(path.relative_to(folder)):
            (path.stat().st_mtime_ns, path.read_bytes()) if path.is_file() else None
            for path in Path(folder).rglob("*")}
