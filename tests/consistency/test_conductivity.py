"""The conductivity of the deformed pore: that of the cell at rest, closed forms, symmetries, backends compared."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from porocore.cell.cell import Cell
from porocore.cell.contact.wall_contact import ContactSettings
from porocore.cell.geometry.channels import OrthogonalChannels
from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.cell.meshing.mesh import MeshSettings
from porocore.errors import ConfigurationError
from porocore.interfaces.law import CellLaw, Interval
from porocore.macro.integration.newton import newton_step
from porocore.macro.laws.closure import CLOSURES, make_closure
from porocore.macro.laws.macro_law import ClosedLaw
from porocore.macro.problem import NewtonSettings
from porocore.states import MacroState, Status
from porocore.surrogates.polynomial.surrogate import PolynomialSurrogate
from porocore.testing.synthetic.cell import SOLID_FRACTION, synthetic_training_set
from porocore.testing.synthetic.response import confined_column

COARSE = MeshSettings(size=0.35, fluid_size=0.3)
NU = 0.35
SOLID = NeoHookean(poisson_ratio=NU)
EYE = np.eye(3)
DIAGONAL = np.diag([0.02, -0.15, 0.04]), 0.05
GENERAL = np.array([[0.03, 0.08, -0.02], [0.01, -0.06, 0.04], [0.0, 0.05, 0.02]]), 0.08
CROSSING = Cell(geometry=OrthogonalChannels(radius=0.25), material=SOLID, mesh=COARSE)
RADIUS = 0.1
CHANNEL = Cell(
    geometry=OrthogonalChannels(radius=RADIUS, axes="x"),
    material=SOLID,
    mesh=MeshSettings(size=0.3, fluid_size=0.14),
    viscosity=1.0,
)


@pytest.fixture(scope="module")
def solving(load):
    """``solving(backend, cell)`` is a solver and the cell, prepared once."""

    @cache
    def make(backend, cell):
        solver = load("cell solver", backend)
        return solver, solver.prepare(cell, deformed=True)

    return make


@pytest.fixture(scope="module")
def solved(solving):
    """``solved(backend, cell, H, p)``, solved once; H row by row."""

    @cache
    def make(backend, cell, H, p):
        solver, prepared = solving(backend, cell)
        return solver.solve(prepared, MacroState.single(np.reshape(H, (3, 3)), p), tangent=False).response

    return lambda backend, cell, H, p=0.0: make(backend, cell, tuple(np.ravel(H).tolist()), p)


@pytest.mark.parametrize("cell", [CROSSING, CHANNEL], ids=["crossing", "channel"])
def test_at_rest_it_is_that_of_the_undeformed_cell(cell_solver, solving, solved, cell):
    solver, prepared = solving(cell_solver, cell)
    K = solver.conductivity(prepared)
    rest = solved(cell_solver, cell, 0 * EYE)
    np.testing.assert_allclose(rest.conductivity[0], K, atol=1e-12 * K.max())
    assert rest.min_fluid_jacobian[0] == pytest.approx(1, abs=1e-12)


@pytest.mark.parametrize(
    "state", [DIAGONAL, pytest.param(GENERAL, marks=pytest.mark.slow)], ids=["diagonal", "general"]
)
def test_backends_agree(cell_solver_pair, solved, state):
    a, b = (solved(backend, CROSSING, *state).conductivity[0] for backend in cell_solver_pair)
    np.testing.assert_allclose(a, b, atol=1e-8 * np.abs(b).max())


@pytest.mark.slow
def test_eighth_and_whole_agree(solved):
    whole = CROSSING.model_copy(update={"symmetry": "none"})
    a, b = (solved("skfem", cell, *DIAGONAL) for cell in (CROSSING, whole))
    np.testing.assert_allclose(a.conductivity, b.conductivity, atol=1e-8 * b.conductivity.max())
    assert a.min_fluid_jacobian[0] == pytest.approx(b.min_fluid_jacobian[0], rel=1e-8)


@pytest.mark.slow
def test_turning_the_cell_changes_nothing(solved):
    H, p = GENERAL
    R = Rotation.from_rotvec([0.3, -0.5, 0.7]).as_matrix()
    K = solved("skfem", CROSSING, H, p).conductivity[0]
    turned = solved("skfem", CROSSING, R @ (EYE + H) - EYE, p).conductivity[0]
    np.testing.assert_allclose(turned, K, atol=1e-8 * K.max())
    np.testing.assert_allclose(K, K.T, atol=1e-15)
    assert np.linalg.eigvalsh(K).min() > 0.1 * K.max()
    assert np.abs(K - np.diag(np.diag(K))).max() > 0.01 * K.max()


def test_exchanged_axes_exchange_the_conductivity(solved):
    H, p = DIAGONAL
    one = np.diag(solved("skfem", CROSSING, H, p).conductivity[0])
    other = np.diag(solved("skfem", CROSSING, np.diag(np.diag(H)[[1, 2, 0]]), p).conductivity[0])
    np.testing.assert_allclose(other, one[[1, 2, 0]], rtol=1e-7)


def test_a_pore_that_swells_with_its_cell(solving):
    """x = λ Y: k = λ² K, so K_ref = J₀ F₀⁻¹ k F₀⁻ᵀ = λ³ K."""
    _, prepared = solving("skfem", CROSSING)
    pore, solid = prepared.pore("eighth"), prepared.eighth.mesh
    K, smallest = pore.deformed(0.2 * EYE, np.zeros((len(solid.points), 3)), solid)
    np.testing.assert_allclose(K, 1.2**3 * pore.undeformed, rtol=1e-8)
    assert smallest == pytest.approx(1.2**3, rel=1e-12)


@pytest.mark.parametrize("stretch", [0.8, 1.3])
def test_a_channel_stretched_along_its_axis(solved, stretch):
    """Uniaxial stress leaves the solid homogeneous, so that the radius becomes λ_t r: K_ref = λ_t⁴/λ · π r⁴/8."""
    mu, lam = SOLID.mu, 2 * SOLID.mu * NU / (1 - 2 * NU)
    lateral = brentq(lambda t: mu * (t * t - 1) + lam * np.log(stretch * t * t), 0.3, 2)
    H = np.diag([stretch, lateral, lateral]) - EYE
    found = solved("skfem", CHANNEL, H).conductivity[0]
    exact = lateral**4 / stretch * np.pi * RADIUS**4 / 8
    assert found[0, 0] == pytest.approx(exact, rel=2e-3)
    assert (found.ravel()[1:] == 0).all()
    rest = solved("skfem", CHANNEL, 0 * EYE).conductivity[0, 0, 0]
    assert found[0, 0] / rest == pytest.approx(lateral**4 / stretch, rel=1e-4)


@pytest.mark.parametrize("p", [1e-3, 0.3])
def test_a_channel_widened_by_pressure(solved, p):
    """K_ref = π r'⁴/8 with r' of a thick cylinder that has the cell's section; images change the widening by 0.5 %."""
    found = solved("skfem", CHANNEL, 0 * EYE, p).conductivity[0, 0, 0]
    rest = solved("skfem", CHANNEL, 0 * EYE).conductivity[0, 0, 0]
    widened = thick_cylinder(RADIUS, p)
    assert found == pytest.approx(np.pi * widened**4 / 8, rel=1e-2)
    assert (found / rest) ** 0.25 - 1 == pytest.approx(widened / RADIUS - 1, rel=1e-2)
    if p < 0.01:
        assert widened / RADIUS - 1 == pytest.approx(lame(RADIUS, p), rel=2e-3)


