"""Interface of a surrogate: fit, predict, save, load; its training set and progress; least states."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Self

from porocore.core.inputs import InputSpace
from porocore.core.tensors import TRIVIAL, PointGroup
from porocore.interfaces.law import CellLaw
from porocore.interfaces.records import RestData
from porocore.states import CellResponse, MacroState

#: What to do about too few states to train on, whatever the sampler.
MORE_STATES = (
    "take more of them (sampling.options.count, or smaller steps in sampling.inputs), and narrow the ranges where most "
    "of them have no stable solution"
)


def least_states(inputs: int) -> int:
    """Return how many stable states a surrogate needs: a slope and a curvature for each input, and two more."""
    return 2 * inputs + 2


@dataclass(frozen=True, eq=False)
class TrainingSet:
    """Solved states and what a surrogate may know of the cell beforehand.

    Attributes
    ----------
    states, responses
        Rows that all hold values (:attr:`CellResponse.valid`).
    inputs
        The named inputs that were sampled and their ranges.
    reference
        Response of the undeformed cell with its tangent (one row): M and Q of the linear limit.
    identity
        Hash of the cell and of the law, stored with the surrogate and checked when it is used.
    provenance
        Text to keep with the surrogate (versions, configuration).
    symmetry
        Point group of the cell (``Cell.point_group``): the operations Q with
        W(Q F Qᵀ, p) = W(F, p). It is not to be seen from the response at rest: fibres that bear tension only do nothing
        there, and a stiffness cannot tell all cubic groups apart. Trivial: nothing is known of it.
    tolerance
        States whose estimated error is larger, as a share of the range of what is learned, are to be flagged as
        outside; None: those beyond the hull of the training states are.
    rests
        Undeformed members of a cell with parameters, and what is known of these; None for a cell without.

    Examples
    --------
    >>> from porocore import InputSpace, MacroState, TrainingSet
    >>> from porocore.testing.synthetic.cell import respond
    >>> inputs = InputSpace.from_ranges({"H22": (-0.2, 0.05), "p": (0.0, 0.1)})
    >>> states = inputs.scatter([[-0.1, 0.0], [0.02, 0.05]])
    >>> rest = respond(MacroState.zeros(1))
    >>> data = TrainingSet(states, respond(states), inputs, rest, identity="made-up", provenance={})
    >>> data.responses.mean_grad.shape, data.reference.tangent.mean_grad_p.shape
    ((2, 3, 3), (1, 3, 3))
    """

    states: MacroState
    responses: CellResponse
    inputs: InputSpace
    reference: CellResponse
    identity: str
    provenance: dict[str, str]
    symmetry: PointGroup = TRIVIAL
    tolerance: float | None = None
    rests: RestData | None = None


@dataclass(frozen=True)
class TrainingProgress:
    """One report of a running training.

    Attributes
    ----------
    epoch, epochs
        How many were taken, and how many are taken at most.
    loss, validation_loss
        Present losses; the second is NaN for a training that keeps no states for validation.
    ends
        Epoch after which the training ends if the loss stays above its smallest so far; None: the last.
    unit
        What is counted: epochs, or iterations of L-BFGS.
    ended
        In the last report how the training ended, in a few words, where it is worth telling.
    """

    epoch: int
    epochs: int
    loss: float
    validation_loss: float = math.nan
    ends: int | None = None
    unit: str = "epochs"
    ended: str = ""

    @property
    def words(self) -> str:
        """The losses that there are, and how the training ended."""
        losses = {"loss": self.loss, "validation": self.validation_loss}
        told = [f"{name} {value:.2e}" for name, value in losses.items() if not math.isnan(value)]
        return ", ".join([*told, self.ended] if self.ended else told)

    @property
    def left(self) -> float:
        """Epochs that are left, as far as can be told: the geometric mean of the fewest and the most."""
        if self.ended:
            return 0.0
        fewest = self.epochs if self.ends is None else min(self.ends, self.epochs)
        return math.sqrt(max(fewest - self.epoch, 0) * (self.epochs - self.epoch))


#: Receiver of the reports of a training.
OnProgress = Callable[[TrainingProgress], None]


class Surrogate(CellLaw):
    """A surrogate of one model family; ``options`` are its settings from the configuration.

    An instance is created with its options, :meth:`fit` makes it usable, :meth:`save` and :meth:`load`
    keep everything that using it needs, in a format that executes nothing when it is read.

    What it offers is declared by the attributes of its class; a study that needs more is refused before anything is
    solved, and the conformance suite and the crosscheck hold it to what it declares.
    """

    #: Largest error within the sampled range, as a share of the range of each response, that users may count on.
    expected_error: ClassVar[float] = 5e-3
    #: Whether it gives the undeformed cell's responses and derivatives exactly.
    exact_at_rest: ClassVar[bool] = True
    #: Whether it learns cells with parameters, whose states hold them, and gives ``slopes`` by them; else its
    #: :meth:`fit` refuses them. Of a class with several models each instance may say so for its own.
    learns_parameters: bool = False
    #: Models to choose from, if there are several kinds; then the constructor takes ``model=``.
    models: ClassVar[tuple[str, ...]] = ()
    #: Model of this instance, one of :attr:`models`; empty where there is one kind only.
    model: str = ""
    #: Hash of the cell that it was trained for; set by ``fit`` and ``load``.
    identity: str
    #: Sampled inputs and their range; set by ``fit`` and ``load``.
    inputs: InputSpace
    #: Texts kept beside it; set by ``fit`` and ``load``.
    provenance: dict[str, str]

    @abstractmethod
    def __init__(self, **options: Any) -> None: ...

    @property
    def provides(self) -> tuple[str, ...] | None:
        """Responses of :class:`~porocore.CellResponse` that :meth:`predict` fills in; None: not declared."""
        return None

    @classmethod
    def load_libraries(cls) -> None:
        """Import the libraries that training needs.

        A run calls this before it solves the first cell: numerical libraries that share symbols (two copies of
        MKL) round differently in the other order of loading, and a training would not repeat to the last bit.
        """

    @abstractmethod
    def fit(
        self,
        data: TrainingSet,
        *,
        seed: int,
        checkpoint: Path | None = None,
        on_progress: OnProgress | None = None,
    ) -> Self:
        """Train on ``data`` and return self.

        A training that was interrupted continues from ``checkpoint`` if that file exists and belongs to the
        same data, options and seed, and then ends with the same weights as an uninterrupted one.
        """

    @abstractmethod
    def predict(self, states: MacroState, *, tangent: bool = True) -> CellResponse:
        """Return responses and exact derivatives of n states; ``doubt`` says which not to rely on.

        These are states whose error is estimated to exceed the tolerance of the training set, and those far from all
        that was sampled.
        """

    @abstractmethod
    def save(self, path: Path) -> None:
        """Write one file, atomically."""

    @classmethod
    @abstractmethod
    def load(cls, path: Path) -> Self:
        """Read what :meth:`save` wrote.

        Raises
        ------
        DataError
            The file is truncated, foreign or of another version.
        """
