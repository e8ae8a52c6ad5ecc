"""A macro solver for confined columns alone, by finite volumes: displacements between cells, pressures in them.

It has a mesh of its own, writes no checkpoints and approximates; its class says so, and the suite skips the rest.
"""

from __future__ import annotations

import numpy as np

from porocore.core.formulas import TimeFunction
from porocore.interfaces.law import Interval, columns_of
from porocore.interfaces.macro import MacroSolver
from porocore.interfaces.solution import History, MacroSolution, Profile, StepReport
from porocore.macro.integration.stepping import Stepper
from porocore.macro.problem import Boundary, body_mesh
from porocore.states import MacroState
from porocore.testing import MacroSolverSuite


class Failed(Exception):
    """A step without a solution."""


class Column:
    """Maps of the unknowns, n + 1 displacements u_2 and n pressures, to the points of the law.

    The law is asked in the n cells, which bear stress and storage, and at the n + 1 faces, through which fluid flows.
    """

    def __init__(self, problem):
        self.problem, self.mesh = problem, body_mesh(problem)
        width, self.height, depth = problem.body.size
        self.area, self.n = width * depth, problem.body.elements[1]
        n = self.n
        self.h = self.height / n
        self.size = 2 * n + 1
        self.ends = [problem.boundary.get(name, Boundary()) for name in ("y-", "y+")]
        strain = np.zeros((n, self.size))
        rows = np.arange(n)
        strain[rows, rows], strain[rows, rows + 1] = -1 / self.h, 1 / self.h
        pressure = np.eye(self.size)[n + 1 :]
        # A face lies between two cells, or at an end.
        below, above = np.maximum(np.arange(n + 1) - 1, 0), np.minimum(np.arange(n + 1), n - 1)
        slope = (pressure[above] - pressure[below]) / self.h
        self.drained = [end.pressure is not None for end in self.ends]
        self.flux = np.zeros(n + 1)
        mean = (pressure[below] + pressure[above]) / 2
        for face, sign, drained in ((0, 1.0, self.drained[0]), (n, -1.0, self.drained[1])):
            if drained:
                slope[face], mean[face] = sign * pressure[min(face, n - 1)] / (self.h / 2), 0.0
        self.by_strain = np.concatenate([strain, (strain[below] + strain[above]) / 2])
        self.by_pressure = np.concatenate([pressure, mean])
        self.by_slope = np.concatenate([np.zeros((n, self.size)), slope])

    def value(self, value, time):
        """A prescribed value at a time."""
        share = self.problem.factor(value, time) * self.problem.load
        return share if isinstance(value, TimeFunction) else value * share

    def states(self, x, time):
        """At the points of the law, and the gradients of the pressure there."""
        n, p, slope = self.n, self.by_pressure @ x, self.by_slope @ x
        for face, sign, end in ((0, -1.0, self.ends[0]), (n, 1.0, self.ends[1])):
            if end.pressure is not None:
                held = self.value(end.pressure, time)
                p[n + face] += held
                slope[n + face] += sign * held / (self.h / 2)
        H, grad_p = np.zeros((len(p), 3, 3)), np.zeros((len(p), 3))
        H[:, 1, 1], grad_p[:, 1] = self.by_strain @ x, slope
        return MacroState(H, p), grad_p

    def residual(self, x, response, dt, time):
        """Forces of the faces and volumes of the cells per cross-section, and their derivatives."""
        n, t = self.n, response.tangent
        cells, faces = slice(0, n), slice(n, None)
        stress = response.stress[cells, 1, 1]
        by_stress = t.stress_grad_u[cells, 1, 1, 1, 1, None] * self.by_strain[cells]
        by_stress += t.stress_p[cells, 1, 1, None] * self.by_pressure[cells]
        flux = response.flux[faces, 1].copy()
        by_flux = t.flux_grad_u[faces, 1, 1, 1, None] * self.by_strain[faces]
        by_flux += t.flux_p[faces, 1, None] * self.by_pressure[faces]
        by_flux += t.flux_grad_p[faces, 1, 1, None] * self.by_slope[faces]
        by_storage = t.storage_grad_u[cells, 1, 1, None] * self.by_strain[cells]
        by_storage += t.storage_p[cells, None] * self.by_pressure[cells]
        for face, sign, end, drained in zip((0, n), (-1, 1), self.ends, self.drained, strict=True):
            if not drained:
                flux[face], by_flux[face] = sign * self.value(end.flux, time), 0.0
        traction = [self.value(end.traction[1], time) for end in self.ends]
        forces = np.diff(stress, prepend=-traction[0], append=traction[1])
        by_forces = np.diff(
            by_stress, axis=0, prepend=np.zeros((1, self.size)), append=np.zeros((1, self.size))
        )
        for face, end in zip((0, n), self.ends, strict=True):
            held = end.normal if end.normal is not None else end.displacement[1]
            if held is not None:
                sign = -1 if face == 0 and end.normal is not None else 1
                forces[face] = x[face] - sign * self.value(held, time)
                by_forces[face] = np.eye(self.size)[face]
        volumes = self.h * response.storage[cells] + dt * np.diff(flux)
        by_volumes = self.h * by_storage + dt * np.diff(by_flux, axis=0)
        self.outflow = flux[-1] - flux[0]
        self.flux = flux
        return np.concatenate([forces, volumes]), np.concatenate([by_forces, by_volumes])

    def step(self, law, memory, x, dt, time):
        """Newton's iteration: unknowns, the law's response and how many iterations it took."""
        settings, x = self.problem.newton, x.copy()
        for iteration in range(settings.iterations + 1):
            response = law.respond(*self.states(x, time), memory, step=Interval(time - dt, time))
            bad = ~np.isfinite(response.stress).all(axis=(1, 2)) | ~np.isfinite(response.flux).all(axis=1)
            if bad.any():
                raise Failed(f"the law has no values at {bad.sum()} of {len(bad)} points")
            values, tangent = self.residual(x, response, dt, time)
            scale = np.abs(tangent) @ np.abs(x) + 1e-3 * np.abs(tangent).max(axis=1) * 1e-6
            misfit = float((np.abs(values) / scale).max())
            if misfit <= (settings.tolerance if iteration else 0.0):
                return x, response, iteration
            if iteration < settings.iterations:
                x -= np.linalg.solve(tangent, values)
        raise Failed(
            f"Newton's iteration stood at {misfit:.2g} after {settings.iterations} iterations "
            f"(newton.tolerance = {settings.tolerance:g})"
        )

    def ends_of_p(self, x, time):
        """Pressures at the faces of both ends: prescribed, or continued from the cells."""
        p = x[self.n + 1 :]
        found = []
        for end, (first, second) in zip(
            self.ends, ((p[0], p[min(1, self.n - 1)]), (p[-1], p[max(-2, -self.n)])), strict=True
        ):
            share = 0.5 if end.flux != 0 else 0.125
            found.append(
                self.value(end.pressure, time)
                if end.pressure is not None
                else first + share * (first - second)
            )
        return found


