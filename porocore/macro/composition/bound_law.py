"""Law whose parameters are bound to constants, all of them or some (BoundLaw)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from porocore.cell.family.parameters import number, require_known
from porocore.interfaces.law import LawMemory, MacroLaw, MacroResponse, fingerprint
from porocore.interfaces.law_changes import MemoryChanges, PointChanges, ResponseChanges
from porocore.states import Array, MacroState


class BoundLaw(MacroLaw):
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
        self.law, self.name, self.noise = law, law.name, law.noise
        self.constant_tangent = law.constant_tangent
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

    def initial_at(self, points: MacroState) -> LawMemory:
        """Return the memory at rest with the constants; its states have the open parameters alone."""
        rest = replace(points, grad_u=np.zeros_like(points.grad_u), p=np.zeros_like(points.p))
        return replace(self.law.initial_at(self._whole(points)), states=rest)

    def respond(
        self, states: MacroState, grad_p: Array, memory: LawMemory, *, tangent: bool = True
    ) -> MacroResponse:
        """Return the response of the law; see :class:`MacroLaw`."""
        return self.respond_to_each(states, [grad_p], memory, tangent=tangent)[0]

    def respond_to_each(
        self, states: MacroState, gradients: Sequence[Array], memory: LawMemory, *, tangent: bool = True
    ) -> list[MacroResponse]:
        """Return the responses of the law; see :class:`MacroLaw`."""
        found = self.law.respond_to_each(self._whole(states), gradients, self._seen(memory), tangent=tangent)
        return [replace(each, memory=replace(each.memory, states=states)) for each in found]

    def respond_to_changes(
        self,
        states: MacroState,
        grad_p: Array,
        memory: LawMemory,
        changes: PointChanges,
        before: MemoryChanges,
    ) -> tuple[MacroResponse, ResponseChanges]:
        """Return the response of the law and its derivatives; constants do not change. See :class:`MacroLaw`."""
        n, k = changes.modulus.shape
        theta = np.zeros((n, len(self.law.parameters), k)) if self.law.parameters else None
        if theta is not None and changes.parameters is not None:
            theta[:, self._open] = changes.parameters
        whole = replace(changes, parameters=theta)
        response, found = self.law.respond_to_changes(
            self._whole(states), grad_p, self._seen(memory), whole, before
        )
        return replace(response, memory=replace(response.memory, states=states)), found

    def before_accept(self, response: MacroResponse, memory: LawMemory) -> LawMemory | None:
        """Ask the law, whose states have all parameters; see :class:`MacroLaw`."""
        seen = replace(response, memory=self._seen(response.memory))
        changed = self.law.before_accept(seen, self._seen(memory))
        return None if changed is None else replace(changed, states=memory.states)

    def reasons(self, states: MacroState) -> list[str]:
        """Return the reasons that the law knows; see :class:`MacroLaw`."""
        return self.law.reasons(self._whole(states))

    def _whole(self, states: MacroState) -> MacroState:
        """Return the states with all parameters; those without the open ones as they are, which the law refuses."""
        if not self.law.parameters or (self.parameters and states.parameters is None):
            return states
        given = np.zeros((len(states), 0)) if states.parameters is None else states.parameters
        return replace(states, parameters=self.completed(given))

    def _seen(self, memory: LawMemory) -> LawMemory:
        return replace(memory, states=self._whole(memory.states))
