"""Checks of sensitivities: derivatives of the histories by unknowns are the limits of differences of runs."""

from __future__ import annotations

from typing import Any

import numpy as np

from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.core.fields import provided
from porocore.interfaces.sensitivities import (
    HISTORY_SERIES,
    BoundaryChange,
    CellParameterChange,
    HistoryWeights,
    InitialPressureChange,
    LoadChange,
    MacroChange,
    MacroSensitivities,
    ModulusChange,
    ViscosityChange,
)
from porocore.interfaces.solution import MacroSolution
from porocore.macro.body.mesh import BodyMesh
from porocore.macro.boundary.reactions import interpolation
from porocore.macro.laws.closure import make_closure
from porocore.macro.laws.macro_law import ClosedLaw
from porocore.macro.problem import MacroProblem, body_mesh
from porocore.testing.expect import holds, near
from porocore.testing.macro_checks.runs import SIDES, Solving
from porocore.testing.synthetic.porous_family import PorousFamilyLaw
from porocore.testing.synthetic.response import confined_column

#: Unknowns: change, value, and by how much the value differs on either side of the differences.
UNKNOWNS: dict[str, tuple[MacroChange, float, float]] = {
    "radius": (CellParameterChange("radius"), 0.22, 2e-5),
    "modulus": (ModulusChange(), 1.0, 1e-4),
    "viscosity": (ViscosityChange(), 0.01, 1e-6),
    "load": (LoadChange(), 0.9, 1e-4),
    "pressure": (BoundaryChange("y+", "pressure"), 0.002, 1e-5),
    "initial": (InitialPressureChange(), 0.004, 1e-5),
}
#: Unknowns by whose logarithm the derivative is.
RELATIVE = ("modulus", "viscosity")
STATE = "a column of the made-up family of porous cells, all unknowns along one direction"


