#!/usr/bin/python3
"""Holds the sources to the layers: who includes whom, who sees which library, no cycles.

check_layers.py [ROOT]        checks a source tree (default: the one that this script is part of)
check_layers.py --self-test   plants one fault of each kind in a temporary tree and expects each to be found
"""
import os
import re
import sys
import tempfile
from collections import namedtuple
from pathlib import Path

# A layer may include itself and what has a smaller number; layers with the same number are strangers.
LAYERS = {"base": 0, "math": 1, "fields": 2, "materials": 3, "parallel": 3, "transfer": 3, "solvers": 4,
          "effects": 5, "time": 6, "scene": 7, "io": 7, "simulation": 8, "apps": 9}

# Header pattern -> layers that may include it.
LIBRARIES = [
    (re.compile(r"mpi\.h$"), {"parallel", "solvers", "io", "apps"}),
    (re.compile(r"petscsf\.h$"), {"parallel", "solvers", "apps"}),
    (re.compile(r"petsc\w*\.h(pp)?$"), {"solvers", "apps"}),
    (re.compile(r"(hdf5(_hl)?|H5\w*)\.h$"), {"io"}),
    (re.compile(r"metis\.h$"), {"parallel"}),
    (re.compile(r"muParser\w*\.h$"), {"math"}),
]
MPI_NAMES_ALLOWED = {"parallel", "solvers", "io", "apps"}
MPI_NAME = re.compile(r"\bP?MPI_[A-Za-z]\w*")

LONG_FILE = 450  # lines
INCLUDE = re.compile(r'^\s*#\s*include\s*([<"])([^>"]+)[>"]')
# Comments, raw strings, strings and character literals; the ' of 1'000 starts no character literal.
NO_CODE = re.compile(r'//[^\n]*|/\*.*?\*/|R"([^()\s\\]{0,16})\(.*?\)\1"|"(?:\\.|[^"\\\n])*"|'
                     r"(?<![0-9A-Fa-f])'(?:\\.|[^'\\\n])*'", re.DOTALL)

Fault = namedtuple("Fault", "kind place text")


def layer_of(path):
    """Layer of a path relative to the root; None for a file that stands in no folder of a layer."""
    parts = path.parts
    if parts[0] == "apps":
        return "apps"
    rest = parts[2:] if parts[:2] == ("include", "mpm_hpc") else parts[1:]
    return rest[0] if len(rest) > 1 else None


def blank(match):
    return re.sub(r"[^\n]", " ", match.group())


def resolve(root, includer, name):
    """The file of this tree that an #include means, relative to the root, or None for a library's."""
    for folder in (includer.parent, Path("include"), Path("src"), Path(".")):
        candidate = Path(os.path.normpath(folder / name))
        if not candidate.parts[0] == ".." and (root / candidate).is_file():
            return candidate
    return None


def find_cycle(graph):
    """A list of files of which each includes the next and the last is the first, or []."""
    state = {}  # 1: on the current path, 2: done
    for start in sorted(graph):
        if start in state:
            continue
        path, pending = [start], [iter(graph[start])]
        state[start] = 1
        while pending:
            following = next(pending[-1], None)
            if following is None:
                pending.pop()
                state[path.pop()] = 2
            elif state.get(following) == 1:
                return path[path.index(following):] + [following]
            elif following not in state:
                state[following] = 1
                path.append(following)
                pending.append(iter(graph.get(following, [])))
    return []