class ColumnMacroSolver(MacroSolver):
    """Confined columns by finite volumes, of second order."""

    bodies = ("column",)
    parts = frozenset({"flux", "load_curve", "initial"})
    checkpoints = False
    meshes = "own"
    accuracy = 8e-2

    def prepare(self, problem):
        return Column(problem)

    def solve(self, prepared, law, *, checkpoint=None, on_step=None):
        column, problem = prepared, prepared.problem
        stepper = Stepper(problem.time, problem.corners)
        start = problem.initial
        y = np.linspace(0, column.height, column.n + 1)
        x = np.concatenate([start.gradient[1][1] * y, np.full(column.n, start.pressure)])
        state = column.states(x, 0.0)
        response = law.respond(*state, law.initial(len(state[0].p)))
        memory = response.memory
        first = [
            0.0,
            0.0,
            max(-x[: column.n + 1].min(), 0.0),
            max(start.pressure, 0.0),
            0.0,
            0.0,
            0.0,
            0.0,
            0.0,
            max(x[: column.n + 1].max(), 0.0),
            min(start.pressure, 0.0),
            np.abs(x[: column.n + 1]).max(),
        ]
        rows, profiles = [first], [self._profile(column, law, x, response, 0.0)]
        while not stepper.done:
            time = stepper.next()
            dt = time - stepper.time
            try:
                found, response, iterations = column.step(law, memory, x, dt, time)
            except Failed as failure:
                stepper.reject(str(failure))
                continue
            x, memory = found, response.memory
            rows.append(self._row(column, x, response, rows[-1], time, dt, iterations))
            if stepper.is_profile(time):
                profiles.append(self._profile(column, law, x, response, time))
            stepper.accept(None)
            if on_step is not None:
                on_step(StepReport(time, problem.time.end, iterations, rows[-1][2]))
        history = History(*map(np.array, zip(*rows, strict=True)))
        mesh = column.mesh
        kept = {each.name: each.quantity for each in law.internal}
        return MacroSolution(
            law.name, problem.load, mesh.points, mesh.cells, history, tuple(profiles), quantities=kept
        )

    @staticmethod
    def _row(column, x, response, last, time, dt, iterations):
        cells, volume = slice(0, column.n), column.area * column.h
        stress = response.stress[cells, 1, 1]
        return [
            time,
            column.problem.ramp(time),
            float(-x[: column.n + 1].min()),
            float(max(*x[column.n + 1 :], *column.ends_of_p(x, time))),
            last[4] + dt * column.area * float(column.outflow),
            last[5] - volume * float((response.storage[cells] / response.volume_ratio[cells]).sum()),
            float(response.flagged[cells].mean()),
            float(np.abs(stress - stress.mean()).max()),
            float(iterations),
            float(x[: column.n + 1].max()),
            float(min(*x[column.n + 1 :], *column.ends_of_p(x, time))),
            float(np.abs(x[: column.n + 1]).max()),
        ]

    @staticmethod
    def _profile(column, law, x, response, time):
        """On the core's mesh of the same elements, so that a report can show it."""
        mesh, n = column.mesh, column.n
        y, centres = mesh.points[:, 1], (np.arange(n) + 0.5) * column.h
        u = np.zeros((len(y), 3))
        u[:, 1] = np.interp(y, np.linspace(0, column.height, n + 1), x[: n + 1])
        bottom, top = column.ends_of_p(x, time)
        p = np.interp(y, [0, *centres, column.height], [bottom, *x[n + 1 :], top])
        layer = (mesh.points[mesh.cells].mean(axis=1)[:, 1] / column.h).astype(int)
        states, remembered = response.memory.states, response.memory.internal[layer]
        columns = columns_of(law.internal)
        flux = np.zeros((len(layer), 3))
        flux[:, 1] = ((column.flux[1:] + column.flux[:-1]) / 2)[layer]
        return Profile(
            time=time,
            u=u,
            p=p,
            grad_u=states.grad_u[layer],
            mean_grad=response.mean_grad[layer],
            deformation=response.deformation[layer],
            conductivity=response.transformed_conductivity[layer],
            stress=response.stress[layer],
            flux=flux,
            element_p=states.p[layer],
            internal={
                each.name: remembered[:, columns[each.name]].reshape(-1, *each.shape) for each in law.internal
            },
            flagged=response.flagged[layer].astype(float),
            fluid_volume=response.memory.fluid_volume[layer],
        )


class TestColumn(MacroSolverSuite):
    kit_version = "5"

    @classmethod
    def make_solver(cls, **options):
        return ColumnMacroSolver(**options)
