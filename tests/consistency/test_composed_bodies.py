"""Bodies of many cells on every macro backend: closed forms, bound constants, turned bodies, checkpoints."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from porocore.errors import ConfigurationError
from porocore.interfaces.solution import History
from porocore.macro.analytic import LayeredConsolidation, SoilLayer, Terzaghi
from porocore.macro.laws.composed import RegionLaw
from porocore.macro.laws.linear import LinearisedLaw, LinearPoroelasticity
from porocore.macro.problem import MacroProblem
from porocore.plugins.registry import registry
from porocore.testing.synthetic.cell import BoundCell, parametric_law, porosity
from porocore.testing.synthetic.response import confined_column, linear_law

SHORT = {"end": 6.0, "step": 1.5, "ramp_increments": 2, "ramp_step": 0.1, "profiles": (1.0,)}
FIELDS = {"radius": "0.2 + 0.005*y", "stiffness": 1.3}
#: Pores that shrink while the load acts.
GROWING = {
    "radius": {"formula": "0.2 + 0.005*y", "initial": 0.25, "over": {"ramp": 1.0, "until": 3.0}},
    "stiffness": 1.3,
}


@pytest.fixture(params=["skfem", pytest.param("dolfinx", marks=pytest.mark.slow)])
def make_solver(request):
    pytest.importorskip(request.param)
    return registry().get("macro solver", request.param)


def solved(make_solver, problem, law, **how):
    solver = make_solver(checkpoint_seconds=0)
    return solver.solve(solver.prepare(problem), law, **how)


def soil(stiffness, conductivity):
    c = linear_law().coefficients
    return LinearPoroelasticity(
        replace(
            c,
            stiffness=stiffness * c.stiffness,
            storage=c.storage / stiffness,
            conductivity=conductivity * c.conductivity,
        )
    )


def test_layers_alike_are_one_layer():
    """The transform of layers, inverted, against Terzaghi's series."""
    one = Terzaghi.from_coefficients(linear_law().coefficients, 7.5, 1e-3)
    layers = [SoilLayer.from_coefficients(linear_law().coefficients, height) for height in (2.5, 5.0)]
    found, heights = LayeredConsolidation(layers, 1e-3), np.array([0.0, 2.5, 5.0, 7.0])
    for t in (0.1, 3.0, 40.0):
        assert found.settlement(t) == pytest.approx(one.settlement(t), rel=1e-11)
        np.testing.assert_allclose(found.pressure(heights, t), one.pressure(heights, t), atol=1e-14)


def test_two_layers_consolidate_as_the_closed_form_says(make_solver):
    """Schiffman & Stein's problem: an upper soil on a stiffer one that conducts less; 0.5 % of the largest values."""
    upper, lower, ramp = soil(1.0, 1.0), soil(4.0, 0.2), 0.02
    plan = {"end": 20, "step": 0.5, "ramp_increments": 4, "ramp_step": ramp / 4, "profiles": (1.0, 10.0)}
    plan["tolerance"] = 3e-4
    problem = confined_column(30, time=plan, regions={"lower": {"along": "y", "below": 2.5}})
    law = RegionLaw.by_name(list(problem.regions), {"lower": lower}, rest=upper)
    solution = solved(make_solver, problem, law)
    heights = ((lower, 2.5), (upper, 5.0))
    exact = LayeredConsolidation(
        [SoilLayer.from_coefficients(s.coefficients, h) for s, h in heights], 1e-3, ramp
    )
    times = solution.history.time[1::5]
    settlement = np.array([exact.settlement(t) for t in times])
    np.testing.assert_allclose(solution.history.settlement[1::5], settlement, atol=0.005 * settlement.max())
    for profile in solution.profiles[1:3]:
        pressure = exact.pressure(solution.points[:, 1], profile.time)
        np.testing.assert_allclose(profile.p, pressure, atol=0.005 * exact.layers[0].initial_pressure(1e-3))


@pytest.mark.parametrize("closure", ["potential", "mean-gradient"])
def test_a_constant_field_gives_the_answer_of_the_bound_constant(make_solver, closure):
    bound = solved(
        make_solver,
        confined_column(3, -0.02, time=SHORT),
        parametric_law(BoundCell([0.2, 1.3]), closure=closure),
    )
    problem = confined_column(3, -0.02, time=SHORT, fields={"radius": 0.2, "stiffness": 1.3})
    free = solved(make_solver, problem, parametric_law(closure=closure))
    assert_same(free, bound, 1e-12)


