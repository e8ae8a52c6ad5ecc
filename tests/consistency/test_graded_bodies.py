"""Graded and turned bodies on every macro backend, against references that know neither fields nor axes."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from porocore.cell.materials.neo_hookean import NeoHookean
from porocore.core.inputs.input_space import InputSpace
from porocore.core.tensors.point_group import CUBIC
from porocore.interfaces.law import CellLaw, LawMemory, MacroLaw, MacroResponse, MacroTangent, UndeformedCells
from porocore.interfaces.solution import History
from porocore.interfaces.surrogate import TrainingSet
from porocore.macro.analytic.layered import LayeredConsolidation, SoilLayer
from porocore.macro.composition.bound_law import BoundLaw
from porocore.macro.composition.linearised_law import LinearisedLaw
from porocore.macro.composition.region_law import RegionLaw
from porocore.macro.laws import ClosedLaw, make_closure
from porocore.macro.problem import MacroProblem
from porocore.plugins.registry import registry
from porocore.states import CellResponse, CellTangent, MacroState
from porocore.surrogates.polynomial.surrogate import PolynomialSurrogate
from porocore.testing.synthetic import porous_family, potential_cell
from porocore.testing.synthetic.parametric_cell import CONDUCTIVITY, ParametricCell, parametric_law, porosity
from porocore.testing.synthetic.response import confined_column

HEIGHT = 7.5
SHORT = {"end": 6.0, "step": 1.5, "ramp_increments": 2, "ramp_step": 0.1, "profiles": (1.0,)}
FEW = {"end": 4.0, "step": 2.0, "ramp_increments": 1, "ramp_step": 1.0, "profiles": (2.0,)}


@pytest.fixture(params=["skfem", pytest.param("dolfinx", marks=pytest.mark.slow)])
def solved(request):
    pytest.importorskip(request.param)

    def solve(problem, law):
        solver = registry().get("macro solver", request.param)()
        return solver.solve(solver.prepare(problem), law)

    return solve


def radius(y):
    return 0.16 + 0.12 * (y / HEIGHT) ** 2


def stiffness(y):
    return 2.5 - 1.5 * y / HEIGHT


def hundred_layers():
    """Layers of the made-up cell with the parameters in their middle, from its closed form at rest."""
    rest = potential_cell.respond(MacroState.zeros(1)).tangent
    height = HEIGHT / 100
    found = []
    for y in height * (np.arange(100) + 0.5):
        r, e = radius(y), stiffness(y)
        more = float(porosity(np.array(r))) - (1 - potential_cell.SOLID_FRACTION)
        biot = more - rest.stress_p[0, 1, 1]
        modulus = e * rest.stress_grad_u[0, 1, 1, 1, 1]
        found.append(SoilLayer(height, modulus, biot, rest.fluid_volume_p[0] / e, CONDUCTIVITY[1, 1] * r**4))
    return found


GRADED = {"radius": "0.16 + 0.12*(y/7.5)**2", "stiffness": "2.5 - 1.5*y/7.5"}


def test_a_graded_column_is_one_of_a_hundred_layers(solved):
    """Closed form of layers under a short ramp; K varies by a factor of nine, C by one of two and a half."""
    load, ramp = 1e-5, 0.1
    exact = LayeredConsolidation(hundred_layers(), load, ramp)
    plan = {"end": 60, "step": 5, "ramp_increments": 4, "ramp_step": ramp / 4, "profiles": (20.0,)}
    problem = confined_column(12, -load, time=plan | {"tolerance": 1e-3}, fields=GRADED)
    solution = solved(problem, LinearisedLaw(parametric_law()))
    some = np.flatnonzero(solution.history.time > 2)[::10]
    expected = np.array([exact.settlement(t) for t in solution.history.time[some]])
    np.testing.assert_allclose(solution.history.settlement[some], expected, atol=5e-3 * expected.max())
    scale = max(layer.initial_pressure(load) for layer in exact.layers)
    every, profile = on_axis(solution), solution.profiles[1]
    pressure = exact.pressure(solution.points[every, 1], profile.time)
    np.testing.assert_allclose(profile.p[every], pressure, atol=5e-3 * scale)


@pytest.fixture(scope="module")
def layered():
    """A body of a hundred regions, each with a law of its own whose parameters are bound."""
    pytest.importorskip("skfem")
    edges = np.linspace(0, HEIGHT, 101)
    regions = {f"{k}": {"above": edges[k], "below": edges[k + 1]} for k in range(100)}
    law, middle = parametric_law(), (edges[1:] + edges[:-1]) / 2
    laws = {
        f"{k}": BoundLaw(law, {"radius": float(radius(y)), "stiffness": float(stiffness(y))})
        for k, y in enumerate(middle)
    }
    solver = registry().get("macro solver", "skfem")()
    problem = confined_column(100, -0.03, time=FEW, regions=regions)
    return solver.solve(solver.prepare(problem), RegionLaw.by_name([*regions], laws, rest=laws["0"]))


@pytest.mark.slow
def test_a_graded_column_tends_to_a_body_of_a_hundred_regions(solved, layered):
    """Finite strain, the same time steps; the error falls as the square of the size of the elements."""
    top, errors = layered.history.settlement, []
    for elements in (5, 10, 20):
        found = solved(confined_column(elements, -0.03, time=FEW, fields=GRADED), parametric_law())
        error = np.abs(found.history.settlement - top).max() / top.max()
        for mine, theirs in zip(found.profiles[1:], layered.profiles[1:], strict=True):
            order, every = np.argsort(theirs_y(layered)), on_axis(found)
            expected = np.interp(
                found.points[every, 1], theirs_y(layered)[order], theirs.p[on_axis(layered)][order]
            )
            error = max(error, np.abs(mine.p[every] - expected).max() / theirs.p.max())
        errors.append(error)
    assert errors[1] < errors[0] / 3
    assert errors[2] < errors[1] / 3
    assert errors[2] < 1e-3


def on_axis(solution):
    """Corners of the elements along the column."""
    corners = np.unique(solution.cells[:, :8])
    return corners[(solution.points[corners][:, [0, 2]] == 0).all(axis=1)]


def theirs_y(solution):
    return solution.points[on_axis(solution), 1]


THETA = {"radius": 0.21, "poisson_ratio": 0.33}


def closed(surrogate, **at):
    """The potential closure; its constants are those of a cell without parameters."""
    solid = 1 - float(porous_family.porosity(at.get("radius", 0.22)))
    K = at["radius"] ** 4 * (1 + 8 * at["radius"]) if at else 1.0
    return ClosedLaw(surrogate, make_closure("potential", solid, NeoHookean(), K * np.eye(3), law="deformed"))


@pytest.fixture(scope="module")
def of_the_family():
    return PolynomialSurrogate().fit(porous_family.porous_training_set(96, 3), seed=0)


@pytest.fixture(scope="module")
def of_one_cell():
    """A study of its own: states of the one cell, which knows no parameters."""
    inputs = InputSpace.from_ranges({"H22": (-0.12, 0.04), "p": (0.0, 0.1)})
    low, high = np.array(inputs.lower), np.array(inputs.upper)
    states = inputs.scatter(low + (high - low) * np.random.default_rng(5).random((40, 2)))
    names, values = tuple(THETA), np.array([*THETA.values()])

    def respond(at):
        theta = np.tile(values, (len(at), 1))
        return replace(porous_family.respond(at.with_parameters(theta), names), slopes=None)

    rest = respond(MacroState.zeros(1))
    rest = replace(rest, min_fluid_jacobian=np.ones(1))
    return PolynomialSurrogate().fit(
        TrainingSet(states, respond(states), inputs, rest, "one cell", {}, CUBIC), seed=0
    )


def test_a_constant_field_is_the_surrogate_bound_to_it_and_near_one_of_its_own(
    solved, of_the_family, of_one_cell
):
    law = closed(of_the_family)
    free = solved(confined_column(4, -0.03, time=SHORT, fields=THETA), law)
    bound = solved(confined_column(4, -0.03, time=SHORT), BoundLaw(law, THETA))
    assert_same(free, bound, 1e-12)
    own = solved(confined_column(4, -0.03, time=SHORT), closed(of_one_cell, **THETA))
    for name, within in (("settlement", 1e-3), ("drained", 1e-3), ("pressure_max", 2e-3)):
        mine, theirs = getattr(free.history, name), getattr(own.history, name)
        np.testing.assert_allclose(mine, theirs, rtol=0, atol=within * np.abs(theirs).max())


class RotatedLaw(MacroLaw):
    """A law rotated as a whole, all of its tensors index by index."""

    def __init__(self, law, R):
        self.law, self.R = law, R
        self.name, self.parameters, self.identity = law.name, law.parameters, f"rotated {law.identity}"

    def inside(self, states):
        H = np.einsum("ia,nij,jb->nab", self.R, states.grad_u, self.R)
        return MacroState(H, states.p, states.parameters)

    def initial(self, n):
        return self.law.initial(n)

    def initial_at(self, points):
        return replace(self.law.initial_at(self.inside(points)), states=points)

    def respond(self, states, grad_p, memory, *, tangent=True):
        R, law = self.R, self.law
        mean = np.einsum("ia,nij,jb->nab", R, memory.mean_grad, R)
        before = LawMemory(self.inside(memory.states), mean, memory.fluid_volume)
        found = law.respond(self.inside(states), np.einsum("ia,ni->na", R, grad_p), before, tangent=tangent)

        def back(tensor):
            return np.einsum("ia,nab,jb->nij", R, tensor, R)

        t = found.tangent
        return MacroResponse(
            stress=back(found.stress),
            storage=found.storage,
            flux=np.einsum("ia,na->ni", R, found.flux),
            memory=LawMemory(states, back(found.memory.mean_grad), found.memory.fluid_volume),
            deformation=back(found.deformation),
            volume_ratio=found.volume_ratio,
            transformed_conductivity=back(found.transformed_conductivity),
            outside_training_range=found.outside_training_range,
            tangent=t
            and MacroTangent(
                stress_grad_u=np.einsum(
                    "ia,jb,kc,ld,nabcd->nijkl", R, R, R, R, t.stress_grad_u, optimize=True
                ),
                stress_p=back(t.stress_p),
                storage_grad_u=back(t.storage_grad_u),
                storage_p=t.storage_p,
                flux_grad_u=np.einsum("ia,kc,ld,nacd->nikl", R, R, R, t.flux_grad_u, optimize=True),
                flux_p=np.einsum("ia,na->ni", R, t.flux_p),
                flux_grad_p=back(t.flux_grad_p),
            ),
        )


class ExchangedCell(CellLaw):
    """The made-up cell turned by 90° about z: its axis 1 points along y, its axis 2 along −x; indices change places."""

    parameters, identity = ParametricCell.parameters, "exchanged"
    #: Component of the cell along x, y and z, and its sign.
    PLACE, SIGN = np.array([1, 0, 2]), np.array([-1.0, 1.0, 1.0])

    def exchanged(self, tensor, first=1):
        """Indices from ``first`` on, in place of those of the body."""
        for axis in range(first, tensor.ndim):
            sign = self.SIGN.reshape([-1 if k == axis else 1 for k in range(tensor.ndim)])
            tensor = sign * np.take(tensor, self.PLACE, axis=axis)
        return tensor

    def predict(self, states, *, tangent=True):
        inside = replace(states, grad_u=_into_the_cell(states.grad_u))
        found = ParametricCell().predict(inside, tangent=tangent)
        t = found.tangent
        return CellResponse(
            mean_grad=self.exchanged(found.mean_grad),
            status=found.status,
            potential=found.potential,
            stress=self.exchanged(found.stress),
            fluid_volume=found.fluid_volume,
            tangent=t
            and CellTangent(
                **{
                    name: self.exchanged(value) if value.ndim > 1 else value
                    for name, value in vars(t).items()
                    if value is not None
                }
            ),
        )

    def undeformed(self, parameters):
        cells = ParametricCell().undeformed(parameters)
        return UndeformedCells(cells.porosity, self.exchanged(cells.conductivity))


def _into_the_cell(H):
    """H in the axes of the cell, e₁ = y, e₂ = −x, e₃ = z, component by component."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = np.moveaxis(H, (1, 2), (0, 1))
    rows = [[yy, -yx, yz], [-xy, xx, -xz], [zy, -zx, zz]]
    return np.moveaxis(np.array(rows), (0, 1), (1, 2))


