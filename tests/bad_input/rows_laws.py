"""Laws with memory that are refused: relaxation, fixed charges, parameters that evolve."""

from __future__ import annotations

from typing import Any

from tests.bad_input.bad_row import faulty

BRANCHES = "cell.material.relaxation.branches"
#: Each branch, and what is said.
PRONY: dict[str, tuple[Any, str]] = {
    "time 0": ({"strength": 1, "time": 0}, f"{BRANCHES}.0.time: expected a number with 0 < time, got 0"),
    "a negative time": (
        {"strength": 1, "time": -3},
        f"{BRANCHES}.0.time: expected a number with 0 < time, got -3",
    ),
    "no time": ({"strength": 1}, f"{BRANCHES}.0.time: missing; add 'time:'"),
    "a time with a unit but no scales": (
        {"strength": 1, "time": "3 s"},
        f"{BRANCHES}.0.time: '3 s' has a unit",
    ),
    "a negative strength": (
        {"strength": -0.1, "time": 1},
        f"{BRANCHES}.0.strength: expected a number with 0 <= strength <= 1e+06, got -0.1",
    ),
    "NaN": (
        {"strength": float("nan"), "time": 1},
        f"{BRANCHES}.0.strength: expected a finite number, got .nan",
    ),
    "a range": (
        {"strength": {"range": [0.1, 1]}, "time": 1},
        f"{BRANCHES}.0.strength: a range cannot stand here",
    ),
    "another key": ({"strength": 1, "time": 1, "tau": 1}, f"{BRANCHES}.0.tau: unknown key"),
}
ONE = {"branches": [{"strength": 0.5, "time": 3}]}
OTHER = {"branches": [{"strength": 0.6, "time": 3}]}
#: Relaxations of two regions, and the region that is named.
REGIONS = {
    "one alone relaxes": ({"core": {}, "shell": {"relaxation": ONE}}, "shell"),
    "another strength": ({"core": {"relaxation": ONE}, "shell": {"relaxation": OTHER}}, "shell"),
    "one does not relax": ({"core": {"relaxation": ONE}, "shell": {}}, "shell"),
}
SCALES = {"scales": {"modulus": "1 MPa", "length": "1 mm", "pore": "1 um"}, "cell.viscosity": "1 mPa*s"}
#: Each fault of the charges, its key below macro.charges, and what is said.
CHARGES: dict[str, tuple[dict[str, Any], str, str]] = {
    "a negative density": ({"density": -0.1}, "density", "expected a density of at least 0, got -0.1"),
    "a density that becomes negative": (
        {"density": "1 - 0.2*y"},
        "density",
        "expected a density of at least 0, got -0.4155 at (0.01127, 7.077, 0.01127)",
    ),
    "a table with a negative density": (
        {"density": {"kind": "table", "along": "y", "table": [[0, 0.2], [1, -0.1]]}},
        "density",
        "expected a density of at least 0, got -0.1",
    ),
    "no density": ({"density": None}, "density", "expected a number, got no value"),
    "a bath of 0": ({"bath": 0}, "bath", "expected a concentration above 0, got 0"),
    "a negative bath": ({"bath": -1}, "bath", "expected a concentration above 0, got -1"),
    "a bath that runs dry": (
        {"bath": {"table": [[0, 1], [5, 0]]}},
        "bath",
        "expected a concentration above 0, got 0",
    ),
    "a bath that ramps up": ({"bath": {"ramp": 1, "until": 3}}, "bath", "got a ramp, which begins at 0"),
    "a bath that becomes negative": (
        {"bath": {"expression": "1 - 0.1*t"}},
        "bath",
        "expected a concentration above 0 at all times, got",
    ),
    "a bath of a surface without salt": (
        {"bath": {"y+": 0}},
        "bath.y+",
        "expected a concentration above 0, got 0",
    ),
    "a bath of a surface that becomes negative": (
        {"bath": {"y+": {"expression": "1 - 0.1*t"}}},
        "bath.y+",
        "expected a concentration above 0 at all times, got",
    ),
    "a text for a bath of a surface": ({"bath": {"y+": "much"}}, "bath.y+", "expected a number, got 'much'"),
    "a bath of no surface": (
        {"bath": {"y+": 0.1, "y": 0.2}},
        "bath.y",
        "no drained surface is called 'y'; did you mean 'y+'? the drained surfaces are y+",
    ),
    "a bath of a surface that is not drained": (
        {"bath": {"y+": 0.1, "y-": 0.2}},
        "bath.y-",
        "expected a drained surface, but 'y-' is none; give macro.boundary.y- a 'pressure:', or remove it; the drained "
        "surfaces are y+",
    ),
    "a drained surface without a bath": (
        {"bath": {"x-": 0.1}},
        "bath.y+",
        "missing; the surface 'y+' is drained, but has no bath",
    ),
    "a temperature of 0": (
        {"temperature": 0},
        "temperature",
        "expected a number with 0 < temperature <= 10000, got 0",
    ),
    "a temperature below all": ({"temperature": "-300 °C"}, "temperature", "got '-300 °C'"),
    "degrees of Fahrenheit": (
        {"temperature": "77 °F"},
        "temperature",
        "expected a temperature, such as 310 K or 37 °C, got '77 °F'",
    ),
    "an osmotic coefficient of 0": (
        {"osmotic_coefficient": 0},
        "osmotic_coefficient",
        "expected a number with 0 < osmotic_coefficient <= 10, got 0",
    ),
    "another beginning": (
        {"initial": "swollen"},
        "initial",
        "expected 'free-swelling' or 'as charged', got 'swollen'",
    ),
    "another key": ({"densty": 1}, "densty", "unknown key; did you mean 'density'?"),
}
#: The same of units.
UNITS: dict[str, tuple[dict[str, Any], str, str]] = {
    "a pressure for a density": (
        {"density": "0.2 kPa"},
        "density",
        "expected a concentration, such as 0.15 mol/l, got '0.2 kPa', which is a pressure",
    ),
    "an unknown unit": ({"density": "0.2 meq/ml"}, "density", "did you mean 'mEq/ml'?"),
    "an amount for a bath": ({"bath": "0.15 mol"}, "bath", "did you mean 'mol/l'?"),
}
FAMILY = {
    "cell.geometry.radius": {"range": [0.2, 0.3]},
    "macro.fields": {"radius": 0.25},
    "sampling.sampler": "sobol",
    "sampling.options": {"count": 100},
    "sampling.tolerance": None,
    "sampling.inputs.p.step": None,
    "sampling.inputs.H22.step": None,
    "closure": "potential",
}
#: Each rate of the radius, its key below macro.evolution.radius, and what is said.
RATES: dict[str, tuple[Any, str, str]] = {
    "an unknown name": (
        {"rate": "-k*flow", "constants": {"k": 1}},
        ".rate",
        "'flow' at character 4 of '-k*flow': unknown name",
    ),
    "no formula": ({"rate": "-k*"}, ".rate", "'-k*' is no formula"),
    "a rate with a unit": ({"rate": "0.1 1/s"}, ".rate", "'0.1 1/s' is no formula"),
    "rate and law": ({"rate": "1", "law": "growth"}, "", "got both; keep one"),
    "neither": ({"constants": {"k": 1}}, "", "got neither; add one"),
    "an unknown law": (
        {"law": "grow"},
        ".law",
        "no law of evolution is called 'grow'; did you mean 'growth'?",
    ),
    "a law without its constants": (
        {"law": "growth"},
        "",
        "the law 'growth' needs the constant 'growth_rate'",
    ),
    "a constant of no law": (
        {"law": "degradation", "constants": {"k": 1}},
        "",
        "the law 'degradation' has no constant 'k'",
    ),
    "a constant called like a quantity": (
        {"rate": "J", "constants": {"J": 1}},
        ".rate",
        "'J' has two meanings in the rate 'J'",
    ),
    "a constant called like a parameter": (
        {"rate": "J", "constants": {"radius": 1}},
        ".rate",
        "'radius' has two meanings in the rate 'J'",
    ),
    "NaN": ({"rate": "k", "constants": {"k": float("nan")}}, ".constants.k", "expected a finite number"),
    "a text": ("1", "", "expected a section with keys below it (rate, law, constants)"),
}
ROWS = [
    *(
        faulty(f"relaxation: {name}", {"cell.material.relaxation": {"branches": [branch]}}, told)
        for name, (branch, told) in PRONY.items()
    ),
    faulty(
        "relaxation: no branches",
        {"cell.material.relaxation": {"branches": []}},
        f"{BRANCHES}: expected at least 1 entry, got []",
    ),
    faulty(
        "relaxation: below the cell",
        {"cell.relaxation": ONE},
        "cell.relaxation: unknown key; a solid that relaxes has 'relaxation: {branches:",
    ),
    *(
        faulty(
            f"relaxation of regions: {name}",
            {"cell.material": None, "cell.materials": materials, "closure": "potential"},
            f"cell.materials.{region}",
            "is no Prony series; give all materials of a cell the same branches, or none",
        )
        for name, (materials, region) in REGIONS.items()
    ),
    *(
        faulty(
            f"charges: {name}",
            {"macro.charges": {"density": 0.2, "bath": 0.15, **changes}},
            f"macro.charges.{key}: ",
            told,
        )
        for name, (changes, key, told) in CHARGES.items()
    ),
    *(
        faulty(
            f"charges: {name}",
            {**SCALES, "macro.charges": {"density": 1e-3, "bath": 1e-3, **changes}},
            f"macro.charges.{key}: ",
            told,
        )
        for name, (changes, key, told) in UNITS.items()
    ),
    *(
        faulty(
            f"evolution: {name}",
            {**FAMILY, "macro.evolution": {"radius": rate}},
            f"macro.evolution.radius{key}: ",
            told,
        )
        for name, (rate, key, told) in RATES.items()
    ),
    faulty(
        "evolution: a length for a rate",
        {
            **FAMILY,
            **SCALES,
            "macro.evolution": {"radius": {"law": "degradation", "constants": {"degradation_rate": "3 mm"}}},
        },
        "macro.evolution.radius.constants.degradation_rate: expected one by a time, such as 0.1 1/h, got '3 mm', which "
        "is a length",
    ),
    faulty(
        "evolution: no parameter",
        {**FAMILY, "macro.evolution": {"radios": {"rate": "1"}}},
        "macro.evolution.radios: no cell has the parameter 'radios'; did you mean 'radius'?",
    ),
    faulty(
        "evolution: a cell without parameters",
        {"macro.evolution": {"radius": {"rate": "1"}}},
        "macro.evolution.radius: no cell has the parameter 'radius'; there are none",
    ),
    faulty(
        "evolution: a rate of the state with the mean gradient",
        {**FAMILY, "macro.evolution": {"radius": {"rate": "-0.01*flux"}}, "closure": "mean-gradient"},
        "macro.evolution.radius: the rate follows the state of the body, and closure 'mean-gradient' does not know",
    ),
    faulty(
        "evolution: a first value that changes",
        {**FAMILY, "macro.evolution": {"radius": {"rate": "1"}}, "macro.fields": {"radius": "0.25 + 0.01*t"}},
        "macro.fields.radius: expected the value at the beginning, since the parameter evolves",
    ),
    faulty(
        "evolution: a first value beyond the range",
        {**FAMILY, "macro.evolution": {"radius": {"rate": "1"}}, "macro.fields": {"radius": 0.5}},
        "macro.fields.radius: the field is 0.5",
    ),
    faulty(
        "charges: free swelling of a sealed body",
        {
            "macro.charges": {"density": 0.2, "bath": 0.15},
            "macro.boundary.y+": {"traction": [0, 1, 0]},
        },
        "macro.charges.initial: free swelling takes up fluid, but no surface has a pressure",
    ),
    faulty(
        "charges: free swelling of a body that is held by what moves it",
        {
            "macro.charges": {"density": 0.2, "bath": 0.15},
            "macro.boundary.y-": {"pressure": 0},
            "macro.boundary.y+": {"displacement": [None, 1, None]},
        },
        "macro.charges.initial: ",
    ),
    faulty(
        "laws: a field of a number of a law",
        {"macro.charges": {"density": 0.2, "bath": 0.15}, "macro.fields": {"charges.density": 0.1}},
        "macro.fields.charges.density: 'charges.density' is no parameter of the cell",
    ),
]
