"""Integrals over elements: fields at their points, forces and volumes of a response, element tangents.

An integral over an element is a product of matrices: values at its points times shape functions at its points.
"""

from __future__ import annotations

import numpy as np

from porocore.interfaces.law import Integrand, MacroTangent
from porocore.states import Array, MacroState
from porocore_fem_skfem.macro_space import Shapes


class ElementIntegrals:
    """Integrals over the elements of a body with these shape functions.

    Local node a of u_i has column n_u i / 3 + a of an element's unknowns, then come the pressures.
    """

    def __init__(self, shapes: Shapes) -> None:
        self.shapes = s = shapes
        e, q, a, _ = s.grad_u.shape
        self._n_u = 3 * a
        #: (elements, a, q · 3), by which a stress with rows (q, j) is integrated against ∇N_a.
        self._by_grad = np.ascontiguousarray(s.grad_u.transpose(0, 2, 1, 3)).reshape(e, a, 3 * q)
        #: (elements, c, q · 4): N and its gradient at each point, by which storage and flux are integrated.
        N = np.broadcast_to(s.p.T[None, :, :, None], (e, s.p.shape[1], q, 1))
        by_p = np.concatenate([N, s.grad_p.transpose(0, 2, 1, 3)], axis=3)
        self._by_p = np.ascontiguousarray(by_p).reshape(e, -1, 4 * q)
        #: The same as far as elements differ: (1, ...) where all are alike but for their place.
        self._grad, self._p_and_grad = (
            values[:1] if s.alike else values for values in (self._by_grad, self._by_p)
        )

    def states(self, unknowns: Array) -> tuple[MacroState, Array]:
        """Return H, p and ∇p (points, 3) at the points from the unknowns (elements, ...) of the elements."""
        e, q = self.shapes.weights.shape
        u, p = unknowns[:, : self._n_u].reshape(e, 3, -1), unknowns[:, None, self._n_u :]
        grad_u = _product(u, self._grad).reshape(e, 3, q, 3).swapaxes(1, 2).reshape(-1, 3, 3)
        p_and_grad = _product(p, self._p_and_grad).reshape(-1, 4)
        return MacroState(grad_u, p_and_grad[:, 0].copy()), p_and_grad[:, 1:].copy()

    def contributions(self, response: Integrand) -> tuple[Array, Array, Array]:
        """Return ∫ P_E:∇N, ∫ Δstorage N and ∫ q·∇N of each element."""
        w = self.shapes.weights
        e, q = w.shape
        stress = np.empty((e, 3, q, 3))
        np.multiply(response.stress.reshape(e, q, 3, 3).swapaxes(1, 2), w[:, None, :, None], out=stress)
        forces = _product(stress.reshape(e, 3, -1), self._grad.swapaxes(1, 2)).reshape(e, -1)
        fluid = np.zeros((e, 2, q, 4))
        np.multiply(response.storage.reshape(e, q), w, out=fluid[:, 0, :, 0])
        np.multiply(response.flux.reshape(e, q, 3), w[:, :, None], out=fluid[:, 1, :, 1:])
        volumes = _product(fluid.reshape(e, 2, -1), self._p_and_grad.swapaxes(1, 2))
        return forces, volumes[:, 0], volumes[:, 1]

    def tangent(self, tangent: MacroTangent, dt: float, part: slice) -> list[Array]:
        """Return the entries of some elements, flat: forces by displacements and by pressures, then volumes.

        These are (elements, ...) of (a, i, k, b), (a, i, c), (c, k, b) and (c, d).
        """
        s, total = self.shapes, len(self.shapes.weights)
        w, g, gp = s.weights[part], s.grad_u[part], s.grad_p[part]
        e, q, a, _ = g.shape
        c = gp.shape[2]
        by_grad, by_p = self._by_grad[part], self._by_p[part]

        def at_points(values: Array, *shape: int) -> Array:
            values = values.reshape(total, q, *shape)[part]
            return values * w.reshape(e, q, *(1 for _ in shape))

        # (e, q, j, i, k, l) times ∇N_b: rows (q, j), columns (i, k, b).
        stiffness = at_points(tangent.stress_grad_u, 3, 3, 3, 3).swapaxes(2, 3).reshape(e, q, 27, 3)
        slopes = np.matmul(stiffness, g.swapaxes(2, 3)).reshape(e, 3 * q, 9 * a)
        forces = np.matmul(by_grad, slopes)
        stress_p = at_points(tangent.stress_p, 3, 3).swapaxes(2, 3)[..., None] * s.p[:, None, None, :]
        forces_p = np.matmul(by_grad, stress_p.reshape(e, 3 * q, 3 * c))
        # Rows (q, 0) for the storage, (q, 1 … 3) for the flux.
        by_u = np.concatenate(
            [at_points(tangent.storage_grad_u, 1, 3, 3), -dt * at_points(tangent.flux_grad_u, 3, 3, 3)],
            axis=2,
        ).reshape(e, q, 12, 3)
        by_u = np.matmul(by_u, g.swapaxes(2, 3)).reshape(e, 4 * q, 3 * a)
        volumes = np.matmul(by_p, by_u)
        by_value = np.concatenate(
            [at_points(tangent.storage_p, 1), -dt * at_points(tangent.flux_p, 3)], axis=2
        )
        by_pressure = by_value[..., None] * s.p[:, None, :]
        by_pressure[:, :, 1:] -= dt * np.matmul(at_points(tangent.flux_grad_p, 3, 3), gp.swapaxes(2, 3))
        volumes_p = np.matmul(by_p, by_pressure.reshape(e, 4 * q, c))
        return [values.reshape(e, -1) for values in (forces, forces_p, volumes, volumes_p)]


def _product(values: Array, by: Array) -> Array:
    """Return (elements, r, m) times (elements or 1, m, n); one product where all elements share the second."""
    if len(by) > 1:
        return np.asarray(np.matmul(values, by))
    return np.asarray(values.reshape(-1, values.shape[2]) @ by[0]).reshape(*values.shape[:2], -1)
