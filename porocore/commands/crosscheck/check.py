"""The whole crosscheck: cell solvers, samples, surrogates, macro solvers, one after another; its JSON document."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any

from porocore.commands.backends import Backends
from porocore.commands.crosscheck.bodies import (
    DERIVATIVES,
    RESPONSES,
    BodyRun,
    CellRun,
    SurrogateRun,
    compare_bodies,
    compare_cells,
    compare_surrogates,
    load_libraries,
    make_laws,
    make_meshes,
    run_body,
    run_cell,
    train,
)
from porocore.commands.crosscheck.comparison import Comparison, SharedSamples, failures_of, share_samples
from porocore.commands.crosscheck.relaxation import CellPath, PathRun, check_relaxation
from porocore.core.console import Console
from porocore.core.files.plain_data import json_ready
from porocore.interfaces.law import MacroLaw
from porocore.states import CellResponse, Status
from porocore.study.config.config import RunConfig
from porocore.study.run.folder import versions


@dataclass(frozen=True, eq=False)
class CrossCheck:
    """All that was compared, and what it was compared from.

    Attributes
    ----------
    config
        The case.
    comparisons
        Line by line, failures first within each part.
    cells, samples, surrogates, bodies
        The results; ``samples`` is None where no cell solver could solve them.
    paths
        Those of a cell whose solid relaxes, where these were compared.
    """

    config: RunConfig
    comparisons: tuple[Comparison, ...]
    cells: tuple[CellRun, ...]
    samples: SharedSamples | None
    surrogates: tuple[SurrogateRun, ...]
    bodies: tuple[BodyRun, ...]
    paths: tuple[PathRun, ...] = ()

    @property
    def failed(self) -> tuple[Comparison, ...]:
        """Lines that did not pass."""
        return tuple(line for line in self.comparisons if not line.passed)

    @property
    def passed(self) -> bool:
        """True if all comparisons pass."""
        return not self.failed

    @property
    def worst(self) -> Comparison:
        """The line that exceeds its tolerance most, or is nearest to it; of several failures the first."""
        return max(self.comparisons, key=lambda line: line.excess)


def crosscheck(config: RunConfig, who: Backends, *, console: Console) -> CrossCheck:
    """Run every backend on the case and compare all pairs.

    A backend that fails is a line of the result; the others go on.

    Raises
    ------
    PorocoreError
        The case itself cannot be used: its cell cannot be meshed.
    """
    load_libraries(who.names["surrogate"])
    found = failures_of(who)
    make_meshes(config)
    cells = []
    for name in who.names["cell solver"]:
        with console.task(f"cell, {name}", "solves") as task:
            cells.append(run_cell(config, name, task))
    found += compare_cells(cells)

    samples, failures = share_samples(config, who.names["cell solver"], console)
    found += failures
    surrogates: list[SurrogateRun] = []
    bodies: list[BodyRun] = []
    if samples is not None:
        surrogates = [train(config, name, samples, console) for name in who.names["surrogate"]]
        found += compare_surrogates(surrogates, samples, config.sampling.test.seed)
        for name, law in make_laws(config, samples, surrogates).items():
            if not isinstance(law, MacroLaw):
                found.append(Comparison.failure("body", f"law {name}", "closure", name, law))
                continue
            bodies += [run_body(config, backend, name, law, console) for backend in who.names["macro solver"]]
        found += compare_bodies(bodies)
    return CrossCheck(config, tuple(found), tuple(cells), samples, tuple(surrogates), tuple(bodies))


def crosscheck_relaxation(
    config: RunConfig, names: Sequence[str], paths: Sequence[CellPath], *, console: Console
) -> CrossCheck:
    """Compare the law of a solid that relaxes with the cell along paths, by each named cell solver.

    Raises
    ------
    PorocoreError
        The case cannot be used: its solid does not relax, or a path cannot be followed.
    """
    runs, found = check_relaxation(config, names, paths, console)
    return CrossCheck(config, tuple(found), (), None, (), (), tuple(runs))


FORMAT, VERSION = "porocore-crosscheck", 1


def document(result: CrossCheck) -> dict[str, Any]:
    """Everything, ready for JSON; what is not finite is null."""
    samples = result.samples
    found = {
        "format": FORMAT,
        "version": VERSION,
        "passed": result.passed,
        "failed": len(result.failed),
        "worst": _line(result.worst) if result.comparisons else None,
        "comparisons": [_line(line) for line in result.comparisons],
        "cells": {run.backend: _cell(run) for run in result.cells},
        "samples": None
        if samples is None
        else {
            "backend": samples.backend,
            "learned_from": len(samples.training.states),
            "held_out": len(samples.states),
            "span": {
                name: samples.span(name) for name in RESPONSES if getattr(samples.solved, name) is not None
            },
            "porosity": samples.reference.porosity,
            "mesh": samples.reference.mesh,
            "seconds": samples.seconds,
        },
        "surrogates": {
            run.name: {
                "held_out_error": run.errors,
                "failure": run.failure or None,
                "seconds": run.seconds,
            }
            for run in result.surrogates
        },
        "bodies": [_body(run) for run in result.bodies],
        "paths": [_path(run) for run in result.paths],
        "versions": versions(),
        "configuration": result.config.model_dump(mode="json"),
    }
    ready: dict[str, Any] = json_ready(found)
    return ready


def _line(line: Comparison) -> dict[str, Any]:
    return asdict(line) | {"passed": line.passed}


def _cell(run: CellRun) -> dict[str, Any]:
    return {
        "states": {name: _response(response) for name, response in run.responses.items()},
        "conductivity": run.conductivity,
        "failures": run.failures,
        "seconds": run.seconds,
    }


def _response(response: CellResponse) -> dict[str, Any]:
    values = {name: getattr(response, name) for name in RESPONSES}
    values |= {name: getattr(response.tangent, name, None) for name in DERIVATIVES}
    return {"status": Status(int(response.status[0])).name} | {
        name: None if value is None else value[0] for name, value in values.items()
    }


def _path(run: PathRun) -> dict[str, Any]:
    names = ("stress", "fluid_volume", "status")
    return {
        "backend": run.backend,
        "path": run.path.name,
        "time": run.path.times,
        "grad_u": run.path.states.grad_u,
        "p": run.path.states.p,
        "cell": {name: getattr(run.cell, name) for name in names},
        "law": {
            "stress": run.stress,
            "fluid_volume": run.fluid_volume,
            "status": [int(status) for status in run.statuses],
        },
        "stress_error": run.stress_error,
        "fluid_error": run.fluid_error,
        "seconds": run.seconds,
    }


def _body(run: BodyRun) -> dict[str, Any]:
    history = None if run.solution is None else run.solution.history
    return {
        "backend": run.backend,
        "law": run.law,
        "failure": run.failure or None,
        "seconds": run.seconds,
        "history": None if history is None else {f.name: getattr(history, f.name) for f in fields(history)},
        "profiles": None
        if run.solution is None
        else [
            {"time": profile.time, "points": run.solution.points, "u": profile.u, "p": profile.p}
            for profile in run.solution.profiles
        ],
    }
