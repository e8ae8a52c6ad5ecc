"""One state of a laminate: u¹ is linear across each layer, so that a few algebraic equations are all there is.

In layer k of share c_k, F_k = F + a_k ⊗ n with n across the layers. Beside fluid the traction of every layer is the
pressure's, (P_k + p cof F_k) n = 0; without fluid it is the same in all layers, and Σ c_k a_k = 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from porocore import Status
from porocore.core.tensors import cofactor, cofactor_tangent, determinant

#: Of a_k, at which Newton's iteration has converged: the next correction would be its square.
SMALL = 1e-9
ITERATIONS, SMALLEST_STEP = 40, 1 / 256


@dataclass(frozen=True, eq=False)
class Laminate:
    """Materials with their shares, the axis across them, and whether there is fluid between them."""

    solids: tuple
    axis: int
    drained: bool

    @property
    def shares(self):
        return np.array([share for _, share in self.solids])

    def solve(self, F, p: float):
        """(status, a (k, 3)); a is None where there is no solution.

        The stretch is applied step by step and the rotation afterwards, which changes no traction but turns it.
        """
        if not (np.isfinite(F).all() and np.isfinite(p)) or np.linalg.det(F) <= 0:
            return Status.inverted, None
        V, sizes, Wt = np.linalg.svd(F)
        rotation, stretch = V @ Wt, Wt.T @ np.diag(sizes) @ Wt
        a, done, step = np.zeros((len(self.solids), 3)), 0.0, 1.0
        while done < 1:
            share = min(1.0, done + step)
            found = self._newton(np.eye(3) + share * (stretch - np.eye(3)), share * p, a)
            if found is None:
                step /= 2
                if step < SMALLEST_STEP:
                    return Status.not_converged, None
            else:
                a, done, step = found, share, 2 * step
        a = a @ rotation.T
        if self.drained and self.fluid_volume(F, a) <= 0:
            return Status.overlap, None
        return (Status.unstable if self.negative(F, a) else Status.converged), a

    def gradients(self, F, a):
        """(k, 3, 3) of the layers."""
        found = np.repeat(F[None], len(a), axis=0)
        found[:, :, self.axis] += a
        return found

    def fluid_volume(self, F, a) -> float:
        """φ = J₀ − ⟨J⟩_s."""
        return float(np.linalg.det(F) - self.shares @ determinant(self.gradients(F, a)))

    def stiffness(self, gradients):
        """B_k (k, 3, 3), by which a_k changes the traction; the pressure's share of it vanishes."""
        tangents = [material.tangent(f) for (material, _), f in zip(self.solids, gradients, strict=True)]
        return np.array([A[:, self.axis, :, self.axis] for A in tangents])

    def negative(self, F, a) -> int:
        """Negative eigenvalues of the second derivative of the energy by all a_k that may vary."""
        m, c = len(a), self.shares
        blocks = np.zeros((m, 3, m, 3))
        for k, B in enumerate(self.stiffness(self.gradients(F, a))):
            blocks[k, :, k] = c[k] * B
        free = np.eye(m) if self.drained else np.linalg.svd(c[None])[2][1:].T
        basis = np.kron(free, np.eye(3))
        return int((np.linalg.eigvalsh(basis.T @ blocks.reshape(3 * m, 3 * m) @ basis) < 0).sum())

    def balance(self, B, loads, total):
        """Δa_k (k, 3, r) with B_k Δa_k + loads_k all alike: zero beside fluid, else so that Σ c_k Δa_k = ``total``."""
        answers = np.linalg.solve(B, loads)
        if self.drained:
            return -answers
        c = self.shares[:, None, None]
        inverse = np.linalg.inv(B)
        traction = np.linalg.solve((c * inverse).sum(axis=0), (c * answers).sum(axis=0) + total)
        return inverse @ traction - answers

    def _newton(self, F, p: float, a):
        """a from a start, or None."""
        pressure = p * cofactor(F[None])[0, :, self.axis]
        for _ in range(ITERATIONS):
            gradients = self.gradients(F, a)
            if (determinant(gradients) <= 0).any():
                return None
            P = [material.stress(f) for (material, _), f in zip(self.solids, gradients, strict=True)]
            loads = np.array(P)[:, :, self.axis] + pressure
            missing = -(self.shares[:, None] * a).sum(axis=0)
            change = self.balance(self.stiffness(gradients), loads[:, :, None], missing[:, None])[:, :, 0]
            size = float(np.abs(change).max())
            if not np.isfinite(size):
                return None
            factor = 1.0
            while (determinant(self.gradients(F, a + factor * change)) <= 0).any():
                factor /= 2
                if factor < SMALLEST_STEP:
                    return None
            a = a + factor * change
            if size < SMALL:
                return a
        return None

    def sensitivities(self, F, p: float, a):
        """Derivatives of a_k (k, 3, 10) by H, row by row, and p."""
        gradients = self.gradients(F, a)
        tangents = [material.tangent(f) for (material, _), f in zip(self.solids, gradients, strict=True)]
        A = np.array(tangents) + p * cofactor_tangent(gradients)
        by_H = A[:, :, self.axis].reshape(len(a), 3, 9)
        loads = np.concatenate([by_H, cofactor(gradients)[:, :, self.axis, None]], axis=2)
        return self.balance(self.stiffness(gradients), loads, np.zeros((3, 10)))