def lame(a, p):
    """Relative widening of a linear elastic cylinder, plane strain, held at the outer radius b = 1/√π."""
    c, mu, lam = np.pi * a * a, SOLID.mu, 2 * SOLID.mu * NU / (1 - 2 * NU)
    return p * (1 - c) / (2 * mu * (1 + c * (lam + mu) / mu))


def thick_cylinder(a, p):
    """Radius under p of the same cylinder, neo-Hookean, at finite strain: shooting from the inner wall."""
    mu, lam, b = SOLID.mu, 2 * SOLID.mu * NU / (1 - 2 * NU), 1 / np.sqrt(np.pi)

    def stress(first, second):
        return mu * (first - 1 / first) + lam * np.log(first * second) / first

    def slopes(R, y):
        x, P = y
        radial = brentq(lambda s: stress(s, x / R) - P, 0.01, 20)
        return [radial, -(P - stress(x / R, radial)) / R]

    def outer(r):
        return solve_ivp(slopes, (a, b), [r, -p * r / a], rtol=1e-9, atol=1e-12).y[0, -1] - b

    return brentq(outer, a, 1.8 * a, xtol=1e-12)


def test_where_walls_touch_there_is_none_and_the_rest_stays(solved):
    response = solved("skfem", CROSSING, np.diag([0.0, -0.36, 0.0]), 0.1)
    assert response.status[0] == Status.contact
    assert np.isnan(response.conductivity).all()
    assert response.min_fluid_jacobian[0] <= 0
    assert np.isfinite(response.stress).all()
    assert response.stable.all()


