"""Numbers as other software writes them, YAML's words for true and false, tabs, lists of another length."""

from __future__ import annotations

from tests.bad_input.bad_row import CONFIG, Content, Row, faulty, study

SCALES = {
    "scales": {"modulus": "3 kPa", "length": "1 mm", "pore": "1 um", "viscosity": "1 mPa*s"},
    "cell.viscosity": "1 mPa*s",
}
#: Keys with a number that has a comma, and the advice.
COMMAS = [
    ("macro.time.end", "12,0", "expected a number, got '12,0'; decimals stand after a point: write 12.0"),
    ("macro.time.end", "1,200.5", "got '1,200.5'; digits are not grouped: write 1200.5"),
    ("macro.time.end", "1.200,5", "got '1.200,5'; decimals stand after a point: write 1200.5"),
    ("macro.time.end", "1,234", "decimals stand after a point: write 1.234, or 1234"),
    ("macro.loads.0", "-0,04", "decimals stand after a point: write -0.04"),
    ("cell.geometry.radius", "0,25", "decimals stand after a point: write 0.25"),
    ("sampling.tolerance", "0,05", "decimals stand after a point: write 0.05"),
    ("macro.options", {"checkpoint_seconds": "0,5"}, "decimals stand after a point: write 0.5"),
    (
        "macro.boundary.y+.traction.1",
        {"expression": "0,5*t"},
        "may stand here; decimals stand after a point",
    ),
    (
        "macro.boundary.y+.traction",
        [0, 0, 5, 0],
        "expected a list of 3 entries (along x, y and z), got [0, 0, 5, 0]; commas separate the entries",
    ),
]
#: Lines of a file with such a number in a list or within braces, where YAML makes two entries of it, and what is said.
HALVES = [
    (
        "macro: {x: {radius: 0,25}}",
        "macro.x.radius: got the key '25' without a value",
        "write 'radius: 0.25'",
    ),
    ("macro: {radius: 0,05, b: 1}", "macro.radius: got the key '05'", "write 'radius: 0.05'"),
    ("macro: {ramp: -0,1 mm, until: 10 s}", "macro.ramp: got the key '1 mm'", "write 'ramp: -0.1 mm'"),
    ("macro: {ramp: -0,08 mm}", "macro.ramp: got the key '08 mm'", "write 'ramp: -0.08 mm'"),
    ("macro: {ramp: 1,5e-3 m}", "macro.ramp: got the key '5e-3 m'", "write 'ramp: 1.5e-3 m'"),
    (
        "range: [-0,35, 0,02]",
        "commas separate the entries of a list, decimals stand after",
        "write 0.02, else",
    ),
    ("range: [0,05 kPa, 1 kPa]", "decimals stand after a point; if '0,05 kPa' was meant", "write 0.05 kPa,"),
    ("range: [0,09]", "decimals stand after a point; if '0,09' was meant as one number, write 0.09"),
]
#: Words of a command with such a number.
WORDS: list[tuple[tuple[str, ...], str]] = [
    (("cell", CONFIG, "--at", "H22=-0,1"), "got 'H22=-0,1'; decimals stand after a point: write -0.1"),
    (("cell", CONFIG, "--at", "H22=-0,1,p=0.1"), "decimals stand after a point: write -0.1"),
    (("cell", CONFIG, "--parameters", "radius=0,2"), "decimals stand after a point: write 0.2"),
    (("cell", CONFIG, "--grad-u", "0 0 0; 0 -0,1 0; 0 0 0"), "decimals stand after a point"),
    (("stability", CONFIG, "--along", "H22=-0,36"), "decimals stand after a point: write -0.36"),
    (("sweep", CONFIG, "--over", "radius=0,2:0,3:3"), "got '0,2'; decimals stand after a point: write 0.2"),
    (("sweep", CONFIG, "--over", "radius=0,2"), "decimals stand after a point: write 0.2"),
    (("sensitivity", CONFIG, "--loads", "uniaxial=-0,5:0,5"), "decimals stand after a point"),
    (("units", "time=1,5"), "got 'time=1,5'; decimals stand after a point: write 1.5"),
    (("units", "--force", "1,5"), "expected a number, got '1,5'; decimals stand"),
]
#: Keys that are ``yes``, and what is said.
SWITCHES = [
    ("closure", "expected one of mean-gradient, potential, got yes, which YAML reads as true"),
    ("fem.backend", "skfem, got yes, which YAML reads as true"),
    (
        "sampling.sampler",
        "expected one of active, density-sweep, latin-hypercube, macro-driven, sobol, got yes, which",
    ),
    ("cell.geometry.axes", "expected one of x, y, z, xy, xz, yz, xyz, got yes, which YAML reads as true"),
    ("macro.body.kind", "expected one of box, cylinder, quarter-cylinder, wedge, file, got yes, which"),
    ("macro.options.solver", "expected auto, direct or iterative, got yes, which YAML reads as true"),
    ("macro.time.step", "expected a number, got yes, which YAML reads as true"),
    ("title", "expected text, got yes, which YAML reads as true"),
]
#: Lists of another length, and what their entries are.
LISTS = [
    ("macro.body.elements", [1, 2], "expected a list of 3 entries (along x, y and z), got [1, 2]"),
    ("macro.body.size", 3, "expected a list of 3 entries (along x, y and z), got 3"),
    ("macro.probes", {"a": [0, 1]}, "macro.probes.a: expected a list of 3 entries (along x, y and z)"),
    (
        "sampling.inputs.p.range",
        [0],
        "expected a list of 2 entries (its lower and its upper end), got [0]",
    ),
    (
        "macro.body",
        {"kind": "cylinder", "radius": 1, "height": 1, "elements": [1, 2]},
        "macro.body.elements: expected a list of 3 entries (from the axis to the mantle, along y and around)",
    ),
    ("macro.time.load_curve", [[1]], "a list of 2 entries (a time and a factor)"),
]
#: Values beside the scales whose units are not what they should be, and what is said.
UNITS = [
    (
        "sampling.inputs.p",
        {"range": ["-1 kPa", 25], "step": "1 kPa"},
        "sampling.inputs.p.range: expected a unit with each number of the list, got 25 without one beside '-1 kPa'; "
        "write [-1 kPa, 25 kPa]",
    ),
    (
        "macro.body.size",
        ["1 mm", 2, "1 mm"],
        "macro.body.size: expected a unit with each",
        "write [1 mm, 2 mm, 1 mm]",
    ),
    (
        "cell.viscosity",
        {"range": ["1 mPa*s", 2]},
        "cell.viscosity.range: expected a unit with each",
        "write [1 mPa*s, 2 mPa*s]",
    ),
    (
        "cell.geometry.radius",
        "5 nm",
        "expected a number with 0 < radius < 0.5 without a unit, got '5 nm'",
        "it is a share of the cell's edge",
    ),
    ("cell.mesh.size", "1 um", "without a unit, got '1 um'; it is a share of the cell's edge"),
    ("cell.geometry.radius", {"range": ["1 um", "2 um"]}, "with two numbers without units, got [1 um, 2 um]"),
    ("macro.time.end", "5 MIN", "got '5 MIN'; the unit 'MIN' is not known; did you mean 'min'?"),
    ("macro.time.end", "5 S", "got '5 S'; did you mean 's'?"),
    ("macro.body.size.0", "5 µM", "got '5 µM', which is a concentration; did you mean 'um'?"),
    ("cell.material.poisson_ratio", "3 kPa", "a number with -1 < poisson_ratio < 0.5 without a unit"),
]
#: Numbers in place of vectors, and their form.
VECTORS = [
    (
        "macro.boundary.y-.displacement",
        0,
        "a list of 3 entries (along x, y and z), such as [null, 0, null], got 0",
    ),
    ("macro.boundary.x-.displacement", 1, "such as [1, null, null], got 1"),
    ("macro.boundary.y+.traction", "-5 kPa", "such as [0, -5 kPa, 0], got '-5 kPa'"),
    ("macro.body_force", -5, "such as [0, -5, 0], got -5"),
]
#: Names of other measures of deformation, or a part of a name, and the input that is meant.
MEANT = {
    "F22": "the inputs are of H = grad u = F − I: H22 = F22 − 1",
    "F_12": "H12 = F12",
    "eps33": "for a small strain along an axis H33 is that strain",
    "J": "J = det(I + H) follows from the components of H",
    "H2": "did you mean 'H21' or 'H22' or 'H23'?",
}
#: A whole number has no decimals, and a range has two numbers that may have commas.
OTHERS = [
    ("sampling.test.count", "1,000", "got '1,000'; digits are not grouped: write 1000"),
    ("cell.geometry.radius", {"range": ["0,2", 0.3]}, "decimals stand after a point: write 0.2"),
]
TABBED: Content = study().replace("  time:\n", "\ttime:\n")