def test_a_body_that_is_turned_with_its_axes_answers_alike(make_solver):
    """A column along x whose material axes are turned by 90° about z, and one along y; K differs between the axes."""
    upright = confined_column(3, -0.02, time=SHORT, fields=FIELDS)
    turned = {"x-": "y+", "x+": "y-", "y-": "x-", "y+": "x+", "z-": "z-", "z+": "z+"}
    data = upright.model_dump(exclude={"boundary", "body", "fields"}, exclude_defaults=True)
    boundary = {
        turned[name]: {
            "displacement": (face.displacement[1], face.displacement[0], face.displacement[2]),
            "traction": (face.traction[1], 0, 0),
            "pressure": face.pressure,
        }
        for name, face in upright.boundary.items()
    }
    # y of the upright column is x, its x is −y: the cell's first axis points along −y, its second one along x.
    axes = {"about": [0, 0, 1], "angle": -90}
    lying = MacroProblem.model_validate(
        data
        | {
            "boundary": boundary,
            "body": {"kind": "box", "size": (7.5, 0.1, 0.1), "elements": (3, 1, 1)},
            "fields": {"radius": "0.2 + 0.005*x", "stiffness": 1.3, "axes": axes},
        }
    )
    one, other = (solved(make_solver, problem, parametric_law()) for problem in (upright, lying))
    top, end = one.points[:, 1] == 7.5, other.points[:, 0] == 7.5
    np.testing.assert_allclose(other.profiles[-1].u[end, 0], one.profiles[-1].u[top, 1].mean(), rtol=1e-10)
    np.testing.assert_allclose(other.history.pressure_max, one.history.pressure_max, rtol=1e-9, atol=1e-14)
    np.testing.assert_allclose(other.history.drained, one.history.drained, rtol=1e-9, atol=1e-16)


def test_a_run_with_growing_cells_is_continued(make_solver, tmp_path):
    problem, law = (
        confined_column(3, -0.02, time=SHORT, fields=GROWING),
        parametric_law(closure="mean-gradient"),
    )
    whole = solved(make_solver, problem, law)
    assert any(abs(whole.history.time - 3.0) < 1e-9)

    class Killed(Exception):
        pass

    def stop(report):
        if report.time > 1.5:
            raise Killed

    path = tmp_path / "macro.h5"
    with pytest.raises(Killed):
        solved(make_solver, problem, law, checkpoint=path, on_step=stop)
    assert_same(
        solved(make_solver, problem, parametric_law(closure="mean-gradient"), checkpoint=path), whole, 1e-9
    )


def test_what_shrinking_pores_give_off_leaves_the_body(make_solver):
    """A held body without load: φ at the end follows from its parameters alone, and so does the drained volume."""
    held = {"displacement": (0, 0, 0)}
    radius = {"formula": "0.2", "initial": 0.25, "over": {"ramp": 1.0, "until": 1.0}}
    problem = MacroProblem.model_validate(
        {
            "body": {"kind": "box", "size": (1, 1, 1), "elements": (1, 1, 1)},
            "boundary": {
                "x-": held,
                "x+": held,
                "z-": held,
                "z+": held,
                "y-": held,
                "y+": held | {"pressure": 0},
            },
            "time": {"end": 100, "step": 25, "ramp_increments": 1, "ramp_step": 1.0, "profiles": ()},
            "fields": {"radius": radius, "stiffness": 1.0},
        }
    )
    given_off = float(porosity(np.array(0.25)) - porosity(np.array(0.2)))
    for law in (parametric_law(), LinearisedLaw(parametric_law())):
        assert solved(make_solver, problem, law).history.drained[-1] == pytest.approx(given_off, rel=1e-8)


def test_a_law_without_the_parameter_is_refused(make_solver):
    with pytest.raises(
        ConfigurationError, match=r"macro.fields.radius: 'radius' is no parameter of the cell; there"
    ):
        solved(make_solver, confined_column(2, fields={"radius": 0.2}), linear_law())
    with pytest.raises(ConfigurationError, match=r"macro.fields.radius: missing"):
        solved(make_solver, confined_column(2), parametric_law())


def assert_same(one, other, within):
    for field in fields(History):
        if field.name not in ("iterations", "stress_spread"):
            mine, theirs = getattr(one.history, field.name), getattr(other.history, field.name)
            np.testing.assert_allclose(mine, theirs, rtol=0, atol=within * max(abs(theirs).max(), 1e-3))
    for mine, theirs in zip(one.profiles, other.profiles, strict=True):
        np.testing.assert_allclose(mine.u, theirs.u, rtol=0, atol=within)
        np.testing.assert_allclose(mine.stress, theirs.stress, rtol=0, atol=within)
