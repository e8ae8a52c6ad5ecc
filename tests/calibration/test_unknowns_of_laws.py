"""Unknowns that are numbers of the law of the body: strengths and times, charges and their bath, constants of rates."""

from __future__ import annotations

from io import StringIO
from typing import Any

import numpy as np
import pytest

from porocore.commands.calibration.cells import FamilyCells
from porocore.commands.calibration.experiment import BodyAtValues
from porocore.commands.calibration.plan import CalibrationPlan
from porocore.core.console import Console
from porocore.errors import ConfigurationError
from tests.helpers.curve_experiment import ACCURACY, MACRO, UNKNOWNS, law, model_of, planned, starts

pytest.importorskip("skfem")

CELL: dict[str, Any] = {
    "viscosity": 1.0,
    "geometry": {"radius": {"range": [0.15, 0.3]}},
    "material": {
        "relaxation": {"branches": [{"strength": 0.5, "time": 0.3}, {"strength": 0.8, "time": 2.0}]}
    },
}
CHARGES = {"density": 0.1, "bath": 0.15, "temperature": "0.5 K"}
#: A bath that is diluted, around a body that is charged more at its top.
FIELDS = {
    **CHARGES,
    "density": {"kind": "table", "along": "y", "table": [[0, 0.1], [1.5, 0.2]]},
    "bath": {"table": [[0, 0.15], [0.3, 0.15], [0.5, 0.08]]},
}
DECAY = {"radius": {"law": "degradation", "constants": {"degradation_rate": 0.05}}}
STRENGTH: dict[str, Any] = {"lower": 0, "upper": 2}
TIME: dict[str, Any] = {"lower": 0.1, "upper": 3}
LAW: dict[str, Any] = {
    "relaxation.1.strength": STRENGTH,
    "relaxation.1.time": TIME,
    "relaxation.2.strength": STRENGTH,
    "slow": {"of": "relaxation.2.time", **TIME},
    "charges.density": {"lower": 0, "upper": 2},
    "charges.bath": {"lower": 0.05, "upper": 2},
    "evolution.radius.degradation_rate": {"lower": 0, "upper": 0.2},
}


def of_laws(
    unknowns: dict[str, Any] = LAW,
    charges: dict[str, Any] = CHARGES,
    evolution: dict[str, Any] = DECAY,
    **changes: Any,
) -> CalibrationPlan:
    fields = {"radius": 0.22, "poisson_ratio": 0.33}
    macro = {**MACRO, "fields": fields, "charges": charges, "evolution": evolution, **changes}
    cell = {**CELL, "material": {**CELL["material"], "poisson_ratio": {"range": [0.25, 0.4]}}}
    return planned(unknowns, cell=cell, macro=macro)


def differ(plan: CalibrationPlan) -> None:
    """Compare the derivatives along a direction that moves all unknowns with central differences."""
    model, at = model_of(plan), starts(plan)
    found, step = model.curves(at), 1e-4 * at * np.where(np.arange(len(at)) % 2, 1.0, -0.7)
    near, far = (model.values(at + k * step) - model.values(at - k * step) for k in (1, 2))
    wanted = (8 * near - far) / 12
    assert np.abs(found.slopes @ step - wanted).max() <= ACCURACY * np.abs(wanted).max()


def test_slopes_by_numbers_of_all_laws_are_limits_of_differences() -> None:
    differ(of_laws())