def test_a_state_without_values_has_no_conductivity_either(solved):
    response = solved("skfem", CROSSING, np.diag([0.0, -1.1, 0.0]))
    assert response.status[0] == Status.inverted
    assert np.isnan(response.conductivity).all()
    assert np.isnan(response.min_fluid_jacobian).all()


def test_what_it_cannot_be_computed_for_is_refused(load):
    solver = load("cell solver", "skfem")
    several = Cell(supercell=(2, 1, 1), contact=ContactSettings(kind="none"), mesh=COARSE)
    with pytest.raises(ConfigurationError, match=r"cell\.supercell has several"):
        solver.prepare(several, deformed=True)


class Dropped(CellLaw):
    """A cell law that does not tell how its conductivity changes."""

    def __init__(self, law):
        self.law, self.identity = law, law.identity

    def predict(self, states, *, tangent=True):
        response = self.law.predict(states, tangent=tangent)
        if response.tangent is None:
            return response
        slopes = replace(response.tangent, conductivity_grad_u=None, conductivity_p=None)
        return replace(response, tangent=slopes)


@pytest.fixture(scope="module")
def learned():
    """A made-up cell whose conductivity falls tenfold over the sampled range."""
    data = synthetic_training_set(60, seed=1)
    size = np.exp(12 * data.states.grad_u[:, 1, 1] + 2 * data.states.p)
    K = size[:, None, None] * np.diag([1.0, 0.8, 1.0])
    rest = replace(data.reference, conductivity=np.diag([1.0, 0.8, 1.0])[None])
    data = replace(data, responses=replace(data.responses, conductivity=K), reference=rest)
    return PolynomialSurrogate().fit(data, seed=0)


@pytest.mark.parametrize("closure", CLOSURES)
def test_newtons_iteration_converges_quadratically(macro_solver, load, learned, closure):
    """And linearly to the same, where the slopes of the conductivity are not known."""
    closed = make_closure(closure, SOLID_FRACTION, NeoHookean(), np.diag([1.0, 0.8, 1.0]), law="deformed")
    solver = load("macro solver", macro_solver)
    d = solver.prepare(confined_column(6, load=-0.05))
    settings = NewtonSettings(tolerance=1e-13, iterations=40)
    found = []
    for cells in (learned, Dropped(learned)):
        law = ClosedLaw(cells, closed)
        start = np.zeros(d.mesh.size)
        found.append(
            newton_step(d, law, law.initial(d.n_points), start, Interval(0, 20), d.loads(-0.05), settings)
        )
    exact, dropped = ([m for m in step.misfits if 1e-13 < m < 1] for step in found)
    assert len(exact) >= 2
    assert (np.log(exact[1:]) / np.log(exact[:-1]))[-1] > 1.6
    assert found[0].iterations <= 8
    assert len(dropped) > len(exact) + 2
    np.testing.assert_allclose(found[1].x, found[0].x, atol=1e-10)
