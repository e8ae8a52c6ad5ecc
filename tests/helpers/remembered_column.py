"""A small column whose law remembers: charges around two branches of relaxation around an evolving pore radius."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.interfaces.law import MacroLaw
from porocore.interfaces.solution import MacroSolution
from porocore.macro.laws.charges import ChargedLaw
from porocore.macro.laws.closure import make_closure
from porocore.macro.laws.evolution import EvolvingLaw
from porocore.macro.laws.macro_law import ClosedLaw
from porocore.macro.laws.rates import Rate
from porocore.macro.laws.relaxation import RelaxingLaw
from porocore.macro.problem import MacroProblem
from porocore.plugins.registry import registry
from porocore.testing.synthetic.porous_family import PorousFamilyLaw

CELL = ("radius",)
RANGE = (0.15, 0.3)
#: Branches as strength and time; of the charges R T Φ, c_F0 and c*; constants of the rate.
STRENGTHS, TIMES = (0.6, 0.3), (2.0, 5000.0)
OSMOTIC, DENSITY, BATH = 0.25, 0.2, 0.15


def cells() -> ClosedLaw:
    """The law of equilibrium of a family of cells."""
    return ClosedLaw(PorousFamilyLaw(*CELL), make_closure("potential", 0.6, NeoHookean(), np.eye(3)))


def remembering_law(*kinds: str) -> MacroLaw:
    """The law with some of ``evolution``, ``relaxation`` and ``charges``."""
    law: MacroLaw = cells()
    if "evolution" in kinds:
        law = EvolvingLaw(law, {"radius": Rate("-k*p", CELL, ["k"])}, {"radius": RANGE})
    if "relaxation" in kinds:
        law = RelaxingLaw(law, len(STRENGTHS))
    return ChargedLaw(law, OSMOTIC) if "charges" in kinds else law


def remembered_column(*kinds: str, elements: int, checkpoint: Path) -> MacroSolution:
    """A confined column under a load that is ramped, drained on top, with a checkpoint after each step."""
    numbers = {
        "evolution": {"evolution.radius.k": 0.05},
        "relaxation": {
            f"relaxation.{k}.{name}": value
            for k, pair in enumerate(zip(STRENGTHS, TIMES, strict=True), start=1)
            for name, value in zip(("strength", "time"), pair, strict=True)
        },
        "charges": {"charges.density": DENSITY, "charges.bath": BATH},
    }
    fields: dict[str, Any] = {"radius": "0.2 + 0.01*y"}
    for kind in kinds:
        fields |= numbers[kind]
    sides = {face: {"displacement": (0, None, 0)} for face in ("x-", "x+", "z-", "z+")}
    ends = {"y-": {"displacement": (0, 0, 0)}, "y+": {"traction": (0, -1, 0), "pressure": 0}}
    data = {
        "body": {"kind": "box", "elements": (1, elements, 1), "size": (0.5, 3.0, 0.5)},
        "boundary": sides | ends,
        "load": 0.05,
        "time": {
            "end": 20.0,
            "step": 2.0,
            "ramp_increments": 2,
            "ramp_step": 0.5,
            "profiles": (1.0, 4.0, 10.0),
        },
        "fields": fields,
    }
    solver = registry().get("macro solver", "skfem")(checkpoint_seconds=0.0)
    prepared = solver.prepare(MacroProblem.model_validate(data))
    return solver.solve(prepared, remembering_law(*kinds), checkpoint=checkpoint)
