"""Response of the neo-Hookean solid, faster than by its tangent A_ijkl."""

from __future__ import annotations

import numpy as np

from porocore.cell.materials.neo_hookean import NeoHookean
from porocore.states import Array
from porocore_fem_skfem.operators import Operators, Scatter
from porocore_fem_skfem.response import CACHED, PointKinematics, SolidResponse


class NeoHookeanResponse(SolidResponse):
    """Response of the neo-Hookean solid, whose stiffness is a constant Laplacian and terms of rank one in F⁻ᵀ∇N."""

    def __init__(self, material: NeoHookean, operators: Operators, scatter: Scatter) -> None:
        super().__init__(material, operators, scatter)
        self.mu, self.volumetric = material.mu, material.volumetric
        self._laplacian = self._constant_blocks()

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
        # G_il δF_kl G_kj = (G δFᵀ G)_ij, written out for the component-first layout.
        inner = np.stack([[(G[i] * dF[k]).sum(axis=0) for k in range(3)] for i in range(3)])
        swapped = np.stack([[(inner[i] * G[:, j]).sum(axis=0) for j in range(3)] for i in range(3)])
        return np.asarray((second + pJ) * trace * G - (first + pJ) * swapped + self.mu * dF)

    def stiffness(self, at: PointKinematics) -> Array:
        _, first, second = self.volumetric(np.log(at.J))
        pJ = at.p * at.J
        e, q, a, _ = self.grad_N.shape
        F_inverse = np.ascontiguousarray(np.moveaxis(at.cof / at.J, -1, 0)).transpose(0, 2, 1)
        g = np.matmul(self.grad_N.reshape(e * q, a, 3), F_inverse).transpose(0, 2, 1).reshape(e, q, 3 * a)
        d = (self.w * (second + pJ)).reshape(e, q, 1)
        c = (self.w * (first + pJ)).reshape(e, q, 1)
        blocks = np.empty((e, 3, a, 3, a))
        chunk = max(1, CACHED // (3 * a) ** 2)
        for k in range(0, e, chunk):
            part = slice(k, k + chunk)
            g_T = g[part].transpose(0, 2, 1)
            if q == 1:
                plus, minus = g_T * (d[part] * g[part]), g_T * (c[part] * g[part])
            else:
                g_T = np.ascontiguousarray(g_T)
                plus, minus = np.matmul(g_T, d[part] * g[part]), np.matmul(g_T, c[part] * g[part])
            shape = (-1, 3, a, 3, a)
            np.subtract(plus.reshape(shape), minus.reshape(shape).transpose(0, 3, 2, 1, 4), out=blocks[part])
        return self.scatter(blocks) + self._laplacian

    def _constant_blocks(self) -> Array:
        """Return the constant part μ ∇N_a·∇N_b δ_ij of the tangent."""
        e, q, a, _ = self.grad_N.shape
        flat = self.grad_N.transpose(0, 2, 1, 3).reshape(e, a, q * 3)
        weights = np.repeat(self.w.reshape(e, 1, q), 3, axis=2)
        laplacian = self.mu * np.matmul(flat * weights, flat.transpose(0, 2, 1))
        blocks = np.zeros((e, 3, a, 3, a))
        for i in range(3):
            blocks[:, i, :, i, :] = laplacian
        return self.scatter(blocks)