def check(root):
    """Returns (faults, warnings, number of files)."""
    faults, warnings, graph = [], [], {}
    files = sorted(p.relative_to(root) for top in ("include", "src", "apps") for p in (root / top).rglob("*")
                   if p.suffix in (".hpp", ".cpp", ".h"))
    for file in files:
        layer = layer_of(file)
        if layer not in LAYERS:
            faults.append(Fault("unknown layer", f"{file}:1", "stands in no layer's folder"))
            continue
        text = (root / file).read_text(encoding="utf-8")
        lines = text.splitlines()
        if len(lines) > LONG_FILE:
            warnings.append(f"{file}: {len(lines)} lines, more than {LONG_FILE}")

        graph[file] = []
        # Comments go, so that an #include in one doesn't count; strings stay for the names of the files.
        code = NO_CODE.sub(lambda m: blank(m) if m.group()[0] == "/" else m.group(), text)
        for number, line in enumerate(code.splitlines(), 1):
            include = INCLUDE.match(line)
            if not include:
                continue
            place, name = f"{file}:{number}", include.group(2)
            target = resolve(root, file, name)
            if target:
                graph[file].append(target)
                other = layer_of(target)
                if other != layer and LAYERS.get(other, 0) >= LAYERS[layer]:
                    faults.append(Fault("layer", place, f"{layer} must not include {other} ({name})"))
            elif name.startswith("mpm_hpc/") or include.group(1) == '"' and ".." in name:
                faults.append(Fault("missing file", place, f"{name} does not exist"))
            for pattern, allowed in LIBRARIES:
                if not target and pattern.search(name):
                    if layer not in allowed:
                        faults.append(Fault("library", place, f"{layer} must not include {name}; only "
                                            f"{', '.join(sorted(allowed, key=LAYERS.get))} may"))
                    break

        if layer not in MPI_NAMES_ALLOWED:
            for number, line in enumerate(NO_CODE.sub(blank, text).splitlines(), 1):
                for found in MPI_NAME.findall(line):
                    faults.append(Fault("MPI name", f"{file}:{number}", f"{layer} must not name {found}"))

    cycle = find_cycle(graph)
    if cycle:
        faults.append(Fault("cycle", f"{cycle[0]}:1", "include cycle " + " -> ".join(map(str, cycle))))
    return faults, warnings, len(files)


# A tree without a fault, with everything in it that could be mistaken for one.
CLEAN = {
    "include/mpm_hpc/base/a.hpp": '#pragma once\n// #include "mpm_hpc/apps/x.hpp" MPI_Comm\n',
    "include/mpm_hpc/math/a.hpp": '#pragma once\n#include "mpm_hpc/base/a.hpp"\n/*\n#include <mpi.h>\n*/\n',
    "include/mpm_hpc/fields/a.hpp": '#include "mpm_hpc/math/a.hpp"\nauto s = "MPI_Comm // ";  // MPI_Comm\n',
    "include/mpm_hpc/materials/a.hpp": '#include "mpm_hpc/fields/a.hpp"\nint n = 1\'000\'000;\n',
    "include/mpm_hpc/parallel/a.hpp": "#include <metis.h>\n#include <mpi.h>\n#include <petscsf.h>\n",
    "include/mpm_hpc/transfer/a.hpp": '#include "mpm_hpc/base/a.hpp"\n#include "mpm_hpc/fields/a.hpp"\n',
    "include/mpm_hpc/solvers/a.hpp": '#include <petscksp.h>\n#include "mpm_hpc/parallel/a.hpp"\n',
    "include/mpm_hpc/effects/walls/a.hpp": '#include "mpm_hpc/solvers/a.hpp"\n#include <vector>\n',
    "include/mpm_hpc/time/a.hpp": '#include "mpm_hpc/effects/walls/a.hpp"\n',
    "include/mpm_hpc/scene/a.hpp": '#include "mpm_hpc/time/a.hpp"\n',
    "include/mpm_hpc/io/a.hpp": "#include <H5public.h>\n#include <hdf5.h>\nMPI_Comm c;\n",
    "include/mpm_hpc/simulation/a.hpp": '#include "mpm_hpc/scene/a.hpp"\n#include "mpm_hpc/io/a.hpp"\n',
    "src/effects/walls/a.cpp": '#include "mpm_hpc/effects/walls/a.hpp"\n#include "local.hpp"\n',
    "src/effects/walls/local.hpp": '#include "mpm_hpc/effects/walls/a.hpp"\n',
    "apps/mpm_hpc.cpp": '#include <mpi.h>\n#include <petsc.h>\n#include "mpm_hpc/simulation/a.hpp"\n',
}