class RunDerivatives(Solving):
    """Part of :class:`porocore.testing.macro_checks.states.MacroSolverSuite`."""

    law = ClosedLaw(
        PorousFamilyLaw("radius", "viscosity"), make_closure("potential", 0.6, NeoHookean(), np.eye(3))
    )

    @staticmethod
    def pressed(**shifts: float) -> MacroProblem:
        """A column in units of the modulus, each of whose unknowns is shifted by so much."""
        at = {name: value + shifts.get(name, 0.0) for name, (_, value, _) in UNKNOWNS.items()}
        E = at["modulus"]
        top = {"traction": (0, -0.05 / E, 0), "pressure": at["pressure"] / E}
        return confined_column(
            2,
            load=at["load"],
            size=(0.5, 1.0, 0.5),
            # The base is lifted, so that there is a heave beside the settlement.
            boundary={**SIDES, "y-": {"displacement": (0, 0.004, 0)}, "y+": top},
            fields={"radius": at["radius"], "viscosity": at["viscosity"] / E},
            initial={"pressure": at["initial"] / E},
            probes={"inside": (0.2, 0.6, 0.3)},
            time={"end": 1.4, "step": 0.5, "ramp_increments": 2, "ramp_step": 0.2, "profiles": ()},
            newton={"tolerance": 1e-12},
        )

    @classmethod
    def with_derivatives(cls) -> tuple[MacroSolution, MacroSensitivities]:
        """Solve with sensitivities; the checks are skipped where the solver declares none."""
        problem = cls.pressed()
        solver = cls.offered(problem)
        cls.needs(type(solver).sensitivities, "sensitivities = False: it gives none")
        changes = [change for change, *_ in UNKNOWNS.values()]
        return solver.solve_with_sensitivities(solver.prepare(problem), cls.law, changes, profiles=True)

    def test_sensitivities_are_limits_of_differences(self) -> None:
        """Along all unknowns together; loads and pressures are those of units in which the modulus is 1."""
        _, found = self.with_derivatives()
        ends: list[dict[str, Any]] = []
        for sign in (1, -1):
            shifts = {name: sign * step for name, (*_, step) in UNKNOWNS.items()}
            run = self.solve(self.pressed(**shifts), self.law)
            ends.append(_series(run, run.history, 1.0 + shifts["modulus"]))
        steps = [step / value if name in RELATIVE else step for name, (_, value, step) in UNKNOWNS.items()]
        for name, values in _series(found, found, 1.0).items():
            wanted = (ends[0][name] - ends[1][name]) / 2
            scale = max(float(np.abs(wanted).max()), 1e-5 * float(np.abs(ends[0][name]).max()))
            near(name, values @ np.array(steps), wanted, STATE, within=self.within(1e-6) * scale)

    def test_gradients_are_sums_of_sensitivities(self) -> None:
        """The gradient of a sum over all values of some histories, which a pass backwards gives."""
        problem = self.pressed()
        solver = self.offered(problem)
        self.needs(type(solver).gradients, "gradients = False: it gives none")
        changes = [change for change, *_ in UNKNOWNS.values()]
        _, gradients = solver.solve_with_gradients(solver.prepare(problem), self.law, changes, _weights)
        run, found = self.with_derivatives()
        weights = _weights(run)
        wanted = sum(getattr(weights, name)[:, 0] @ getattr(found, name) for name in HISTORY_SERIES)
        wanted = wanted + np.einsum("sc,sck->k", weights.probes["inside"][..., 0], found.probes["inside"])
        wanted = wanted + np.einsum("su,suk->k", provided(weights.profiles)[..., 0], provided(found.profiles))
        shape = np.shape(gradients)
        holds(shape == (1, len(UNKNOWNS)), STATE, f"gradients (1, {len(UNKNOWNS)})", f"shape {shape}")
        within = self.within(1e-7) * float(np.abs(wanted).max())
        near("the gradient of a sum", gradients[0], wanted, STATE, within=within)

    def test_sensitivities_of_profiles_are_those_of_probes(self) -> None:
        """Between the nodes the derivatives of the nodal fields are those of a probe, at rest and at the end."""
        solution, found = self.with_derivatives()
        problem = self.pressed()
        fields, at = provided(found.profiles), interpolation(body_mesh(problem), problem.probes)
        shape, wanted = fields.shape, (len(solution.profiles), at.shape[1], len(UNKNOWNS))
        holds(shape == wanted, STATE, f"derivatives of profiles {wanted}", f"shape {shape}")
        for place, name in ((-1, "at the end"), (0, "at rest")):
            probes = found.probes["inside"][place]
            within = 1e-9 * float(np.abs(found.probes["inside"]).max(axis=(0, 2)).min())
            near(f"the probe {name}", at @ fields[place], probes, STATE, within=within)

    def test_a_run_with_sensitivities_is_the_run_without(self) -> None:
        solution, found = self.with_derivatives()
        plain = self.solve(self.pressed(), self.law)
        for name in HISTORY_SERIES:
            wanted = getattr(plain.history, name)
            within = 1e-9 * float(np.abs(wanted).max())
            near(name, getattr(solution.history, name), wanted, "solved with sensitivities", within=within)
        shape, expected = found.settlement.shape, (len(plain.history.time), len(UNKNOWNS))
        holds(shape == expected, STATE, f"derivatives (steps, unknowns) = {expected}", f"shape {shape}")


def _weights(solution: MacroSolution) -> HistoryWeights:
    """Return growing weights of displacements, a probe and the profiles, falling ones of pressures and drainage."""
    growing = np.linspace(0.5, 2.0, len(solution.history.time))[:, None]
    falling, probe = growing[::-1], growing[:, :, None] * np.array([0.0, 1.0, 0.0, 20.0])[:, None]
    corners = len(BodyMesh.of(solution).p_nodes)
    size = (len(solution.profiles), 3 * len(solution.points) + corners, 1)
    fields = 1e-2 * np.random.default_rng(5).uniform(-1, 1, size)
    return HistoryWeights(
        1, growing, growing, falling, falling, falling, probes={"inside": probe}, profiles=fields
    )


def _series(of: Any, histories: Any, modulus: float) -> dict[str, Any]:
    """Return all series of a solution or of its derivatives; pressures and forces times the modulus."""
    found = {name: getattr(histories, name) for name in HISTORY_SERIES}
    found |= {name: modulus * found[name] for name in ("pressure_max", "pressure_min")}
    found |= {f"the displacement of {name}": values[:, :3] for name, values in of.probes.items()}
    found |= {f"the pressure of {name}": modulus * values[:, 3] for name, values in of.probes.items()}
    # Across the column forces are the round-off of the differences where their loads do not change them.
    found["the reaction of y-"] = modulus * of.reactions["y-"][:, 1]
    return found | {f"the inflow of {name}": values for name, values in of.inflow.items()}
