"""Fluid of bodies whose fields and material axes change in time: what leaves is what is stored no longer.

For every law the stored volume is integrated by hand over the solution, from a cell in closed form in the axes and with
the parameters of each time. The mean-gradient closure alone has no stored volume of the state: its storage is that of
the formula over each step, in axes that stand still.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from porocore.macro.laws.composed import BoundLaw, NearestMemberLaw, RegionLaw
from porocore.macro.laws.linear import LinearisedLaw
from porocore.macro.laws.macro_law import AdaptiveLaw
from porocore.macro.problem import MacroProblem
from porocore.plugins.registry import registry
from tests.helpers import anisotropic_cell as cell
from tests.helpers.anisotropic_cell import (
    ABOUT,
    AXES,
    FIELDS,
    NEWTON,
    TIMES,
    AnisotropicCell,
    anisotropic_law,
    block,
    linear_law,
)


@pytest.fixture(params=["skfem", pytest.param("dolfinx", marks=pytest.mark.slow)])
def make_solver(request):
    pytest.importorskip(request.param)
    return registry().get("macro solver", request.param)


def axes_at(places, t):
    turns = np.deg2rad(50 * t + 20 * places[:, 0])
    return Rotation.from_rotvec(np.outer(turns, ABOUT / np.linalg.norm(ABOUT))).as_matrix()


def porosity_at(places, t):
    return 0.22 + np.interp(t, [0, 0.7, 2.2], [0, 0.2, 1]) * (0.3 + 0.02 * places[:, 0] - 0.22)


def swelling_at(places, t):
    return 0.004 * t * places[:, 1]


class Learning(AnisotropicCell):
    """Flags all states of a step with a larger strain, until it has learned."""

    flagged = True

    def predict(self, states, *, tangent=True):
        found = super().predict(states, tangent=tangent)
        outside = np.full(len(states), self.flagged and bool(np.abs(states.grad_u).max() > 0.02))
        # Before it has learned, its fluid is wrong by a constant and a factor.
        wrong = 1.02 if self.flagged else 1.0
        return replace(found, doubt=outside.astype(np.int64), fluid_volume=wrong * found.fluid_volume)


def learning(*parameters):
    first, then = Learning(*parameters), Learning(*parameters)
    then.flagged = False
    closed = anisotropic_law(cell=first)
    return AdaptiveLaw(first, closed.closure, lambda states: then)


BOTH = ("porosity", "swelling")
MEMBERS = (0.22, 0.28, 0.32)


def members():
    return NearestMemberLaw(
        [linear_law(f) for f in MEMBERS], np.array(MEMBERS)[:, None], {"porosity": (0.2, 0.35)}
    )


def nearest(f):
    return np.array(MEMBERS)[np.abs(f[:, None] - np.array(MEMBERS)).argmin(axis=1)]


def as_given(f):
    return f


#: Name → law, its parameters, whether its fluid is that of the linear limit, and the porosity that it sees.
LAWS = {
    "linear": (linear_law, (), True, as_given),
    "linear of a family": (lambda: LinearisedLaw(anisotropic_law(*BOTH)), BOTH, True, as_given),
    "potential": (lambda: anisotropic_law(*BOTH), BOTH, False, as_given),
    "bound": (lambda: BoundLaw(anisotropic_law(*BOTH), {"swelling": 0.0}), BOTH[:1], False, as_given),
    "learning": (lambda: learning(*BOTH), BOTH, False, as_given),
    "members": (members, BOTH[:1], True, nearest),
}


def solved(make_solver, problem, law):
    """The solution, and H, p and the places at the points at each kept time."""
    solver = make_solver()
    d = solver.prepare(problem)
    found = solver.solve(d, law)
    points = []
    for profile in found.profiles:
        x = d.from_mesh(np.concatenate([profile.u.ravel(), profile.p[d.mesh.p_nodes]]))
        states, _ = d.states(x)
        points.append((profile.time, states.grad_u, states.p))
    places = d.mesh.quadrature_points[d.elements].reshape(-1, 3)
    return found, points, places, d.weights


def in_axes(H, R):
    return np.einsum("nia,nij,njb->nab", R, H, R)


def drained_at_profiles(found):
    history = found.history
    return np.array([history.drained[np.argmin(np.abs(history.time - each.time))] for each in found.profiles])


@pytest.mark.parametrize("turning", [True, False], ids=["turning", "still"])
@pytest.mark.parametrize("name", LAWS)
def test_what_leaves_is_what_is_stored_no_longer(make_solver, name, turning):
    make, parameters, is_linear, seen = LAWS[name]
    fields = {key: FIELDS[key] for key in parameters} | ({"axes": AXES} if turning else {})
    found, points, places, weights = solved(make_solver, block(fields), make())
    stored = []
    for t, H, p in points:
        f = seen(porosity_at(places, t)) if "porosity" in parameters else np.full(len(p), cell.POROSITY)
        s = swelling_at(places, t) if "swelling" in parameters else np.zeros(len(p))
        H = in_axes(H, axes_at(places, t)) if turning else H
        stored.append(weights @ cell.fluid(H, p, f, s, linear=is_linear))
    assert len(stored) == 1 + len(TIMES)
    drained = drained_at_profiles(found)
    assert abs(drained[-1]) > 1e-3
    np.testing.assert_allclose(drained, stored[0] - np.array(stored), rtol=0, atol=1e-11)


def test_the_layers_of_two_laws_keep_their_fluid(make_solver):
    """A linear layer, with the porosity in time, below a layer of the potential closure that stands still."""
    given = RegionLaw([anisotropic_law("swelling"), LinearisedLaw(anisotropic_law("porosity"))])
    low = {"kind": "layer", "below": 0.5, "fields": {"porosity": FIELDS["porosity"], "axes": AXES}}
    problem = block({"swelling": FIELDS["swelling"]}, regions={"low": low})
    found, points, places, weights = solved(make_solver, problem, given)
    below, stored = places[:, 1] < 0.5, []
    for t, H, p in points:
        n = len(p)
        low_fluid = cell.fluid(
            in_axes(H, axes_at(places, t)), p, porosity_at(places, t), np.zeros(n), linear=True
        )
        rest = cell.fluid(H, p, np.full(n, cell.POROSITY), swelling_at(places, t))
        stored.append(weights @ np.where(below, low_fluid, rest))
    np.testing.assert_allclose(drained_at_profiles(found), stored[0] - np.array(stored), rtol=0, atol=1e-11)


def cofactor(F):
    return np.linalg.det(F)[:, None, None] * np.linalg.inv(F).swapaxes(1, 2)


@pytest.mark.parametrize("parameters", [(), BOTH[:1]], ids=["axes", "axes and porosity"])
def test_the_mean_gradient_closure_counts_its_formula_in_axes_that_stand_still(make_solver, parameters):
    """Σ φ_f cof F̄:ΔH − cof F̄:Δm − (det F̄ − cof F̄:m/φ_s) Δφ_s, with H and m in the axes of the body."""
    fields = {key: FIELDS[key] for key in parameters} | {"axes": AXES}
    law = anisotropic_law(*parameters, closure="mean-gradient")
    found, points, places, weights = solved(make_solver, block(fields), law)
    total, before = [0.0], None
    for t, H, p in points:
        R = axes_at(places, t)
        m = in_axes(cell.mean_grad(in_axes(H, R), p), R.swapaxes(1, 2))
        f = porosity_at(places, t) if parameters else np.full(len(p), cell.POROSITY)
        if before is not None:
            solid = (1 - f)[:, None, None]
            F = np.eye(3) + H + m / solid
            cof = cofactor(F)
            step = np.einsum("nij,nij->n", cof, f[:, None, None] * (H - before[0]) - (m - before[1]))
            grown = np.linalg.det(F) - np.einsum("nij,nij->n", cof, m / solid)
            total.append(total[-1] + weights @ (step + grown * (f - before[2])))
        before = H, m, f
    assert abs(total[-1]) > 1e-3
    np.testing.assert_allclose(drained_at_profiles(found), -np.array(total), rtol=0, atol=1e-11)


# ---- a held element ------------------------------------------------------------------------------

#: u₂ = −0.04 y on all sides, so that the strain is the same at all times, whatever the law.
STRAIN = 0.04
#: Edge of the body, which is so small that it drains within a step.
EDGE = 0.01
HELD = {
    "x-": {"normal": 0},
    "x+": {"normal": 0},
    "z-": {"normal": 0, "pressure": 0},
    "z+": {"normal": 0},
    "y-": {"displacement": (0, 0, 0), "pressure": 0},
    "y+": {"displacement": (0, -STRAIN * EDGE, 0), "pressure": 0},
}


def held(fields):
    """One element; the fields change from t = 5 to t = 10."""
    return MacroProblem.model_validate(
        {
            "body": {"kind": "box", "elements": (1, 1, 1), "size": (EDGE, EDGE, EDGE)},
            "boundary": HELD,
            "fields": fields,
            "time": {"end": 12, "step": 0.5, "ramp_increments": 2, "ramp_step": 0.5, "profiles": (5,)},
            "newton": NEWTON,
        }
    )


LATER = {"table": [[0, 0], [5, 0], [10, 1]]}
TURNED = {"about": (0, 0, 1), "angle": {"formula": "90", "initial": 0, "over": LATER}}


@pytest.mark.parametrize("name", ["linear", "linear of a family", "potential"])
def test_axes_that_turn_by_a_right_angle_in_a_held_body(make_solver, name):
    """The drained volume in the end is that of a body whose axes were turned from the beginning: α_11 ε for α_22 ε."""
    make, parameters, is_linear, _ = LAWS[name]
    constants = {key: value for key, value in (("porosity", 0.25), ("swelling", 0.0)) if key in parameters}
    found = solved(make_solver, held(constants | {"axes": TURNED}), make())[0]
    strain = STRAIN if is_linear else STRAIN - STRAIN**2 / 2
    assert found.history.drained[-1] / EDGE**3 == pytest.approx(0.25 * 1.5 * strain, rel=1e-9)


def test_axes_that_turn_in_a_held_body_of_the_mean_gradient_closure(make_solver):
    """The body keeps its volume, so that the fluid gives way to the solid, φ_s det F̄."""
    H = np.diag([0, -STRAIN, 0])[None]
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])[None]
    solid = [
        0.75 * np.linalg.det(np.eye(3) + at + cell.mean_grad(at, np.zeros(1)) / 0.75)[0]
        for at in (H, in_axes(H, turn))
    ]
    found = solved(make_solver, held({"axes": TURNED}), anisotropic_law(closure="mean-gradient"))[0].history
    given = found.drained[-1] - found.drained[np.argmin(np.abs(found.time - 5))]
    assert given / EDGE**3 == pytest.approx(solid[1] - solid[0], rel=1e-4)


@pytest.mark.parametrize("name", ["linear", "linear of a family", "potential", "mean-gradient"])
def test_a_run_with_turning_axes_is_continued(make_solver, tmp_path, name):
    """From a checkpoint in the middle of the turn, by a law that is made anew."""
    make, parameters = (lambda: anisotropic_law(*BOTH[:1], closure="mean-gradient")), BOTH[:1]
    if name != "mean-gradient":
        make, parameters, *_ = LAWS[name]
    problem = block({key: FIELDS[key] for key in parameters} | {"axes": AXES})

    def solution(**how):
        solver = make_solver(checkpoint_seconds=0)
        return solver.solve(solver.prepare(problem), make(), **how)

    class Killed(Exception):
        pass

    def stop(report):
        if report.time > 1:
            raise Killed

    with pytest.raises(Killed):
        solution(checkpoint=tmp_path / "macro.h5", on_step=stop)
    found, whole = solution(checkpoint=tmp_path / "macro.h5"), solution()
    np.testing.assert_allclose(found.history.drained, whole.history.drained, rtol=1e-9, atol=1e-13)
    np.testing.assert_allclose(found.profiles[-1].u, whole.profiles[-1].u, rtol=1e-9, atol=1e-12)
