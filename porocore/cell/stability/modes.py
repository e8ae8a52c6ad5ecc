"""Buckling modes of a periodic cell for a wave vector, negative pivots, loss of rank-one convexity.

K u = λ M u with the lumped mass M of the undeformed solid at density 1, so λ is the minimum of δ²Π per ∫|u|² dV and
depends on the mesh by the discretisation error only. Units are E and the cube root of the cell's volume.

Each wave vector has eight classes of perturbations (:func:`porocore.cell.symmetry.bloch_classes`). Each class
has a tangent of the eighth with its own held displacements. By Sylvester's law their negative pivots add up to the
number of modes of that wave vector under which the energy falls.

Q_ik(n) = A_ijkl n_j n_l with A = ∂P_E/∂H at fixed p, the drained tangent. Where m·Q(n)m < 0 for some n and m, a jump of
F by m ⊗ n lowers the energy to second order: the macroscopic problem loses ellipticity, and bands may form.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache
from typing import Any, TypeVar

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import LinearOperator, eigsh
from scipy.spatial import cKDTree

from porocore.cell.equilibrium.discrete import DiscreteSolid, FactorError, Iterate, lumped_mass
from porocore.cell.geometry.pore_geometry import CUBE, Sides
from porocore.cell.meshing.mesh import CellMesh
from porocore.cell.symmetry import bloch_classes, images, odd_axes, translation
from porocore.errors import PorocoreError
from porocore.states import Array

Value = TypeVar("Value")
#: "110" is k = (π, π, 0), period two along x and y.
WAVES = tuple(bloch_classes())
#: Wave vectors that differ in the names of the axes only.
FAMILIES = {"0": ("000",), "100": ("100", "010", "001"), "110": ("110", "101", "011"), "111": ("111",)}
#: Free unknowns up to which the factors of all classes are kept for the next state, at about 6 kB an unknown.
KEPT = 10_000


def negative_pivots(solid: DiscreteSolid, iterate: Iterate, waves: Iterable[str] = WAVES) -> dict[str, int]:
    """Return the number of unstable modes of each wave vector; −1 where the solver cannot tell.

    The solid is that of the eighth, in equilibrium under a diagonal H.

    Raises
    ------
    FactorError
        A tangent cannot be factorised.
    """

    def count(parity: str) -> int:
        pivots = solid.negative_pivots(iterate, parity)
        if "|" in parity and len(iterate.residual) > KEPT:
            solid.release(parity)
        return pivots

    found = by_wave(waves, solid.exchanged_axes(iterate), count)
    return {wave: -1 if min(counts) < 0 else sum(counts) for wave, counts in found.items()}


def by_wave(
    waves: Iterable[str], swaps: Iterable[str], evaluate: Callable[[str], Value]
) -> dict[str, list[Value]]:
    """Return a value of each class of each wave vector; classes that ``swaps`` of axes map onto each other share it."""
    evaluated = cache(evaluate)
    return {
        wave: [evaluated(min(images(parity, swaps))) for parity in bloch_classes()[wave]] for wave in waves
    }


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


#: Directions on the half sphere, about 2.5° apart.
DIRECTIONS = 4000
#: Number of sampled minima that are refined.
REFINED = 12
ITERATIONS = 500


@dataclass(frozen=True, eq=False)
class AcousticMinimum:
    """Smallest m·Q(n)m over unit vectors.

    Attributes
    ----------
    value : float
        Minimum [E]; the material is strongly elliptic where it is positive.
    direction : (3,)
        n, normal of the band.
    polarisation : (3,)
        m, direction of the jump.
    """

    value: float
    direction: Array
    polarisation: Array


def acoustic_tensor(A: Array, n: Array) -> Array:
    """Return Q (..., 3, 3), symmetrised, for directions (..., 3)."""
    Q = np.einsum("ijkl,...j,...l->...ik", A, n, n, optimize=True)
    return np.asarray((Q + np.swapaxes(Q, -1, -2)) / 2)


def acoustic_minimum(A: Array) -> AcousticMinimum:
    """Return the minimum of A = ∂P_ij/∂H_kl over all directions, all NaN where A is not finite.

    A fine sample is followed by descent from its best points.
    """
    if not np.isfinite(A).all():
        return AcousticMinimum(float("nan"), np.full(3, np.nan), np.full(3, np.nan))
    sample = half_sphere(DIRECTIONS)
    lowest = np.linalg.eigvalsh(acoustic_tensor(A, sample))[:, 0]
    n = sample[np.argsort(lowest, kind="stable")[:REFINED]]
    best = np.inf
    for _ in range(ITERATIONS):
        m = np.linalg.eigh(acoustic_tensor(A, n))[1][..., 0]
        # At fixed m the form is quadratic in n: each half step takes its minimum.
        by_n = np.einsum("ijkl,ai,ak->ajl", A, m, m, optimize=True)
        values, vectors = np.linalg.eigh((by_n + by_n.transpose(0, 2, 1)) / 2)
        n = vectors[..., 0]
        value = float(values[:, 0].min())
        if best - value <= 1e-12 * np.abs(A).max():
            break
        best = value
    values, vectors = np.linalg.eigh(acoustic_tensor(A, n))
    first = int(values[:, 0].argmin())
    return AcousticMinimum(float(values[first, 0]), _upward(n[first]), _upward(vectors[first, :, 0]))


def half_sphere(count: int) -> Array:
    """Return directions (count, 3) spread evenly over the half sphere z > 0, by the golden angle."""
    k = np.arange(count) + 0.5
    z = k / count
    angle = np.pi * (3 - np.sqrt(5)) * k
    r = np.sqrt(1 - z * z)
    return np.column_stack([r * np.cos(angle), r * np.sin(angle), z])


def _upward(n: Array) -> Array:
    """Return n or −n, whichever has a positive largest component."""
    return np.asarray(n * np.sign(n[np.abs(n).argmax()]))
