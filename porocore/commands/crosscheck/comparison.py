"""One line of a crosscheck (Comparison), the states and backends that take part, failed calls."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

import numpy as np

from porocore.commands.backends import FEM, Backends, advice, attempt, find_backends
from porocore.core.console import Console
from porocore.errors import DataError, PluginError
from porocore.interfaces.surrogate import MORE_STATES, TrainingSet
from porocore.macro.reference import CellReference
from porocore.sampling.datasets.dataset import Dataset
from porocore.sampling.samplers.designs import random_requests
from porocore.states import CellResponse, MacroState
from porocore.study.config.config import RunConfig
from porocore.study.run.composition import training_set
from porocore.study.run.folder import RunFolder
from porocore.study.run.pipeline import sample, solve_reference
from porocore.study.run.results import load_reference

Part = Literal["plugin", "cell", "surrogate", "body", "relaxation"]

#: Of averages, derivatives and K: two backends solve the same algebraic equations to some 1e-11.
CELL = 1e-8
#: Of histories: each step is solved to 1e-9 of its forces, and errors of some hundred steps add up.
BODY = 1e-6
#: Two surrogates may differ between the held-out states by so many times the sum of their errors there.
SPREAD = 3.0


@dataclass(frozen=True)
class Comparison:
    """Two backends on one quantity, or one that could not be compared.

    Attributes
    ----------
    part
        Of the study: the cell solvers, the surrogates, the macro solvers, or the law of a solid that relaxes; or a
        plugin that cannot be used.
    case
        The state or the path of the cell, or the law of the body.
    quantity
        What is compared.
    one, other
        Names of the backends; ``other`` is empty where one failed alone.
    difference
        The largest, relative to the scale of the quantity (docs/crosscheck.md); infinite where there is no number.
    tolerance
        Up to which it passes.
    reason
        Why there is no number; empty where there is one.
    skipped
        Whether a backend declares not to offer what would be compared, which is no failure.
    """

    part: Part
    case: str
    quantity: str
    one: str
    other: str
    difference: float
    tolerance: float
    reason: str = ""
    skipped: bool = False

    @classmethod
    def left_out(
        cls, part: Part, case: str, quantity: str, one: str, reason: str, *, other: str = ""
    ) -> Comparison:
        """Return a comparison that is not made, because of what a backend declares."""
        return cls(part, case, quantity, one, other, 0.0, math.inf, reason, skipped=True)

    @classmethod
    def failure(
        cls, part: Part, case: str, quantity: str, one: str, reason: str, *, other: str = ""
    ) -> Comparison:
        """A comparison that there is nothing to compare for, which is a failure too."""
        return cls(part, case, quantity, one, other, math.inf, 0.0, reason)

    @property
    def passed(self) -> bool:
        """True if the difference is within the tolerance, or nothing was to be compared."""
        return self.skipped or (not self.reason and self.difference <= self.tolerance)

    @property
    def excess(self) -> float:
        """The difference in units of its tolerance; infinite for a failure."""
        if self.skipped:
            return 0.0
        if self.reason or math.isnan(self.difference):
            return math.inf
        if self.difference == 0:
            return 0.0
        return self.difference / self.tolerance if self.tolerance > 0 else math.inf

    @property
    def pair(self) -> str:
        """Names of the compared backends."""
        return f"{self.one} – {self.other}" if self.other else self.one

    def describe(self) -> str:
        """Return the comparison as text."""
        where = f"{self.quantity}, {self.case}" if self.case else self.quantity
        if self.reason:
            return f"{where}, {self.pair}: {self.reason}"
        return f"{where}, {self.pair}: differs by {self.difference:.2e}, tolerance {self.tolerance:.0e}"


_SHEAR = np.array([[0, 0.1, 0], [0, -0.05, 0], [0, 0, 0]])
#: The states at which cell solvers are compared; the last needs the whole cell.
STATES: dict[str, MacroState] = {
    "at rest": MacroState.zeros(1),
    "H₂₂ = −0.15, p = 0.1": MacroState.single(np.diag([0.0, -0.15, 0.0]), 0.1),
    "H₁₂ = 0.1, H₂₂ = −0.05, p = 0.05": MacroState.single(_SHEAR, 0.05),
}
#: States between the samples, at which surrogates are compared with each other; nothing is solved there.
BETWEEN = 500


@dataclass(frozen=True, eq=False)
class SharedSamples:
    """The states that one backend solved for all surrogates.

    Attributes
    ----------
    backend
        Which.
    reference
        Its undeformed cell.
    training
        The stable states of the sampler.
    states, solved
        Held-out states with values.
    seconds
        Wall time.
    """

    backend: str
    reference: CellReference
    training: TrainingSet
    states: MacroState
    solved: CellResponse
    seconds: float

    def span(self, response: str) -> float:
        """Range of the component of a response that varies most, over all solved states; 1 if none varies."""
        both = np.concatenate([getattr(self.training.responses, response), getattr(self.solved, response)])
        # A state whose walls touch has no conductivity, and its other responses.
        both = both[np.isfinite(both.reshape(len(both), -1)).all(axis=1)]
        return float(np.ptp(both, axis=0).max()) or 1.0 if len(both) else 1.0

    def between(self, seed: int) -> MacroState:
        """Return the :data:`BETWEEN` random states of the sampled box at which surrogates are compared."""
        inputs = self.training.inputs
        return inputs.scatter([request.x for request in random_requests(inputs, BETWEEN, seed + 1)])


def share_samples(
    config: RunConfig, backends: Sequence[str], console: Console
) -> tuple[SharedSamples | None, list[Comparison]]:
    """Return samples of the configured backend if it takes part, else of the first that can."""
    failures: list[Comparison] = []
    for name in sorted(backends, key=lambda name: name != config.fem.backend):
        outcome = attempt(solve_samples, config, name, console)
        if outcome.value is not None:
            return outcome.value, failures
        failures.append(Comparison.failure("cell", "", "samples", name, outcome.reason))
    return None, failures


def solve_samples(config: RunConfig, backend: str, console: Console) -> SharedSamples:
    """The undeformed cell, the sampler's states and the held-out ones.

    Raises
    ------
    DataError
        Too few states converged.
    """
    settings = config.with_backends(fem=backend)
    with (
        TemporaryDirectory(prefix="porocore-crosscheck-") as scratch,
        RunFolder.claim(Path(scratch) / "run", settings) as folder,
    ):
        solve_reference(folder, console=console)
        began = time.perf_counter()
        sample(folder, console=console)
        seconds = time.perf_counter() - began
        training, reference = training_set(folder), load_reference(folder)
        held_out = Dataset.open(folder.test_dataset)
        unseen, solved = held_out.states(), held_out.responses()
    if not (valid := np.flatnonzero(solved.valid)).size:
        raise DataError(f"none of {len(solved)} held-out states has values; {MORE_STATES}")
    return SharedSamples(backend, reference, training, unseen[valid], solved[valid], seconds)


def select_backends(fem: Sequence[str] = (), surrogates: Sequence[str] = ()) -> Backends:
    """Return the installed backends, or those that are named.

    A backend whose requirements are not installed stays out; a plugin that is broken is a failure, unless
    both kinds are named.

    Raises
    ------
    PluginError
        A name is unknown or cannot be used; or there are not two of any kind, so that nothing can be compared.
    """
    found = find_backends({FEM: fem, ("surrogate",): surrogates})
    names = found.names
    if not names["cell solver"]:
        why = advice(row for row in (*found.broken, *found.missing) if row.kind in ("cell solver", ""))
        raise PluginError(
            "there is nothing to compare: no cell solver takes part; install one: "
            + ("; ".join(why) or "see docs/plugins.md")
        )
    broken = () if fem and surrogates else found.broken
    if not broken and max(map(len, names.values())) < 2:
        named = [*dict.fromkeys((*names["cell solver"], *names["macro solver"])), *names["surrogate"]]
        more = "; ".join(advice(found.missing))
        if fem or surrogates:
            more = "leave out --fem and --surrogate, or repeat them"
        raise PluginError(
            "there is nothing to compare: a crosscheck needs two finite-element backends or two surrogates, and "
            f"there is only {' and '.join(named) or 'none'}; {more or 'install another (docs/plugins.md)'}"
        )
    return Backends(names, broken, () if fem or surrogates else found.missing)


def failures_of(backends: Backends) -> list[Comparison]:
    """Return a failure for each plugin that cannot be used."""
    found = []
    for row in backends.broken:
        reason = f"{row.distribution} is {row.state}: {row.advice}"
        found.append(Comparison.failure("plugin", row.kind, row.name, row.distribution, reason))
    return list(dict.fromkeys(found))
