"""Base of samplers that learn (LearningSampler); sampler ``active``, by a committee of surrogates."""

from __future__ import annotations

import hashlib
from abc import abstractmethod
from math import ceil
from typing import Any

import numpy as np

from porocore.core.inputs import InputSpace
from porocore.core.models.bounds import LARGEST_SEED
from porocore.interfaces.records import flatten_response
from porocore.interfaces.sampler import (
    Judgement,
    Outlook,
    StudyFacts,
    StudySampler,
    make_anew,
)
from porocore.interfaces.surrogate import TrainingSet, least_states
from porocore.sampling.samplers.candidates import (
    MOST_CORNER_INPUTS,
    MemberChoice,
    SobolStream,
    corner_count,
    distances,
    most_worth,
    opening,
    spacing,
    spread_out,
)
from porocore.sampling.samplers.designs import (
    RoundSampler,
    from_unit,
    positive,
    refuse_unknown,
    whole,
)
from porocore.states import Array, BoolArray, CellResponse, Status

#: A round asks for at least this share of the states that are known, so that the cost for each state stays the same.
GROWTH = 0.1
#: A round of :class:`Active` is chosen from so many candidates at most, but for two for each state.
MOST_CANDIDATES = 512
#: Of a family of cells so many, since each state is a candidate at every member.
MOST_AT_MEMBERS = 2048
#: Members of a family that the states before the first round are solved at, at least.
FIRST_MEMBERS = 4
#: Seconds more in which a round of a family is chosen, roughly: its polynomials have more terms.
FAMILY_SECONDS = 1.0
#: States of :class:`Active` are at least this share of their mean spacing apart.
APART = 0.5


class LearningSampler(RoundSampler, StudySampler):
    """Rounds that are chosen from the responses so far: the base of :class:`Active` and its kin.

    ``usual`` is the default of ``initial``; the other options are those of :class:`Active`.
    """

    _study: StudyFacts | None = None

    seeded = True
    tolerance: float | None
    #: Seconds in which a round is chosen on a quiet core, roughly.
    decision: float = 0.1

    def __init__(
        self,
        inputs: InputSpace,
        count: int,
        initial: int | None,
        usual: int,
        batch: int,
        seed: int,
        states_per_member: int,
    ) -> None:
        super().__init__(inputs, whole("sampling.options.count", count, 2))
        self.states_per_member = whole("sampling.options.states_per_member", states_per_member, 1)
        if inputs.parameters:
            usual = max(usual, FIRST_MEMBERS * self.states_per_member)
        self.initial = usual if initial is None else whole("sampling.options.initial", initial, 2)
        self.batch = whole("sampling.options.batch", batch, 1)
        self.seed = whole("sampling.options.seed", seed, 0, LARGEST_SEED)
        self.decision += FAMILY_SECONDS if inputs.parameters else 0.0
        self.choice = MemberChoice.for_states(inputs, count, self.states_per_member, self.seed)

    @abstractmethod
    def choose_round(self, room: int) -> Array:
        """Return at most ``room`` points (m, d) of the unit box, chosen by what is known; none ends the sampling."""

    @abstractmethod
    def notes(self) -> Any:
        """Return what :meth:`choose_round` has left for the next round, as plain data."""

    @abstractmethod
    def recall(self, notes: Any) -> None:
        """Take the :meth:`notes` of a round that was chosen earlier."""

    def next_round(self, room: int) -> Array:
        """Return the round that was chosen earlier for the same responses; choose it where there is none."""
        remember = make_anew if self._study is None else self._study.remember

        def choose() -> dict[str, Any]:
            return {"points": self.choose_round(room).tolist(), "notes": self.notes()}

        chosen = remember(self._grounds(room), choose)
        self.recall(chosen["notes"])
        return np.array(chosen["points"], dtype=float).reshape(-1, len(self.inputs))

    def _grounds(self, room: int) -> str:
        """Return a hash of what a round depends on: the states so far and their responses."""
        found = hashlib.sha256(f"{type(self).__qualname__} {room} {len(self.points)}".encode())
        found.update(self.points.tobytes())
        for response in self.observed:
            found.update(f"{int(response.status[0])}".encode())
            for name, values in flatten_response(response).items():
                found.update(name.encode() + values.tobytes())
        return found.hexdigest()

    def round_size(self, room: int) -> int:
        """Return the size of the next round."""
        return min(room, max(self.batch, ceil(GROWTH * len(self.points))))

    def inform(self, study: StudyFacts) -> None:
        """Keep what the sampler may know of the study."""
        self._study = study

    @property
    def study(self) -> StudyFacts:
        """The study as given to :meth:`inform`; RuntimeError before that."""
        if self._study is None:
            raise RuntimeError(
                f"{type(self).__name__} has to know the undeformed cell; call inform before ask"
            )
        return self._study

    def training_set(self) -> TrainingSet | None:
        """Return all stable states so far in the order of asking; None if they are fewer than two."""
        good = self.stable
        if good.sum() < 2:
            return None
        rows = CellResponse.concatenate([self.observed[i] for i in np.flatnonzero(good)])
        states, study = self.inputs.scatter(from_unit(self.inputs, self.points[good])), self.study
        rest = study.reference, study.identity
        return TrainingSet(states, rows, self.inputs, *rest, {}, study.symmetry, rests=study.rests)

    def judge(self, unit: Array) -> Judgement | None:
        """Return the committee's judgement of points (m, d) of the unit box; None where too little is known for one."""
        data = self.training_set()
        if data is None:
            return None
        candidates = self.inputs.scatter(from_unit(self.inputs, unit))
        judgement = self.study.judge(data, self.study.responses, candidates)
        return judgement if judgement.disagreement.any() else None

    @property
    def outlook(self) -> Outlook:
        """The budget, the fewest states with which the sampling may end, and the rounds between."""
        asked = len(self.points)
        fewest = self.expected if self.tolerance is None else max(self.least, least_states(len(self.inputs)))
        fewest = min(max(fewest, asked), self.expected)
        return Outlook(self.expected, fewest, asked, self.round_size(self.count), self.decision)

    @property
    def members(self) -> int:
        """Number of times that a member of a family is prepared; 1 for a cell without parameters."""
        return ceil(self.expected / self.states_per_member) if self.inputs.parameters else 1

    @property
    def least(self) -> int:
        """States before which no tolerance ends the sampling."""
        return self.initial

    @property
    def stable(self) -> BoolArray:
        """States so far from which a surrogate may learn, (n,) bool."""
        return np.array([Status(int(response.status[0])).stable for response in self.observed], dtype=bool)

    @property
    def enough(self) -> bool:
        """True if a surrogate can learn from the stable states so far; before that no tolerance ends a sampling."""
        return int(self.stable.sum()) >= least_states(len(self.inputs))

    def reachable(self, candidates: Array) -> BoolArray:
        """Return whether the nearest known state of each candidate is stable, (m,) bool."""
        _, nearest = distances(candidates, self.points)
        reachable: BoolArray = self.stable[nearest]
        return reachable

    def spread_out(self, unit: Array, reachable: BoolArray, size: int) -> list[int]:
        """Return at most ``size`` of the reachable candidates (m, d), far from all others, as indices."""
        few = reachable & self.choice.few(unit, reachable.astype(float), self.points, size)
        return spread_out(unit, few.astype(float), self.points, size)


