"""Made-up undeformed cell, laws of it, and the confined column, for tests without cell solves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.interfaces.law import LawMemory, MacroLaw, MacroResponse
from porocore.macro.laws import ClosedLaw, LinearCellLaw, MeanGradientClosure
from porocore.macro.laws.linear import LinearCoefficients, LinearPoroelasticity
from porocore.macro.problem import Boundary, MacroProblem
from porocore.states import Array, CellResponse, CellTangent, MacroState, Status

#: φ_s and K of the made-up cell, close to those of three channels of radius 0.25 with μ_f = 1e-3.
SOLID_FRACTION = 0.5877
CONDUCTIVITY: Array = 1.94 * np.eye(3)


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


class AlteredLaw(MacroLaw):
    """A law whose responses are tampered with: ``alter`` receives the response, the states and the memory."""

    name = "altered"
    identity = "altered"

    def __init__(
        self, law: MacroLaw, alter: Callable[[MacroResponse, MacroState, LawMemory], MacroResponse]
    ) -> None:
        self._law, self._alter = law, alter

    def initial(self, n: int) -> LawMemory:
        """Return the memory of the given law."""
        return self._law.initial(n)

    def respond(
        self, states: MacroState, grad_p: Array, memory: LawMemory, *, tangent: bool = True
    ) -> MacroResponse:
        """Return the altered response."""
        response = self._law.respond(states, grad_p, memory, tangent=tangent)
        return self._alter(response, states, memory)


def without_large_steps(law: MacroLaw, limit: float) -> AlteredLaw:
    """No values wherever a component of H changes by more than ``limit`` within a step."""

    def alter(response: MacroResponse, states: MacroState, memory: LawMemory) -> MacroResponse:
        far = np.abs(states.grad_u - memory.states.grad_u).max(axis=(1, 2)) > limit
        return replace(response, stress=np.where(far[:, None, None], np.nan, response.stress))

    return AlteredLaw(law, alter)
