"""Laws of composed bodies: by region, nearest member, with bound parameters, in the axes of the material."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from typing import Any, TypeVar

import numpy as np

from porocore.cell.family.family import number, require_known
from porocore.core.fields import Batch
from porocore.errors import ConfigurationError
from porocore.interfaces.law import (
    Interval,
    LawMemory,
    LawWrapper,
    MacroLaw,
    MacroResponse,
    MacroTangent,
    MemoryChanges,
    PointChanges,
    ResponseChanges,
    columns_of,
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
        self.internal = tuple({each.name: each for law in self.laws for each in law.internal}.values())
        numbers, columns = np.arange(self.memory_size), columns_of(self.internal)
        nothing = numbers[:0]
        self._remembered = [
            np.concatenate([nothing, *(numbers[columns[each.name]] for each in law.internal)])
            for law in self.laws
        ]

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
            (rows, self._memory_back(law.initial_at(self._seen(points[rows], k)), k))
            for k, law, rows in self._regions(points)
        ]
        return replace(_joined(LawMemory, parts, len(points)), states=points.at_rest())

    def rest_changes(self, points: MacroState, changes: PointChanges) -> Array:
        """Return the derivatives of the fluid volume at rest, by the law of each point's region."""
        found = np.zeros_like(changes.modulus)
        for k, law, rows in self._regions(points):
            found[rows] = law.rest_changes(self._seen(points[rows], k), self._changes_seen(changes[rows], k))
        return found

    def respond(
        self,
        states: MacroState,
        grad_p: Array,
        memory: LawMemory,
        *,
        step: Interval | None = None,
        tangent: bool = True,
    ) -> MacroResponse:
        """Return the response of the law of each point's region."""
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
        """Return the responses to several gradients of the pressure; see :class:`MacroLaw`."""
        found: list[list[tuple[IntArray, MacroResponse]]] = [[] for _ in gradients]
        for k, law, rows in self._regions(states):
            responses = law.respond_to_each(
                self._seen(_chosen(states, rows, len(states)), k),
                [grad_p if len(rows) == len(states) else grad_p[rows] for grad_p in gradients],
                self._memory_seen(_chosen(memory, rows, len(states)), k),
                step=step,
                tangent=tangent,
            )
            for parts, response in zip(found, responses, strict=True):
                parts.append((rows, replace(response, memory=self._memory_back(response.memory, k))))
        joined = [_joined(MacroResponse, parts, len(states)) for parts in found]
        return [replace(each, memory=replace(each.memory, states=states)) for each in joined]

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
        """Return the responses of the laws and their derivatives; see :class:`MacroLaw`."""
        n, responses, found = len(states), [], []
        for k, law, rows in self._regions(states):
            response, derivatives = law.respond_to_changes(
                self._seen(_chosen(states, rows, n), k),
                grad_p if len(rows) == n else grad_p[rows],
                self._memory_seen(_chosen(memory, rows, n), k),
                self._changes_seen(_chosen(changes, rows, n), k),
                self._memory_changes_seen(_chosen(before, rows, n), k),
                step=step,
            )
            responses.append((rows, replace(response, memory=self._memory_back(response.memory, k))))
            found.append((rows, self._changes_back(derivatives, k)))
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
            parts.append((rows, self._memory_back(old if new is None else new, k)))
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
        """Return the memory with the parameters and internal variables of law ``k`` alone."""
        internal = memory.internal if self._remembers_all(k) else memory.internal[:, self._remembered[k]]
        return replace(memory, states=self._seen(memory.states, k), internal=internal)

    def _memory_changes_seen(self, before: MemoryChanges, k: int) -> MemoryChanges:
        if self._remembers_all(k):
            return before
        return replace(before, internal=before.internal[:, self._remembered[k]])

    def _memory_back(self, memory: LawMemory, k: int) -> LawMemory:
        """Return a memory of law ``k`` with all internal variables; those of other laws are 0."""
        return replace(memory, internal=self._among_all(memory.internal, k))

    def _changes_back(self, changes: ResponseChanges, k: int) -> ResponseChanges:
        by_grad_p = changes.internal_grad_p
        return replace(
            changes,
            internal=self._among_all(changes.internal, k),
            internal_grad_u=self._among_all(changes.internal_grad_u, k),
            internal_p=self._among_all(changes.internal_p, k),
            internal_grad_p=None if by_grad_p is None else self._among_all(by_grad_p, k),
        )

    def _remembers_all(self, k: int) -> bool:
        """Tell whether the internal variables of law ``k`` are all that there are, in their order."""
        return self.laws[k].internal == self.internal

    def _among_all(self, values: Array, k: int) -> Array:
        """Return numbers (n, own, …) of the internal variables of law ``k`` among those of all."""
        if self._remembers_all(k):
            return values
        found = np.zeros((len(values), self.memory_size, *values.shape[2:]))
        found[:, self._remembered[k]] = values
        return found


