"""Sampler ``macro-driven``: states that macro runs of the study visit."""

from __future__ import annotations

from math import ceil
from typing import Any

import numpy as np

from porocore.core.inputs import InputSpace
from porocore.sampling.samplers.active import LearningSampler
from porocore.sampling.samplers.candidates import (
    corner_count,
    distances,
    most_worth,
    opening,
    sobol_points,
    spacing,
    spread_out,
)
from porocore.sampling.samplers.designs import positive, refuse_unknown, whole
from porocore.states import Array

#: Visited states are put on a lattice of so many steps for each input: near ones are one, and round-off moves none.
LATTICE = 500
#: More visited states than this are thinned out before a round is chosen from them.
MOST_CANDIDATES = 1024
#: Visited states nearer to a known one than this share of the mean spacing of the known ones are taken as known.
APART = 0.25
#: Seconds of a time step of the macro runs on a quiet core, roughly: 0.02 to 0.06 on up to 27 elements.
STEP_SECONDS = 0.04
#: The macro runs of so many rounds have to agree.
AGREEING = 3


class MacroDriven(LearningSampler):
    """Sampling along macro runs: fit a surrogate, run the macro problem with it, solve visited states, repeat.

    It ends when a round has changed no result of the macro runs (final displacement and largest pressure under each
    load; largest and final force on a surface that is moved) by more than ``tolerance``, twice in a row, and the stable
    states are as many as a surrogate needs; or with the budget. One half of a round are the visited states that are
    farthest from all known ones; the other are those that tell most about all visited states, weighted by how much a
    committee of polynomials disagrees there (as in :class:`~porocore.sampling.samplers.active.Active`).
    Visited states outside the box are moved to its faces. Of a macro run that does not reach its end, the states until
    there count; where nothing new was visited, the round fills the box.

    Parameters
    ----------
    inputs
        The box.
    count : int, at least 2
        The budget of states, those without values included.
    initial : int, at least 2
        States before the first round: the corners of a box of up to three inputs and farthest points, or a Sobol
        sequence; null: the corners and two states for each input, at least 8.
    batch : int, at least 1
        States in a round, or a tenth of those that are known if this is more.
    tolerance
        Largest change of a macro result that counts as none, relative.
    elements : int, at least 1
        Elements of the macro runs along each axis, at most.
    steps : int, at least 2
        Time steps of the macro runs after the ramp, about.
    seed : int, at least 0
        Seed of the design.
    states_per_member : int, at least 1
        States that are solved at one member of a family of cells before another is prepared: visited states are moved
        to the nearest of as many members as the budget asks for, and a round keeps to a few of them. Without parameters
        it does nothing.

    Raises
    ------
    ConfigurationError
        An option is unknown or of no use; the message begins with its key in a configuration.
    """

    fills_ranges = False
    choosing = "exploring by macro runs"
    decision = 0.0

    def __init__(
        self,
        inputs: InputSpace,
        count: int = 60,
        initial: int | None = None,
        batch: int = 6,
        tolerance: float = 0.001,
        elements: int = 20,
        steps: int = 60,
        seed: int = 0,
        states_per_member: int = 4,
        **unknown: Any,
    ) -> None:
        known = ("count", "initial", "batch", "elements", "steps", "seed", "states_per_member")
        refuse_unknown("macro-driven", known, unknown)
        d = len(inputs)
        usual = max(8, corner_count(d) + 2 * d)
        super().__init__(inputs, count, initial, usual, batch, seed, states_per_member)
        self.tolerance = positive("sampling.tolerance", tolerance)
        self.elements = whole("sampling.options.elements", elements, 1)
        self.steps = whole("sampling.options.steps", steps, 2)
        self.decision += STEP_SECONDS * self.steps
        #: Results of the macro runs after each round.
        self.results: list[Array] = []

    def choose_round(self, room: int) -> Array:
        """Return the design, or the most informative of the visited states."""
        if not len(self.points):
            return self._cloud(min(self.initial, room), self.seed)
        data = self.training_set()
        size = self.round_size(room)
        if data is None:
            return self._filling(size)
        found = self.study.explore(data, elements=self.elements, steps=self.steps)
        self.results.append(np.array(found.results))
        if self.converged and self.enough:
            return self.points[:0]
        visited = self._lattice(self.inputs.gather(self.inputs.without_rotation(found.states)))
        return self._among(visited, size)

    def _among(self, visited: Array, size: int) -> Array:
        """Return at most ``size`` of the visited points (m, d); where they are known, others of the box."""
        distance, _ = distances(visited, self.points)
        reachable, apart = self.reachable(visited), APART * spacing(len(self.points) + size, len(self.inputs))
        # States that are already that dense are made denser.
        while (reachable & (distance > apart)).sum() < size and apart > 2 / LATTICE:
            apart /= 2
        allowed = reachable & (distance > apart)
        if not allowed.any():
            return self._filling(size)
        allowed &= self.choice.few(visited, allowed.astype(float), self.points, size)
        far = spread_out(visited, allowed.astype(float), self.points, size // 2)
        judgement = self.judge(visited)
        if judgement is None:
            chosen = spread_out(visited, allowed.astype(float), self.points, size)
            return self.choice.together(visited[chosen])
        for candidate in far:
            judgement.take(candidate)
        known = np.concatenate([self.points, visited[far]])
        chosen = far + most_worth(visited, judgement, allowed, known, size - len(far), apart)
        return self.choice.together(visited[chosen])

    def notes(self) -> list[list[float | None]]:
        """Return the results of the macro runs, None for those that are not known."""
        return [[value if np.isfinite(value) else None for value in found.tolist()] for found in self.results]

    def recall(self, notes: list[list[float | None]]) -> None:
        """Take the results of the macro runs."""
        self.results = [np.array(found, dtype=float) for found in notes]

    @property
    def least(self) -> int:
        """States with which macro runs of three rounds agree at the earliest."""
        rounds = max(AGREEING - 1 - len(self.results), 0)
        return max(len(self.points), self.initial) + rounds * self.batch

    @property
    def converged(self) -> bool:
        """True when the last two rounds have changed no result."""
        if len(self.results) < AGREEING:
            return False
        last = np.stack(self.results[-AGREEING:])
        return bool((np.abs(np.diff(last, axis=0)) <= self.tolerance * np.abs(last[1:])).all())

    def _cloud(self, count: int, seed: int) -> Array:
        """Return points (count, d) that fill the box; of a family, some at each of its members."""
        m = len(self.inputs.parameters)
        if not m:
            return opening(len(self.inputs), count, seed)
        return self.choice.in_rows(sobol_points(len(self.inputs) - m, count, seed))

    def _filling(self, size: int) -> Array:
        """Return farthest points of the box, for rounds in which nothing new was visited."""
        cloud = self._cloud(256, self.seed + len(self.points))
        return self.choice.together(cloud[self.spread_out(cloud, self.reachable(cloud), size)])

    def _lattice(self, x: Array) -> Array:
        """Return the distinct visited states in the unit box, (m, d), at the nearest of the members."""
        unit = np.round(np.clip(self.inputs.to_unit(x), 0, 1) * LATTICE) / LATTICE
        distinct: Array = np.unique(self.choice.snapped(unit), axis=0)
        return distinct[:: ceil(len(distinct) / MOST_CANDIDATES)]
