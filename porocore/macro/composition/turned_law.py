"""Law of a body whose material axes are turned from point to point (TurnedLaw)."""

from __future__ import annotations

from dataclasses import replace
from typing import overload

import numpy as np

from porocore.interfaces.law import LawMemory, MacroLaw, MacroResponse, MacroTangent, fingerprint
from porocore.interfaces.law_changes import MemoryChanges, ResponseChanges
from porocore.interfaces.law_wrapper import LawWrapper
from porocore.states import Array, MacroState


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
