"""Stokes flow through large pores: MINRES for velocity and pressure, multigrid and mass as preconditioner.

An iteration costs one cycle of multigrid; conjugate gradients for the pressure alone would solve for the velocity.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from porocore.cell.equilibrium.discrete import FactorError
from porocore.states import Array
from porocore_fem_skfem.products import Product

LIMIT = 1_000
#: Least entry of :func:`schur_scale`, a share of the largest: 0 where all velocities of a pressure's elements are held.
LEAST = 1e-6


@dataclass(frozen=True, eq=False)
class StokesSystem:
    """Symmetric system of f flows, each with three velocities at n nodes and m pressures.

    Attributes
    ----------
    laplacian : (n, n)
        ∫ ∇N·∇N.
    gradient
        ∫ ψ ∂v/∂x_i, (n, m) for each i.
    mass : (m,)
        ∫ ψ.
    moving : (n, 3 f), even : (m, f)
        1 for unknowns, 0 for what vanishes; the columns of the first go through the flows of each component.
    precondition
        Approximate inverse of the Laplacian, for the columns of ``moving``; 0 where these are.
    """

    laplacian: sparse.csr_matrix
    gradient: list[sparse.csr_matrix]
    mass: Array
    moving: Array
    even: Array
    precondition: Callable[[Array], Array]


def solve(system: StokesSystem, force: Array, tolerance: float) -> tuple[Array, Array, Array, Array]:
    """Return velocities (n, 3 f), pressures (m, f) and the residuals of both under a force (n, 3 f).

    ``tolerance`` is that of the relative residual in the norm of the preconditioner.

    Raises
    ------
    FactorError
        The iteration does not converge.
    """
    n, m = len(system.moving), len(system.even)
    flows = system.even.shape[1]
    laplacian, gradient = Product(system.laplacian), [Product(one) for one in system.gradient]
    divergence = [Product(one.T.tocsr()) for one in system.gradient]

    def split(x: Array) -> tuple[Array, Array]:
        """Return velocities and pressures of columns (3 n + m, f)."""
        return x[: 3 * n].reshape(n, 3 * flows), x[3 * n :]

    scale = system.even / schur_scale(system)

    def apply(x: Array) -> Array:
        w, p = split(x)
        y = np.empty_like(x)
        stressed, spread = split(y)
        stressed[:] = laplacian @ w
        spread[:] = 0.0
        for i, (grad, div) in enumerate(zip(gradient, divergence, strict=True)):
            some = slice(i * flows, (i + 1) * flows)
            stressed[:, some] -= grad @ p
            spread -= div @ w[:, some]
        stressed *= system.moving
        spread *= system.even
        return y

    def precondition(x: Array) -> Array:
        w, p = split(x)
        return np.concatenate([system.precondition(w).reshape(3 * n, flows), p * scale])

    right = np.concatenate([(force * system.moving).reshape(3 * n, flows), np.zeros((m, flows))])
    x, converged = minres(apply, right, precondition, tolerance=tolerance, limit=LIMIT)
    if not converged:
        raise FactorError(f"MINRES did not converge in {LIMIT} iterations")
    return *split(x), *split(right - apply(x))


def schur_scale(system: StokesSystem) -> Array:
    """Return the diagonal of the pressure's Schur complement with the Laplacian's in its place, as large as the mass.

    Like the mass where velocities are free, (m, f); much less where the wall holds most of an element's velocities, for
    which the mass costs up to a quarter more iterations.
    """
    flows = system.even.shape[1]
    free = system.moving / system.laplacian.diagonal()[:, None]
    squares = [one.multiply(one).T.tocsr() for one in system.gradient]
    found = sum(square @ free[:, i * flows : (i + 1) * flows] for i, square in enumerate(squares))
    found = np.maximum(found, LEAST * found.max(axis=0))
    return np.asarray(found * (system.mass.sum() / found.sum(axis=0)))


def minres(
    apply: Callable[[Array], Array],
    right: Array,
    precondition: Callable[[Array], Array],
    *,
    tolerance: float,
    limit: int,
) -> tuple[Array, bool]:
    """Solve a symmetric system for the columns (n, k), and return whether all converged.

    The preconditioner is positive definite; residuals are measured in its norm [Elman, Silvester & Wathen, Finite
    Elements and Fast Iterative Solvers, algorithm 4.1].
    """
    x, before, direction_before, direction = (np.zeros_like(right) for _ in range(4))
    v, z = right.copy(), precondition(right)
    gamma = np.sqrt(np.maximum(_products(v, z), 0.0))
    eta, goal, gamma_before = gamma, tolerance * gamma, np.ones_like(gamma)
    sine_before, sine, cosine_before, cosine = (np.full_like(gamma, value) for value in (0.0, 0.0, 1.0, 1.0))
    for _ in range(limit):
        active = np.abs(eta) > goal
        if not active.any():
            return x, True
        known = np.where(gamma > 0, gamma, 1.0)
        z /= known
        product = apply(z)
        delta = _products(product, z)
        before *= -gamma / gamma_before
        before += product
        before -= v * (delta / known)
        before, v, q = v, before, z
        z = precondition(v)
        gamma_before, gamma = known, np.sqrt(np.maximum(_products(v, z), 0.0))
        first = cosine * delta - cosine_before * sine * known
        second = sine * delta + cosine_before * cosine * known
        third = sine_before * known
        length = np.hypot(first, gamma)
        length = np.where(length > 0, length, 1.0)
        direction_before *= -third
        direction_before += q
        direction_before -= direction * second
        direction_before /= length
        direction_before, direction = direction, direction_before
        cosine_before, cosine, sine_before, sine = cosine, first / length, sine, gamma / length
        x += direction * np.where(active, cosine * eta, 0.0)
        eta = np.where(active, -sine * eta, eta)
    return x, bool((np.abs(eta) <= goal).all())


def _products(x: Array, y: Array) -> Array:
    """Return the product of each column of x with that of y; sums along the first axis take four times as long."""
    return np.asarray(np.einsum("nk,nk->k", x, y))
