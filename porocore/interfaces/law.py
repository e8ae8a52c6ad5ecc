"""Interfaces of laws: of the cell (CellLaw) and of the macroscale (MacroLaw), its response and tangent.

Linear poroelasticity (:mod:`porocore.macro.laws.linear`) and a closed cell law (:mod:`porocore.macro.laws`) are both of
this kind, so one macro code path serves all and each checks the others.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from porocore.core.fields.batch import Batch
from porocore.core.files.plain_data import stable_hash
from porocore.errors import ConfigurationError
from porocore.interfaces.law_changes import MemoryChanges, PointChanges, ResponseChanges
from porocore.states import Array, CellResponse, CellSlopes, MacroState


@dataclass(frozen=True, eq=False)
class LawMemory(Batch):
    """State of a law at the last accepted time, for n points.

    What a step takes up is the change of the fluid volume, a number that does not depend on the axes or the parameters
    by which the next step sees the points.

    Attributes
    ----------
    states
        (H, p; θ) and places; a law that sees the points in the axes of their material sees the tensors in the present
        ones, and the cell stood in ``states.place.axes`` of these (None: it still does).
    mean_grad : (n, 3, 3)
        <∇_Y u¹>_s.
    fluid_volume : (n,)
        φ, fluid volume per reference volume, from which the storage of the next step is counted.
    """

    states: MacroState
    mean_grad: Array
    fluid_volume: Array


@dataclass(frozen=True, eq=False)
class UndeformedCells(Batch):
    """Facts of n undeformed cells of one family, one for each point of a body."""

    porosity: Array  #: (n,)  φ_f, from the cell law itself, so that its storage at rest is consistent
    conductivity: Array  #: (n, 3, 3)  K


@dataclass(frozen=True, eq=False)
class MacroTangent(Batch):
    """Exact derivatives of a :class:`MacroResponse` with respect to (H, p, ∇_X p); response indices first."""

    stress_grad_u: Array  #: (n, 3, 3, 3, 3)
    stress_p: Array  #: (n, 3, 3)
    storage_grad_u: Array  #: (n, 3, 3)
    storage_p: Array  #: (n,)
    flux_grad_u: Array  #: (n, 3, 3, 3)  ∂q_i/∂H_kl
    flux_p: Array  #: (n, 3)
    flux_grad_p: Array  #: (n, 3, 3)


class Integrand(Protocol):
    """Stress (n, 3, 3), storage (n,) and flux (n, 3) at n points, which residuals are integrals of."""

    @property
    def stress(self) -> Array:
        """P_E (n, 3, 3)."""

    @property
    def storage(self) -> Array:
        """Fluid taken up (n,)."""

    @property
    def flux(self) -> Array:
        """Flux q (n, 3)."""


@dataclass(frozen=True, eq=False)
class MacroResponse(Batch):
    """Response of n points, dimensionless.

    Attributes
    ----------
    stress : (n, 3, 3)
        P_E, total first Piola–Kirchhoff, tension positive.
    storage : (n,)
        Fluid volume taken up per reference volume since the memory's time (negative: squeezed out), which is the change
        of the memory's fluid volume.
    flux : (n, 3)
        q = Ḡw, relative fluid flux through reference area.
    memory
        To hand in at the next step if this one is accepted.
    deformation : (n, 3, 3)
        F̄ = I + H + <∇u¹>_s/φ_s (I + H in a linear law).
    volume_ratio : (n,)
        det F̄, by which the drained volume is divided (1 in a linear law).
    transformed_conductivity : (n, 3, 3)
        K_t = K_ref/det F̄ with q = −K_ref ∇_X p (K in a linear law).
    outside_training_range : (n,) bool
        The cell law was asked outside the range that it was trained on.
    """

    stress: Array
    storage: Array
    flux: Array
    memory: LawMemory
    deformation: Array
    volume_ratio: Array
    transformed_conductivity: Array
    outside_training_range: npt.NDArray[Any]
    tangent: MacroTangent | None = None


class MacroLaw(ABC):
    """Stress, fluid storage and flux as functions of (H, p, ∇_X p) and of the last accepted state.

    Examples
    --------
    >>> from porocore import MacroState
    >>> from porocore.testing.synthetic.response import linear_law
    >>> law, state = linear_law(), MacroState.single(np.diag([0.0, -0.01, 0.0]), p=0.002)
    >>> response = law.respond(state, grad_p=np.array([[0.0, 1e-3, 0.0]]), memory=law.initial(1))
    >>> response.stress[:, 1, 1].round(5), response.storage.round(5), response.flux[0].round(5)
    (array([-0.00603]), array([-0.00724]), array([ 0.     , -0.00194,  0.     ]))
    """

    #: Short name for reports and checkpoints.
    name: str
    #: Changes whenever the law would answer differently; a checkpoint of another law is refused.
    identity: str
    #: Share of the magnitudes that cancel in a response below which its digits mean nothing, beyond round-off.
    noise: float = 0.0
    #: Whether the tangent of a point is the same for all states, gradients and memories, as in a linear law; it may
    #: depend on the parameters and on the place of the point, and on nothing else. As long as these stay, a solver
    #: assembles and factorises once for each length of step, and need not ask for the tangent again.
    constant_tangent: bool = False
    #: Names of the cell's parameters that ``states.parameters`` holds, in this order.
    parameters: tuple[str, ...] = ()

    @abstractmethod
    def initial(self, n: int) -> LawMemory:
        """Return the memory of n points at rest, H = 0 and p = 0."""

    def parameters_of(self, region: int) -> tuple[str, ...]:
        """Return the names of those :attr:`parameters` that points of a region need; others may be NaN there."""
        return self.parameters

    def initial_at(self, points: MacroState) -> LawMemory:
        """Return the memory at rest of n points with the parameters and places of ``points``.

        A law whose answer at rest depends on them overrides this.
        """
        return self.initial(len(points))

    @abstractmethod
    def respond(
        self, states: MacroState, grad_p: Array, memory: LawMemory, *, tangent: bool = True
    ) -> MacroResponse:
        """Return the response at n points; ``grad_p`` is ∇_X p (n, 3)."""

    def respond_to_each(
        self, states: MacroState, gradients: Sequence[Array], memory: LawMemory, *, tangent: bool = True
    ) -> list[MacroResponse]:
        """Return the responses at the same n points to several gradients of the pressure, each (n, 3)."""
        return [self.respond(states, grad_p, memory, tangent=tangent) for grad_p in gradients]

    def respond_to_changes(
        self,
        states: MacroState,
        grad_p: Array,
        memory: LawMemory,
        changes: PointChanges,
        before: MemoryChanges,
    ) -> tuple[MacroResponse, ResponseChanges]:
        """Return the response with its tangent, and its derivatives by unknowns at fixed (H, p, ∇p).

        Parameters
        ----------
        changes
            What the unknowns change at the points.
        before
            Derivatives of ``memory``.

        Raises
        ------
        ConfigurationError
            The law does not know them.
        """
        raise ConfigurationError(
            f"the law '{self.name}' gives no derivatives by unknowns, without which a run has no sensitivities; "
            "choose a law of a closure"
        )

    def before_accept(self, response: MacroResponse, memory: LawMemory) -> LawMemory | None:
        """Return None to accept a converged step, or a new memory to solve it again.

        A law that does not change accepts every step. One that has changed since returns the memory of the last
        accepted time by its present answers. ``memory`` is the one that the step began from.
        """
        return None

    def reasons(self, states: MacroState) -> list[str]:
        """Return for each of n flagged states which component drives it out, in words; empty where it is not known."""
        return [""] * len(states)


class CellLaw(ABC):
    """Responses of the cell as functions of (H, p): a surrogate, the solved cell, or its linear limit."""

    #: Hash of the cell, and of whatever else determines the responses.
    identity: str
    #: Share of a response below which its digits mean nothing, beyond round-off.
    noise: float = 0.0
    #: Names of the cell's parameters that ``states.parameters`` holds, in this order.
    parameters: tuple[str, ...] = ()

    @abstractmethod
    def predict(self, states: MacroState, *, tangent: bool = True) -> CellResponse:
        """Return the responses of n states, with their exact derivatives if ``tangent``."""

    def predict_from(self, before: MacroState, states: MacroState, *, tangent: bool = True) -> CellResponse:
        """Return the responses of n points whose last accepted states were ``before``, which few laws use."""
        return self.predict(states, tangent=tangent)

    def undeformed(self, parameters: Array) -> UndeformedCells | None:
        """Return porosity and conductivity of the undeformed cells with ``parameters`` (n, m).

        A law with :attr:`parameters` overrides this; None: all points have the same cell.
        """
        return None

    def slopes(self, states: MacroState) -> CellSlopes:
        """Return the derivatives of the responses of n states by the parameters of the cell, at fixed (H, p).

        Raises
        ------
        ConfigurationError
            The law has no parameters, or does not know its derivatives by them.
        """
        raise ConfigurationError(
            f"the law {type(self).__name__} gives no derivatives by parameters of the cell; choose one that is made "
            "for a cell with parameters, such as the surrogate polynomial"
        )

    def reasons(self, states: MacroState) -> list[str]:
        """Return for each of n flagged states which component drives it out, in words; empty where it is not known."""
        return [""] * len(states)


def fingerprint(*parts: str | float | Array) -> str:
    """Return the hash of texts, numbers and arrays, for :attr:`MacroLaw.identity`."""
    hashed: list[str | bytes] = []
    for part in parts:
        data = part.encode() if isinstance(part, str) else np.asarray(part, dtype=float).tobytes()
        hashed += [f"{type(part).__name__}{len(data)}:", data]
    return stable_hash(*hashed, length=16)
