"""Laws of composed bodies: by region, nearest member, with bound parameters, in the axes of the material."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from typing import Any, TypeVar, overload

import numpy as np

from porocore.cell.family.family import number, require_known
from porocore.core.fields import Batch
from porocore.errors import ConfigurationError
from porocore.interfaces.law import (
    LawMemory,
    LawWrapper,
    MacroLaw,
    MacroResponse,
    MacroTangent,
    MemoryChanges,
    PointChanges,
    ResponseChanges,
    fingerprint,
)
from porocore.macro.composition.regions import Region, of_regions
from porocore.states import Array, IntArray, MacroState

B = TypeVar("B", bound=Batch)


class RegionLaw(MacroLaw):
    """A law that asks for each point the law of its region.

    The tangent is constant where that of each law is, and the noise is the largest. Parameters are those of all laws
    together, each name once.

    Parameters
    ----------
    laws
        Law of each region by the region's number: that of the rest of the body first, then the others in the order of
        the configuration.

    Raises
    ------
    ConfigurationError
        There is no law.
    """

    def __init__(self, laws: Sequence[MacroLaw]) -> None:
        if not laws:
            raise ConfigurationError("laws of regions: expected a law for each region, got none")
        self.laws = tuple(laws)
        self.name = " + ".join(dict.fromkeys(law.name for law in self.laws))
        self.identity = fingerprint("regions", *(law.identity for law in self.laws))
        self.noise = max(law.noise for law in self.laws)
        self.constant_tangent = all(law.constant_tangent for law in self.laws)
        self.parameters = tuple(dict.fromkeys(name for law in self.laws for name in law.parameters))
        first = {id(law): k for k, law in reversed(list(enumerate(self.laws)))}
        self._first_alike = np.array([first[id(law)] for law in self.laws])
        self._columns = [[self.parameters.index(name) for name in law.parameters] for law in self.laws]

    @classmethod
    def by_name(cls, regions: Sequence[str], laws: Mapping[str, MacroLaw], rest: MacroLaw) -> RegionLaw:
        """Return the law of ``regions``, by their names in the configuration; those without a law have ``rest``.

        Raises
        ------
        ConfigurationError
            A law is given for a region that is not there.
        """
        for name in laws:
            if name not in regions:
                known = ", ".join(regions) or "none"
                raise ConfigurationError(
                    f"laws of regions: there is no region '{name}'; the regions are {known}"
                )
        return cls([rest, *(laws.get(name, rest) for name in regions)])

    @classmethod
    def by_cell(
        cls, regions: Mapping[str, Region], rest: MacroLaw, others: Mapping[str, MacroLaw]
    ) -> MacroLaw:
        """Return the law of a body with ``regions``, by the law of each cell that they name.

        ``rest`` is that of the cell of the rest of the body, which is the law of all where there are no ``others``.
        """
        return cls(of_regions(regions, rest, others)) if others else rest

    def parameters_of(self, region: int) -> tuple[str, ...]:
        """Return those of the region's law; see :class:`MacroLaw`."""
        return self.laws[region].parameters if region < len(self.laws) else ()

    def initial(self, n: int) -> LawMemory:
        """Return the memory at rest of n points of the rest of the body."""
        return self.laws[0].initial(n)

    def initial_at(self, points: MacroState) -> LawMemory:
        """Return the memory at rest, by the law of each point's region."""
        parts = [
            (rows, law.initial_at(self._seen(points[rows], k))) for k, law, rows in self._regions(points)
        ]
        return replace(_joined(LawMemory, parts, len(points)), states=points.at_rest())

    def respond(
        self, states: MacroState, grad_p: Array, memory: LawMemory, *, tangent: bool = True
    ) -> MacroResponse:
        """Return the response of the law of each point's region."""
        return self.respond_to_each(states, [grad_p], memory, tangent=tangent)[0]

    def respond_to_each(
        self, states: MacroState, gradients: Sequence[Array], memory: LawMemory, *, tangent: bool = True
    ) -> list[MacroResponse]:
        """Return the responses to several gradients of the pressure; see :class:`MacroLaw`."""
        found: list[list[tuple[IntArray, MacroResponse]]] = [[] for _ in gradients]
        for k, law, rows in self._regions(states):
            responses = law.respond_to_each(
                self._seen(_chosen(states, rows, len(states)), k),
                [grad_p if len(rows) == len(states) else grad_p[rows] for grad_p in gradients],
                self._memory_seen(_chosen(memory, rows, len(states)), k),
                tangent=tangent,
            )
            for parts, response in zip(found, responses, strict=True):
                parts.append((rows, response))
        joined = [_joined(MacroResponse, parts, len(states)) for parts in found]
        return [replace(each, memory=replace(each.memory, states=states)) for each in joined]

    def respond_to_changes(
        self,
        states: MacroState,
        grad_p: Array,
        memory: LawMemory,
        changes: PointChanges,
        before: MemoryChanges,
    ) -> tuple[MacroResponse, ResponseChanges]:
        """Return the responses of the laws and their derivatives; see :class:`MacroLaw`."""
        n, responses, found = len(states), [], []
        for k, law, rows in self._regions(states):
            response, derivatives = law.respond_to_changes(
                self._seen(_chosen(states, rows, n), k),
                grad_p if len(rows) == n else grad_p[rows],
                self._memory_seen(_chosen(memory, rows, n), k),
                self._changes_seen(_chosen(changes, rows, n), k),
                _chosen(before, rows, n),
            )
            responses.append((rows, response))
            found.append((rows, derivatives))
        whole = _joined(MacroResponse, responses, n)
        whole = replace(whole, memory=replace(whole.memory, states=states))
        return whole, _joined(ResponseChanges, found, n)

    def before_accept(self, response: MacroResponse, memory: LawMemory) -> LawMemory | None:
        """Ask the law of each region; a changed memory of one leaves those of the others as they are."""
        parts, changed = [], False
        for k, law, rows in self._regions(response.memory.states):
            part = response[rows]
            part = replace(part, memory=self._memory_seen(part.memory, k))
            old = self._memory_seen(memory[rows], k)
            new = law.before_accept(part, old)
            changed |= new is not None
            parts.append((rows, old if new is None else new))
        if not changed:
            return None
        return replace(_joined(LawMemory, parts, len(memory.states)), states=memory.states)

    def reasons(self, states: MacroState) -> list[str]:
        """Return the reasons that the laws know; see :class:`MacroLaw`."""
        found = [""] * len(states)
        for k, law, rows in self._regions(states):
            for row, reason in zip(rows, law.reasons(self._seen(states[rows], k)), strict=True):
                found[row] = reason
        return found

    def _regions(self, states: MacroState) -> list[tuple[int, MacroLaw, IntArray]]:
        """Return each law that is asked, with the number of its first region and its points; regions may share one.

        Raises
        ------
        ValueError
            The states do not tell their region, or one of a region without a law.
        """
        if states.place is None:
            raise ValueError("expected states with the number of their region (place)")
        region = states.place.region
        if len(region) and not 0 <= region.min() <= region.max() < len(self.laws):
            raise ValueError(
                f"expected regions from 0 to {len(self.laws) - 1}, for which there are laws, got {region.max()}"
            )
        asked = self._first_alike[region]
        numbers = np.unique(asked) if self._first_alike.any() and len(region) else [0]
        return [(int(k), self.laws[k], np.flatnonzero(asked == k)) for k in numbers]

    def _seen(self, states: MacroState, k: int) -> MacroState:
        """Return the states with the parameters of law ``k`` alone, in its order."""
        theta = states.parameters
        if theta is not None and self._columns[k] == list(range(theta.shape[1])):
            return states
        return replace(
            states, parameters=theta[:, self._columns[k]] if theta is not None and self._columns[k] else None
        )

    def _changes_seen(self, changes: PointChanges, k: int) -> PointChanges:
        """Return the changes of the parameters of law ``k`` alone."""
        theta, columns = changes.parameters, self._columns[k]
        return replace(changes, parameters=theta[:, columns] if theta is not None and columns else None)

    def _memory_seen(self, memory: LawMemory, k: int) -> LawMemory:
        return replace(memory, states=self._seen(memory.states, k))


