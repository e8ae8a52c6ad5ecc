"""Training data of a potential: W and its derivatives by ln U and p; expansion at rest."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from porocore.core.tensors.point_group import PointGroup
from porocore.errors import DataError
from porocore.interfaces.surrogate import TrainingSet
from porocore.states import Array, CellResponse
from porocore.surrogates.stretch.components import PLACES
from porocore.surrogates.stretch.log_stretch import LogStretch
from porocore.surrogates.symmetry import on_one, on_places, on_variables

#: A variable below this in all states was not sampled.
STILL = 1e-9
#: Stress and energy at rest below this share of the stiffness are round-off.
NOTHING = 1e-10
#: ∂L/∂y of the six components of L, (6, 3, 3).
STRETCHES = np.array(
    [[[(r, c) in {(i, j), (j, i)} for c in range(3)] for r in range(3)] for i, j in PLACES], float
)


def variables(stretch: LogStretch, p: Array) -> Array:
    """Return y (7, n): six components of ln U, and p."""
    return np.concatenate([stretch.L, p[None]])


@dataclass(frozen=True, eq=False)
class RestExpansion:
    """Quadratic expansion of W at rest, W₂(y) = W₀ + T·L − φ p + ½ y·A y: exact in the limit of small loads.

    A cell that is held while its solid swells has an energy W₀, a stress T and a mean gradient at rest; of others they
    are zero, and φ is φ_f.

    Attributes
    ----------
    porosity
        φ at rest.
    matrix : (7, 7)
        A: the drained stiffness, minus Biot's coupling, minus the inverse of the Biot modulus.
    mean_grad : (9, 7)
        ∂<∇u¹>_s/∂y.
    symmetry
        The cell's point group, which all of them have exactly.
    value
        W₀.
    stress : (6,)
        T = ∂W/∂L, where shears count twice.
    held : (9,)
        <∇u¹>_s at rest.
    """

    porosity: float
    matrix: Array
    mean_grad: Array
    symmetry: PointGroup
    value: float = 0.0
    stress: Array = field(default_factory=lambda: np.zeros(6))
    held: Array = field(default_factory=lambda: np.zeros(9))

    @classmethod
    def from_response(cls, reference: CellResponse, symmetry: PointGroup) -> RestExpansion:
        """Return the expansion from the response of the undeformed cell (one row) with its tangent.

        The error of a free mesh breaks the cell's symmetry and is averaged out.

        Raises
        ------
        DataError
            A derivative is missing.
        """
        t = reference.tangent
        if (
            t is None
            or reference.fluid_volume is None
            or t.stress_grad_u is None
            or t.stress_p is None
            or t.fluid_volume_p is None
            or t.mean_grad_grad_u is None
            or t.mean_grad_p is None
        ):
            raise DataError(
                "a potential needs stress, fluid volume and all derivatives of the undeformed cell; "
                "solve it with tangent=True"
            )
        A = np.zeros((7, 7))
        m = np.zeros((9, 7))
        for a, (i, j) in enumerate(PLACES):
            column = _symmetric(t.stress_grad_u[0], i, j)
            for b, (k, l) in enumerate(PLACES):
                A[b, a] = column[k, l] if k == l else column[k, l] + column[l, k]
            A[6, a] = A[a, 6] = t.stress_p[0, i, j] if i == j else t.stress_p[0, i, j] + t.stress_p[0, j, i]
            m[:, a] = _symmetric(t.mean_grad_grad_u[0], i, j).ravel()
        A[6, 6] = -t.fluid_volume_p[0]
        m[:, 6] = t.mean_grad_p[0].ravel()
        y, places, one = on_variables(symmetry), on_places(symmetry), on_one(symmetry)
        value, P, held = _held(reference, float(np.abs(A).max()))
        # F = I + L + L²/2 + …, so that a stress at rest works on second order of L.
        curved = np.einsum("ij,aik,bkj->ab", P, STRETCHES, STRETCHES)
        A[:6, :6] += (curved + curved.T) / 2
        T = np.append(np.einsum("ij,aij->a", P, STRETCHES), 0.0)
        return cls(
            float(reference.fluid_volume[0]),
            y.mean(y, (A + A.T) / 2),
            places.mean(y, m),
            symmetry,
            value,
            y.mean(one, T[:, None])[:6, 0],
            places.mean(one, held.reshape(9, 1))[:, 0],
        )

    def potential(self, y: Array) -> tuple[Array, Array]:
        """Return W₂ (n,) and ∂W₂/∂y (7, n); the Hessian is ``matrix``."""
        gradient = self.matrix @ y
        value = (y * gradient).sum(axis=0) / 2 - self.porosity * y[6]
        gradient[6] -= self.porosity
        if self.value or self.stress.any():
            value += self.value + self.stress @ y[:6]
            gradient[:6] += self.stress[:, None]
        return value, gradient


def _held(reference: CellResponse, stiffness: float) -> tuple[float, Array, Array]:
    """Return W₀, P (3, 3) and <∇u¹>_s (3, 3) of a cell at rest; exact zeros where they are but round-off."""
    P = np.zeros((3, 3)) if reference.stress is None else reference.stress[0]
    W = 0.0 if reference.potential is None else float(reference.potential[0])
    held = np.abs(P).max() > NOTHING * stiffness or abs(W) > NOTHING * stiffness
    return (W, P, reference.mean_grad[0]) if held else (0.0, np.zeros((3, 3)), np.zeros((3, 3)))


def _symmetric(tensor: Array, i: int, j: int) -> Array:
    """Return ∂(3, 3)/∂ one component of a symmetric argument."""
    column: Array = tensor[:, :, i, j] if i == j else tensor[:, :, i, j] + tensor[:, :, j, i]
    return column


@dataclass(frozen=True, eq=False)
class PotentialData:
    """Data of n states in the variables y.

    Attributes
    ----------
    rest
        The undeformed cell.
    y : (7, n)
        Variables.
    active
        Those that were sampled.
    value : (n,), gradient : (7, n)
        W and ∂W/∂y. Only the rows of ``active`` are used by those who learn in these alone.
    mean_grad : (9, n), mean_grad_by_y : (9, 7, n)
        Rᵀ<∇u¹>_s, which depends on U and p only, and its derivatives.
    """

    rest: RestExpansion
    y: Array
    active: tuple[int, ...]
    value: Array
    gradient: Array
    mean_grad: Array
    mean_grad_by_y: Array

    @classmethod
    def from_training_set(cls, data: TrainingSet) -> PotentialData:
        """Return the data of the stable states; those beyond an instability would mislead a potential.

        Raises
        ------
        DataError
            A response or a derivative is missing, or fewer than two states are left.
        """
        kept = np.flatnonzero(data.responses.stable)
        states, responses = data.states[kept], data.responses[kept]
        missing = [
            name
            for name in ("potential", "stress", "fluid_volume", "tangent")
            if getattr(responses, name) is None
        ]
        if missing:
            raise DataError(
                f"a potential is learned from {', '.join(missing)}, which these states lack; sample again"
            )
        if len(kept) < 2:
            raise DataError(f"expected at least two stable training states, got {len(kept)}; sample more")
        rest = RestExpansion.from_response(data.reference, data.symmetry)
        assert responses.potential is not None
        assert responses.stress is not None
        assert responses.fluid_volume is not None
        stretch = LogStretch.from_gradient(states.grad_u)
        y = variables(stretch, states.p)
        gradient = np.concatenate(
            [stretch.pull(np.moveaxis(responses.stress, 0, -1)), -responses.fluid_volume[None]]
        )
        active = tuple(int(a) for a in np.flatnonzero(np.abs(y).max(axis=1) > STILL))
        mean_grad, gradients = unrotated(stretch, responses)
        return cls(rest, y, active, responses.potential.copy(), gradient, mean_grad, gradients)

    def __len__(self) -> int:
        return self.y.shape[1]

    @cached_property
    def remainder(self) -> tuple[Array, Array]:
        """Remainder of W (n,) and of ∂W/∂y (7, n) beyond the expansion at rest."""
        value, gradient = self.rest.potential(self.y)
        return self.value - value, self.gradient - gradient

    @property
    def mean_grad_remainder(self) -> tuple[Array, Array]:
        """Remainder of Rᵀ<∇u¹>_s (9, n) and of its derivatives (9, 7, n) beyond the linear limit at rest."""
        slopes = self.rest.mean_grad
        value = self.rest.held[:, None] + slopes @ self.y
        return self.mean_grad - value, self.mean_grad_by_y - slopes[:, :, None]

    @cached_property
    def scales(self) -> Array:
        """Root mean square of W and of each ∂W/∂y about their means, (8,), by which errors are weighted.

        The means of variables that were not sampled count as much as the largest of the others.
        """
        spread = np.concatenate([[self.value.std()], self.gradient.std(axis=1)])
        floor = 1e-3 * spread[1:7].max(initial=0.0)
        spread[1:7] = np.maximum(spread[1:7], floor)
        return np.where(spread > 0, spread, 1.0)


def unrotated(stretch: LogStretch, responses: CellResponse) -> tuple[Array, Array]:
    """Return Rᵀ m (9, n) and its derivatives by y (9, 7, n); along pure stretches R does not change."""
    t = responses.tangent
    assert t is not None
    if t.mean_grad_grad_u is None or t.mean_grad_p is None:
        raise DataError("the derivatives of <∇u¹> are missing; solve the states with tangent=True")
    n = len(responses)
    R = None if stretch.rotation is None else np.moveaxis(stretch.rotation, -1, 0)

    def back(tensor: Array) -> Array:
        turned = tensor if R is None else R.swapaxes(1, 2) @ tensor
        return np.moveaxis(turned.reshape(n, 9), 0, -1)

    M = t.mean_grad_grad_u.reshape(n, 9, 9)
    gradients = np.empty((9, 7, n))
    for component in range(6):
        direction = np.moveaxis(stretch.pull_direction(component), -1, 0).reshape(n, 9, 1)
        gradients[:, component] = back((M @ direction).reshape(n, 3, 3))
    gradients[:, 6] = back(t.mean_grad_p)
    return back(responses.mean_grad), gradients
