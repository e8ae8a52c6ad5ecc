"""Base of laws that ask another law (LawWrapper): how it sees the points, and how its answers are taken back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from porocore.interfaces.law import LawMemory, MacroLaw, MacroResponse
from porocore.interfaces.law_changes import MemoryChanges, PointChanges, ResponseChanges
from porocore.states import Array, MacroState


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

    def respond(
        self, states: MacroState, grad_p: Array, memory: LawMemory, *, tangent: bool = True
    ) -> MacroResponse:
        """Return the response of the inner law; see :class:`~porocore.interfaces.law.MacroLaw`."""
        return self.respond_to_each(states, [grad_p], memory, tangent=tangent)[0]

    def respond_to_each(
        self, states: MacroState, gradients: Sequence[Array], memory: LawMemory, *, tangent: bool = True
    ) -> list[MacroResponse]:
        """Return the responses of the inner law; see :class:`~porocore.interfaces.law.MacroLaw`."""
        seen = [self.gradient_in(grad_p, states) for grad_p in gradients]
        found = self.law.respond_to_each(
            self.states_in(states), seen, self.memory_in(memory, states), tangent=tangent
        )
        return [self.response_out(response, states) for response in found]

    def respond_to_changes(
        self,
        states: MacroState,
        grad_p: Array,
        memory: LawMemory,
        changes: PointChanges,
        before: MemoryChanges,
    ) -> tuple[MacroResponse, ResponseChanges]:
        """Return response and derivatives of the inner law; see :class:`~porocore.interfaces.law.MacroLaw`."""
        response, found = self.law.respond_to_changes(
            self.states_in(states),
            self.gradient_in(grad_p, states),
            self.memory_in(memory, states),
            self.changes_in(changes),
            self.memory_changes_in(before, states),
        )
        return self.response_out(response, states), self.changes_out(found, states)

    def before_accept(self, response: MacroResponse, memory: LawMemory) -> LawMemory | None:
        """Ask the inner law; see :class:`~porocore.interfaces.law.MacroLaw`."""
        reached = response.memory
        seen = replace(response, memory=self.memory_in(reached, reached.states))
        changed = self.law.before_accept(seen, self.memory_in(memory, memory.states))
        return None if changed is None else self.memory_out(changed, memory.states)

    def reasons(self, states: MacroState) -> list[str]:
        """Return the reasons that the inner law knows; see :class:`~porocore.interfaces.law.MacroLaw`."""
        return self.law.reasons(self.states_in(states))