# (kind that must be found, file, line that is planted at its end)
PLANTED = [
    ("layer", "include/mpm_hpc/base/a.hpp", '#include "mpm_hpc/transfer/a.hpp"'),
    ("layer", "include/mpm_hpc/transfer/a.hpp", '#include "mpm_hpc/materials/a.hpp"'),
    ("layer", "include/mpm_hpc/materials/a.hpp", '#include <mpm_hpc/parallel/a.hpp>'),
    ("layer", "include/mpm_hpc/parallel/a.hpp", '#include "mpm_hpc/transfer/a.hpp"'),
    ("layer", "include/mpm_hpc/solvers/a.hpp", '#include "../time/a.hpp"'),
    ("layer", "include/mpm_hpc/scene/a.hpp", '#include "mpm_hpc/io/a.hpp"'),
    ("layer", "include/mpm_hpc/io/a.hpp", '#  include "mpm_hpc/scene/a.hpp"'),
    ("layer", "src/effects/walls/a.cpp", '#include "mpm_hpc/simulation/a.hpp"'),
    ("missing file", "src/effects/walls/a.cpp", '#include "mpm_hpc/base/nowhere.hpp"'),
    ("unknown layer", "src/extras/a.cpp", "int x;"),
    ("unknown layer", "include/mpm_hpc/a.hpp", "int x;"),
    ("library", "include/mpm_hpc/effects/walls/a.hpp", "#include <mpi.h>"),
    ("library", "include/mpm_hpc/simulation/a.hpp", "#include <mpi.h>"),
    ("library", "include/mpm_hpc/parallel/a.hpp", "#include <petscksp.h>"),
    ("library", "include/mpm_hpc/effects/walls/a.hpp", "#include <petscmat.h>"),
    ("library", "apps/mpm_hpc.cpp", "#include <hdf5.h>"),
    ("library", "include/mpm_hpc/scene/a.hpp", "#include <H5Fpublic.h>"),
    ("library", "include/mpm_hpc/solvers/a.hpp", "#include <metis.h>"),
    ("MPI name", "include/mpm_hpc/time/a.hpp", "int f() { return MPI_SUCCESS; }"),
    ("MPI name", "include/mpm_hpc/fields/a.hpp", 'auto x = "a" + MPI_Wtime();'),
    ("MPI name", "include/mpm_hpc/materials/a.hpp", "int m = 1'000 + MPI_SUCCESS + 1'000;"),
    ("cycle", "include/mpm_hpc/effects/walls/a.hpp", '#include "../../../../src/effects/walls/local.hpp"'),
    ("cycle", "include/mpm_hpc/base/a.hpp", '#include "a.hpp"'),
]


def self_test():
    """Returns the exit code."""
    missed = 0
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)

        def write(name, text):
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            (root / name).write_text(text, encoding="utf-8")

        for name, text in CLEAN.items():
            write(name, text)
        faults, warnings, count = check(root)
        if faults or warnings or count != len(CLEAN):
            print(f"WRONG: the clean tree of {len(CLEAN)} files gave {count} files, {faults} {warnings}")
            missed += 1
        for kind, name, line in PLANTED:
            write(name, CLEAN.get(name, "") + line + "\n")
            line_number = CLEAN.get(name, "").count("\n") + 1 if kind not in ("cycle", "unknown layer") else 1
            if not any(f.kind == kind and f.place.endswith(f":{line_number}") for f in check(root)[0]):
                print(f"WRONG: '{line}' in {name} was not found ({kind})")
                missed += 1
            if name in CLEAN:
                write(name, CLEAN[name])
            else:
                (root / name).unlink()
        write("src/base/long.cpp", "\n" * (LONG_FILE + 1))
        if len(check(root)[1]) != 1:
            print("WRONG: the long file gave no warning")
            missed += 1
    print(f"self-test: {len(PLANTED)} faults planted, {missed} things wrong")
    return 1 if missed else 0


def main(arguments):
    if arguments == ["--self-test"]:
        return self_test()
    root = Path(arguments[0]) if arguments else Path(__file__).resolve().parents[2]
    faults, warnings, count = check(root)
    for warning in warnings:
        print(f"warning: {warning}")
    for fault in faults:
        print(f"{fault.place}: {fault.text}")
    print(f"{count} files, {len(faults)} faults, {len(warnings)} warnings")
    if count == 0:
        print(f"no source below {root}")
    return 1 if faults or count == 0 else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
