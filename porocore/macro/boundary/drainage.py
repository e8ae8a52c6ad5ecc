"""Drainage of a body: through which surfaces and how long; prescribed values of one process."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import eigh_tridiagonal
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from porocore.macro.analytic import relaxed
from porocore.macro.body.kinds import Box
from porocore.macro.body.mesh import BodyMesh
from porocore.macro.boundary.conditions import BoundaryData, Loads
from porocore.macro.laws.linear import LinearCoefficients, RestCoefficients
from porocore.macro.problem import Boundary, MacroSetup, body_mesh
from porocore.states import Array, IntArray

#: A conductivity below this share of the largest is none: what the cell solver leaves where no pore runs through.
CLOSED = 1e-6
#: Steps of Lanczos' iteration, of which the slow parts need few, and the length of a vector that is round-off.
LANCZOS, EXHAUSTED = 24, 1e-10
#: Times that differ by less than this share are one.
SAME = 1e-9


def undrained(macro: MacroSetup, conductivity: Array) -> list[str]:
    """Return why the body, or a surface with a prescribed pressure, cannot drain; empty where all can.

    Parameters
    ----------
    macro
        With the surfaces on which the pressure is prescribed; the direction is known of those across x, y or z.
    conductivity : (3, 3)
        K of the undeformed cell.
    """
    faces = macro.boundary.items()
    if not any(boundary.pressure is not None or boundary.flux != 0 for _, boundary in faces):
        return [
            "no surface has a prescribed pressure, so no fluid can leave and nothing consolidates; "
            "give one under macro.boundary"
        ]
    K, found = np.diag(conductivity), []
    if K.max() <= 0:
        return [
            "the cell conducts no fluid in any direction, so none leaves through the surfaces whose pressure or flux "
            "is prescribed and nothing consolidates; its pores must run through, see cell.geometry"
        ]
    for name, boundary in faces:
        face = macro.surfaces[name].of if name in macro.surfaces else name
        if face not in Box.surfaces:
            continue
        i = "xyz".index(face[0])
        if boundary.pressure is not None and K[i] <= CLOSED * K.max():
            kind = "face" if name == face else "surface"
            found.append(
                f"the cell conducts no fluid along {face[0]} (K_{i + 1}{i + 1} = {K[i]:.2g}), so none leaves "
                f"through the {kind} {name}, whose pressure is prescribed; see cell.geometry"
            )
    return found


def drained_surfaces(macro: MacroSetup) -> list[str]:
    """Return the names of the surfaces with a prescribed pressure, through which fluid leaves."""
    return [name for name, boundary in macro.boundary.items() if boundary.pressure is not None]


def drained_axes(macro: MacroSetup) -> tuple[int, ...]:
    """Return the axes along which fluid leaves by flat faces across them; all three where one face is none of these."""
    faces = [macro.surfaces[name].of if name in macro.surfaces else name for name in drained_surfaces(macro)]
    if not all(face in Box.surfaces for face in faces):
        return (0, 1, 2)
    return tuple(i for i, axis in enumerate("xyz") if any(face[0] == axis for face in faces))


def moved(macro: MacroSetup) -> bool:
    """Return whether displacements move the body and nothing else does, so that its force relaxes."""
    faces = macro.boundary.values()
    pushed = any(f.plate is not None or f.follower != 0 or any(t != 0 for t in f.traction) for f in faces)
    return any(face.is_moved for face in faces) and not pushed and not any(macro.body_force)


def held_sideways(macro: MacroSetup) -> int | None:
    """Return the axis along which alone a body can deform, since all of its other surfaces are held; None without.

    It is that of two whole flat faces. Along it the other surfaces slide.
    """
    mesh = body_mesh(macro)
    names = set(mesh.surfaces)
    for axis, letter in enumerate("xyz"):
        ends, others = {f"{letter}-", f"{letter}+"}, [i for i in range(3) if i != axis]
        sides = [macro.boundary.get(name, Boundary()) for name in names - ends]
        if not ends <= names or macro.surfaces or not all(_slides(side, axis, others) for side in sides):
            continue
        return axis if mesh.unnamed == 0 else None
    return None


def _slides(side: Boundary, axis: int, others: list[int]) -> bool:
    return side.displacement[axis] is None and (
        side.normal == 0 or all(side.displacement[i] == 0 for i in others)
    )


def relaxation_time(macro: MacroSetup, coefficients: LinearCoefficients, left: float = 0.05) -> float | None:
    """Return the time after a sudden displacement at which the force is within a share of its final value.

    None where it is not known in closed form: it is for a body that is held sideways, and both of whose ends along the
    axis that is left are moved or held, through one or both of which it drains.
    """
    axis = held_sideways(macro) if moved(macro) else None
    if axis is None:
        return None
    names = [f"{'xyz'[axis]}{sign}" for sign in "-+"]
    sides = [face for name, face in macro.boundary.items() if name not in names]
    if any(face.pressure is not None or face.flux != 0 for face in sides):
        return None
    ends = [macro.boundary.get(name, Boundary()) for name in names]
    drained = sum(end.pressure is not None for end in ends)
    if drained == 0 or any(end.normal is None and end.displacement[axis] is None for end in ends):
        return None
    compliance = float(coefficients.biot[axis, axis] ** 2 / coefficients.stiffness[axis, axis, axis, axis])
    time = relaxed(compliance / (compliance + coefficients.storage), left)
    length = float(np.ptp(body_mesh(macro).points[:, axis])) / drained
    return None if time is None else time * length**2 / coefficients.consolidation_coefficient(axis)


def drainage_time(
    macro: MacroSetup, coefficients: LinearCoefficients | RestCoefficients, share: float = 0.95
) -> float | None:
    """Return the time in which so large a share of what a sudden load drives out has left; None: nothing can leave.

    It is that of a pore pressure S ∂p/∂t = ∇·(S c ∇p) which is 1 everywhere at first and zero at surfaces with a
    prescribed pressure, on the body as it is. c_ij is K_ij/√(S_i S_j), where K_ii/S_i is the consolidation coefficient
    of confined compression along an axis, and S the geometric mean of the S_i. So it is exact for a column (Terzaghi),
    and a scale for bodies that give way sideways. The coefficients are those of one cell, or of the elements.
    """
    mesh = body_mesh(macro)
    drained = [mesh.surface(name, name) for name in drained_surfaces(macro)]
    facets = [nodes.ravel() for nodes in drained if len(nodes)]
    c = RestCoefficients.of_elements(coefficients, len(mesh.cells))
    if not facets or np.einsum("eii->ei", c.conductivity).max() <= 0:
        return None
    places = [0, 4, 8]  # 11, 22 and 33 among the nine components
    moduli, alpha = np.diagonal(c.stiffness, axis1=1, axis2=2)[:, places], c.biot[:, places]
    root = np.sqrt(c.storage[:, None] + alpha**2 / moduli)
    diffusivity = c.conductivity / (root[:, :, None] * root[:, None, :])
    largest = float(np.einsum("eii->ei", diffusivity).max())
    # Where all elements are alike, the storage makes no difference.
    storage = np.prod(root, axis=1) ** (2 / 3)
    storage /= storage.max()
    flow, volume = _diffusion(mesh, diffusivity + CLOSED * largest * np.eye(3), storage)
    free = np.setdiff1d(np.arange(len(mesh.points)), np.concatenate(facets))
    rates, shares = _decay(flow[free][:, free], volume[free][:, free], volume.sum(axis=1)[free])
    shares /= storage @ mesh.weights.sum(axis=1)
    if rates[0] * np.ptp(mesh.points, axis=0).max() ** 2 <= 100 * CLOSED * largest:
        return None
    return _time_to(1 - share, rates, shares)


def _time_to(left: float, rates: Array, shares: Array) -> float | None:
    """Return the time at which so much of decaying parts is left, by bisection; None if there was no more at first."""
    begin, end = 0.0, float(np.log(max(shares.sum() / left, 1.0)) / rates[0])
    while end - begin > SAME * end:
        middle = (begin + end) / 2
        later = shares @ np.exp(-rates * middle) > left
        begin, end = (middle, end) if later else (begin, middle)
    return end or None


def _decay(flow: Any, volume: Any, ones: Array) -> tuple[Array, Array]:
    """Return rates, the slowest first, and integrals of the decaying parts of a pressure that is 1 at first.

    By the spectral measure that Lanczos' iteration sees from the solution of a constant source: alike modes, as of a
    body in layers that do not exchange fluid, count as one.
    """
    solve = splu(csc_array(flow)).solve
    vector = solve(ones)
    size = float(np.sqrt(vector @ (volume @ vector)))
    found, diagonal, beside = [vector / size], [], []
    for _ in range(min(LANCZOS, len(ones))):
        vector = solve(volume @ found[-1])
        diagonal.append(float(found[-1] @ (volume @ vector)))
        basis = np.array(found)
        for _ in range(2):  # once leaves a share of the round-off
            vector -= basis.T @ (basis @ (volume @ vector))
        length = float(np.sqrt(max(vector @ (volume @ vector), 0.0)))
        if length <= EXHAUSTED * diagonal[0]:
            break
        beside.append(length)
        found.append(vector / length)
    times, parts = eigh_tridiagonal(diagonal, beside[: len(diagonal) - 1])
    positive = times > EXHAUSTED * times.max()
    rates = 1 / times[positive][::-1]
    return rates, (size * parts[0][positive][::-1] * rates) ** 2


def _diffusion(mesh: BodyMesh, diffusivity: Array, storage: Array) -> tuple[Any, Any]:
    """Return the sparse matrices (nodes, nodes) of ∫S ∇q·c∇p and ∫S qp with quadratic functions."""
    element = mesh.element
    values, reference = element.values(element.points), element.gradients(element.points)
    gradients = np.einsum("qak,eqkj->eqaj", reference, np.linalg.inv(mesh.jacobians), optimize=True)
    weights = storage[:, None] * mesh.weights
    flow = np.einsum("eq,eqai,eij,eqbj->eab", weights, gradients, diffusivity, gradients, optimize=True)
    volume = np.einsum("eq,qa,qb->eab", weights, values, values, optimize=True)
    rows = np.repeat(mesh.cells, mesh.cells.shape[1], axis=1).ravel()
    columns = np.tile(mesh.cells, mesh.cells.shape[1]).ravel()
    shape = (len(mesh.points), len(mesh.points))
    matrices = (csc_array((local.ravel(), (rows, columns)), shape=shape) for local in (flow, volume))
    one, other = matrices
    return one, other


@dataclass(frozen=True, eq=False)
class LocalLoads:
    """Prescribed values and loads for a unit of each time function.

    Attributes
    ----------
    values : (k, functions)
        Of the local prescribed unknowns.
    external : (functions, local unknowns)
        Dead loads and prescribed fluxes, where owned.
    followers
        Time function and factor of each pressure that follows its surface.
    """

    values: Array
    external: Array
    followers: tuple[tuple[int, float], ...] = ()

    @classmethod
    def of(cls, boundary: BoundaryData, unknowns: IntArray, owned: int, rotation: Any) -> LocalLoads:
        """Return those of a process.

        Parameters
        ----------
        unknowns : (local unknowns,)
            Number of each in the mesh's order.
        owned
            How many of them, from the first, belong to the process.
        rotation
            Sparse (local unknowns, local unknowns), from Cartesian ones; None where all are Cartesian.
        """
        place = np.full(boundary.external.shape[1], -1)
        place[boundary.prescribed] = np.arange(len(boundary.prescribed))
        places = place[unknowns]
        external = np.where(np.arange(len(unknowns)) < owned, boundary.external[:, unknowns], 0.0)
        if rotation is not None:
            external = external @ rotation.T
        followers = tuple((function, factor) for function, factor, _ in boundary.followers)
        return cls(boundary.values[places[places >= 0]], external, followers)

    def at(self, amplitudes: Array) -> Loads:
        """Return the loads at the values (functions,) of the time functions."""
        pressures = tuple(float(factor * amplitudes[function]) for function, factor in self.followers)
        return Loads(self.values @ amplitudes, amplitudes @ self.external, pressures)