def _chosen(batch: B, rows: IntArray, n: int) -> B:
    """Return some of n points of a batch, and the batch itself where these are all."""
    return batch if len(rows) == n else batch[rows]


def _joined(kind: type[B], parts: Sequence[tuple[IntArray, B]], n: int) -> B:
    """Return a batch of n rows from parts, each with its rows; 0 where a part leaves out what another has."""
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
            whole = np.zeros((n, *first.shape[1:]), dtype=first.dtype)
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
        self._is_tensor = {each.name: bool(each.shape) for each in law.internal}

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
        return replace(memory, states=states, internal=self._turned(memory.internal, R.swapaxes(1, 2)))

    def memory_changes_in(self, before: MemoryChanges, states: MacroState) -> MemoryChanges:
        """Return the derivatives of the memory in the axes of the material."""
        R = _axes(states)
        if R is None:
            return before
        internal = self._turned(before.internal, R.swapaxes(1, 2))
        return replace(before, grad_u=_each_in(before.grad_u, R), internal=internal)

    def memory_out(self, memory: LawMemory, states: MacroState) -> LawMemory:
        """Return the memory in the axes of the body."""
        R = _axes(states)
        return (
            memory if R is None else replace(memory, states=states, internal=self._turned(memory.internal, R))
        )

    def _turned(self, internal: Array, R: Array) -> Array:
        """Return numbers (n, v) or (n, v, k) of the internal variables, of which tensors T become R T Rᵀ."""
        tensors = [columns for name, columns in columns_of(self.internal).items() if self._is_tensor[name]]
        if not tensors:
            return internal
        found, n = internal.copy(), len(internal)
        for columns in tensors:
            T = internal[:, columns].reshape(n, 3, 3, -1)
            found[:, columns] = _each_in(T, R.swapaxes(1, 2)).reshape(found[:, columns].shape)
        return found

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
            mean_grad=_back(response.mean_grad, R),
            tangent=None if response.tangent is None else _tangent_in_body(response.tangent, R),
        )

    def changes_out(self, changes: ResponseChanges, states: MacroState) -> ResponseChanges:
        """Return the derivatives of a response in the axes of the body."""
        R = _axes(states)
        if R is None:
            return changes
        by_grad_p = changes.internal_grad_p
        return replace(
            changes,
            stress=_each_in(changes.stress, R.swapaxes(1, 2)),
            flux=R @ changes.flux,
            internal=self._turned(changes.internal, R),
            internal_grad_u=self._turned(_by_tensor_back(changes.internal_grad_u, R), R),
            internal_p=self._turned(changes.internal_p, R),
            internal_grad_p=None if by_grad_p is None else self._turned(by_grad_p @ R.swapaxes(1, 2), R),
        )


def _axes(states: MacroState) -> Array | None:
    return None if states.place is None else states.place.axes


def _in(tensor: Array, R: Array) -> Array:
    """Return Rᵀ T R (n, 3, 3)."""
    return np.asarray(R.swapaxes(1, 2) @ tensor @ R)


def _back(tensor: Array, R: Array) -> Array:
    """Return R T Rᵀ (n, 3, 3)."""
    return np.asarray(R @ tensor @ R.swapaxes(1, 2))


def _each_in(tensors: Array, R: Array) -> Array:
    """Return Rᵀ T R of tensors (n, 3, 3, k)."""
    found: Array = np.einsum("nia,nijk,njb->nabk", R, tensors, R, optimize=True)
    return found


def _by_tensor_back(slopes: Array, R: Array) -> Array:
    """Return derivatives (n, v, 3, 3) by a tensor in the axes of the body."""
    return np.asarray(R[:, None] @ slopes @ R[:, None].swapaxes(2, 3))


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
    by_grad_p, storage_grad_p = tangent.stress_grad_p, tangent.storage_grad_p
    if by_grad_p is not None:
        by_grad_p = (pairs @ by_grad_p.reshape(n, 9, 3) @ R.swapaxes(1, 2)).reshape(n, 3, 3, 3)
    if storage_grad_p is not None:
        storage_grad_p = (R @ storage_grad_p[:, :, None])[..., 0]
    return MacroTangent(
        stress_grad_u=_fourth_rank_back(tangent.stress_grad_u, R),
        stress_p=_back(tangent.stress_p, R),
        storage_grad_u=_back(tangent.storage_grad_u, R),
        storage_p=tangent.storage_p,
        flux_grad_u=flux.reshape(n, 3, 3, 3),
        flux_p=(R @ tangent.flux_p[:, :, None])[..., 0],
        flux_grad_p=_back(tangent.flux_grad_p, R),
        stress_grad_p=by_grad_p,
        storage_grad_p=storage_grad_p,
    )