def _chosen(batch: B, rows: IntArray, n: int) -> B:
    """Return some of n points of a batch, and the batch itself where these are all."""
    return batch if len(rows) == n else batch[rows]


def _joined(kind: type[B], parts: Sequence[tuple[IntArray, B]], n: int) -> B:
    """Return a batch of n rows from parts, each with its rows; NaN where a part leaves out what another has."""
    if len(parts) == 1:
        return parts[0][1]
    values: dict[str, Any] = {}
    for f in fields(kind):  # type: ignore[arg-type]
        found = [(rows, getattr(part, f.name)) for rows, part in parts]
        there = [(rows, value) for rows, value in found if value is not None]
        if not there:
            values[f.name] = None
            continue
        first = there[0][1]
        if isinstance(first, MacroState):  # of a memory, which gets the states of all points
            values[f.name] = MacroState.zeros(n)
        elif isinstance(first, Batch):
            values[f.name] = _joined(type(first), there, n)
        else:
            whole = np.empty((n, *first.shape[1:]), dtype=first.dtype)
            if len(there) < len(found):
                whole[:] = np.nan
            for rows, value in there:
                whole[rows] = value
            values[f.name] = whole
    return kind(**values)


class NearestMemberLaw(RegionLaw):
    """A law that asks at each point the law of the member whose parameters lie nearest.

    Parameters
    ----------
    laws
        Laws of k members, which have no parameters themselves.
    values : (k, m)
        Parameters of the members.
    ranges
        Ranges of the m parameters by name, in which distances are measured.

    Raises
    ------
    ConfigurationError
        There is no law.
    """

    def __init__(
        self, laws: Sequence[MacroLaw], values: Array, ranges: dict[str, tuple[float, float]]
    ) -> None:
        super().__init__(laws)
        self.parameters = tuple(ranges)
        self._spans = np.array([high - low for low, high in ranges.values()])
        self._values = np.asarray(values, float)
        self.identity = fingerprint("members", self.identity, self._values)

    def parameters_of(self, region: int) -> tuple[str, ...]:
        """Return all names; see :class:`MacroLaw`."""
        return self.parameters

    def _regions(self, states: MacroState) -> list[tuple[int, MacroLaw, IntArray]]:
        """Return number, law and points of each member that is the nearest somewhere.

        Raises
        ------
        ValueError
            The states have no parameters.
        """
        if states.parameters is None:
            raise ValueError("expected states with parameters")
        away = (states.parameters[:, None, :] - self._values) / self._spans
        nearest = (away**2).sum(axis=2).argmin(axis=1)
        return [(int(k), self.laws[k], np.flatnonzero(nearest == k)) for k in np.unique(nearest)]

    def _seen(self, states: MacroState, k: int) -> MacroState:
        """Return the states without parameters, which a member has not."""
        return replace(states, parameters=None)

    def _changes_seen(self, changes: PointChanges, k: int) -> PointChanges:
        """Return the changes without parameters.

        Raises
        ------
        ConfigurationError
            A parameter changes, of which the nearest member does not know.
        """
        if changes.parameters is not None and changes.parameters.any():
            raise ConfigurationError(
                f"the law '{self.name}' of the nearest members of a family jumps with its parameters, so that a run "
                "has no sensitivities to them; choose a surrogate of the family"
            )
        return replace(changes, parameters=None)