def test_data_before_the_first_step_see_the_forces_that_hold_a_swollen_body() -> None:
    """Direct derivatives and a pass backwards; the clock is late, so that data lie between rest and the first step."""
    unknowns = {name: UNKNOWNS[name] for name in ("modulus", "radius", "delay")}
    plan = of_laws({**unknowns, "charges.density": LAW["charges.density"]})
    differ(plan)
    model, at = model_of(plan), starts(plan)
    found, weights = model.curves(at), np.random.default_rng(2).normal(size=sum(map(len, plan.curves)))
    _, gradient = model.gradient(at, lambda values: weights)
    np.testing.assert_allclose(gradient, weights @ found.slopes, rtol=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("charges", [CHARGES, FIELDS], ids=["numbers", "fields"])
@pytest.mark.parametrize("backend", ["skfem", "dolfinx"])
def test_slopes_by_numbers_of_laws_beside_those_of_the_cell(backend: str, charges: dict[str, Any]) -> None:
    """Modulus, viscosity and pore size change the units in which the laws have their numbers."""
    pytest.importorskip(backend)
    others = {name: UNKNOWNS[name] for name in ("radius", "modulus", "viscosity", "pore", "load", "delay")}
    for name in LAW:
        differ(of_laws({**others, name: LAW[name]}, charges, backend=backend))


def test_a_number_of_a_field_is_its_factor() -> None:
    plan = of_laws({name: LAW[name] for name in ("charges.density", "charges.bath")}, FIELDS)
    np.testing.assert_array_equal(starts(plan), [1.0, 1.0])
    assert [each.number.quantity for each in model_of(plan).numbers] == ["", ""]
    more = {
        **FIELDS,
        "density": {"kind": "table", "along": "y", "table": [[0, 0.15], [1.5, 0.3]]},
        "bath": {"table": [[0, 0.3], [0.3, 0.3], [0.5, 0.16]]},
    }
    other = of_laws(charges=more)
    found, wanted = model_of(plan).values(np.array([1.5, 2.0])), model_of(other).values(starts(other))
    np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-12)


def test_baths_of_surfaces_have_one_factor() -> None:
    def between(low: float, high: float) -> dict[str, Any]:
        return {**CHARGES, "bath": {"y-": low, "y+": {"table": [[0.3, high], [0.5, high / 2]]}}}

    drained = {**MACRO["boundary"], "y-": {**MACRO["boundary"]["y-"], "pressure": 0}}
    plan = of_laws({"charges.bath": LAW["charges.bath"]}, between(0.2, 0.1), boundary=drained)
    other = of_laws(charges=between(0.3, 0.15), boundary=drained)
    found, wanted = model_of(plan).values(np.array([1.5])), model_of(other).values(starts(other))
    np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-12)
    differ(plan)


def test_a_body_has_the_same_laws_in_the_units_of_other_scales() -> None:
    """All that has a time, a stress or a concentration is divided by its unit."""
    config = of_laws(charges=FIELDS).experiments[0].config
    scales = of_laws({name: UNKNOWNS[name] for name in ("modulus", "viscosity")}, FIELDS)
    numbers = [next(iter(each.numbers.values())) for each in scales.unknowns]
    body = BodyAtValues.of_values(config, -1.0, dict(zip(numbers, (2.0, 6.0), strict=True)))
    time = body.scales.factor("time")
    assert time == pytest.approx(3.0)
    found = {name: body.problem.fields[name] for name in LAW if name in body.problem.fields}
    assert found["relaxation.1.strength"] == 0.5
    assert found["relaxation.1.time"] == pytest.approx(0.3 / time)
    assert found["evolution.radius.degradation_rate"] == pytest.approx(0.05 * time)
    assert found["charges.density"].factor == pytest.approx(1 / 2)  # type: ignore[union-attr]
    assert found["charges.bath"].over.at(0.4 / time) == pytest.approx(0.115 / 2)  # type: ignore[union-attr]


def test_the_course_of_a_field_keeps_its_times_in_the_units_of_other_scales() -> None:
    course = {"kind": "formula", "formula": "0.22", "initial": 0.25, "over": {"table": [[0, 0], [0.4, 1]]}}
    fields = {"radius": course, "poisson_ratio": 0.33}
    plan = of_laws({name: UNKNOWNS[name] for name in ("modulus", "viscosity")}, evolution={}, fields=fields)
    differ(plan)


