"""Law of a body whose regions have laws of their own (RegionLaw)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from typing import Any, TypeVar

import numpy as np

from porocore.core.fields.batch import Batch
from porocore.errors import ConfigurationError
from porocore.interfaces.law import LawMemory, MacroLaw, MacroResponse, fingerprint
from porocore.interfaces.law_changes import MemoryChanges, PointChanges, ResponseChanges
from porocore.macro.composition.regions import Region, by_region
from porocore.states import Array, IntArray, MacroState

T = TypeVar("T", bound=Batch)


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
        return cls(by_region(regions, rest, others)) if others else rest

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


def _chosen(batch: T, rows: IntArray, n: int) -> T:
    """Return some of n points of a batch, and the batch itself where these are all."""
    return batch if len(rows) == n else batch[rows]


def _joined(kind: type[T], parts: Sequence[tuple[IntArray, T]], n: int) -> T:
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
