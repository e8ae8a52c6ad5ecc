"""Laws: of the cell (CellLaw), of the macroscale (MacroLaw), that ask another (LawWrapper); their changes.

Linear poroelasticity (:mod:`porocore.macro.laws.linear`) and a closed cell law (:mod:`porocore.macro.laws`) are both of
this kind, so one macro code path serves all and each checks the others.

Every array holds derivatives by k unknowns along its last axis, behind the batch axis of n points and the indices of
the value.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
import numpy.typing as npt

from porocore.core.fields import Batch
from porocore.core.files.plain_data import stable_hash
from porocore.errors import ConfigurationError
from porocore.states import Array, CellResponse, CellSlopes, IntArray, MacroState


@dataclass(frozen=True, eq=False)
class PointChanges(Batch):
    """Changes of n points under k unknowns.

    Attributes
    ----------
    modulus : (n, k)
        Relative change of the modulus of the whole solid, with W = E w(H, p/E).
    viscosity : (n, k)
        Relative change of the viscosity of the fluid.
    parameters : (n, m, k)
        Change of the parameters of the cell; None for a law without.
    """

    modulus: Array
    viscosity: Array
    parameters: Array | None = None


@dataclass(frozen=True)
class Interval:
    """Time step in which a law goes from its memory to the state that it is asked for; of no length: at once."""

    begin: float
    end: float

    @property
    def length(self) -> float:
        """Length Δt of the step."""
        return self.end - self.begin


@dataclass(frozen=True)
class InternalVariable:
    """Quantity that a law remembers at each point, beside H, p and φ.

    Attributes
    ----------
    name
        As files have it.
    shape
        Of its value: () or (3, 3), a tensor in the axes of the body.
    group
        Variables of one group, such as stresses, share the largest value to which their errors in time are referred;
        empty: the error does not decide on the step.
    quantity
        Of ``porocore.core.units.QUANTITIES``; empty: a plain number, or that of the cell's parameter of this name.
    """

    name: str
    shape: tuple[()] | tuple[int, int] = ()
    group: str = ""
    quantity: str = ""

    @property
    def size(self) -> int:
        """Numbers of a value, 1 or 9."""
        return 9 if self.shape else 1


def columns_of(variables: Sequence[InternalVariable]) -> dict[str, slice]:
    """Return the columns of each variable among the numbers of all, by its name."""
    found, first = {}, 0
    for each in variables:
        found[each.name] = slice(first, first + each.size)
        first += each.size
    return found


@dataclass(frozen=True, eq=False)
class MemoryChanges(Batch):
    """Derivatives of a :class:`~porocore.interfaces.law.LawMemory` by k unknowns.

    Attributes
    ----------
    grad_u : (n, 3, 3, k)
        Of H.
    fluid_volume : (n, k)
        Of φ.
    internal : (n, v, k)
        Of the numbers of the internal variables.
    """

    grad_u: Array
    fluid_volume: Array
    internal: Array

    @classmethod
    def zeros(cls, n: int, v: int, k: int) -> MemoryChanges:
        """Return the changes of n points with v numbers of internal variables that nothing changes."""
        return cls(np.zeros((n, 3, 3, k)), np.zeros((n, k)), np.zeros((n, v, k)))


@dataclass(frozen=True, eq=False)
class ResponseChanges(Batch):
    """Derivatives of a :class:`~porocore.interfaces.law.MacroResponse` at fixed (H, p, ∇p), changes of the memory too.

    Attributes
    ----------
    stress : (n, 3, 3, k)
        Of P_E.
    storage : (n, k)
        Of the fluid taken up.
    flux : (n, 3, k)
        Of q.
    internal : (n, v, k)
        Of the numbers of the internal variables at the end.
    internal_grad_u : (n, v, 3, 3)
        Derivatives of these by H.
    internal_p : (n, v)
        Derivatives of these by p.
    internal_grad_p : (n, v, 3)
        Derivatives of these by ∇p; None: zero.
    potential : (n, k)
        Of the potential W; None: not known.
    """

    stress: Array
    storage: Array
    flux: Array
    internal: Array
    internal_grad_u: Array
    internal_p: Array
    internal_grad_p: Array | None = None
    potential: Array | None = None

    @classmethod
    def forgetful(cls, stress: Array, storage: Array, flux: Array) -> ResponseChanges:
        """Return the derivatives for a law without internal variables."""
        n, k = storage.shape
        return cls(stress, storage, flux, np.zeros((n, 0, k)), np.zeros((n, 0, 3, 3)), np.zeros((n, 0)))

    def moved(
        self, tangent: MacroTangent, before: MemoryChanges, grad_u: Array, p: Array, grad_p: Array
    ) -> tuple[ResponseChanges, MemoryChanges]:
        """Return the total derivatives of response and memory, where the state moves too.

        Parameters
        ----------
        tangent
            Of the response.
        before
            Derivatives of the memory from which the step began.
        grad_u, p, grad_p : (n, 3, 3, k), (n, k), (n, 3, k)
            Derivatives of H, p and ∇p.
        """
        n, k = p.shape
        H = grad_u.reshape(n, 9, k)

        def along(by_H: Array, by_p: Array, by_grad_p: Array | None, *shape: int) -> Array:
            slopes: Array = np.matmul(by_H.reshape(n, -1, 9), H)
            add_scaled(slopes, by_p.reshape(n, -1), p)
            if by_grad_p is not None:
                slopes += np.matmul(by_grad_p.reshape(n, -1, 3), grad_p)
            return slopes.reshape(n, *shape, k)

        t, v = tangent, self.internal.shape[1]
        total = replace(
            self,
            stress=self.stress + along(t.stress_grad_u, t.stress_p, t.stress_grad_p, 3, 3),
            storage=self.storage + along(t.storage_grad_u, t.storage_p, t.storage_grad_p),
            flux=self.flux + along(t.flux_grad_u, t.flux_p, t.flux_grad_p, 3),
        )
        internal = self.internal
        if v:
            internal = internal + along(self.internal_grad_u, self.internal_p, self.internal_grad_p, v)
        return total, MemoryChanges(grad_u, before.fluid_volume + total.storage, internal)


def add_scaled(total: Array, values: Array, factors: Array) -> None:
    """Add values (n, r) times factors (n, k), many of them zero, to ``total`` (n, r, k) in place."""
    for j in np.flatnonzero(factors.any(axis=0)):
        total[..., j] += values * factors[:, j, None]


@dataclass(frozen=True, eq=False)
class LawMemory(Batch):
    """State of a law at the last accepted time, for n points.

    What a step takes up is the change of the fluid volume, a number that does not depend on the axes or the parameters
    by which the next step sees the points. Tensors are in the axes of the body.

    Attributes
    ----------
    states
        (H, p; θ) and places; a law that sees the points in the axes of their material sees the tensors in the present
        ones, and the cell stood in ``states.place.axes`` of these (None: it still does).
    fluid_volume : (n,)
        φ, fluid volume per reference volume, from which the storage of the next step is counted.
    internal : (n, v)
        Numbers of the internal variables that the law declares, in their order.
    """

    states: MacroState
    fluid_volume: Array
    internal: Array

    @classmethod
    def forgetful(cls, states: MacroState, fluid_volume: Array) -> LawMemory:
        """Return the memory of a law without internal variables."""
        return cls(states, fluid_volume, np.zeros((len(states), 0)))


@dataclass(frozen=True, eq=False)
class UndeformedCells(Batch):
    """Facts of n undeformed cells of one family, one for each point of a body."""

    porosity: Array  #: (n,)  φ_f, from the cell law itself, so that its storage at rest is consistent
    conductivity: Array  #: (n, 3, 3)  K


@dataclass(frozen=True, eq=False)
class MacroTangent(Batch):
    """Exact derivatives of a :class:`MacroResponse` with respect to (H, p, ∇_X p); response indices first.

    Stress and storage depend on ∇_X p where the law has a memory that does; None: they do not.
    """

    stress_grad_u: Array  #: (n, 3, 3, 3, 3)
    stress_p: Array  #: (n, 3, 3)
    storage_grad_u: Array  #: (n, 3, 3)
    storage_p: Array  #: (n,)
    flux_grad_u: Array  #: (n, 3, 3, 3)  ∂q_i/∂H_kl
    flux_p: Array  #: (n, 3)
    flux_grad_p: Array  #: (n, 3, 3)
    stress_grad_p: Array | None = None  #: (n, 3, 3, 3)  ∂P_E,ij/∂(∇_X p)_k
    storage_grad_p: Array | None = None  #: (n, 3)


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
    mean_grad : (n, 3, 3)
        <∇_Y u¹>_s of the cell.
    cell_p : (n,)
        Pressure at which the cell is asked, which is p unless the law makes another one of it.
    doubt : (n,)
        Reasons not to rely on the cell law, :class:`~porocore.Doubt` as a number; 0: none.
    potential : (n,)
        W of the cell, with P_E = ∂W/∂H and φ = −∂W/∂p; None for a law without.
    """

    stress: Array
    storage: Array
    flux: Array
    memory: LawMemory
    deformation: Array
    volume_ratio: Array
    transformed_conductivity: Array
    mean_grad: Array
    cell_p: Array
    doubt: IntArray
    tangent: MacroTangent | None = None
    potential: Array | None = None

    @property
    def flagged(self) -> npt.NDArray[np.bool_]:
        """Points that are not to be relied on, (n,) bool."""
        flagged: npt.NDArray[np.bool_] = self.doubt != 0
        return flagged