class BoundLaw(LawWrapper):
    """A law with constants in place of some of its parameters; those that stay open are given with each state.

    Parameters
    ----------
    law
        Any law.
    values
        Constants by the name of the parameter.

    Raises
    ------
    ConfigurationError
        A name is no parameter of the law, or a value no finite number.
    """

    def __init__(self, law: MacroLaw, values: Mapping[str, float]) -> None:
        before: dict[str, float] = law.bound if isinstance(law, BoundLaw) else {}
        require_known(values, law.parameters, before)
        constants = {name: number(name, value) for name, value in values.items()}
        self.bound: dict[str, float] = before | constants
        super().__init__(law)
        self.parameters = tuple(name for name in law.parameters if name not in constants)
        self._row = np.array([constants.get(name, np.nan) for name in law.parameters])
        self._open = [law.parameters.index(name) for name in self.parameters]
        bound = (f"{name}={constants[name]!r}" for name in law.parameters if name in constants)
        self.identity = fingerprint("bound", law.identity, *bound)

    def completed(self, parameters: Array) -> Array:
        """Return the parameters of the law (n, all), given those that are open (n, open)."""
        found = np.tile(self._row, (len(parameters), 1))
        found[:, self._open] = parameters
        return found

    def parameters_of(self, region: int) -> tuple[str, ...]:
        """Return those of the law's that are open; see :class:`MacroLaw`."""
        return tuple(name for name in self.law.parameters_of(region) if name in self.parameters)

    def initial(self, n: int) -> LawMemory:
        """Return the memory at rest; see :class:`MacroLaw`."""
        return self.law.initial(n) if self.parameters else self.initial_at(MacroState.zeros(n))

    def states_in(self, states: MacroState) -> MacroState:
        """Return the states with all parameters; those without the open ones as they are, which the law refuses."""
        if not self.law.parameters or (self.parameters and states.parameters is None):
            return states
        given = np.zeros((len(states), 0)) if states.parameters is None else states.parameters
        return replace(states, parameters=self.completed(given))

    def memory_in(self, memory: LawMemory, states: MacroState) -> LawMemory:
        """Return the memory with all parameters."""
        return replace(memory, states=self.states_in(memory.states))

    def changes_in(self, changes: PointChanges) -> PointChanges:
        """Return the changes of all parameters; constants do not change."""
        n, k = changes.modulus.shape
        theta = np.zeros((n, len(self.law.parameters), k)) if self.law.parameters else None
        if theta is not None and changes.parameters is not None:
            theta[:, self._open] = changes.parameters
        return replace(changes, parameters=theta)

    def memory_out(self, memory: LawMemory, states: MacroState) -> LawMemory:
        """Return the memory, whose states have the open parameters alone."""
        return replace(memory, states=states)


