"""Derivatives of made-up cells; made-up undeformed cell, its laws, and the confined column, for tests."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.core.inputs import flatten
from porocore.interfaces.law import (
    Interval,
    LawMemory,
    LawWrapper,
    MacroLaw,
    MacroResponse,
    MemoryChanges,
    PointChanges,
    ResponseChanges,
)
from porocore.macro.laws.closure import MeanGradientClosure
from porocore.macro.laws.composed import BoundLaw
from porocore.macro.laws.linear import LinearCellLaw, LinearCoefficients, LinearPoroelasticity
from porocore.macro.laws.macro_law import CHUNK, ClosedLaw
from porocore.macro.laws.relaxation import RelaxingLaw
from porocore.macro.problem import Boundary, MacroProblem
from porocore.states import Array, CellResponse, CellSlopes, CellTangent, MacroState, Status

#: φ_s and K of the made-up cell, close to those of three channels of radius 0.25 with μ_f = 1e-3.
SOLID_FRACTION = 0.5877
CONDUCTIVITY: Array = 1.94 * np.eye(3)


#: A made-up cell: responses by name at real or complex z (n, 10 + m), which are H row by row, p and the parameters.
Values = Callable[[Any], dict[str, Any]]
#: Step of the derivatives: a power of two, so that nothing is rounded by it.
STEP = 2.0**-100


def respond_by(
    values: Values, states: MacroState, *, hidden: tuple[str, ...] = (), tangent: bool = True
) -> CellResponse:
    """Return the responses of a made-up cell with their derivatives, and with slopes where it has parameters.

    Parameters
    ----------
    values
        The cell.
    states
        n states, with its parameters.
    hidden
        Names of values that are no responses, of which the slopes alone are known.
    tangent
        Whether derivatives and slopes are wanted.
    """
    found = {name: np.real(x) for name, x in values(flatten(states)).items() if name not in hidden}
    response = CellResponse(status=np.full(len(states), int(Status.converged), dtype=np.int64), **found)
    if not tangent:
        return response
    by, slopes = complex_steps(values, states), None
    derivatives = {}
    for name in ("mean_grad", "stress", "fluid_volume"):
        derivatives[f"{name}_grad_u"], derivatives[f"{name}_p"] = by_state(by[name])
    if states.parameter_count:
        slopes = CellSlopes(**{name: x[..., 10:].copy() for name, x in by.items()})
    return replace(response, tangent=CellTangent(**derivatives), slopes=slopes)


def complex_steps(values: Values, states: MacroState) -> dict[str, Array]:
    """Return the derivatives of values, exact to round-off, by H row by row, p and the parameters on the last axis."""
    z = flatten(states)
    count = z.shape[1]
    steps = 1j * STEP * np.eye(count)[:, None]
    # So many states at a time that a large body needs no more memory for them than for its matrix.
    parts = [values((part + steps).reshape(-1, count)) for part in np.array_split(z, len(z) // CHUNK + 1)]
    joined = {
        name: np.concatenate([np.imag(part[name]).reshape(count, -1, *x.shape[1:]) for part in parts], axis=1)
        for name, x in parts[0].items()
    }
    return {name: np.moveaxis(x / STEP, 0, -1) for name, x in joined.items()}


def by_state(slopes: Array) -> tuple[Array, Array]:
    """Return the derivatives by H (..., 3, 3) and by p (...) of those of :func:`complex_steps`."""
    return slopes[..., :9].reshape(*slopes.shape[:-1], 3, 3), slopes[..., 9].copy()


def cubic_reference(
    poisson_ratio: float = 0.35, normal: float = -0.2297, lateral: float = -0.0754, shear: float = -0.11
) -> CellResponse:
    """Response of an undeformed cell with cubic symmetry (one row, with tangent).

    M_iiii, M_iijj and M_ijij = M_ijji are ``normal``, ``lateral`` and ``shear``; Q follows from the identity
    Q_ii = (1 − 2ν)(M_iiii + 2 M_iijj) that holds for pores of any shape in a homogeneous isotropic solid.
    """
    i = np.eye(3)
    one = np.einsum("ia,ja,ka,la->ijkl", i, i, i, i)
    volume = np.einsum("ij,kl->ijkl", i, i)
    mixed = np.einsum("ik,jl->ijkl", i, i) + np.einsum("il,jk->ijkl", i, i)
    M: Array = (normal - lateral - 2 * shear) * one + lateral * volume + shear * mixed
    Q: Array = (1 - 2 * poisson_ratio) * np.einsum("ijkk->ij", M)
    return CellResponse(
        mean_grad=np.zeros((1, 3, 3)),
        status=np.array([int(Status.converged)]),
        tangent=CellTangent(mean_grad_grad_u=M[None], mean_grad_p=Q[None]),
    )


def confined_column(
    elements: int | tuple[int, int, int], load: float = -1e-3, **settings: Any
) -> MacroProblem:
    """A column of 0.1 × 7.5 × 0.1, loaded and drained on top, no lateral displacement, bottom fixed.

    ``elements`` of a column of one element's width are counted along its height; ``load`` < 0 compresses;
    ``settings`` go to :class:`porocore.macro.problem.MacroProblem`.
    """
    side = Boundary(displacement=(0, None, 0))
    faces = {face: side for face in ("x-", "x+", "z-", "z+")}
    bottom, top = Boundary(displacement=(0, 0, 0)), Boundary(traction=(0, 1, 0), pressure=0)
    counts = (1, elements, 1) if isinstance(elements, int) else elements
    body = {"kind": "box", "elements": counts, "size": settings.pop("size", (0.1, 7.5, 0.1))}
    data = {"body": body, "boundary": {**faces, "y-": bottom, "y+": top}, "load": load}
    return MacroProblem.model_validate(data | settings)


def linear_law() -> LinearPoroelasticity:
    """Linear poroelasticity of the made-up cell."""
    return LinearPoroelasticity(
        LinearCoefficients.from_reference(cubic_reference(), SOLID_FRACTION, NeoHookean(), CONDUCTIVITY)
    )


def mean_gradient_law(reference: CellResponse | None = None) -> ClosedLaw:
    """The mean-gradient closure on the linear law <∇u¹>_s = M:H + Q p: a nonlinear law that costs nothing."""
    cell_law = LinearCellLaw(cubic_reference() if reference is None else reference)
    return ClosedLaw(cell_law, MeanGradientClosure(SOLID_FRACTION, NeoHookean(), CONDUCTIVITY))


def relaxing_law(*branches: tuple[float, float]) -> BoundLaw:
    """The mean-gradient closure of a solid with relaxing branches, strength γ and time τ of each."""
    law = RelaxingLaw(mean_gradient_law(), len(branches))
    return BoundLaw(law, dict(zip(law.parameters, (x for branch in branches for x in branch), strict=True)))


#: ∂P_E/∂(∇p) and ∂φ/∂(∇p) of a made-up law; no component is zero, and no two are alike.
STRESS_GRAD_P: Array = 0.02 * np.cos(np.arange(1.0, 28.0)).reshape(3, 3, 3)
STORAGE_GRAD_P: Array = 0.02 * np.cos(np.arange(28.0, 31.0))


class GradientLaw(LawWrapper):
    """A law whose stress and fluid volume grow with ∇_X p too, at the rates STRESS_GRAD_P and STORAGE_GRAD_P."""

    def __init__(self, law: MacroLaw) -> None:
        super().__init__(law)
        self.name = self.identity = f"{law.name} by ∇p"

    def respond_to_each(
        self,
        states: MacroState,
        gradients: Sequence[Array],
        memory: LawMemory,
        *,
        step: Interval | None = None,
        tangent: bool = True,
    ) -> list[MacroResponse]:
        """Return the responses of the inner law and what the gradients add to them."""
        found = super().respond_to_each(states, gradients, memory, step=step, tangent=tangent)
        return [self._moved(*pair) for pair in zip(found, gradients, strict=True)]

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
        """Return the same with the derivatives of the inner law and that of φ by the modulus, in whose units ∇p is."""
        response, found = super().respond_to_changes(states, grad_p, memory, changes, before, step=step)
        stored = -(grad_p @ STORAGE_GRAD_P)[:, None] * changes.modulus
        return self._moved(response, grad_p), replace(found, storage=found.storage + stored)

    @staticmethod
    def _moved(response: MacroResponse, grad_p: Array) -> MacroResponse:
        n, stored, tangent = len(grad_p), grad_p @ STORAGE_GRAD_P, response.tangent
        if tangent is not None:
            tangent = replace(
                tangent,
                stress_grad_p=np.broadcast_to(STRESS_GRAD_P, (n, 3, 3, 3)),
                storage_grad_p=np.broadcast_to(STORAGE_GRAD_P, (n, 3)),
            )
        return replace(
            response,
            stress=response.stress + np.tensordot(grad_p, STRESS_GRAD_P, axes=(1, 2)),
            storage=response.storage + stored,
            memory=replace(response.memory, fluid_volume=response.memory.fluid_volume + stored),
            tangent=tangent,
        )


class AlteredLaw(MacroLaw):
    """A law whose responses are tampered with: ``alter`` receives the response, the states and the memory."""

    name = "altered"
    identity = "altered"

    def __init__(
        self, law: MacroLaw, alter: Callable[[MacroResponse, MacroState, LawMemory], MacroResponse]
    ) -> None:
        self._law, self._alter, self.internal = law, alter, law.internal

    def initial(self, n: int) -> LawMemory:
        """Return the memory of the given law."""
        return self._law.initial(n)

    def respond(
        self,
        states: MacroState,
        grad_p: Array,
        memory: LawMemory,
        *,
        step: Interval | None = None,
        tangent: bool = True,
    ) -> MacroResponse:
        """Return the altered response."""
        response = self._law.respond(states, grad_p, memory, step=step, tangent=tangent)
        return self._alter(response, states, memory)


def without_large_steps(law: MacroLaw, limit: float) -> AlteredLaw:
    """No values wherever a component of H changes by more than ``limit`` within a step."""

    def alter(response: MacroResponse, states: MacroState, memory: LawMemory) -> MacroResponse:
        far = np.abs(states.grad_u - memory.states.grad_u).max(axis=(1, 2)) > limit
        return replace(response, stress=np.where(far[:, None, None], np.nan, response.stress))

    return AlteredLaw(law, alter)
