"""Law of a body whose material axes are turned from point to point (TurnedLaw)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import overload

import numpy as np

from porocore.interfaces.law import LawMemory, MacroLaw, MacroResponse, MacroTangent, fingerprint
from porocore.interfaces.law_changes import MemoryChanges, PointChanges, ResponseChanges
from porocore.states import Array, MacroState


class TurnedLaw(MacroLaw):
    """A law in the axes of its material: states are turned into them, and responses back into those of the body.

    With the rotation R of a point, whose columns are the material axes, the law is asked for Rᵀ H R, p and Rᵀ ∇p; it
    answers P, q and K, of which the body sees R P Rᵀ, R q and R K Rᵀ. Points without axes are left alone. Memories are
    in the axes of the body, so that a point may turn with time.
    """

    def __init__(self, law: MacroLaw) -> None:
        self.law = law
        self.name, self.noise, self.parameters = law.name, law.noise, law.parameters
        self.identity = fingerprint("turned", law.identity)
        self.constant_tangent = law.constant_tangent

    def parameters_of(self, region: int) -> tuple[str, ...]:
        """Return those of the law; see :class:`MacroLaw`."""
        return self.law.parameters_of(region)

    def initial(self, n: int) -> LawMemory:
        """Return the memory of the law, whose axes are those of the body."""
        return self.law.initial(n)

    def initial_at(self, points: MacroState) -> LawMemory:
        """Return the memory at rest in the axes of the body."""
        R = _axes(points)
        if R is None:
            return self.law.initial_at(points)
        memory = self.law.initial_at(_in_material(points, R))
        rest = replace(points, grad_u=np.zeros_like(points.grad_u), p=np.zeros_like(points.p))
        return replace(memory, states=rest, mean_grad=_back(memory.mean_grad, R))

    def respond(
        self, states: MacroState, grad_p: Array, memory: LawMemory, *, tangent: bool = True
    ) -> MacroResponse:
        """Return the response in the axes of the body."""
        return self.respond_to_each(states, [grad_p], memory, tangent=tangent)[0]

    def respond_to_each(
        self, states: MacroState, gradients: Sequence[Array], memory: LawMemory, *, tangent: bool = True
    ) -> list[MacroResponse]:
        """Return the responses in the axes of the body; see :class:`MacroLaw`."""
        R = _axes(states)
        if R is None:
            return self.law.respond_to_each(states, gradients, memory, tangent=tangent)
        turned = [(grad_p[:, None, :] @ R)[:, 0] for grad_p in gradients]
        found = self.law.respond_to_each(
            _in_material(states, R), turned, _memory_in_material(memory, R), tangent=tangent
        )
        return [_in_body(response, states, R) for response in found]

    def respond_to_changes(
        self,
        states: MacroState,
        grad_p: Array,
        memory: LawMemory,
        changes: PointChanges,
        before: MemoryChanges,
    ) -> tuple[MacroResponse, ResponseChanges]:
        """Return response and derivatives in the axes of the body; see :class:`MacroLaw`."""
        R = _axes(states)
        if R is None:
            return self.law.respond_to_changes(states, grad_p, memory, changes, before)
        turned = replace(before, grad_u=_each_in(before.grad_u, R), mean_grad=_each_in(before.mean_grad, R))
        response, found = self.law.respond_to_changes(
            _in_material(states, R),
            (grad_p[:, None, :] @ R)[:, 0],
            _memory_in_material(memory, R),
            changes,
            turned,
        )
        return _in_body(response, states, R), _changes_in_body(found, R)

    def before_accept(self, response: MacroResponse, memory: LawMemory) -> LawMemory | None:
        """Ask the law, which sees the memories in its own axes; see :class:`MacroLaw`."""
        R, before = _axes(response.memory.states), _axes(memory.states)
        if R is None or before is None:
            return self.law.before_accept(response, memory)
        seen = replace(response, memory=_memory_in_material(response.memory, R))
        changed = self.law.before_accept(seen, _memory_in_material(memory, before))
        if changed is None:
            return None
        return replace(changed, states=memory.states, mean_grad=_back(changed.mean_grad, before))

    def reasons(self, states: MacroState) -> list[str]:
        """Return the reasons that the law knows for the turned states; see :class:`MacroLaw`."""
        R = _axes(states)
        return self.law.reasons(states if R is None else _in_material(states, R))


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


def _in_material(states: MacroState, R: Array) -> MacroState:
    """Return the states in the axes of the material, at places that have no others."""
    place = None if states.place is None else replace(states.place, axes=None)
    return replace(states, grad_u=_in(states.grad_u, R), place=place)


def _memory_in_material(memory: LawMemory, R: Array) -> LawMemory:
    return replace(memory, states=_in_material(memory.states, R), mean_grad=_in(memory.mean_grad, R))


def _in_body(response: MacroResponse, states: MacroState, R: Array) -> MacroResponse:
    memory = replace(response.memory, states=states, mean_grad=_back(response.memory.mean_grad, R))
    return replace(
        response,
        stress=_back(response.stress, R),
        flux=(R @ response.flux[:, :, None])[..., 0],
        memory=memory,
        deformation=_back(response.deformation, R),
        transformed_conductivity=_back(response.transformed_conductivity, R),
        tangent=None if response.tangent is None else _tangent_in_body(response.tangent, R),
    )


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