def test_unknowns_of_laws_have_units_and_times_are_searched_in_their_logarithm() -> None:
    scaled = {"scales": {"modulus": "1 kPa", "length": "1 mm", "pore": "1 um", "viscosity": "1 mPa s"}}
    unknowns = {
        "relaxation.1.time": {"lower": "0.2 s", "upper": "1 min", "start": "5 s"},
        "relaxation.1.strength": STRENGTH,
        "charges.density": {"lower": "0.01 mol/l", "upper": "0.3 mol/l"},
    }
    cell = {**CELL, "material": {"relaxation": {"branches": [{"strength": 0.5, "time": "4 s"}]}}}
    macro = {**MACRO, "fields": {"radius": 0.22}, "charges": {"density": "0.1 mol/l", "bath": "0.15 mol/l"}}
    plan = planned(unknowns, cell=cell, macro=macro, **scaled)
    time, strength, density = (each.unknown for each in plan.unknowns)
    assert (time.scale, time.unit, time.start, time.upper) == ("log", "s", 5.0, 60.0)
    assert (strength.scale, strength.start) == ("linear", 0.5)
    assert (density.unit, density.start) == ("mol/l", pytest.approx(0.1))
    # One second is one unit of time here: L^4 mu/(f d^2) with these scales.
    assert plan.unknowns[0].dimensionless(plan.experiments[0]) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("unknowns", "changes", "said"),
    [
        (
            {"relaxation.3.time": TIME},
            {},
            r"unknowns.relaxation.3.time: expected a number of the study, .*did you mean 'relaxation.[12].time'",
        ),
        (
            {"relaxation.1.time": {"lower": 0, "upper": 1}},
            {},
            "unknowns.relaxation.1.time.lower: expected a number above 0, as every value of 'relaxation.1.time' is",
        ),
        (
            {"relaxation.1.strength": {"lower": -1, "upper": 1}},
            {},
            "unknowns.relaxation.1.strength.lower: expected a number of at least 0, as every value of",
        ),
        (
            {"charges.bath": {"lower": 0, "upper": 1}},
            {"charges": FIELDS},
            "unknowns.charges.bath.lower: expected a number above 0",
        ),
        (
            {"charges.density": {"lower": -1, "upper": 1}},
            {},
            "unknowns.charges.density.lower: expected a number of at least 0",
        ),
        (
            {"charges.density": {"lower": 0, "upper": 1, "field": {"along": "y", "at": [0, 1]}}},
            {},
            "unknowns.charges.density: expected a parameter of the cell, which alone may be a field over the body",
        ),
    ],
)
def test_faults_of_unknowns_of_laws(unknowns: dict[str, Any], changes: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigurationError, match=said):
        of_laws(unknowns, **changes)


@pytest.mark.parametrize(
    ("unknown", "changes", "said"),
    [
        (
            "viscosity",
            {"evolution": {"radius": {"rate": "-k", "constants": {"k": 0.1}}}},
            "evolution.radius.rate",
        ),
        (
            "modulus",
            {
                "evolution": {
                    "radius": {"law": "growth", "constants": {"growth_rate": 1, "homeostatic_stress": -0.1}}
                }
            },
            "evolution.radius.law: the rate of 'growth' goes by multiples of the modulus",
        ),
        (
            "viscosity",
            {"charges": {**CHARGES, "bath": {"expression": "0.15 + 0.1*t"}}},
            r"macro: the formula '0.15 \+ 0.1\*t' goes by a dimensionless time",
        ),
        (
            "pore",
            {"charges": {**CHARGES, "density": "0.1 + 0.1*t"}},
            r"macro: the formula '0.1 \+ 0.1\*t' goes by a dimensionless time",
        ),
    ],
)
def test_laws_by_dimensionless_numbers_are_refused_beside_unknown_scales(
    unknown: str, changes: dict[str, Any], said: str
) -> None:
    plan = of_laws({unknown: UNKNOWNS[unknown]}, **changes)
    with pytest.raises(ConfigurationError, match=said):
        model_of(plan)


def test_experiments_share_cells_and_each_body_has_its_own_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    elastic, relaxing = (
        planned({"modulus": UNKNOWNS["modulus"]}, cell=cell).experiments[0].config
        for cell in ({"viscosity": 1.0}, {"viscosity": 1.0, "material": CELL["material"]})
    )
    assert elastic.stages.training == relaxing.stages.training
    equilibrium = law()
    monkeypatch.setattr(FamilyCells, "_in_equilibrium", lambda self: equilibrium)
    for first in (elastic, relaxing):
        laws = FamilyCells(None, first, ("",), Console(StringIO()), None).laws()  # type: ignore[arg-type]
        assert laws(elastic) is equilibrium
        assert laws(relaxing).parameters[-1] == "relaxation.2.time"