class MacroLaw(ABC):
    """Stress, fluid storage and flux as functions of (H, p, ∇_X p) and of the last accepted state.

    A law may have a memory: internal variables (:attr:`internal`), of which the response depends, and which it hands
    back in the response's memory. The answer belongs to a step in time; without one the state has stood for long, so
    that nothing relaxes any more and nothing has evolved since the beginning.

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
    #: Names of the parameters that ``states.parameters`` holds, in this order: the cell's, then the law's own.
    parameters: tuple[str, ...] = ()
    #: What the law remembers beside H, p and φ, in the order of the numbers in a memory.
    internal: tuple[InternalVariable, ...] = ()

    @property
    def memory_size(self) -> int:
        """Number v of the numbers of all internal variables."""
        return sum(each.size for each in self.internal)

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

    def rest_changes(self, points: MacroState, changes: PointChanges) -> Array:
        """Return the derivatives (n, k) of the fluid volume of :meth:`initial_at`.

        A law whose cell holds another volume at rest where an unknown changes overrides this.
        """
        return np.zeros_like(changes.modulus)

    @abstractmethod
    def respond(
        self,
        states: MacroState,
        grad_p: Array,
        memory: LawMemory,
        *,
        step: Interval | None = None,
        tangent: bool = True,
    ) -> MacroResponse:
        """Return the response at n points at the end of a step; ``grad_p`` is ∇_X p (n, 3)."""

    def respond_to_each(
        self,
        states: MacroState,
        gradients: Sequence[Array],
        memory: LawMemory,
        *,
        step: Interval | None = None,
        tangent: bool = True,
    ) -> list[MacroResponse]:
        """Return the responses at the same n points to several gradients of the pressure, each (n, 3)."""
        return [self.respond(states, grad_p, memory, step=step, tangent=tangent) for grad_p in gradients]

    def respond_to_changes(
        self,
        states: MacroState,
        grad_p: Array,
        memory: LawMemory,
        changes: PointChanges,
        before: MemoryChanges,
        *,
        step: Interval | None = None,
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


class LawWrapper(MacroLaw):
    """Law that asks another law, which may see the points in another way.

    The methods ``…_in`` say how the inner law sees the points, and the methods ``…_out`` how its answers are taken
    back; here they change nothing. Everything that a macroscopic law is asked passes through them, so that a subclass
    overrides only what differs.

    Parameters
    ----------
    law
        The inner law.
    """

    def __init__(self, law: MacroLaw) -> None:
        self.law = law
        self.name, self.identity, self.noise = law.name, law.identity, law.noise
        self.parameters, self.constant_tangent = law.parameters, law.constant_tangent
        self.internal = law.internal

    def states_in(self, states: MacroState) -> MacroState:
        """Return states as the inner law sees them."""
        return states

    def gradient_in(self, grad_p: Array, states: MacroState) -> Array:
        """Return ∇_X p (n, 3) at points with ``states`` as the inner law sees it."""
        return grad_p

    def memory_in(self, memory: LawMemory, states: MacroState) -> LawMemory:
        """Return the memory of points with ``states`` as the inner law sees it."""
        return memory

    def changes_in(self, changes: PointChanges) -> PointChanges:
        """Return changes of points as the inner law sees them."""
        return changes

    def memory_changes_in(self, before: MemoryChanges, states: MacroState) -> MemoryChanges:
        """Return derivatives of the memory of points with ``states`` as the inner law sees them."""
        return before

    def memory_out(self, memory: LawMemory, states: MacroState) -> LawMemory:
        """Return a memory of the inner law as that of points with ``states``."""
        return memory

    def response_out(self, response: MacroResponse, states: MacroState) -> MacroResponse:
        """Return a response of the inner law as that of points with ``states``."""
        return replace(response, memory=self.memory_out(response.memory, states))

    def changes_out(self, changes: ResponseChanges, states: MacroState) -> ResponseChanges:
        """Return derivatives of a response of the inner law as those of points with ``states``."""
        return changes

    def parameters_of(self, region: int) -> tuple[str, ...]:
        """Return those of the inner law; see :class:`~porocore.interfaces.law.MacroLaw`."""
        return self.law.parameters_of(region)

    def initial(self, n: int) -> LawMemory:
        """Return the memory of the inner law at rest."""
        return self.law.initial(n)

    def initial_at(self, points: MacroState) -> LawMemory:
        """Return the memory of the inner law at rest, at its own points."""
        return self.memory_out(self.law.initial_at(self.states_in(points)), points.at_rest())

    def rest_changes(self, points: MacroState, changes: PointChanges) -> Array:
        """Return the derivatives of the inner law's fluid volume at rest, at its own points."""
        return self.law.rest_changes(self.states_in(points), self.changes_in(changes))

    def respond(
        self,
        states: MacroState,
        grad_p: Array,
        memory: LawMemory,
        *,
        step: Interval | None = None,
        tangent: bool = True,
    ) -> MacroResponse:
        """Return the response of the inner law; see :class:`~porocore.interfaces.law.MacroLaw`."""
        return self.respond_to_each(states, [grad_p], memory, step=step, tangent=tangent)[0]

    def respond_to_each(
        self,
        states: MacroState,
        gradients: Sequence[Array],
        memory: LawMemory,
        *,
        step: Interval | None = None,
        tangent: bool = True,
    ) -> list[MacroResponse]:
        """Return the responses of the inner law; see :class:`~porocore.interfaces.law.MacroLaw`."""
        seen = [self.gradient_in(grad_p, states) for grad_p in gradients]
        found = self.law.respond_to_each(
            self.states_in(states), seen, self.memory_in(memory, states), step=step, tangent=tangent
        )
        return [self.response_out(response, states) for response in found]

    def respond_to_changes(
        self,
        states: MacroState,
        grad_p: Array,
        memory: LawMemory,
        changes: PointChanges,
        before: MemoryChanges,
        *,
        step: Interval | None = None,
    ) -> tuple[MacroResponse, ResponseChanges]:
        """Return response and derivatives of the inner law; see :class:`~porocore.interfaces.law.MacroLaw`."""
        response, found = self.law.respond_to_changes(
            self.states_in(states),
            self.gradient_in(grad_p, states),
            self.memory_in(memory, states),
            self.changes_in(changes),
            self.memory_changes_in(before, states),
            step=step,
        )
        return self.response_out(response, states), self.changes_out(found, states)

    def before_accept(self, response: MacroResponse, memory: LawMemory) -> LawMemory | None:
        """Ask the inner law; see :class:`~porocore.interfaces.law.MacroLaw`."""
        reached = response.memory
        seen = replace(response, memory=self.memory_in(reached, reached.states))
        changed = self.law.before_accept(seen, self.memory_in(memory, memory.states))
        return None if changed is None else self.renewed(changed, memory)

    def renewed(self, inner: LawMemory, memory: LawMemory) -> LawMemory:
        """Return the ``memory`` of a step's beginning where the inner law, which has changed, has another one of it."""
        return self.memory_out(inner, memory.states)

    def reasons(self, states: MacroState) -> list[str]:
        """Return the reasons that the inner law knows; see :class:`~porocore.interfaces.law.MacroLaw`."""
        return self.law.reasons(self.states_in(states))