def block(load, **more):
    """A block that is pressed and sheared obliquely, and drains through two of its sides."""
    return MacroProblem.model_validate(
        {
            "body": {"kind": "box", "size": (1.0, 1.2, 0.8), "elements": (2, 2, 2)},
            "boundary": {
                "y-": {"displacement": (0, 0, 0)},
                "y+": {"traction": (0.3, 1, 0.2), "pressure": 0},
                "x+": {"pressure": 0},
            },
            "load": load,
            "time": {
                "end": 0.02,
                "step": 0.01,
                "ramp_increments": 2,
                "ramp_step": 0.005,
                "profiles": (0.01,),
            },
            "fields": {"radius": "0.2 + 0.05*x*y", "stiffness": "1 + 0.3*z"},
            "newton": {"tolerance": 1e-12},
        }
        | more
    )


@pytest.mark.parametrize("closure", ["potential", "mean-gradient"])
def test_axes_that_are_turned_anyhow_give_the_rotated_law(solved, closure):
    about, angle = [1.0, 2.0, 3.0], 37.0
    R = Rotation.from_rotvec(np.deg2rad(angle) * np.array(about) / np.linalg.norm(about)).as_matrix()
    law = parametric_law(closure=closure)
    plain = block(-0.01)
    turned = block(-0.01, fields={**plain.fields, "axes": {"about": about, "angle": angle}})
    found, expected = solved(turned, law), solved(plain, RotatedLaw(law, R))
    assert_same(found, expected, 1e-10)
    # The turn matters.
    other = solved(plain, law)
    assert np.abs(other.profiles[-1].u - expected.profiles[-1].u).max() > 1e-4


