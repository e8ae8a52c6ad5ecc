"""Lowest eigenvalue and buckling mode of the tangent for a wave vector, by Lanczos' iteration.

K u = λ M u with the lumped mass M of the undeformed solid at density 1, so λ is the minimum of δ²Π per ∫|u|² dV and
depends on the mesh by the discretisation error only. Units are E and the cube root of the cell's volume.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import LinearOperator, eigsh
from scipy.spatial import cKDTree

from porocore.cell.equilibrium.discrete import DiscreteSolid, FactorError, Iterate
from porocore.cell.equilibrium.mass import lumped_mass
from porocore.cell.geometry.sides import CUBE, Sides
from porocore.cell.meshing.mesh import CellMesh
from porocore.cell.stability.inertia import by_wave
from porocore.cell.symmetry.exchange import images
from porocore.cell.symmetry.parity import bloch_classes, odd_axes, translation
from porocore.errors import PorocoreError
from porocore.states import Array

#: First shift below the spectrum and largest one; each is four times the one before.
FIRST_SHIFT, LARGEST_SHIFT = -1.0, -1e6
#: Tolerance of the position of a node, in lengths of the cell.
NEAR = 1e-6


@dataclass(frozen=True, eq=False)
class Mode:
    """Lowest mode of one parity class.

    Attributes
    ----------
    value : float
        λ [E per squared length of the cell]; negative: the energy falls along the mode.
    parity
        Parity class.
    mesh
        Mesh of the eighth.
    u : (nodes, 3)
        Mode on the eighth, of largest component 1.
    """

    value: float
    parity: str
    mesh: CellMesh
    u: Array

    @property
    def periods(self) -> tuple[int, ...]:
        """Periods of the mode along the axes, in cells."""
        first, second = odd_axes(self.parity, 0), odd_axes(self.parity, 1)
        return tuple(2 if (a in first) != (a in second) else 1 for a in "xyz")

    def at(self, points: Array) -> Array:
        """Return the mode (n, 3) at points (n, 3) that are mirror images of nodes of the eighth.

        The nodes of the whole cell and of a block of whole cells are such images.

        Raises
        ------
        ValueError
            A point is no image of a node.
        """
        there, signs = folded(points, self.parity, self.mesh.sides)
        distance, node = cKDTree(self.mesh.points).query(there)
        if distance.max(initial=0.0) > NEAR:
            raise ValueError(f"point {int(distance.argmax())} is no mirror image of a node of the eighth")
        return np.asarray(signs * self.u[node])


def folded(points: Array, parity: str, sides: Sides = CUBE) -> tuple[Array, Array]:
    """Return the mirror images (n, 3) of points in the eighth, and the signs (n, 3) of a field of the class there."""
    first, second = odd_axes(parity, 0), odd_axes(parity, 1)
    there, signs = np.empty_like(points), np.ones_like(points)
    for axis, name in enumerate("xyz"):
        x = np.mod(points[:, axis] / sides[axis], 2.0)
        at_0 = -1.0 if name in first else 1.0
        at_half = -1.0 if name in second else 1.0
        # Four quarters of two cells: identity, mirror at ½, shift by one cell (both mirrors), mirror at 0.
        quarter = np.minimum((2 * x).astype(np.int64), 3)
        there[:, axis] = np.choose(quarter, [x, 1 - x, x - 1, 2 - x]) * sides[axis]
        signs *= np.choose(quarter, [1.0, at_half, at_0 * at_half, at_0])[:, None]
        signs[:, axis] *= np.choose(quarter, [1.0, -1.0, 1.0, -1.0])
    return there, signs


def lowest_mode(solid: DiscreteSolid, iterate: Iterate, wave: str) -> Mode:
    """Return the lowest mode of all classes of a wave vector; rigid translations are left out.

    Raises
    ------
    PorocoreError
        The linear solver cannot tell the inertia.
    FactorError
        A tangent cannot be factorised.
    """
    swaps = solid.exchanged_axes(iterate)
    kept = {min(images(parity, swaps) & set(bloch_classes()[wave])) for parity in bloch_classes()[wave]}
    modes = (lowest_of_class(solid, iterate, parity) for parity in sorted(kept))
    return min(modes, key=lambda mode: mode.value)


def lowest_eigenvalues(solid: DiscreteSolid, iterate: Iterate, waves: Iterable[str]) -> dict[str, float]:
    """Return λ of each wave vector; each class is solved once."""
    swaps = solid.exchanged_axes(iterate)
    found = by_wave(waves, swaps, lambda parity: lowest_of_class(solid, iterate, parity).value)
    return {wave: min(values) for wave, values in found.items()}


def lowest_of_class(solid: DiscreteSolid, iterate: Iterate, parity: str) -> Mode:
    """Return the lowest mode of a class, by Lanczos' iteration with a shift below the spectrum.

    In a class with a rigid translation t, M t is projected out of M, which leaves the other modes. One component of
    one node is held there, so each field represents those that differ from it by a translation.
    """
    K, mass = solid.tangent(iterate, parity), solid.masses(parity)
    n = len(mass)
    rigid = _rigid(solid, parity)

    def weighed(x: Array) -> Array:
        y = mass * x
        return y - rigid.along * (rigid.along @ x) / rigid.mass if rigid else y

    shift = FIRST_SHIFT
    while True:
        count, divide = _factored(solid, iterate, parity, shift, rigid)
        if count < 0:
            raise PorocoreError(
                "eigenvalues need a linear solver that counts negative pivots, which fem.options.solver does not "
                "choose for this cell; use a direct one"
            )
        if count == 0:
            break
        shift *= 4
        if shift < LARGEST_SHIFT:
            raise FactorError(
                f"no shift above {LARGEST_SHIFT:g} makes the tangent of class '{parity}' definite"
            )
    inverse = LinearOperator((n, n), matvec=divide, dtype=float)
    M: Any = LinearOperator((n, n), matvec=weighed, dtype=float) if rigid else sparse.diags(mass)
    start = np.random.default_rng(0).normal(size=n)
    _, vectors = eigsh(K, k=1, M=M, sigma=shift, OPinv=inverse, v0=start, tol=1e-7)
    x = vectors[:, 0]
    value = float(x @ (K @ x)) / float(x @ weighed(x))
    u = solid.expanded(x, parity)
    if rigid:
        u[:, rigid.axis] -= (rigid.along @ x) / rigid.mass
    return Mode(value, parity, solid.mesh, _scaled(u))


def _scaled(u: Array) -> Array:
    """Return u scaled to a largest component of 1; of several within round-off the first one is positive."""
    size = np.abs(u)
    first = np.flatnonzero(size > 0.99 * size.max())[0]
    return np.asarray(u * np.sign(u.flat[first]) / size.max())


@dataclass(frozen=True, eq=False)
class _Rigid:
    """Rigid translation t of a class: its axis, M t of the free unknowns, and tᵀMt including the held one."""

    axis: int
    along: Array
    mass: float


def _rigid(solid: DiscreteSolid, parity: str) -> _Rigid | None:
    axis = translation(parity)
    if axis is None:
        return None
    mass = lumped_mass(solid.mesh)
    along = np.zeros((len(mass), 3))
    along[:, axis] = mass
    return _Rigid(axis, solid.reduced(along, parity), float(mass.sum()))


def _factored(
    solid: DiscreteSolid, iterate: Iterate, parity: str, shift: float, rigid: _Rigid | None
) -> tuple[int, Any]:
    """Return the number of eigenvalues below the shift, and the application of (K − shift·M)⁻¹."""
    factor = solid.factor(iterate, parity, shift)
    count = solid.negative_eigenvalues(factor)
    if rigid is None or count < 0:
        return count, factor.solve
    # K − shift·(M − a aᵀ/m) = B + shift·a aᵀ/m by Sherman and Morrison; its inertia follows from the bordered matrix.
    solved = factor.solve(rigid.along)
    pivot = rigid.mass + shift * float(rigid.along @ solved)

    def divide(x: Array) -> Array:
        y = factor.solve(x)
        return y - solved * (shift * float(rigid.along @ y) / pivot)

    return count + int(pivot < 0), divide