def switched(key: str) -> Content:
    return study({key: "SWITCH"}).replace("SWITCH", "yes")


#: Keys of other software, and values in place of sections, with the advice.
MISPLACED = [
    ("cell.geometry", {"kind": "gyroid"}, "got 'gyroid'; write 'kind: tpms' and 'surface: gyroid'"),
    ("cell.geometry", {"kind": "sphere-pores", "radius": 0.3}, "the keys lattice and centres, got neither"),
    ("cell.geometry", {"kind": "tpms", "surface": "gyroid"}, "the keys level and void_fraction, got neither"),
    ("cell.material", "neo-hookean", "a section with keys below it, such as {kind: neo-hookean}"),
    ("fem", "skfem", "such as {backend: skfem}"),
    ("sampling.inputs.H22", [-0.1, 0.1], "such as {range: [-0.1, 0.1]}"),
    ("cell.material.nu", 0.3, "unknown key; Poisson's ratio is 'poisson_ratio:'"),
    ("macro.body.diameter", 1, "unknown key; half of it is 'radius:'"),
    ("macro.boundary.top", {"pressure": 0}, "no such surface; did you mean 'y+'?"),
    ("macro.boundary.y-.fixed", True, "unknown key; a clamped surface has 'displacement: [0, 0, 0]'"),
    ("macro.boundary.y+.drained", True, "unknown key; a drained surface has 'pressure: 0'"),
    ("macro.body_force", "gravity", "a list of 3 entries (along x, y and z), got 'gravity'"),
]
ROWS = [
    faulty(
        "a range without the unit of its step",
        {
            "scales": {"modulus": "0.5 MPa", "length": "1 mm", "pore": "2 um", "viscosity": "1 Pa s"},
            "sampling.inputs.p": {"range": [-1, 25], "step": "1 kPa"},
        },
        "sampling.inputs.p.range: expected a unit with each number of the list, got -1 without one beside '1 kPa'; "
        "write [-1 kPa, 25 kPa]",
    ),
    *(faulty(f"misplaced: {key} = {value}", {key: value}, part) for key, value, part in MISPLACED),
    *(faulty(f"comma: {key} = {value}", {key: value}, part) for key, value, part in (*COMMAS, *OTHERS)),
    *(
        faulty(f"unit: {key} = {value}", {**SCALES, key: value}, *parts)
        for key, value, *parts in (*UNITS, *VECTORS)
    ),
    *(
        faulty(
            f"sampling: {name}",
            {"sampling.inputs": {name: {"range": [-0.1, 0.1]}}},
            f"sampling.inputs.{name}: unknown key; ",
            part,
        )
        for name, part in MEANT.items()
    ),
    *(
        Row(
            f"cell: {name}",
            ("cell", CONFIG, "--at", f"{name}=0.1"),
            (f"got {name} = 0.1; ", part),
            {CONFIG: study()},
        )
        for name, part in MEANT.items()
    ),
    Row(
        "stability: F22",
        ("stability", CONFIG, "--along", "F22=0.9"),
        ("unknown input 'F22' of a stability map", MEANT["F22"]),
        {CONFIG: study()},
    ),
    faulty(
        "comma before a unit",
        {**SCALES, "macro.time.end": "12,0 s"},
        "macro.time.end: expected a number, got '12,0 s'; decimals stand after a point: write 12.0 s",
    ),
    *(
        Row(f"comma: {text}", ("check", CONFIG), (f"{CONFIG}:1: ", *parts), {CONFIG: text})
        for text, *parts in HALVES
    ),
    *(Row(f"comma: {' '.join(words)}", words, (part,), {CONFIG: study()}) for words, part in WORDS),
    *(Row(f"{key}: yes", ("check", CONFIG), (key, part), {CONFIG: switched(key)}) for key, part in SWITCHES),
    *(faulty(f"list: {key} = {value}", {key: value}, part) for key, value, part in LISTS),
    Row(
        "a tab",
        ("check", CONFIG),
        (":83: expected an indentation by spaces, got a tab, which YAML does not take there",),
        {CONFIG: TABBED},
    ),
    Row(
        "a tab before a value",
        ("check", CONFIG),
        (
            ":1: expected a space, got a tab, which YAML does not take there; replace each tab of the line by a space",
        ),
        {CONFIG: "closure:\tmean-gradient\n"},
    ),
    Row(
        "an input that is none",
        ("cell", CONFIG, "--at", "H24=1"),
        ("expected finite values of some of H11, H12, H13, H21, H22, H23, H31, H32, H33, p, got H24 = 1.0",),
        {CONFIG: study()},
    ),
    *(
        Row(
            f"a member beyond a bound: {at}", ("cell", CONFIG, "--parameters", at), (part,), {CONFIG: study()}
        )
        for at, part in (
            ("radius=0.7", "cell.geometry.radius: expected a number with 0 < radius < 0.5, got 0.7"),
            ("poisson_ratio=0.6", "expected a number with -1 < poisson_ratio < 0.5, got 0.6"),
            ("swelling=9", "cell.material.swelling: expected a number with 0.2 <= swelling <= 5, got 9"),
        )
    ),
    faulty(
        "a nearly incompressible solid",
        {"cell.material.poisson_ratio": 0.499999},
        "cell.material.poisson_ratio: the undeformed cell ended with status",
        "give one up to 0.499",
    ),
    faulty(
        "a probe without units",
        {"macro.probes": {"a": [0, 90, 0]}},
        "which extends from (0, 0, 0) to (0.1, 7.5, 0.1); move it inside (coordinates are lengths as in macro.body)",
    ),
    faulty(
        "a probe with units",
        {**SCALES, "macro.probes": {"a": [0, 90, 0]}},
        "move it inside (coordinates are multiples of scales.length where they have no unit)",
    ),
    faulty(
        "a pressure and a flux",
        {"macro.boundary.y+": {"traction": [0, 1, 0], "pressure": 0, "flux": 0.1}},
        "macro.boundary.y+: expected a pressure or a flux, got both 'pressure:' and a 'flux:' that is not 0; keep one",
    ),
]
