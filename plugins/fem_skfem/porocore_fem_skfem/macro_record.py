"""What is kept of a solve: one row of the history a step, and profiles at the chosen times."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from porocore.laws import MacroResponse
from porocore.solution import History, MacroSolution, Profile
from porocore_fem_skfem.macro_assembly import Assembler
from porocore_fem_skfem.macro_newton import Step

HISTORY = tuple(f.name for f in fields(History))
PROFILE = tuple(f.name for f in fields(Profile))


@dataclass
class Record:
    """History and profiles so far.

    Attributes
    ----------
    rows
        Values in the order of the fields of :class:`porocore.solution.History`.
    profiles
        In the order of time.
    """

    rows: list[tuple[float, ...]] = field(default_factory=list)
    profiles: list[Profile] = field(default_factory=list)

    def column(self, name: str) -> Any:
        """One quantity against time, (steps,)."""
        return np.array([row[HISTORY.index(name)] for row in self.rows])

    def add_rest(self, assembler: Assembler, response: MacroResponse) -> None:
        """The state at rest, t = 0."""
        start = dict.fromkeys(HISTORY, 0.0)
        start |= {"outside": _outside(assembler, response), "stress_spread": _spread(assembler, response)}
        self.rows.append(tuple(start[name] for name in HISTORY))

    def add_step(self, assembler: Assembler, step: Step, time: float, dt: float, ramp: float) -> None:
        """An accepted step that ended at ``time``."""
        space, response = assembler.space, step.response
        last = dict(zip(HISTORY, self.rows[-1], strict=True))
        # In the rows of prescribed pressure the residual is what has flowed in through the boundary.
        held = space.prescribed[space.prescribed >= space.n_u]
        outflow = -float(step.residual.values[held].sum())
        outflow += dt * space.problem.load * ramp * float(space.outflow.sum())
        squeezed = -float(assembler.weights @ (response.storage / response.volume_ratio))
        row = {
            "time": time,
            "ramp": ramp,
            "settlement": float((-step.x[1 : space.n_u : 3]).max()),
            "pressure_max": float(step.x[space.n_u :].max()),
            "drained": last["drained"] + squeezed,
            "drained_flux": last["drained_flux"] + outflow,
            "outside": _outside(assembler, response),
            "stress_spread": _spread(assembler, response),
            "iterations": float(step.iterations),
        }
        self.rows.append(tuple(row[name] for name in HISTORY))

    def add_profile(self, assembler: Assembler, step: Step, time: float) -> None:
        """Fields at ``time``: nodal, and means over the elements."""
        space, response = assembler.space, step.response
        local_p = step.x[space.n_u :][space.p_cells]
        p = np.empty(len(space.points))
        p[space.cells] = local_p @ space.reference.p_at_nodes.T
        states = response.memory.states
        self.profiles.append(
            Profile(
                time=time,
                u=step.x[: space.n_u].reshape(-1, 3).copy(),
                p=p,
                grad_u=_means(assembler, states.grad_u),
                mean_grad=_means(assembler, response.memory.mean_grad),
                deformation=_means(assembler, response.deformation),
                conductivity=_means(assembler, response.transformed_conductivity),
                stress=_means(assembler, response.stress),
                flux=_means(assembler, response.flux),
                element_p=_means(assembler, states.p),
                outside=_means(assembler, response.outside.astype(float)),
            )
        )

    def solution(self, assembler: Assembler, law: str) -> MacroSolution:
        """All of it, with the mesh."""
        space = assembler.space
        history = History(**{name: self.column(name) for name in HISTORY})
        return MacroSolution(
            law, space.problem.load, space.points, space.vtk_cells, history, tuple(self.profiles)
        )


def _means(assembler: Assembler, values: Any) -> Any:
    """Means over the elements (elements, ...) of values at the points (points, ...)."""
    weights = assembler.space.reference.weights
    values = values.reshape(len(assembler.space.cells), len(weights), *values.shape[1:])
    return np.einsum("q,eq...->e...", weights / weights.sum(), values)


def _outside(assembler: Assembler, response: MacroResponse) -> float:
    return float(assembler.weights[response.outside].sum() / assembler.weights.sum())


def _spread(assembler: Assembler, response: MacroResponse) -> float:
    """Largest deviation of the element means of P_E,22 from the body's mean."""
    means = _means(assembler, response.stress[:, 1, 1])
    return float(np.abs(means - means.mean()).max())