class TurnedLaw(LawWrapper):
    """A law in the axes of its material: states are turned into them, and responses back into those of the body.

    With the rotation R of a point, whose columns are the material axes, the law is asked for Rᵀ H R, p and Rᵀ ∇p; it
    answers P, q and K, of which the body sees R P Rᵀ, R q and R K Rᵀ. Points without axes are left alone. Memories are
    in the axes of the body, so that a point may turn with time; the law sees them in the present axes, with the turn
    between these and those of their own time.
    """

    def __init__(self, law: MacroLaw) -> None:
        super().__init__(law)
        self.identity = fingerprint("turned", law.identity)

    def states_in(self, states: MacroState) -> MacroState:
        """Return the states in the axes of the material, at places that have no others."""
        return states.in_own_axes()

    def gradient_in(self, grad_p: Array, states: MacroState) -> Array:
        """Return Rᵀ ∇_X p."""
        R = _axes(states)
        return grad_p if R is None else (grad_p[:, None, :] @ R)[:, 0]

    def memory_in(self, memory: LawMemory, states: MacroState) -> LawMemory:
        """Return the memory in the axes that the material has in ``states``."""
        R = _axes(states)
        if R is None:
            return memory
        before, place = _axes(memory.states), memory.states.place
        turn = None if before is None or before is R else R.swapaxes(1, 2) @ before
        states = replace(
            memory.states,
            grad_u=_in(memory.states.grad_u, R),
            place=None if place is None else replace(place, axes=turn),
        )
        return replace(memory, states=states, mean_grad=_in(memory.mean_grad, R))

    def memory_changes_in(self, before: MemoryChanges, states: MacroState) -> MemoryChanges:
        """Return the derivatives of the memory in the axes of the material."""
        R = _axes(states)
        if R is None:
            return before
        return replace(before, grad_u=_each_in(before.grad_u, R), mean_grad=_each_in(before.mean_grad, R))

    def memory_out(self, memory: LawMemory, states: MacroState) -> LawMemory:
        """Return the memory in the axes of the body."""
        R = _axes(states)
        return memory if R is None else replace(memory, states=states, mean_grad=_back(memory.mean_grad, R))

    def response_out(self, response: MacroResponse, states: MacroState) -> MacroResponse:
        """Return the response in the axes of the body."""
        R = _axes(states)
        if R is None:
            return response
        return replace(
            response,
            stress=_back(response.stress, R),
            flux=(R @ response.flux[:, :, None])[..., 0],
            memory=self.memory_out(response.memory, states),
            deformation=_back(response.deformation, R),
            transformed_conductivity=_back(response.transformed_conductivity, R),
            tangent=None if response.tangent is None else _tangent_in_body(response.tangent, R),
        )

    def changes_out(self, changes: ResponseChanges, states: MacroState) -> ResponseChanges:
        """Return the derivatives of a response in the axes of the body."""
        R = _axes(states)
        return changes if R is None else _changes_in_body(changes, R)


