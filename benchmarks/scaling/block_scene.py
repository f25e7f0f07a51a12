"""The block that the scaling runs move: an elastic cuboid of whole grid cells, 8 particles in each, so that the number of
particles is exact; with a phase field on request."""
from dataclasses import dataclass, replace

SPACING = 0.01  # [m]
DENSITY, YOUNGS_MODULUS, POISSON_RATIO = 1000, 1e6, 0.3  # [kg/m^3], [Pa], [1]
WAVE_SPEED = (YOUNGS_MODULUS * (1 - POISSON_RATIO) / ((1 + POISSON_RATIO) * (1 - 2 * POISSON_RATIO)) / DENSITY) ** 0.5
FLIGHT = (0.2, 0.14, 0.08)  # speed over the wave speed
CFL = 0.4
PARTICLES_PER_CELL = 8
FREE_CELLS = 8  # around the block


def near_cubic(count):
    """Three factors of a number, as near to each other as can be, the largest first."""
    best = (count, 1, 1)
    for c in range(1, int(round(count ** (1 / 3))) + 1):
        if count % c:
            continue
        for b in range(c, int((count // c) ** 0.5) + 1):
            if (count // c) % b == 0 and count // c // b - c < best[0] - best[2]:
                best = (count // c // b, b, c)
    return best


@dataclass(frozen=True)
class Block:
    cells: tuple  # per direction
    phase: bool = False
    moves: bool = True
    steps: int = 60
    keeps: bool = False  # a checkpoint at the end
    cracked: bool = False  # with a phase field: a crack from the start, solved only around it, as a scene does by default
    partitioner: str = "auto"
    spin: float = 0.1  # speed of the rim over the wave speed: some strain, so that the phase field has something to solve

    @property
    def particles(self):
        return PARTICLES_PER_CELL * self.cells[0] * self.cells[1] * self.cells[2]

    @staticmethod
    def cube_of(particles, **rest):
        """The cube of whole cells that is nearest to a number of particles."""
        side = max(1, round((particles / PARTICLES_PER_CELL) ** (1 / 3)))
        return Block((side, side, side), **rest)

    def times(self, ranks):
        """A cuboid of as many such blocks as there are ranks."""
        return replace(self, cells=tuple(n * f for n, f in zip(self.cells, near_cubic(ranks))))

    def domain_cells(self):
        # A step moves by no more than CFL cells for each wave speed.
        room = [FREE_CELLS + int(self.steps * CFL * (f + self.spin)) + 1 if self.moves else FREE_CELLS for f in FLIGHT]
        return tuple(n + FREE_CELLS + r for n, r in zip(self.cells, room))

    def scene(self):
        lower = FREE_CELLS * SPACING
        upper = [lower + n * SPACING for n in self.cells]
        speed = [f * WAVE_SPEED if self.moves else 0.0 for f in FLIGHT]
        spin = self.spin * WAVE_SPEED / (max(self.cells) * SPACING / 2) if self.moves else 0.0
        text = f"""dimension = 3
[domain]
lower = [0, 0, 0]
upper = {[n * SPACING for n in self.domain_cells()]}
[grid]
spacing = {SPACING}
[time]
end = 1e3
cfl = {CFL}
[output]
frames = false
checkpoint = {"true" if self.keeps else "false"}
[material.block]
model = "{"split_neo_hookean" if self.phase else "neo_hookean"}"
density = {DENSITY}
youngs_modulus = {YOUNGS_MODULUS}
poisson_ratio = {POISSON_RATIO}
"""
        if self.phase:  # tough enough that nothing breaks
            text += f"fracture_toughness = {0.1 * YOUNGS_MODULUS * SPACING}\n[effect.phase_field]\n"
            if self.cracked:
                middle = [lower + n // 2 * SPACING for n in self.cells]
                text += (f"[[effect.phase_field.crack]]\nshape = {{type = \"box\", lower = {[m - SPACING for m in middle]}, "
                         f"upper = {[m + SPACING for m in middle]}}}\n")
            else:  # solved everywhere, which costs most
                text += "active_tolerance = 0\n"
        text += f"[parallel]\npartitioner = \"{self.partitioner}\"\n"
        if self.keeps:  # the owners in it are those of all steps
            text += "rebalance_threshold = 1e3\n"
        return text + f"""[[body]]
name = "block"
material = "block"
particles_per_cell = {PARTICLES_PER_CELL}
jitter = 0.25
velocity = {speed}
angular_velocity = [0, 0, {spin}]
shape = {{type = "box", lower = {[lower] * 3}, upper = {upper}}}
"""
