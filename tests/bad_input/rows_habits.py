"""Keys and values as other programs, papers and the hurry write them; each message tells the word that is meant."""

from __future__ import annotations

from tests.bad_input.bad_row import Row, faulty

SCALES = {"modulus": "1 MPa", "length": "1 mm", "pore": "10 um", "viscosity": "1 Pa*s"}
VOXELS = {"kind": "voxels", "path": "scan.npy"}
#: What stands in place of the traction, and words of the message.
COURSES = (
    (
        {"file": "piston.csv"},
        "a measured history is 'table: [[time, value], ...]', with the rows of its file",
    ),
    ({"path": "piston.csv"}, "a measured history is 'table: [[time, value], ...]'"),
    ({"ramp:-0.4 mm": None, "until": 1}, "the blank behind the colon is missing: write 'ramp: -0.4 mm'"),
    (
        {"expression": "min(t/3, 1)"},
        "unknown function; there are sin, cos, tan, exp, log, sqrt, sinh, cosh, tanh",
    ),
    ({"expression": "min(t/3, 1)"}, "a load that comes up and then stays is {ramp: ..., until: ...}"),
    ({"expression": "if(t > 3, 1, 0)"}, "formulas have no conditions; steps are a 'table:'"),
    ({"expression": "1 if t > 3 else 0"}, "formulas have no conditions; steps are a 'table:'"),
    ({"expression": "where(t > 3, 1, 0)"}, "formulas have no conditions; steps are a 'table:'"),
)


def viscosity(given: str, meant: str) -> Row:
    return faulty(
        f"viscosity {given}",
        {"scales": SCALES, "cell.viscosity": given},
        f"is not known; did you mean '{meant}'?",
    )


ROWS = [
    faulty(
        "mu and alpha of an Ogden solid",
        {"cell.material": {"kind": "ogden", "mu": ["0.1 MPa"], "alpha": [2], "bulk_modulus": 1}},
        "cell.material.mu: unknown key; mu and alpha of an Ogden solid are those of its terms: 'terms: [{mu: 0.1, "
        "alpha: 2}]'",
        "cell.material.alpha: unknown key; mu and alpha of an Ogden solid",
    ),
    faulty(
        "mu of a neo-Hookean solid",
        {"cell.material.mu": 0.5},
        "cell.material.mu: unknown key; stresses are in units of a modulus of the solid",
    ),
    *(
        faulty(f"traction {course}: {said[:30]}", {"macro.boundary.y+.traction.1": course}, said)
        for course, said in COURSES
    ),
    faulty(
        "a permeability",
        {"scales": SCALES, "cell.permeability": "1e-13 m^2"},
        "cell.permeability: unknown key; a permeability in m² follows from cell.geometry and the square of the pore "
        "size, 'scales.pore:' (or that of voxel_size), and the hydraulic conductivity from it and 'cell.viscosity:'",
    ),
    faulty(
        "loads with units",
        {"scales": SCALES, "macro.loads": ["-1 kPa", "-2 kPa"]},
        "beside values with units under 'macro.boundary:' it is a bare number: [1] for these values, [1, 2] for them "
        "and for twice them",
    ),
    faulty(
        "strains in per cent",
        {"sampling.inputs.H22": {"range": [-20, 2], "step": 1}},
        "sampling.inputs: the ranges reach det F = -19 at H22 = -20",
        "narrow them; H22 must stay above -1, where a length becomes zero; components of H are no per cent: "
        "0.05 is 5 %",
    ),
    faulty(
        "p at a surface",
        {"macro.boundary.y+.p": 0},
        "macro.boundary.y+.p: unknown key; the pressure of the fluid on a surface is 'pressure:'",
    ),
    faulty(
        "a strain by its axes",
        {"sampling.inputs.eps_yy": {"range": [-0.1, 0.1]}},
        "sampling.inputs.eps_yy: unknown key;",
        "for a small strain along an axis H22 is that strain",
    ),
    faulty(
        "a gradient by its axes",
        {"sampling.inputs.Fxy": {"range": [-0.1, 0.1]}},
        "sampling.inputs.Fxy: unknown key;",
        "H12 = F12",
    ),
    faulty(
        "a crop as one list",
        {"cell.geometry": VOXELS | {"crop": [0, 20, 0, 20, 0, 20]}},
        "cell.geometry.crop: expected a list of 3 entries (along x, y and z), such as [[0, 20], [0, 20], [0, 20]], got",
    ),
    faulty(
        "voxels by resolution and inverted",
        {"cell.geometry": VOXELS | {"resolution": "12 um", "invert": True}},
        "cell.geometry.resolution: unknown key; the edge of a voxel is 'voxel_size:'",
        "cell.geometry.invert: unknown key; the value of the pores is 'pore:'; of a grey image with 'threshold:', "
        "'bright_pores: true'",
    ),
    Row(
        "a state with a blank between its values",
        ("cell", "study.yaml", "--at", "H22=-0.1", "p=0.05"),
        ("got 'p=0.05', too; a comma stands between values by name, and no blank",),
        faulty("", {}).files,
    ),
    Row(
        "a sweep without the name of its option",
        ("sweep", "study.yaml", "radius=0.2,0.25"),
        ("got 'radius=0.2,0.25', too; a parameter and its values follow an option: --over radius=0.2,0.25",),
        faulty("", {}).files,
    ),
    faulty(
        "numbers in place of solids",
        {"cell.material": None, "cell.materials": {"young": "2 MPa", "poisson": 0.5}},
        "cell.materials.young: expected the solid of a region by its name, such as {matrix: {kind: neo-hookean, ",
        "one solid alone is 'material:' in place of 'materials:', and its modulus is 'scales.modulus:'",
    ),
    faulty(
        "a porosity in place of a radius",
        {"cell.geometry.porosity": 0.35},
        "cell.geometry.porosity: unknown key; it follows from the shape of the pores, such as 'radius:' under",
    ),
    viscosity("1e-3 N s/mm2", "N s/mm^2"),
    viscosity("1e-3 N*s/m2", "N*s/m^2"),
    faulty(
        "an end without its unit",
        {
            "scales": SCALES,
            "macro.time": {"end": 20, "step": "1 s", "ramp_increments": 10, "ramp_step": "0.1 s"},
        },
        "macro.time: end = 0.2 s does not lie behind the ramp, which takes 1 s; macro.time.end: 20 has no unit beside "
        "macro.time.step: 1 s, so it is a multiple of its scale,",
        "write '20 s' if that is meant",
    ),
    faulty(
        "an endless end beside times with units",
        {"scales": SCALES, "macro.time": {"end": 10**55, "step": "1 s", "ramp_step": float("inf")}},
        "macro.time.",
    ),
    faulty(
        "a condition in a field",
        {
            "cell.geometry.radius": {"range": [0.2, 0.3]},
            "macro.fields": {"radius": "if(y > 2, 0.2, 0.3)"},
        },
        "macro.fields.radius",
        "formulas have no conditions; steps are a 'table:', and other values in a part of the body 'macro.regions:'",
    ),
    faulty(
        "a field in metres",
        {
            "scales": SCALES,
            "cell.geometry.radius": {"range": [0.2, 0.3]},
            "macro.fields": {"radius": "0.2 + 0.1*y/0.0075"},
        },
        "macro.fields.radius: the field is",
        "beyond the range [0.2, 0.3] of the parameter 'radius'; narrow the field, or widen the range; in its formula y "
        "is in multiples of 0.001 m",
    ),
]
