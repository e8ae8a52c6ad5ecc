"""What is kept of a solve: one row of the history a step, and profiles at the chosen times."""

from __future__ import annotations

from dataclasses import dataclass, field, fields

import numpy as np

from porocore.laws import MacroResponse
from porocore.macro.discretisation import Discretisation
from porocore.macro.newton import Step
from porocore.solution import History, MacroSolution, Profile
from porocore.states import Array

HISTORY = tuple(f.name for f in fields(History))
PROFILE = tuple(f.name for f in fields(Profile))


@dataclass
class Record:
    """History and profiles so far, the same on every process.

    Attributes
    ----------
    rows
        Values in the order of the fields of :class:`porocore.solution.History`.
    profiles
        In the order of time.
    """

    rows: list[tuple[float, ...]] = field(default_factory=list)
    profiles: list[Profile] = field(default_factory=list)

    def column(self, name: str) -> Array:
        """One quantity against time, (steps,)."""
        return np.array([row[HISTORY.index(name)] for row in self.rows])

    def add_rest(self, d: Discretisation, response: MacroResponse) -> None:
        """The state at rest, t = 0."""
        start = dict.fromkeys(HISTORY, 0.0)
        start |= {"outside": _outside(d, response), "stress_spread": _spread(d, response)}
        self.rows.append(tuple(start[name] for name in HISTORY))

    def add_step(self, d: Discretisation, step: Step, time: float, dt: float, ramp: float) -> None:
        """An accepted step that ended at ``time``."""
        response = step.response
        last = dict(zip(HISTORY, self.rows[-1], strict=True))
        # In the rows of prescribed pressure the residual is what has flowed in through the boundary.
        held = d.prescribed[~d.is_force[d.prescribed] & (d.prescribed < d.owned)]
        inflow = float(d.world.total(float(step.residual.values[held].sum())))
        outflow = dt * d.problem.load * ramp * d.outflow - inflow
        squeezed = -float(d.world.total(float(d.weights @ (response.storage / response.volume_ratio))))
        x = d.to_mesh(step.x)
        row = {
            "time": time,
            "ramp": ramp,
            "settlement": float((-x[1 : d.mesh.n_u : 3]).max()),
            "pressure_max": float(x[d.mesh.n_u :].max()),
            "drained": last["drained"] + squeezed,
            "drained_flux": last["drained_flux"] + outflow,
            "outside": _outside(d, response),
            "stress_spread": _spread(d, response),
            "iterations": float(step.iterations),
        }
        self.rows.append(tuple(row[name] for name in HISTORY))

    def add_profile(self, d: Discretisation, step: Step, time: float) -> None:
        """Fields at ``time``: nodal, and means over the elements."""
        response = step.response
        x = d.to_mesh(step.x)
        states = response.memory.states
        self.profiles.append(
            Profile(
                time=time,
                u=x[: d.mesh.n_u].reshape(-1, 3),
                p=d.mesh.pressure_everywhere(x[d.mesh.n_u :]),
                grad_u=d.all_means(states.grad_u),
                mean_grad=d.all_means(response.memory.mean_grad),
                deformation=d.all_means(response.deformation),
                conductivity=d.all_means(response.transformed_conductivity),
                stress=d.all_means(response.stress),
                flux=d.all_means(response.flux),
                element_p=d.all_means(states.p),
                outside=d.all_means(response.outside.astype(float)),
            )
        )

    def solution(self, d: Discretisation, law: str) -> MacroSolution:
        """All of it, with the mesh."""
        history = History(**{name: self.column(name) for name in HISTORY})
        mesh = d.mesh
        return MacroSolution(law, d.problem.load, mesh.points, mesh.cells, history, tuple(self.profiles))


def _outside(d: Discretisation, response: MacroResponse) -> float:
    volume, outside = d.world.total(np.array([d.weights.sum(), d.weights[response.outside].sum()]))
    return float(outside / volume)


def _spread(d: Discretisation, response: MacroResponse) -> float:
    """Largest deviation of the element means of P_E,22 from the body's mean."""
    means = d.means(response.stress[:, 1, 1])
    mean = d.world.total(float(means.sum())) / len(d.mesh.cells)
    return d.world.largest(float(np.abs(means - mean).max(initial=0.0)))
