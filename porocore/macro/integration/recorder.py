"""Recorder of a solve: rows of the history, profiles at the chosen times, sums over processes."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from porocore.interfaces.law import Integrand, MacroResponse
from porocore.interfaces.solution import History, MacroSolution, Profile, StepWork
from porocore.macro.boundary.conditions import Loads
from porocore.macro.boundary.probes import interpolation
from porocore.macro.composition.body_fields import BodyFields
from porocore.macro.composition.kept_cells import kept_cells
from porocore.macro.integration.discretisation import Discretisation
from porocore.macro.integration.newton import Step
from porocore.states import Array

HISTORY = tuple(f.name for f in fields(History))
PROFILE = tuple(f.name for f in fields(Profile))
WORK = tuple(f.name for f in fields(StepWork))


class HistoryRecorder:
    """Recorder of history and profiles, the same on every process.

    Attributes
    ----------
    columns
        The fields of :class:`porocore.History`, then those of probes, reactions, inflows and linear solver, by name.
    rows
        Values in this order.
    profiles
        In the order of time.
    probe
        Sparse (4 probes, unknowns), from all unknowns to u_1, u_2, u_3 and p of each probe.
    """

    def __init__(self, d: Discretisation) -> None:
        self.d = d
        self.rows: list[tuple[float, ...]] = []
        self.profiles: list[Profile] = []
        self.probe = interpolation(d.mesh, d.problem.probes)
        self._groups = (
            *((f"probes/{name}", 4) for name in d.problem.probes),
            *((f"reactions/{name}", 3) for name in d.boundary.supports),
            *((f"inflow/{name}", 1) for name in d.boundary.drains),
            *((f"work/{name}", 1) for name in WORK),
        )
        self.columns = (*HISTORY, *(f"{name}/{i}" for name, width in self._groups for i in range(width)))

    def column(self, name: str) -> Array:
        """Return one quantity against time, (steps,)."""
        return np.array([row[self.columns.index(name)] for row in self.rows])

    def add_start(self, x: Array, response: MacroResponse) -> None:
        """Add the initial state, t = 0."""
        d, whole = self.d, self.d.to_mesh(x)
        start = dict.fromkeys(HISTORY, 0.0)
        start |= {"outside_training_range": _outside(d, response), "stress_spread": _spread(d, response)}
        start |= self._extremes(whole)
        sums = np.zeros(3 * len(d.boundary.supports) + len(d.boundary.drains) + len(WORK))
        self.rows.append((*(start[name] for name in HISTORY), *(self.probe @ whole), *sums))
        self.add_profile(x, response, 0.0)

    def add_step(self, step: Step, time: float, dt: float, loads: Loads, work: StepWork) -> None:
        """Add an accepted step that ended at ``time``, and what the linear solver did for it."""
        d, response = self.d, step.response
        last = dict(zip(HISTORY, self.rows[-1], strict=False))
        squeezed = -float(d.communicator.sum(float(d.weights @ (response.storage / response.volume_ratio))))
        x = d.to_mesh(step.x)
        row = {
            "time": time,
            "ramp": d.problem.ramp(time),
            "drained_paper": last["drained_paper"] + squeezed,
            "drained": last["drained"] + self.outflow(step.residual.values, loads, dt),
            "outside_training_range": _outside(d, response),
            "stress_spread": _spread(d, response),
            "iterations": float(step.iterations),
        }
        row |= self._extremes(x)
        sums = self.sums(step.residual.values, response, dt)
        extra = np.concatenate([self.probe @ x, *sums, [getattr(work, name) for name in WORK]])
        self.rows.append((*(row[name] for name in HISTORY), *map(float, extra)))

    def outflow(self, residual: Array, loads: Loads, dt: float) -> float:
        """Return the volume that has left through the boundary in a step, linear in residual and loads."""
        d = self.d
        # In the rows of prescribed pressure the residual is what has flowed in through the boundary.
        held = d.prescribed[~d.is_force[d.prescribed] & (d.prescribed < d.owned)]
        return dt * d.outflow(loads) - float(d.communicator.sum(float(residual[held].sum())))

    def sums(self, values: Array, response: Integrand, dt: float) -> list[Array]:
        """Return the forces (3,) on the surfaces that are held, then inflows (1,) through those with a pressure.

        They are linear in the residual's ``values`` and the response.
        """
        d = self.d
        residual = d.to_mesh(values)
        supports, drains = d.boundary.supports.values(), d.boundary.drains.values()
        stress = d.all_means(response.stress) if any(each.needs_field for each in supports) else None
        inward = -d.all_means(response.flux) if any(each.needs_field for each in drains) else None
        forces = [each.total(residual, stress) for each in supports]
        return forces + [each.total(residual / dt, inward) for each in drains]

    def _extremes(self, x: Array) -> dict[str, float]:
        # No −0 at rest.
        return {name: sign * float(x[i]) + 0.0 for name, (i, sign) in extremes(x, self.d.mesh.n_u).items()}

    def add_profile(self, unknowns: Array, response: MacroResponse, time: float) -> None:
        """Add the fields at ``time``: nodal values, and means over the elements."""
        d, x = self.d, self.d.to_mesh(unknowns)
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
                outside_training_range=d.all_means(response.outside_training_range.astype(float)),
            )
        )

    def solution(self, law: str, body: BodyFields) -> MacroSolution:
        """Return history and profiles with the mesh, and the cells of its elements by the fields of the ``body``."""
        mesh = self.d.mesh
        history = History(**{name: self.column(name) for name in HISTORY})
        series: dict[str, dict[str, Array]] = {"probes": {}, "reactions": {}, "inflow": {}, "work": {}}
        for path, width in self._groups:
            kind, _, name = path.partition("/")
            series[kind][name] = np.stack([self.column(f"{path}/{i}") for i in range(width)], axis=1)
        return MacroSolution(
            law,
            self.d.problem.load,
            mesh.points,
            mesh.cells,
            history,
            tuple(self.profiles),
            probes=series["probes"],
            reactions=series["reactions"],
            inflow={name: values[:, 0] for name, values in series["inflow"].items()},
            work={name: values[:, 0] for name, values in series["work"].items()},
            linear_solver=self.d.linear.choice,
            # They follow from the times alone.
            element_cells=kept_cells(
                body, tuple(self.d.problem.regions), [each.time for each in self.profiles], self.d.all_means
            ),
        )


def extremes(x: Array, n_u: int) -> dict[str, tuple[int, float]]:
    """Return the unknown that each extreme of the history is, and its sign, by the extreme's name.

    Parameters
    ----------
    x : (unknowns,)
        A solution in the mesh's order.
    n_u
        Number of displacements, which come first.
    """
    u_y, p = x[1:n_u:3], x[n_u:]
    return {
        "settlement": (1 + 3 * int(u_y.argmin()), -1.0),
        "heave": (1 + 3 * int(u_y.argmax()), 1.0),
        "pressure_max": (n_u + int(p.argmax()), 1.0),
        "pressure_min": (n_u + int(p.argmin()), 1.0),
    }


def _outside(d: Discretisation, response: MacroResponse) -> float:
    volume, outside = d.communicator.sum(
        np.array([d.weights.sum(), d.weights[response.outside_training_range].sum()])
    )
    return float(outside / volume)


def _spread(d: Discretisation, response: MacroResponse) -> float:
    """Return the largest deviation of the element means of P_E,22 from the body's mean."""
    means, volumes = d.means(response.stress[:, 1, 1]), d.mesh.weights[d.elements].sum(axis=1)
    weighted, volume = d.communicator.sum(np.array([volumes @ means, volumes.sum()]))
    mean = weighted / volume
    return d.communicator.max(float(np.abs(means - mean).max(initial=0.0)))