class ExtendedLaw(LawWrapper):
    """Law with parameters and internal variables of its own, which stand behind those of the law that it asks.

    Parameters
    ----------
    law
        The inner law.
    parameters
        Names of its own parameters.
    internal
        Its own internal variables, 0 at rest unless a subclass gives :meth:`own_at_rest`.
    """

    def __init__(
        self, law: MacroLaw, parameters: Sequence[str], internal: Sequence[InternalVariable]
    ) -> None:
        super().__init__(law)
        self.parameters = (*law.parameters, *parameters)
        self.internal = (*law.internal, *internal)
        self._own_names, self._count, self._size = tuple(parameters), len(law.parameters), law.memory_size

    def own_parameters(self, states: MacroState) -> Array:
        """Return the values (n, own) of its own parameters.

        Raises
        ------
        ConfigurationError
            The states have none.
        """
        if states.parameters is None:
            raise ConfigurationError(
                f"the law '{self.name}' has the parameters {', '.join(self.parameters)}, but no values were given"
            )
        return states.parameters[:, self._count :]

    def own_internal(self, values: Array) -> Array:
        """Return its own part (n, own, …) of numbers of the internal variables."""
        return values[:, self._size :]

    def own_at_rest(self, points: MacroState, inner: LawMemory) -> Array:
        """Return the numbers (n, own) of its own internal variables at rest, beside the inner law's memory there."""
        return np.zeros((len(points), self.memory_size - self._size))

    def parameters_of(self, region: int) -> tuple[str, ...]:
        """Return those of the inner law, and its own."""
        return (*self.law.parameters_of(region), *self._own_names)

    def states_in(self, states: MacroState) -> MacroState:
        """Return the states with the inner law's parameters alone."""
        theta = states.parameters
        if theta is None:
            return states
        return replace(states, parameters=theta[:, : self._count] if self._count else None)

    def memory_in(self, memory: LawMemory, states: MacroState) -> LawMemory:
        """Return the inner law's part of the memory."""
        internal = memory.internal[:, : self._size]
        return replace(memory, states=self.states_in(memory.states), internal=internal)

    def changes_in(self, changes: PointChanges) -> PointChanges:
        """Return the changes of the inner law's parameters alone."""
        theta = changes.parameters
        if theta is None:
            return changes
        return replace(changes, parameters=theta[:, : self._count] if self._count else None)

    def memory_changes_in(self, before: MemoryChanges, states: MacroState) -> MemoryChanges:
        """Return the derivatives of the inner law's part of the memory."""
        return replace(before, internal=before.internal[:, : self._size])

    def initial(self, n: int) -> LawMemory:
        """Refuse: its own parameters are given at the points; see :meth:`initial_at`.

        Raises
        ------
        ValueError
            Always.
        """
        raise ValueError(f"expected the parameters {', '.join(self.parameters)}; call initial_at")

    def initial_at(self, points: MacroState) -> LawMemory:
        """Return the memory at rest, with its own internal variables."""
        inner, rest = self.law.initial_at(self.states_in(points)), points.at_rest()
        internal = np.concatenate([inner.internal, self.own_at_rest(rest, inner)], axis=1)
        return replace(inner, states=rest, internal=internal)

    def renewed(self, inner: LawMemory, memory: LawMemory) -> LawMemory:
        """Return the memory with that of the inner law; its own internal variables stay."""
        internal = np.concatenate([inner.internal, self.own_internal(memory.internal)], axis=1)
        return replace(inner, states=memory.states, internal=internal)