def _axes(states: MacroState) -> Array | None:
    return None if states.place is None else states.place.axes


def _in(tensor: Array, R: Array) -> Array:
    """Return Rᵀ T R (n, 3, 3)."""
    return np.asarray(R.swapaxes(1, 2) @ tensor @ R)


def _back(tensor: Array, R: Array) -> Array:
    """Return R T Rᵀ (n, 3, 3)."""
    return np.asarray(R @ tensor @ R.swapaxes(1, 2))


@overload
def _each_in(tensors: Array, R: Array) -> Array: ...
@overload
def _each_in(tensors: None, R: Array) -> None: ...
def _each_in(tensors: Array | None, R: Array) -> Array | None:
    """Return Rᵀ T R of tensors (n, 3, 3, k)."""
    return None if tensors is None else np.einsum("nia,nijk,njb->nabk", R, tensors, R, optimize=True)


def _changes_in_body(changes: ResponseChanges, R: Array) -> ResponseChanges:
    back = R.swapaxes(1, 2)
    M, Q = changes.mean_grad_grad_u, changes.mean_grad_p
    return replace(
        changes,
        stress=_each_in(changes.stress, back),
        flux=R @ changes.flux,
        mean_grad=_each_in(changes.mean_grad, back),
        mean_grad_grad_u=None if M is None else _fourth_rank_back(M, R),
        mean_grad_p=None if Q is None else _back(Q, R),
    )


def _fourth_rank_back(tensor: Array, R: Array) -> Array:
    """Return a derivative of a tensor by a tensor (n, 3, 3, 3, 3) in the axes of the body."""
    n = len(R)
    # T ↦ R T Rᵀ of tensors as rows of 9.
    pairs = np.einsum("nia,njb->nijab", R, R).reshape(n, 9, 9)
    return np.asarray(pairs @ tensor.reshape(n, 9, 9) @ pairs.swapaxes(1, 2)).reshape(n, 3, 3, 3, 3)


def _tangent_in_body(tangent: MacroTangent, R: Array) -> MacroTangent:
    n = len(R)
    # T ↦ R T Rᵀ of tensors as rows of 9.
    pairs = np.einsum("nia,njb->nijab", R, R).reshape(n, 9, 9)
    back = pairs.swapaxes(1, 2)
    flux = R @ tangent.flux_grad_u.reshape(n, 3, 9) @ back
    return MacroTangent(
        stress_grad_u=_fourth_rank_back(tangent.stress_grad_u, R),
        stress_p=_back(tangent.stress_p, R),
        storage_grad_u=_back(tangent.storage_grad_u, R),
        storage_p=tangent.storage_p,
        flux_grad_u=flux.reshape(n, 3, 3, 3),
        flux_p=(R @ tangent.flux_p[:, :, None])[..., 0],
        flux_grad_p=_back(tangent.flux_grad_p, R),
    )
