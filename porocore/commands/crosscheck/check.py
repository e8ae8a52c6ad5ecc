"""The whole crosscheck: cell solvers, samples, surrogates, macro solvers, one after another."""

from __future__ import annotations

from dataclasses import dataclass

from porocore.commands.backends import Backends
from porocore.commands.crosscheck.bodies import (
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
from porocore.commands.crosscheck.comparison import (
    Comparison,
    SharedSamples,
    failures_of,
    share_samples,
)
from porocore.core.console import Console
from porocore.interfaces.law import MacroLaw
from porocore.study.config.config import RunConfig


@dataclass(frozen=True, eq=False)
class CrossCheck:
    """All that was compared, and what it was compared from.

    Attributes
    ----------
    config
        The case.
    selection
        Backends that took part.
    comparisons
        Line by line, failures first within each part.
    cells, samples, surrogates, bodies
        The results; ``samples`` is None where no cell solver could solve them.
    """

    config: RunConfig
    selection: Backends
    comparisons: tuple[Comparison, ...]
    cells: tuple[CellRun, ...]
    samples: SharedSamples | None
    surrogates: tuple[SurrogateRun, ...]
    bodies: tuple[BodyRun, ...]

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
    return CrossCheck(config, who, tuple(found), tuple(cells), samples, tuple(surrogates), tuple(bodies))
