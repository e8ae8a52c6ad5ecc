"""Interfaces of samplers: ask and tell, requests, explorations, committees, facts of the study."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

from porocore.core.inputs import InputSpace
from porocore.core.tensors import TRIVIAL, PointGroup
from porocore.interfaces.records import RestData
from porocore.interfaces.surrogate import TrainingSet
from porocore.states import Array, CellResponse, MacroState


@dataclass(frozen=True)
class Request:
    """One state to be solved.

    Attributes
    ----------
    key
        Name of the state within the run; the same run asks for the same keys, whatever the order of completion.
    x
        Values of the sampled inputs.
    start
        Key of the solved state whose field the solver starts from; None: the undeformed cell.
    """

    key: str
    x: tuple[float, ...]
    start: str | None = None


@dataclass(frozen=True)
class Outlook:
    """States that a sampler foresees, for the time left that the progress shows.

    Attributes
    ----------
    expected
        Estimated number of all states, or the most.
    fewest
        How many there will be at least.
    asked
        How many were asked for.
    batch
        States of a further round, on which the sampler decides in a time that counts; 0: it does not.
    decision
        Seconds of such a decision on a quiet core, roughly.
    """

    expected: int
    fewest: int
    asked: int = 0
    batch: int = 0
    decision: float = 0.0


class Sampler(ABC):
    """Chooses states by ask and tell.

    A sampler is deterministic: after the same tells it asks for the same states, so that an interrupted
    sampling is resumed by telling a new sampler the finished states again as it asks for them. So no key may hang on
    ``hash()`` or on the order of a set, which are others in every process.
    """

    #: Whether it takes the option ``seed``, and other seeds give other states.
    seeded: ClassVar[bool] = False
    #: Whether its states fill the ranges of the inputs; if not, held-out states are drawn between those that it chose.
    fills_ranges: ClassVar[bool] = True
    #: Whether it draws states over parameters of a cell, too; a study of such a cell refuses others.
    samples_parameters: ClassVar[bool] = True
    #: What it does when it is asked after all states of a round, in a few words for the progress display.
    choosing: ClassVar[str] = "choosing states"

    @abstractmethod
    def __init__(self, inputs: InputSpace, **options: Any) -> None: ...

    @abstractmethod
    def ask(self) -> list[Request]:
        """Return states that can be solved now, in any order, each once; empty: wait for results, or done."""

    @abstractmethod
    def tell(self, key: str, response: CellResponse) -> None:
        """Take the response (one row) of a requested state; a failed one has its status and NaN."""

    @property
    @abstractmethod
    def done(self) -> bool:
        """True when every state has been asked for and told."""

    @property
    @abstractmethod
    def expected(self) -> int:
        """Estimated number of all states, for the progress display."""

    @property
    def members(self) -> int:
        """Number of times that a member of a family of cells is prepared for the states, at most."""
        return self.expected

    @property
    def outlook(self) -> Outlook:
        """The states foreseen; a sampler that may end early, or takes time to decide on further states, says so."""
        return Outlook(self.expected, self.expected)


@dataclass(frozen=True, eq=False)
class Exploration:
    """Macroscopic states that macro runs visit with a surrogate of the states solved so far.

    Attributes
    ----------
    states
        Macroscopic states that they visit, (n).
    results
        What the runs are made for, such as settlements and pressures; NaN where a run did not reach its end.
    """

    states: MacroState
    results: tuple[float, ...]


class Explore(Protocol):
    """Fits a surrogate and runs the macro problem with it; the same data give the same exploration."""

    def __call__(self, data: TrainingSet, *, elements: int, steps: int) -> Exploration:
        """Explore with at most ``elements`` along each axis of the body and about ``steps`` time steps."""


class Judgement(Protocol):
    """Disagreement of a committee at m candidates, and the value of solving each of them."""

    @property
    def disagreement(self) -> Array:
        """Largest standard deviation among the members at each candidate, (m,), as a share of the range."""

    def worth(self) -> Array:
        """Return the variance that solving each candidate takes from the fit, (m,), after those that were taken."""

    def take(self, candidate: int) -> None:
        """Assume a solution at this candidate."""


class Judge(Protocol):
    """Fits a committee of surrogates to solved states, and asks it about candidates."""

    def __call__(self, data: TrainingSet, responses: tuple[str, ...], candidates: MacroState) -> Judgement:
        """Return the judgement of the ``candidates``, (m), by members that learned ``responses`` from ``data``."""


class Remember(Protocol):
    """Keeps the decisions of a sampler beside its data set, so that a resumed sampling does not come to them again."""

    def __call__(self, grounds: str, decide: Callable[[], Any]) -> Any:
        """Return the decision that was made on these grounds; where there is none, make it and keep it.

        Parameters
        ----------
        grounds
            All that the decision depends on, such as a hash of the responses so far; the options of the sampler and the
            study need not be named.
        decide
            Makes the decision: numbers, texts, lists and dictionaries of them, as in JSON. Numbers are finite.
        """


def make_anew(grounds: str, decide: Callable[[], Any]) -> Any:
    """Return the decision of ``decide``; nothing is kept."""
    return decide()


@dataclass(frozen=True, eq=False)
class StudyFacts:
    """Study that a sampler samples for, as far as a sampler may know it.

    Attributes
    ----------
    reference
        Response of the undeformed cell with its tangent, one row.
    identity
        Hash of the cell.
    responses
        Fields of :class:`CellResponse` that the closure asks of a surrogate.
    explore
        Runs the study's macro problem.
    judge
        Asks a committee of surrogates about states that are not solved yet.
    symmetry
        Point group of the cell, see :class:`~porocore.interfaces.surrogate.TrainingSet`.
    remember
        Keeps decisions that take time, for a sampling that is resumed.
    rests
        Undeformed members of a cell with parameters; None for a cell without.
    """

    reference: CellResponse
    identity: str
    responses: tuple[str, ...]
    explore: Explore
    judge: Judge
    symmetry: PointGroup = TRIVIAL
    remember: Remember = make_anew
    rests: RestData | None = None


class StudySampler(Sampler):
    """Sampler that learns while it samples, and therefore has to know the study."""

    @abstractmethod
    def inform(self, study: StudyFacts) -> None:
        """Take the facts of the study, once, before the first :meth:`~porocore.Sampler.ask`."""
