"""Macro runs on a coarse mesh for a sampler: the states that they visit."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from porocore.errors import ConfigurationError, SolveError
from porocore.interfaces.law import LawMemory, LawWrapper, MacroLaw, MacroResponse
from porocore.interfaces.macro import MacroSolver
from porocore.interfaces.sampler import Exploration
from porocore.interfaces.surrogate import TrainingSet
from porocore.macro.body.kinds import Body
from porocore.macro.composition.regions import region_numbers
from porocore.macro.laws.closure import Closure
from porocore.macro.laws.composed import RegionLaw
from porocore.macro.laws.macro_law import ClosedLaw
from porocore.macro.problem import MacroProblem, body_mesh
from porocore.plugins.border import body_solution_of
from porocore.states import MacroState
from porocore.study.config.config import RunConfig
from porocore.surrogates.polynomial.surrogate import PolynomialSurrogate


@dataclass(frozen=True, eq=False)
class BodyAround:
    """A body of one or several cells, one of which is explored.

    Attributes
    ----------
    study
        That of the whole body, with fields of that cell's parameters alone.
    cell
        Name of that cell; None: that of the rest of the body, or the only one.
    laws
        Laws of all cells by name, that of the explored one left out.
    """

    study: RunConfig
    cell: str | None = None
    laws: Mapping[str | None, MacroLaw] = field(default_factory=dict)

    def law_with(self, law: MacroLaw) -> MacroLaw:
        """Return the law of the body with ``law`` for the cell that is explored."""
        laws = {**self.laws, self.cell: law}
        rest = laws.pop(None)
        return RegionLaw.by_cell(
            self.study.macro.regions, rest, {name: each for name, each in laws.items() if name is not None}
        )


class MacroExplorer:
    """The macro problem of a study on a coarse mesh with long time steps, with a polynomial fitted to the known states.

    The polynomial stands in for the configured surrogate: it is fitted in milliseconds, provides what every closure
    needs, and is the same on every machine. Closure, loads, boundary conditions and backend are the configured ones.
    In a body of several cells only the states of the cell that is explored count.

    Parameters
    ----------
    body
        The body with the explored cell.
    closure
        Closure of that cell.
    make_solver
        Makes the macro solver when it is first needed.
    with_memory
        Gives the law of that cell in equilibrium its memory.
    """

    def __init__(
        self,
        body: BodyAround,
        closure: Closure,
        make_solver: Callable[[], MacroSolver],
        with_memory: Callable[[MacroLaw], MacroLaw],
    ) -> None:
        self._body, self._closure, self._make_solver = body, closure, make_solver
        self._with_memory = with_memory
        self._solver: MacroSolver | None = None

    def __call__(self, data: TrainingSet, *, elements: int, steps: int) -> Exploration:
        """Solve the coarse problem; see :class:`~porocore.interfaces.sampler.Explore`.

        The results are final displacement and largest pressure of each load, and largest and final force on each
        surface that is moved.
        """
        if self._solver is None:
            self._solver = self._make_solver()
        cells = PolynomialSurrogate().fit(data, seed=0)
        visited: list[MacroState] = []
        results: list[float] = []
        for load in self._body.study.macro.loads:
            law = VisitedStates(ClosedLaw(cells, self._closure))
            problem = self._body.study.problem(load)
            moved = [name for name, boundary in problem.boundary.items() if boundary.is_moved]
            coarse = coarse_problem(problem, elements, steps)
            prepared = self._solver.prepare(coarse)
            try:
                solution = body_solution_of(
                    self._solver, prepared, self._body.law_with(self._with_memory(law)), coarse
                )
            except SolveError:
                results += [np.nan] * (2 + 2 * len(moved))
            else:
                history = solution.history
                results += [float(history.displacement[-1]), float(history.pressure_max.max())]
                for name in moved:
                    force = np.abs(solution.reactions[name]).max(axis=1)
                    results += [float(force.max()), float(force[-1])]
            visited += law.visited
        return Exploration(MacroState.concatenate(visited), tuple(results))


class VisitedStates(LawWrapper):
    """Wrapper of a law that records the states at the quadrature points whenever a time step is accepted."""

    def __init__(self, law: MacroLaw) -> None:
        super().__init__(law)
        #: One batch for each accepted time; first the state at rest, of a cell with parameters for each point.
        self.visited = [] if law.parameters else [MacroState.zeros(1)]

    def initial_at(self, points: MacroState) -> LawMemory:
        """Return the memory at rest, and record it for cells with parameters."""
        memory = super().initial_at(points)
        if self.parameters:
            self.visited.append(replace(memory.states, place=None))
        return memory

    def before_accept(self, response: MacroResponse, memory: LawMemory) -> LawMemory | None:
        """Record the states of a converged step that is accepted."""
        changed = super().before_accept(response, memory)
        if changed is None:
            self.visited.append(replace(response.memory.states, place=None))
        return changed


def coarse_problem(problem: MacroProblem, elements: int, steps: int) -> MacroProblem:
    """Return the problem with at most ``elements`` along each axis and about ``steps`` time steps after the ramp.

    There are more elements where a region would have none.
    """
    time = problem.time
    after = time.end - time.end_of_ramp
    return problem.model_copy(
        update={
            "body": _coarse_body(problem, elements),
            "time": time.model_copy(update={"step": max(time.step, after / steps), "profiles": ()}),
        }
    )


def _coarse_body(problem: MacroProblem, elements: int) -> Body:
    body = problem.body.coarsened(elements)
    while problem.regions and body != problem.body:
        mesh = body_mesh(problem.model_copy(update={"body": body}))
        try:
            region_numbers(mesh, problem.regions)
        except ConfigurationError:
            elements *= 2
            body = problem.body.coarsened(elements)
        else:
            break
    return body