class Active(LearningSampler):
    """A design that fills the box, then rounds of states at the largest disagreement of a committee of polynomials.

    The members of the committee learn W with its gradient, or <∇u¹>, as the closure needs. The states of a round
    are those that tell most about the places where the members disagree, as a share of the response's range; each is
    chosen in the knowledge of those before it. Candidates come from a Sobol
    sequence. States that failed or are unstable are not learned from; candidates nearer to one of them than to any
    stable state are passed over.

    Parameters
    ----------
    inputs
        The box.
    count : int, at least 2
        The budget of states, those without values included.
    initial : int, at least 2
        States before the first round: the corners of a box of up to three inputs and farthest points, or a Sobol
        sequence; null: the corners and one state for each input, at least 6.
    batch : int, at least 1
        States in a round, or a tenth of those that are known if this is more.
    candidates : int, at least 2
        Candidates for each state of a round, of which there are at most 512. Few keep close to an even design, which
        serves the error on average; many go to the faces and corners of the box, which serves the largest error.
    tolerance
        Sampling ends when the largest disagreement is below this share of the range and the stable states are as many
        as a surrogate needs; None: when the budget is used up.
    seed : int, at least 0
        Seed of the design and of the candidates.
    states_per_member : int, at least 1
        States that are solved at one member of a family of cells before another is prepared: the budget has as many
        members as it asks for, and a round keeps to a few of them. Without parameters it does nothing.

    Raises
    ------
    ConfigurationError
        An option is unknown or of no use; the message begins with its key in a configuration.
    """

    def __init__(
        self,
        inputs: InputSpace,
        count: int = 100,
        initial: int | None = None,
        batch: int = 4,
        candidates: int = 8,
        tolerance: float | None = None,
        seed: int = 0,
        states_per_member: int = 4,
        **unknown: Any,
    ) -> None:
        known = ("count", "initial", "batch", "candidates", "seed", "states_per_member")
        refuse_unknown("active", known, unknown)
        d = len(inputs)
        usual = max(6, corner_count(d) + d)
        super().__init__(inputs, count, initial, usual, batch, seed, states_per_member)
        self.tolerance = None if tolerance is None else positive("sampling.tolerance", tolerance)
        self.candidates = whole("sampling.options.candidates", candidates, 2)
        self._stream = SobolStream(d - len(inputs.parameters), self.seed)

    def choose_round(self, room: int) -> Array:
        """Return the design, or the most valuable of the next candidates."""
        if not len(self.points):
            return self._first(min(self.initial, room))
        size = self.round_size(room)
        most = MOST_AT_MEMBERS // len(self.choice.values) if self.inputs.parameters else MOST_CANDIDATES
        states = self._stream.take(max(min(self.candidates * size, most), 2 * size))
        unit = self.choice.with_each(states)
        return self.choice.together(unit[self._chosen(unit, size)])

    def _first(self, count: int) -> Array:
        d = len(self.inputs)
        if not self.inputs.parameters and d <= MOST_CORNER_INPUTS:
            return opening(d, count, self.seed)
        return self.choice.in_rows(self._stream.take(count))

    def _chosen(self, unit: Array, size: int) -> list[int]:
        """Return at most ``size`` of the candidates (m, d) as indices; none where the sampling ends."""
        reachable = self.reachable(unit)
        judgement = self.judge(unit)
        if judgement is None:
            return self.spread_out(unit, reachable, size)
        if self.tolerance is not None and self.enough and judgement.disagreement.max() < self.tolerance:
            return []
        apart = APART * spacing(len(self.points) + size, len(self.inputs))
        worth = np.where(reachable, judgement.worth(), 0.0)
        allowed = reachable & self.choice.few(unit, worth, self.points, size)
        chosen = most_worth(unit, judgement, allowed, self.points, size, apart)
        return chosen or self.spread_out(unit, reachable, size)

    def notes(self) -> int:
        """Return the number of candidates so far."""
        return self._stream.taken

    def recall(self, notes: int) -> None:
        """Take the number of candidates so far."""
        self._stream.taken = notes
