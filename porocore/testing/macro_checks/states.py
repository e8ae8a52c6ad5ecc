"""Checks on the discrete equations; suites of macro solvers and laws (MacroSolverSuite, MacroLawSuite).

.. code-block:: python

    class TestMyLaw(MacroLawSuite):
        kit_version = "5"

        @classmethod
        def make_law(cls):
            return MyLaw()

.. code-block:: python

    class TestMyMacroSolver(MacroSolverSuite):
        kit_version = "5"

        @classmethod
        def make_solver(cls, **options):
            return MyMacroSolver(**options)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any, ClassVar

import numpy as np
import pytest

from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.core.fields import provided
from porocore.interfaces.law import (
    Interval,
    LawMemory,
    MacroLaw,
    MacroResponse,
    MacroTangent,
    MemoryChanges,
    PointChanges,
    columns_of,
)
from porocore.interfaces.solution import History
from porocore.macro.laws.linear import LinearCellLaw
from porocore.macro.problem import MacroProblem
from porocore.states import Array, MacroState
from porocore.testing.expect import holds, near, require, same, states_text
from porocore.testing.macro_checks.bodies import Bodies, Plates
from porocore.testing.macro_checks.contact import Contacts
from porocore.testing.macro_checks.flat_bodies import OUTER, SHAPES, FlatBodies
from porocore.testing.macro_checks.memory import Memories
from porocore.testing.macro_checks.runs import (
    ALPHA,
    C22,
    COEFFICIENTS,
    HELD,
    LINEAR,
    NONLINEAR,
    PHI_S,
    SHORT,
    SIDES,
    Histories,
    K,
    Runs,
    Solving,
)
from porocore.testing.macro_checks.sensitivities import RunDerivatives
from porocore.testing.suite import Suite
from porocore.testing.synthetic.response import GradientLaw, confined_column, cubic_reference


class KnownStates(Solving):
    """Part of :class:`porocore.testing.macro_checks.states.MacroSolverSuite`."""

    @pytest.mark.parametrize("elements", [(1, 2, 1), (2, 1, 2)])
    def test_tangent_is_the_derivative_of_the_residual(self, elements: Any) -> None:
        """All unknowns free to move, a nonlinear law, a state without any symmetry."""
        problem = confined_column(elements, size=(0.7, 1.1, 0.9))
        d = self.discretise(problem)
        system, slope, direction = self.tangent_and_slope(d, -0.2)
        # Solving with the slope gives the direction back, if the tangent is the slope.
        found = d.solve(system, slope, direction[d.prescribed])
        state = f"random unknowns of {elements} elements, along a random direction"
        near(
            "what the tangent makes of the slope", found, direction, state, within=1e-5 * abs(direction).max()
        )
        sizes = d.magnitudes(system, direction)[d.free]
        least = (sizes - abs(slope[d.free]) * (1 - 1e-6)).min()
        holds(least >= 0, state, "magnitudes that are no smaller than the sums of what they measure", least)

    @pytest.mark.parametrize("body", ["box", *SHAPES])
    def test_tangent_knows_what_depends_on_the_gradient_of_the_pressure(self, body: Any) -> None:
        """Stress and storage of a law do; a state without any symmetry, and the transposed system too."""
        if body == "box":
            problem = confined_column((1, 2, 1), size=(0.7, 1.1, 0.9))
        else:
            boundary = {"y-": {"displacement": (0, 0, None)}, OUTER[body]: {"pressure": 0}}
            data = {"body": SHAPES[body], "boundary": boundary, "time": SHORT, "load": 1.0}
            problem = MacroProblem.model_validate(data)
        d = self.discretise(problem)
        system, slope, direction = self.tangent_and_slope(d, -0.2, GradientLaw(NONLINEAR))
        found = d.solve(system, slope, direction[d.prescribed])
        state = f"the body '{body}', a law whose stress and storage depend on the gradient of the pressure"
        near(
            "what the tangent makes of the slope", found, direction, state, within=2e-5 * abs(direction).max()
        )
        still, right = np.zeros(len(d.prescribed)), np.zeros((2, d.mesh.size))
        right[:, d.free] = np.random.default_rng(1).standard_normal((2, len(d.free)))
        product = right[1] @ d.solve(system, right[0], still)
        transposed = right[0] @ d.solve(d.transposed(system), right[1], still)
        near("a product with the transposed system", transposed, product, state, rel=1e-6)

    def test_gradients_of_a_quadratic_displacement_and_a_linear_pressure_are_exact(self) -> None:
        d = self.discretise(confined_column((2, 3, 2), size=(1, 2, 3)))
        mesh = d.mesh
        rng = np.random.default_rng(2)
        A, B, g = rng.standard_normal((3, 3)), rng.standard_normal((3, 3, 3)), rng.standard_normal(3)
        u = mesh.points @ A.T + np.einsum("ijk,nj,nk->ni", B, mesh.points, mesh.points)
        p = 0.3 + mesh.points[mesh.p_nodes] @ g
        states, grad_p = d.states(d.from_mesh(np.concatenate([u.ravel(), p])))
        near("grad_p", grad_p, g, "a linear pressure", rel=1e-11)
        linear, _ = d.states(d.from_mesh(np.concatenate([(mesh.points @ A.T).ravel(), p])))
        near("H", linear.grad_u, A, "a linear displacement", within=1e-12, rel=1e-7)
        # A pressure that is a coordinate says where the quadrature points lie.
        at = np.stack([self._pressures(d, mesh.points[mesh.p_nodes, i]) for i in range(3)], axis=1)
        expected = A + np.einsum("ijk,nk->nij", B + B.transpose(0, 2, 1), at)
        near("H", states.grad_u, expected, "a quadratic displacement", within=1e-11, rel=1e-7)
        centre = d.weights @ at / d.weights.sum()
        near("the centre of the quadrature points", centre, [0.5, 1, 1.5], "a box of 1 × 2 × 3", rel=1e-11)
        near("the volume", d.weights.sum(), 6.0, "a box of 1 × 2 × 3", rel=1e-13)

    @staticmethod
    def _pressures(d: Any, p: Any) -> Any:
        """Return the pressures at the quadrature points from those at the nodes."""
        return d.states(d.from_mesh(np.concatenate([np.zeros(d.mesh.n_u), p])))[0].p

    def test_cells_are_triquadratic_hexahedra_in_vtk_order(self) -> None:
        self.needs_core_mesh()
        solution = self.solve(confined_column((1, 2, 1), size=(2, 4, 6), time=SHORT), LINEAR)
        nodes = solution.points[solution.cells]
        first = nodes[np.argmin(nodes[:, :, 1].mean(axis=1))] / np.array([1, 1, 3])
        corners = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2)]
        edges = ["01", "12", "23", "30", "45", "56", "67", "74", "04", "15", "26", "37"]
        faces = ["0473", "1265", "0154", "3762", "0123", "4567"]  # x-, x+, y-, y+, z-, z+
        expected = np.array(
            corners + [np.mean([corners[int(c)] for c in e], axis=0) for e in edges + faces] + [(1, 1, 1)]
        )
        near("nodes of the first cell", first, expected, "a box of two elements", within=1e-12, rel=1e-7)

    # --- states that are known exactly ------------------------------------------------------------------

    def test_uniform_drained_strain_is_reproduced(self) -> None:
        """Two faces displaced, one free: H is uniform and P_E,33 = 0, whatever the mesh."""
        roller: list[list[float | None]] = [[None] * 3 for _ in range(3)]
        for i in range(3):
            roller[i][i] = 0
        dry: dict[str, Any] = {"pressure": 0}
        boundary: dict[str, Any] = {
            f"{axis}-": {"displacement": tuple(roller[i]), **dry} for i, axis in enumerate("xyz")
        }
        boundary |= {
            "x+": {"displacement": (0.1, None, None), **dry},
            "y+": {"displacement": (None, -0.3, None), **dry},
            "z+": dry,
        }
        problem = confined_column((2, 3, 2), load=1.0, size=(1, 2, 1.5), boundary=boundary, time=SHORT)
        profile = self.solve(problem, NONLINEAR).profiles[-1]
        H = profile.grad_u
        state, exact = "two faces displaced, drained", self.within(1e-10)
        near("H, the same everywhere,", H, H[0], state, within=exact)
        near("H11, H22", np.diag(H[0])[:2], [0.1, -0.15], state, within=self.within(1e-12))
        near("shear of H", H[0] - np.diag(np.diag(H[0])), 0.0, state, within=exact)
        near("p", profile.p, 0.0, state, within=1e-14)
        # The stress by the strain energy of the mean deformation, differentiated numerically.
        law = LinearCellLaw(cubic_reference())
        mean = law.predict(MacroState.single(H[0])).mean_grad[0]
        F, h = np.eye(3) + H[0] + mean / PHI_S, 1e-5
        energy = [NeoHookean().energy_density(F + s * h * np.diag(e)) for e in np.eye(3) for s in (1, -1)]
        stress = PHI_S * (np.array(energy[::2]) - np.array(energy[1::2])) / (2 * h)
        near("P_E,ii", np.diag(profile.stress[0]), stress, state, within=self.within(1e-9))
        near("P_E,33 of the free face", profile.stress[0, 2, 2], 0.0, state, within=self.within(1e-8))

    def test_undrained_column_keeps_its_fluid(self) -> None:
        """Displaced on top and sealed: p = −α ε M_B at once and everywhere, P_E,22 = (C + α² M_B) ε."""
        boundary = {**SIDES, "y-": HELD, "y+": {"displacement": (None, 1, None)}}
        solution = self.solve(confined_column(5, load=-0.03, boundary=boundary, time=SHORT), LINEAR)
        strain = -0.03 / 7.5
        p = -ALPHA * strain * COEFFICIENTS.biot_modulus
        last, history, state = solution.profiles[-1], solution.history, "a sealed column, displaced on top"
        near("p", last.p, p, state, rel=self.within(1e-10))
        near("P_E,22", last.stress[:, 1, 1], C22 * strain - ALPHA * p, state, rel=self.within(1e-10))
        near("drained", history.drained, 0.0, state, within=1e-16)
        ramp = np.minimum(1, history.time / 0.2)
        near("settlement", history.settlement, 0.03 * ramp, state, rel=1e-12)
        near("pressure_max", history.pressure_max, p * ramp, state, rel=self.within(1e-9))
        # The prescribed jump is part of the linear system.
        most = history.iterations.max()
        holds(most == 1, state, "one iteration a step", most)

    def test_prescribed_inflow_ends_in_a_linear_pressure(self) -> None:
        """Fluid pressed in at the base and let out on top: p = q̄ (h − y)/K, σ = 0, swelling α p/C."""
        flux, h = 0.02, 7.5
        boundary = {**SIDES, "y-": {**HELD, "flux": -flux}, "y+": {"pressure": 0}}
        plan = {"end": 4000, "step": 200, "ramp_increments": 2, "ramp_step": 10, "profiles": ()}
        solution = self.solve(confined_column(6, load=1.0, boundary=boundary, time=plan), LINEAR)
        profile, y = solution.profiles[-1], solution.points[:, 1]
        p = flux * (h - y) / K[1, 1]
        exact, state = self.within(1e-8), f"steady, an inflow of {flux} at the base"
        near("p", profile.p, p, state, within=exact * p.max(), rel=1e-7)
        near("flux", profile.flux, [0, flux, 0], state, within=exact * flux, rel=1e-7)
        swelling = ALPHA / C22 * flux * (h * y - y**2 / 2) / K[1, 1]
        near("u_2", profile.u[:, 1], swelling, state, within=self.within(1e-7) * swelling.max(), rel=1e-7)
        stored = (COEFFICIENTS.storage + ALPHA**2 / C22) * 0.01 * flux * h**2 / 2 / K[1, 1]
        near("drained", solution.history.drained[-1], -stored, state, rel=self.within(1e-7))
        heave, largest = solution.history.heave, swelling.max()
        near("heave", heave[-1], largest, state, within=self.within(1e-7) * largest, rel=1e-7)

    def test_prescribed_pressure_scales_with_the_load(self) -> None:
        boundary = {**SIDES, "y-": {**HELD, "pressure": 2}, "y+": {"pressure": -1}}
        plan = {"end": 4000, "step": 200, "ramp_increments": 2, "ramp_step": 10, "profiles": ()}
        solution = self.solve(confined_column(4, load=0.01, boundary=boundary, time=plan), LINEAR)
        expected = 0.02 - 0.03 * solution.points[:, 1] / 7.5
        state = "steady, p = 0.02 at the base and -0.01 on top"
        near("p", solution.profiles[-1].p, expected, state, within=1e-9, rel=self.within(1e-7))
        near("pressure_min", solution.history.pressure_min[-1], -0.01, state, rel=self.within(1e-7))

    def test_without_load_nothing_happens(self) -> None:
        history = self.solve(confined_column(3, load=0.0, time=SHORT), NONLINEAR).history
        for field in fields(History):
            if field.name not in ("time", "ramp"):
                same(field.name, getattr(history, field.name), 0.0, "no load")


#: Points of the states that are tried.
POINTS = 12
#: Step of the differences, as a share of the sizes of the states.
STEP = 1e-4
#: Differences of sums in another order, as a share of the largest entry.
ROUND_OFF = 1e-12
#: Responses that the macro solver integrates.
INTEGRATED = ("stress", "storage", "flux")


class MacroLawSuite(Suite):
    """Subclass it, name the class ``Test…`` and give it ``make_law``.

    Attributes
    ----------
    sizes
        Largest H, p and ∇p of the states that are tried.
    accuracy
        Difference between the tangent and differences of the response, as a share of the largest entry.
    values
        Ranges of the law's parameters by their names, in their order.
    step
        Time step over which the law is asked; None: as for a state that has stood for long.
    derivatives
        Whether the law gives derivatives by unknowns.
    unchanged
        Names of the internal variables that a step leaves as they are, such as an overstress that has faded.
    """

    sizes: ClassVar[tuple[float, float, float]] = (0.02, 0.02, 0.02)
    accuracy: ClassVar[float] = 1e-6
    values: ClassVar[Mapping[str, tuple[float, float]]] = {}
    step: ClassVar[Interval | None] = None
    derivatives: ClassVar[bool] = False
    unchanged: ClassVar[tuple[str, ...]] = ()

    @classmethod
    def make_law(cls) -> MacroLaw:
        """The law under test."""
        raise cls.undefined("make_law(cls)", "MyLaw()", "a new porocore.MacroLaw")

    @pytest.fixture(scope="class")
    @classmethod
    def law(cls) -> MacroLaw:
        return cls.make_law()

    @classmethod
    def random(cls, seed: int) -> tuple[MacroState, Array]:
        """Return states and gradients of the pressure without any symmetry."""
        rng = np.random.default_rng(seed)
        H, p, grad_p = cls.sizes
        states = MacroState(rng.uniform(-H, H, (POINTS, 3, 3)), rng.uniform(-p, p, POINTS))
        gradients = rng.uniform(-grad_p, grad_p, (POINTS, 3))
        if cls.values:
            low, high = np.array([*cls.values.values()]).T
            states = states.with_parameters(rng.uniform(low, high, (POINTS, len(low))))
        return states, gradients

    @classmethod
    def at_rest(cls, law: MacroLaw, states: MacroState) -> LawMemory:
        """Return the memory at rest of points with the parameters of ``states``."""
        return law.initial_at(states)

    @classmethod
    def before(cls, law: MacroLaw, seed: int) -> LawMemory:
        """Return the memory of random states, to which two steps have led."""
        states, grad_p = cls.random(seed)
        memory = cls.at_rest(law, states)
        for share in (0.4, 1.0):
            moved = replace(states, grad_u=share * states.grad_u, p=share * states.p)
            memory = law.respond(moved, grad_p, memory, step=cls.step, tangent=False).memory
        return memory

    @classmethod
    def tangent(cls, law: MacroLaw, states: MacroState, grad_p: Array, memory: LawMemory) -> MacroTangent:
        """Return the tangent, which has to be there."""
        response = law.respond(states, grad_p, memory, step=cls.step)
        return require("a tangent", response.tangent, states_text(states))

    def test_the_tangent_is_the_derivative_of_the_response(self, law: MacroLaw) -> None:
        """Along random directions of (H, p, ∇p), from a memory that is not at rest."""
        (states, grad_p), (along, along_grad), memory = self.random(1), self.random(2), self.before(law, 3)

        def at(share: float) -> Any:
            moved = replace(states, grad_u=states.grad_u + share * along.grad_u, p=states.p + share * along.p)
            return law.respond(moved, grad_p + share * along_grad, memory, step=self.step, tangent=False)

        tangent = self.tangent(law, states, grad_p, memory)
        ends = at(STEP), at(-STEP)
        for name in INTEGRATED:
            slope = (getattr(ends[0], name) - getattr(ends[1], name)) / (2 * STEP)
            by_H, by_p = getattr(tangent, f"{name}_grad_u"), getattr(tangent, f"{name}_p")
            found = np.einsum("n...kl,nkl->n...", by_H, along.grad_u)
            found = found + np.einsum("n...,n->n...", by_p, along.p)
            if (by_grad_p := getattr(tangent, f"{name}_grad_p")) is not None:
                found = found + np.einsum("n...j,nj->n...", by_grad_p, along_grad)
            within = self.accuracy * float(np.abs(slope).max())
            near(f"the tangent of the {name}", found, slope, states_text(states), within=within)

    def test_derivatives_by_parameters_and_memory_are_slopes(self, law: MacroLaw) -> None:
        """The response and the memory that is handed back, by each parameter, the memory, and the state."""
        self.needs(self.derivatives, "derivatives = False: the law gives none by unknowns")
        (states, grad_p), (along, along_grad), memory = self.random(1), self.random(2), self.before(law, 3)
        other = self.before(law, 4)
        m, v = len(self.values), memory.internal.shape[1]
        spans = np.array([high - low for low, high in self.values.values()]).reshape(-1)
        moved_memory = MemoryChanges(
            np.concatenate([np.zeros((POINTS, 3, 3, m)), other.states.grad_u[..., None]], axis=-1),
            np.concatenate([np.zeros((POINTS, m)), other.fluid_volume[:, None]], axis=1),
            np.concatenate([np.zeros((POINTS, v, m)), other.internal[..., None]], axis=2),
        )
        theta = np.concatenate([np.diag(spans), np.zeros((m, 1))], axis=1)
        changes = PointChanges(
            np.zeros((POINTS, m + 1)),
            np.zeros((POINTS, m + 1)),
            np.broadcast_to(theta, (POINTS, m, m + 1)).copy() if m else None,
        )
        response, fixed = law.respond_to_changes(
            states, grad_p, memory, changes, moved_memory, step=self.step
        )
        tangent = require("a tangent", response.tangent, states_text(states))

        def at(share: float, k: int) -> MacroResponse:
            now, start = states, memory
            if k < m:
                values = provided(states.parameters).copy()
                values[:, k] += share * spans[k]
                now = states.with_parameters(values)
            elif k == m:
                start = LawMemory(
                    replace(memory.states, grad_u=memory.states.grad_u + share * other.states.grad_u),
                    memory.fluid_volume + share * other.fluid_volume,
                    memory.internal + share * other.internal,
                )
            else:
                H, p = states.grad_u + share * along.grad_u, states.p + share * along.p
                now = replace(states, grad_u=H, p=p)
            ends = grad_p + share * along_grad if k > m else grad_p
            return law.respond(now, ends, start, step=self.step, tangent=False)

        state_changes = (x[..., None] for x in (along.grad_u, along.p, along_grad))
        nothing = MemoryChanges.zeros(POINTS, v, 1)
        parts = ("stress", "storage", "flux", "internal")
        still = replace(fixed, **{name: 0.0 * getattr(fixed, name)[..., :1] for name in parts})
        along_state = still.moved(tangent, nothing, *state_changes)[1].internal
        for k in range(m + 2):
            ends = at(STEP, k), at(-STEP, k)
            what = "the state" if k > m else "the memory" if k == m else [*self.values][k]
            for name in (*INTEGRATED, "internal"):
                if name == "internal":
                    slope = (ends[0].memory.internal - ends[1].memory.internal) / (2 * STEP)
                    found = along_state[..., 0] if k > m else fixed.internal[..., k]
                elif k > m:
                    continue
                else:
                    slope = (getattr(ends[0], name) - getattr(ends[1], name)) / (2 * STEP)
                    found = getattr(fixed, name)[..., k]
                within = self.accuracy * float(np.abs(slope).max(initial=0.0)) + 1e-3 * self.accuracy
                near(f"the derivative of {name} by {what}", found, slope, states_text(states), within=within)

    def test_an_answer_depends_on_what_is_given_alone(self, law: MacroLaw) -> None:
        """Not on other states that were tried from the same memory, such as those of a step that is rejected."""
        (states, grad_p), memory = self.random(11), self.before(law, 12)
        first = law.respond(states, grad_p, memory, step=self.step, tangent=False)
        law.respond(*self.random(13), memory, step=self.step, tangent=False)
        again, state = law.respond(states, grad_p, memory, step=self.step, tangent=False), states_text(states)
        for name in INTEGRATED:
            same(f"{name}, asked again", getattr(again, name), getattr(first, name), state)
        same("the internal variables, asked again", again.memory.internal, first.memory.internal, state)

    def test_the_memory_is_that_of_the_end(self, law: MacroLaw) -> None:
        """H and p that were asked for; internal variables as declared, and not those with which the step began."""
        (states, grad_p), memory = self.random(14), self.before(law, 15)
        found = law.respond(states, grad_p, memory, step=self.step, tangent=False).memory
        state = states_text(states)
        for name in ("grad_u", "p"):
            wanted = getattr(states, name)
            within = ROUND_OFF * float(np.abs(wanted).max())
            near(f"{name} of the memory", getattr(found.states, name), wanted, state, within=within)
        rest, shape = self.at_rest(law, states).internal.shape, (POINTS, law.memory_size)
        holds(rest == shape, f"{state}, at rest", f"internal variables {shape}", rest)
        holds(found.internal.shape == shape, state, f"internal variables {shape}", found.internal.shape)
        for name, columns in columns_of(law.internal).items():
            changed = bool((found.internal[:, columns] != memory.internal[:, columns]).any())
            expected = name not in self.unchanged
            what = f"{name} to {'change' if expected else 'stay'} in a step"
            holds(changed == expected, state, what, "a change" if changed else "the values at its beginning")

    def test_a_tangent_that_is_said_to_be_constant_is_so(self, law: MacroLaw) -> None:
        """The same at all points, for all states, gradients and memories: ``constant_tangent``."""
        self.needs(law.constant_tangent, "constant_tangent = False: the tangent may change")
        n = POINTS
        at_rest = self.random(1)[0].at_rest()
        theta = at_rest.parameters
        alike = None if theta is None else np.tile(theta[:1], (n, 1))
        at_rest = replace(at_rest, parameters=alike)
        rest = self.tangent(law, at_rest, np.zeros((n, 3)), self.at_rest(law, at_rest))
        for seed in (1, 4):
            states, grad_p = self.random(seed)
            tangent = self.tangent(law, replace(states, parameters=alike), grad_p, self.before(law, seed + 1))
            for field in fields(MacroTangent):
                found, wanted = getattr(tangent, field.name), getattr(rest, field.name)
                state = f"{states_text(states)}, constant_tangent = True"
                if found is None or wanted is None:
                    holds(found is wanted, state, f"{field.name} for all states or for none", "it for some")
                    continue
                wanted = wanted[:1]
                within = ROUND_OFF * float(np.abs(wanted).max(initial=0.0))
                near(field.name, found, np.broadcast_to(wanted, found.shape), state, within=within)

    def test_what_is_taken_up_is_the_change_of_the_stored_fluid(self, law: MacroLaw) -> None:
        """The next step counts from the fluid volume of the memory, whatever axes and parameters it has."""
        (states, grad_p), memory = self.random(9), self.before(law, 10)
        found = law.respond(states, grad_p, memory, step=self.step, tangent=False)
        stored = found.memory.fluid_volume
        within = ROUND_OFF * float(np.abs(stored).max())
        near("the storage", found.storage, stored - memory.fluid_volume, states_text(states), within=within)

    def test_points_do_not_depend_on_one_another(self, law: MacroLaw) -> None:
        """Each alone, and in another order."""
        (states, grad_p), memory = self.random(5), self.before(law, 6)
        whole, state = law.respond(states, grad_p, memory, step=self.step), states_text(states)
        for rows in (np.array([3]), np.arange(POINTS)[::-1]):
            part = law.respond(states[rows], grad_p[rows], memory[rows], step=self.step)
            for name in INTEGRATED:
                wanted = getattr(whole, name)[rows]
                within = ROUND_OFF * float(np.abs(getattr(whole, name)).max())
                near(
                    f"{name} of {len(rows)} of the points", getattr(part, name), wanted, state, within=within
                )

    def test_without_the_tangent_the_response_is_the_same(self, law: MacroLaw) -> None:
        (states, grad_p), memory = self.random(7), self.before(law, 8)
        whole = law.respond(states, grad_p, memory, step=self.step)
        plain, state = law.respond(states, grad_p, memory, step=self.step, tangent=False), states_text(states)
        holds(plain.tangent is None, state, "no tangent where none is wanted", "a tangent")
        for name in INTEGRATED:
            wanted = getattr(whole, name)
            near(name, getattr(plain, name), wanted, state, within=ROUND_OFF * float(np.abs(wanted).max()))


class MacroSolverSuite(
    KnownStates, Plates, Contacts, Bodies, FlatBodies, Histories, Runs, Memories, RunDerivatives
):
    """Subclass it, name the class ``Test…`` and give it ``make_solver``.

    It expects that :meth:`~porocore.MacroSolver.prepare` returns a ``porocore.macro`` discretisation, that the
    solver runs on one process, and that it takes the option ``checkpoint_seconds``.
    """
