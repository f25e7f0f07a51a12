#!/usr/bin/python3
"""Restarts of implicit and quasi-static runs: the same bits on as many ranks, on others the same to the solver's tolerance."""
import sys
import tempfile
from pathlib import Path

sys.dont_write_bytecode = True
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))
import mpm_program as mpm  # noqa: E402

restart = mpm.load_script(Path(__file__).with_name("check_restart.py"))

# A strip, clamped at one side, that a load bends; rows and checkpoints fall on the same steps.
STRIP = """\
dimension = 2
[domain]
lower = [-0.5, -1.5]
upper = [2.5, 1]
[grid]
spacing = 0.125
[time]
end = 0.1
integrator = "{integrator}"
max_dt = 0.025
[newton]
tolerance = 1e-10
[output]
frames = false
every = 0.05
history_every = 0.05
checkpoint_every = 0.05
[material.strip]
model = "{model}"
youngs_modulus = 1e4
poisson_ratio = 0.3
density = 10
[[body]]
name = "strip"
material = "strip"
shape = {{type = "box", lower = [0, 0], upper = [2, 0.5]}}
particles_per_cell = 4
[effect.walls]
x_min = "slip"
[[effect.grip]]
name = "clamp"
shape = {{type = "box", lower = [-1, -1], upper = [0.2, 1]}}
[[effect.traction]]
shape = {{type = "box", lower = [1.875, -1], upper = [3, 1]}}
traction = [0, -64]
area = 0.5
ramp = 0.2
"""
SCENES = {"implicit": STRIP.format(integrator="implicit", model="neo_hookean"),
          "quasi_static": STRIP.format(integrator="quasi_static", model="hencky")}
# Newton's method stops at 1e-10 of the forces; the strip is ten times softer than that against bending.
LOOSE = 1e-9 / restart.TOLERANCE


def main():
    with tempfile.TemporaryDirectory() as folder:
        runs = restart.Runs(Path(folder))
        runs.make({f"{kind}_n{ranks}": (scene, ranks, ()) for kind, scene in SCENES.items() for ranks in (1, 2)})
        wanted = {}
        for kind, scene in SCENES.items():
            step, checkpoint = runs.first_checkpoint(f"{kind}_n2")
            wanted.update({f"{kind}_2to{ranks}": (scene, ranks, ("--restart", checkpoint)) for ranks in (1, 2, 3)})
        runs.make(wanted)
        for kind in SCENES:
            step, _ = runs.first_checkpoint(f"{kind}_n2")
            last = mpm.history(runs[f"{kind}_n2"])[-1]
            restart.expect(f"{kind}, step of the restart", step, f"between 0 and {last['step']:g}", 0 < step < last["step"])
            restart.expect(f"{kind}, elastic energy at the end", f"{last['elastic_energy']:.3g} J", "the strip is bent",
                           last["elastic_energy"] > 0.01)
            restart.expect(f"{kind}, Newton iterations since the last row", last["newton_iterations"], "some",
                           last["newton_iterations"] > 0 and last["newton_residual"] <= 1e-10)
            restart.expect_same_bits(f"{kind}, restart 2 -> 2 ranks", runs[f"{kind}_n2"], runs[f"{kind}_2to2"], step)
            energy = max(row["elastic_energy"] for row in mpm.history(runs[f"{kind}_n2"]))
            scales = {"elastic_energy": LOOSE * energy, "external_work": LOOSE * energy}
            if kind == "implicit":
                scales["momentum_."] = LOOSE * last["mass"] * max(row["max_speed"] for row in mpm.history(runs["implicit_n2"]))
            restart.expect_close(f"{kind} on 2 ranks and on 1", runs[f"{kind}_n1"], runs[f"{kind}_n2"], scales)
            for ranks in (1, 3):
                restart.expect_close(f"{kind}, restart 2 -> {ranks} ranks", runs[f"{kind}_n2"], runs[f"{kind}_2to{ranks}"],
                                     scales)
    print(f"{len(restart.wrong)} wrong")
    return 1 if restart.wrong else 0


if __name__ == "__main__":
    sys.exit(main())
