"""Material response at the quadrature points of the solid: energy, stress, tangent stiffness of elements.

Arrays at quadrature points are component-first, (3, 3, points), element by element.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property
from typing import Protocol

import numpy as np

from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.cell.materials.material import StrainEnergy
from porocore.core.tensors import add_cofactor_tangent
from porocore.states import Array
from porocore_fem_skfem.operators import Operators, Parts, Scatter, empty_blocks

#: Numbers in a batch of element blocks that fits into the processor's cache.
CACHED = 60_000


class PointKinematics(Protocol):
    """Kinematics of one iterate at the quadrature points."""

    F: Array  #: (3, 3, points)  deformation gradient
    cof: Array  #: (3, 3, points)  its cofactor
    J: Array  #: (points,)  det F
    p: float  #: pore pressure


class SolidResponse(ABC):
    """Response of one material on one mesh; ``scatter`` sums element blocks into the stiffness."""

    def __init__(self, material: StrainEnergy, operators: Operators, scatter: Scatter) -> None:
        self.material, self.scatter = material, scatter
        self.grad_N, self.w = operators.grad_N, operators.weights

    @abstractmethod
    def energy_density(self, at: PointKinematics) -> Array:
        """Return Ψ (points)."""

    @abstractmethod
    def stress(self, at: PointKinematics) -> Array:
        """Return P + p cof F (3, 3, points)."""

    @abstractmethod
    def tangent_apply(self, at: PointKinematics, dF: Array) -> Array:
        """Return A:δF + p δcof F (3, 3, points) for δF (3, 3, points) or (3, 3, 1)."""

    @abstractmethod
    def stiffness(self, at: PointKinematics) -> Array:
        """Return the entries of the upper triangle of ∂²Π/∂u², in the order of the scatter's pattern."""