def test_axes_that_are_turned_by_a_right_angle_give_the_rotated_cell(solved):
    plain = block(-0.01)
    turned = block(-0.01, fields={**plain.fields, "axes": {"first": [0, 1, 0], "second": [-1, 0, 0]}})
    constants = make_closure("potential", 1 - float(porosity(np.array(0.2))), NeoHookean(), np.eye(3))
    found = solved(turned, parametric_law())
    expected = solved(plain, ClosedLaw(ExchangedCell(), constants))
    assert_same(found, expected, 1e-10)
    other = solved(plain, parametric_law())
    assert np.abs(other.profiles[-1].p - expected.profiles[-1].p).max() > 1e-6


def assert_same(one, other, within):
    for field in fields(History):
        if field.name not in ("iterations", "stress_spread"):
            mine, theirs = getattr(one.history, field.name), getattr(other.history, field.name)
            np.testing.assert_allclose(mine, theirs, rtol=0, atol=within * max(abs(theirs).max(), 1e-3))
    for mine, theirs in zip(one.profiles, other.profiles, strict=True):
        for name in ("u", "p", "stress", "flux"):
            a, b = getattr(mine, name), getattr(theirs, name)
            np.testing.assert_allclose(a, b, rtol=0, atol=within * max(np.abs(b).max(), 1e-2))
