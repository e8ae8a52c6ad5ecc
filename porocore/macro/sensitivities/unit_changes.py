"""Unit changes of the points and of their memory (UnitChanges), whose derivatives give those by all unknowns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from porocore.interfaces.law import LawMemory, MacroLaw, MacroResponse
from porocore.interfaces.law_changes import MemoryChanges, PointChanges, ResponseChanges
from porocore.macro.sensitivities.point_weights import MemoryWeights, PointWeights
from porocore.states import Array, MacroState

#: Numbers of a memory: H, <∇u¹>_s and φ.
MEMORY = 9 + 9 + 1


@dataclass(frozen=True, eq=False)
class UnitDerivatives:
    """Response with its derivatives at fixed (H, p, ∇p).

    Attributes
    ----------
    response
        With its tangent.
    fixed
        Derivatives by the unit changes of the points.
    storage_memory : (n, 19)
        Derivatives of the storage by the numbers of the memory.
    """

    response: MacroResponse
    fixed: ResponseChanges
    storage_memory: Array

    def of_changes(self, weights: PointWeights, memory: MemoryWeights) -> Array:
        """Return the weights (n, c) of the unit changes of the points."""
        n, fixed = len(weights.storage), self.fixed
        found = (
            (weights.stress.reshape(n, 1, 9) @ fixed.stress.reshape(n, 9, -1))[:, 0]
            + weights.storage[:, None] * fixed.storage
            + (weights.flux[:, None, :] @ fixed.flux)[:, 0]
        )
        return np.asarray(found + self.of_memory_changes(memory))

    def of_memory_changes(self, memory: MemoryWeights) -> Array:
        """Return the same where the memory of the state alone counts."""
        n, fixed = len(memory.fluid_volume), self.fixed
        found = np.zeros_like(fixed.storage)
        if fixed.fluid_volume is not None:
            found = found + memory.fluid_volume[:, None] * fixed.fluid_volume
        if fixed.mean_grad is not None:
            found = found + (memory.mean_grad.reshape(n, 1, 9) @ fixed.mean_grad.reshape(n, 9, -1))[:, 0]
        return np.asarray(found)

    def of_memory(self, weights: PointWeights) -> MemoryWeights:
        """Return the weights of the memory from which the step began."""
        n = len(weights.storage)
        found = weights.storage[:, None] * self.storage_memory
        return MemoryWeights(found[:, :9].reshape(n, 3, 3), found[:, 9:18].reshape(n, 3, 3), found[:, 18])


class UnitChanges:
    """Unit changes of modulus, viscosity and parameters of all points, as far as unknowns change them.

    Parameters
    ----------
    changes
        Of all unknowns, at all points.
    """

    def __init__(self, changes: PointChanges) -> None:
        self.modulus, self.viscosity = bool(changes.modulus.any()), bool(changes.viscosity.any())
        #: Parameters that change, by their places.
        self.parameters: list[int] = []
        self._count = 0
        if changes.parameters is not None:
            self._count = changes.parameters.shape[1]
            self.parameters = np.flatnonzero(changes.parameters.any(axis=(0, 2))).tolist()

    @property
    def size(self) -> int:
        """Number c of unit changes."""
        return self.modulus + self.viscosity + len(self.parameters)

    def _points(self, n: int, columns: int) -> PointChanges:
        modulus, viscosity = np.zeros((n, columns)), np.zeros((n, columns))
        parameters = np.zeros((n, self._count, columns)) if self._count else None
        column = 0
        for wanted, part in ((self.modulus, modulus), (self.viscosity, viscosity)):
            if wanted:
                part[:, column] = 1.0
                column += 1
        for i in self.parameters:
            assert parameters is not None
            parameters[:, i, column] = 1.0
            column += 1
        return PointChanges(modulus, viscosity, parameters)

    def at_step(self, law: MacroLaw, states: MacroState, grad_p: Array, memory: LawMemory) -> UnitDerivatives:
        """Return the derivatives by the unit changes and by the memory."""
        n, c = len(states), self.size
        rows = np.zeros((MEMORY, c + MEMORY))
        rows[:, c:] = np.eye(MEMORY)
        everywhere = np.broadcast_to(rows, (n, *rows.shape))
        before = MemoryChanges(
            everywhere[:, :9].reshape(n, 3, 3, -1),
            everywhere[:, 9:18].reshape(n, 3, 3, -1),
            everywhere[:, 18],
        )
        response, found = law.respond_to_changes(states, grad_p, memory, self._points(n, c + MEMORY), before)
        return UnitDerivatives(response, _first(found, c), np.ascontiguousarray(found.storage[:, c:]))

    def at_rest(self, law: MacroLaw, states: MacroState) -> UnitDerivatives:
        """Return the derivatives by the unit changes of a law's own memory of a state."""
        n, still = len(states), np.zeros((len(states), 3))
        # One column at least, so that laws are asked for something.
        c = max(self.size, 1)
        response, found = law.respond_to_changes(
            states, still, law.initial_at(states), self._points(n, c), MemoryChanges.zeros(n, c)
        )
        return UnitDerivatives(response, _first(found, self.size), np.zeros((n, MEMORY)))

    def of_unknowns(self, weights: Array, changes: PointChanges) -> Array:
        """Return the gradient (k,) from the integrated weights (n, c) of the unit changes."""
        total, column = np.zeros(changes.modulus.shape[1]), 0
        for wanted, part in ((self.modulus, changes.modulus), (self.viscosity, changes.viscosity)):
            if wanted:
                total += weights[:, column] @ part
                column += 1
        for i in self.parameters:
            assert changes.parameters is not None
            total += weights[:, column] @ changes.parameters[:, i]
            column += 1
        return total


def _first(found: ResponseChanges, c: int) -> ResponseChanges:
    """Return the derivatives by the first c changes, in arrays of their own."""

    def first(part: Array) -> Array:
        return np.ascontiguousarray(part[..., :c])

    return ResponseChanges(
        first(found.stress),
        first(found.storage),
        first(found.flux),
        None if found.fluid_volume is None else _weighed(first(found.fluid_volume)),
        None if found.mean_grad is None else _weighed(first(found.mean_grad)),
        None if found.mean_grad_grad_u is None else _weighed(found.mean_grad_grad_u),
        None if found.mean_grad_p is None else _weighed(found.mean_grad_p),
    )


def _weighed(part: Array) -> Array:
    """Return a part of the memory with 0 at points whose law has none, where nothing weighs it."""
    return np.where(np.isnan(part), 0.0, part)
