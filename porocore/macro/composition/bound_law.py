"""Law whose parameters are bound to constants, all of them or some (BoundLaw)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from porocore.cell.family.family import number, require_known
from porocore.interfaces.law import LawMemory, LawWrapper, MacroLaw, PointChanges, fingerprint
from porocore.states import Array, MacroState


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