class GeneralResponse(SolidResponse):
    """Response of any strain energy, by its stress and its tangent A_ijkl."""

    _of: PointKinematics | None = None
    _moduli: Array

    def _by_element(self, F: Array) -> Array:
        """Return a view (elements, points of each, 3, 3)."""
        e, q = self.grad_N.shape[:2]
        return np.moveaxis(F.reshape(3, 3, e, q), (0, 1), (-2, -1))

    def energy_density(self, at: PointKinematics) -> Array:
        return self.material.energy_density(self._by_element(at.F)).reshape(-1)

    def stress(self, at: PointKinematics) -> Array:
        P = np.moveaxis(self.material.stress(self._by_element(at.F)), (-2, -1), (0, 1))
        return P.reshape(3, 3, -1) + at.p * at.cof

    def moduli(self, at: PointKinematics) -> Array:
        """Return A + p ∂cof F/∂F (3, 3, 3, 3, points), kept for the last iterate."""
        if self._of is not at:
            A = self.material.tangent(self._by_element(at.F))
            self._moduli = np.moveaxis(A, (-4, -3, -2, -1), (0, 1, 2, 3)).reshape(3, 3, 3, 3, -1)
            if at.p:
                add_cofactor_tangent(self._moduli, at.p * at.F)
            self._of = at
        return self._moduli

    def tangent_apply(self, at: PointKinematics, dF: Array) -> Array:
        moduli, changes = self.moduli(at), np.zeros((3, 3, at.J.size))
        for k in range(3):
            for l in range(3):
                if dF[k, l].any():
                    changes += moduli[:, :, k, l] * dF[k, l]
        return changes

    def stiffness(self, at: PointKinematics) -> Array:
        e, q, a, _ = self.grad_N.shape
        weighted = (self.moduli(at) * self.w).reshape(3, 3, 3, 3, e, q)
        chunk = max(1, CACHED // (3 * a) ** 2)

        def blocks_of(elements: slice) -> Parts:
            some = range(e)[elements]
            blocks = empty_blocks(len(some), a)
            for start in range(0, len(some), chunk):
                part = slice(some[start], some[start] + len(some[start : start + chunk]))
                grad = self.grad_N[part]
                n = len(grad)
                # Σ_ql grad_bl (Σ_j grad_aj A_ijkl) as two batched products
                A = weighted[..., part, :].transpose(4, 5, 1, 0, 2, 3).reshape(n, q, 3, 27)
                half = np.matmul(grad, A).reshape(n, q, a, 3, 3, 3).transpose(0, 3, 4, 2, 1, 5)
                right = grad.transpose(0, 1, 3, 2).reshape(n, 3 * q, a)
                full = np.matmul(half.reshape(n, 9 * a, 3 * q), right).reshape(n, 3, 3, a, a)
                blocks[start : start + n] = full.transpose(0, 1, 3, 2, 4)
            return self.scatter.parts(blocks)

        return self.scatter.sum_of(blocks_of)


class NeoHookeanResponse(SolidResponse):
    """Response of the neo-Hookean solid, whose stiffness is a constant Laplacian and terms of rank one in F⁻ᵀ∇N.

    It is faster than by the tangent A_ijkl.
    """

    def __init__(self, material: NeoHookean, operators: Operators, scatter: Scatter) -> None:
        super().__init__(material, operators, scatter)
        self.mu, self.volumetric = material.mu, material.volumetric
        self._laplacian = self._constant_blocks(operators)

    def energy_density(self, at: PointKinematics) -> Array:
        return np.asarray(
            self.mu / 2 * ((at.F * at.F).sum(axis=(0, 1)) - 3) + self.volumetric(np.log(at.J))[0]
        )

    def stress(self, at: PointKinematics) -> Array:
        first = self.volumetric(np.log(at.J))[1]
        return self.mu * at.F + (first / at.J + at.p) * at.cof

    def tangent_apply(self, at: PointKinematics, dF: Array) -> Array:
        G = at.cof / at.J  # F⁻ᵀ
        _, first, second = self.volumetric(np.log(at.J))
        pJ = at.p * at.J
        trace = (G * dF).sum(axis=(0, 1))
        # G_il δF_kl G_kj = (G δFᵀ G)_ij; a load moves one or a few components of all points alike.
        swapped = np.zeros_like(G)
        for k, l in np.ndindex(3, 3):
            if dF[k, l].any():
                swapped += (dF[k, l] * G[:, l])[:, None] * G[k]
        return np.asarray((second + pJ) * trace * G - (first + pJ) * swapped + self.mu * dF)

    def stiffness(self, at: PointKinematics) -> Array:
        _, first, second = self.volumetric(np.log(at.J))
        pJ = at.p * at.J
        # Blocks w (d ga⊗gb − c gb⊗ga) with ga = F⁻ᵀ∇N_a
        d, c = self.w * (second + pJ), self.w * (first + pJ)
        G = at.cof / at.J
        if self.grad_N.shape[1] == 1:
            return self._at_one_point(G, d, c) + self._laplacian
        e, q, a, _ = self.grad_N.shape
        d, c = d.reshape(e, q, 1), c.reshape(e, q, 1)
        F_inverse = G.reshape(3, 3, e, q).transpose(2, 3, 1, 0)
        chunk = max(1, CACHED // (3 * a) ** 2)

        def blocks_of(elements: slice) -> Parts:
            inverse = np.ascontiguousarray(F_inverse[elements])
            g = np.matmul(self.grad_N[elements], inverse).transpose(0, 1, 3, 2).reshape(-1, q, 3 * a)
            d_g, c_g = d[elements] * g, c[elements] * g
            blocks, shape = empty_blocks(len(g), a), (-1, 3, a, 3, a)
            for k in range(0, len(g), chunk):
                part = slice(k, k + chunk)
                g_T = np.ascontiguousarray(g[part].transpose(0, 2, 1))
                plus, minus = np.matmul(g_T, d_g[part]), np.matmul(g_T, c_g[part])
                np.subtract(
                    plus.reshape(shape), minus.reshape(shape).transpose(0, 3, 2, 1, 4), out=blocks[part]
                )
            return self.scatter.parts(blocks)

        return self.scatter.sum_of(blocks_of) + self._laplacian

    def _at_one_point(self, G: Array, d: Array, c: Array) -> Array:
        """Return the varying part of the stiffness of elements with one point each, by nodes and then elements."""

        def blocks_of(elements: slice) -> Parts:
            grad, inverse = self._grad_by_nodes[:, :, elements], G[:, :, elements]
            g = np.stack([sum(inverse[i, k] * grad[k] for k in range(3)) for i in range(3)])
            plus, minus = d[elements] * g, c[elements] * g
            return lambda i, j: plus[i, :, None] * g[j, None] - minus[j, :, None] * g[i, None]

        return self.scatter.sum_of(blocks_of, by_nodes=True)

    @cached_property
    def _grad_by_nodes(self) -> Array:
        """∇N of elements with one point each, (3, a, elements)."""
        return np.ascontiguousarray(self.grad_N[:, 0].transpose(2, 1, 0))

    def _constant_blocks(self, operators: Operators) -> Array:
        """Return the constant part μ ∇N_a·∇N_b δ_ij of the tangent."""
        e, _, a, _ = self.grad_N.shape
        blocks = np.zeros((e, 3, a, 3, a))
        laplacian = self.mu * operators.laplacian()
        for i in range(3):
            blocks[:, i, :, i, :] = laplacian
        return self.scatter(blocks)
