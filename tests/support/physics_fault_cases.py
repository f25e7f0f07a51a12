"""Scenes that ask for physics which makes no sense: kernels, transfers, materials, plasticity, formulas, sides, sampling."""
from fault_cases import DISC, changed, scene_case

ELASTIC = 'model = "neo_hookean"\nyoungs_modulus = 1000\npoisson_ratio = 0.3\n'
SPACING, VELOCITY, UPPER = "spacing = 0.05", "velocity = [0.1, 0.1]", "upper = [1, 1]"


def plastic(law, rule, keys):
    """The disc of a plastic material."""
    return changed(DISC, ("neo_hookean", law))[0] + f'[material.rubber.plasticity]\nmodel = "{rule}"\n{keys}\n'


def yielding(name, words, law, rule, good, bad, at=None):
    """The fault is in the plasticity table, whose keys are `good` without it."""
    return scene_case(name, words, (good, bad), scene=plastic(law, rule, good), at=at)


def fluid(keys):
    return changed(DISC, (ELASTIC, f"{keys}\n"))[0]


def transfer_cases():
    linear = (SPACING, f'{SPACING}\nkernel = "linear"')

    def transfer(keys):
        return ("[time]", f"[transfer]\n{keys}\n[time]")

    return [
        scene_case("unknown kernel", ['did you mean "quadratic"'], (SPACING, f'{SPACING}\nkernel = "quadratc"'), at="kernel ="),
        scene_case("unknown scheme", ['did you mean "apic"'], transfer('scheme = "apc"'), at="scheme ="),
        scene_case("linear kernel with MLS forces", ["infinite on nodes", 'forces = "classical"'], linear,
                   transfer('forces = "mls"'), at="forces ="),
        scene_case("linear kernel with PolyPIC", ["vanish on nodes", 'kernel = "quadratic"'], linear,
                   transfer('scheme = "polypic"'), at="scheme ="),
        scene_case("FLIP blend above one", ["flip_blend = 1.5", "at most 1"],
                   transfer('scheme = "flip"\nflip_blend = 1.5'), at="flip_blend ="),
        scene_case("FLIP blend without FLIP", ["flip_blend is for", "remove it"], transfer("flip_blend = 0.5"),
                   at="flip_blend ="),
    ]


def material_cases():
    degrees = 'friction_angle = "30 deg"'
    return [
        yielding("no yield stress", ['lacks the required key "yield_stress"'], "hencky", "von_mises",
                 "yield_stress = 1", "", at="[material.rubber.plasticity]"),
        yielding("negative hardening", ["hardening_modulus = -1", "non-negative"], "hencky", "von_mises",
                 "yield_stress = 1", "yield_stress = 1\nhardening_modulus = -1", at="hardening_modulus"),
        yielding("friction angle in degrees without a unit", ["friction_angle = 37", '"30 deg"'], "hencky",
                 "drucker_prager", degrees, "friction_angle = 37"),
        yielding("unknown cone", ['cone = "inner"', "plane_strain"], "hencky", "drucker_prager", degrees,
                 f'{degrees}\ncone = "inner"', at="cone ="),
        yielding("too much initial hardening", ["raise initial_plastic_volume"], "split_neo_hookean", "nacc", degrees,
                 f"{degrees}\ninitial_plastic_volume = 1e-9", at="initial_plastic_volume"),
        scene_case("plasticity on a law that can't carry it", ["drucker_prager", "can't be joined", '"hencky"'],
                   (degrees, degrees), scene=plastic("split_neo_hookean", "drucker_prager", degrees),
                   at='model = "drucker_prager"'),
        scene_case("plasticity on a fluid", ["can't be joined", '"hencky"'], ("yield_stress = 1", "yield_stress = 1"),
                   scene=fluid('model = "linear_fluid"\nbulk_modulus = 1e5')
                   + '[material.rubber.plasticity]\nmodel = "von_mises"\nyield_stress = 1\n', at='model = "von_mises"'),
        scene_case("fluid without a bulk modulus", ['lacks the required key "bulk_modulus"'],
                   (ELASTIC, 'model = "linear_fluid"\n'), at="[material.rubber]"),
        scene_case("toughness without a phase field", ["fracture_toughness does nothing", r"add \[effect.phase_field\]"],
                   (ELASTIC, f"{ELASTIC}fracture_toughness = 1\n"), at="fracture_toughness"),
        scene_case("negative viscosity", ["viscosity = -1", "non-negative"],
                   (ELASTIC, 'model = "linear_fluid"\nbulk_modulus = 1e5\nviscosity = -1\n'), at="viscosity ="),
        scene_case("Tait's exponent of one", ["exponent = 1", "above 1"],
                   (ELASTIC, 'model = "tait_fluid"\nbulk_modulus = 1e5\nexponent = 1\n'), at="exponent ="),
        scene_case("a fluid with a deformation gradient", ["fluid", "leave it out"],
                   (ELASTIC, 'model = "linear_fluid"\nbulk_modulus = 1e5\n'),
                   (VELOCITY, "deformation_gradient = [[1, 0], [0, 1]]"), at="[[body]]"),
    ]


def formula_cases():
    return [
        scene_case("formula without its bracket", ["bracket is missing"], (VELOCITY, 'velocity = ["sin(x", 0]')),
        scene_case("formula with an unknown name", ['no "q" here'], (VELOCITY, 'velocity = ["2*q", 0]')),
        scene_case("formula without a value", ["no finite number", "correct the formula"],
                   (VELOCITY, 'velocity = ["1/(x - x)", 0]')),
        scene_case("definitions in a circle", ["needs itself", "break the circle"],
                   ("[domain]", '[define]\na = "b"\nb = "a"\n[domain]'), at='a = "b"'),
        scene_case("body force without a value", ["no finite number", "at the start"],
                   ("[[body]]", '[effect.body_force]\nacceleration = ["ln(-1 - t)", 0]\n[[body]]'), at="acceleration ="),
    ]


def side_cases():
    wall = ("[[body]]", '[effect.walls]\nx_max = "slip"\n[[body]]')
    return [
        scene_case("periodic length", ["multiple of 4 cells", "nearest lengths"],
                   (UPPER, 'upper = [1.05, 1]\nperiodic = ["x"]'), at="periodic ="),
        scene_case("periodic wall", ["can't be a wall", "take one of the two out"], (UPPER, f'{UPPER}\nperiodic = ["x"]'),
                   wall, at='x_max = "slip"'),
        scene_case("open wall", ["can't be a wall", "take one of the two out"], (UPPER, f'{UPPER}\nopen = ["x_max"]'),
                   wall, at='x_max = "slip"'),
        scene_case("side that isn't there", ['"z_max" is no side'], (UPPER, f'{UPPER}\nopen = ["z_max"]'), at="open ="),
        scene_case("side twice", ['open names "x_max" twice', "take one"], (UPPER, f'{UPPER}\nopen = ["x_max", "x_max"]'),
                   at="open ="),
        scene_case("direction twice", ['periodic names "x" twice'], (UPPER, f'{UPPER}\nperiodic = ["x", "x"]'),
                   at="periodic ="),
        scene_case("jitter of a Poisson disk", ["jitter has no effect", "drop it"],
                   (VELOCITY, f'{VELOCITY}\nsampling = "poisson_disk"\njitter = 0.2'), at="jitter ="),
        scene_case("lattice of five per cell", ["no perfect square", "poisson_disk"],
                   ("particles_per_cell = 4", "particles_per_cell = 5")),
    ]


def physics_cases():
    return transfer_cases() + material_cases() + formula_cases() + side_cases()
