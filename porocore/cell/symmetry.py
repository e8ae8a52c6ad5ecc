"""Symmetry of a cell: operations that map its mesh onto itself, exchanged axes, parity classes on the eighth.

A cell is periodic, so its origin is arbitrary: Q belongs to its point group if x → Q x + t maps the cell onto itself
for some shift t. Each candidate for t maps one point of a rare kind onto another one of that kind.

A perturbation by H_ij is even or odd under the mirror of each axis. On the planes of an axis an odd field has a normal
component only, an even field has tangential components only.

A perturbation with wave vector components k_a ∈ {0, π} may have one parity at X_a = 0 and another at half
of the cell's side, X_a = ½ in a cube. The product of both mirrors is the translation by one cell, so equal parities
mean period one, k_a = 0, and different ones period two, k_a = π. A class of perturbations is named by the axes under
whose mirrors it is odd: "xy" at both planes of x and of y, "xy|xz" at X = 0 and Y = 0, and at X = ½ and Z = ½. The 64
classes contain every perturbation of the eight wave vectors; the eight classes without a bar have period one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import lru_cache
from itertools import product

import numpy as np

from porocore.cell.geometry.pore_geometry import CUBE, Sides
from porocore.cell.meshing.mesh import CellMesh
from porocore.cell.meshing.tetrahedra import Tetrahedra, volumes
from porocore.core.echo import joined
from porocore.core.tensors import CUBE_OPERATIONS, TRIVIAL, PointGroup, Rotation, as_rotation
from porocore.states import Array, BoolArray, IntArray

#: Shifts that are tried for one operation; with more candidates the group may be too small, never too large.
MOST_SHIFTS = 256
#: Points on which a shift is tried before it is tried on all.
FIRST = 32
MOST_VOXEL_SHIFTS = 4e6
#: Voxels at which shifts are tested, one after the other.
PROBES = 256

#: Condition on an operation Q and on the point onto which each point is mapped.
Allows = Callable[[IntArray, IntArray], bool]


def group_of_points(
    points: Array, labels: IntArray, tolerance: float, allows: Allows = lambda Q, order: True
) -> PointGroup:
    """Return the point group of a set of points with the period 1.

    Parameters
    ----------
    points : (n, 3)
        Points of one period.
    labels : (n,)
        Points with different labels are not mapped onto each other.
    tolerance
        Largest distance of an image from a point.
    allows
        Further condition on an operation.
    """
    if not len(points):
        return TRIVIAL
    return PointGroup.generated(
        [
            Q
            for Q in CUBE_OPERATIONS
            if any(allows(Q, order) for order in images_of_points(points, labels, tolerance, Q))
        ]
    )


def images_of_points(
    points: Array, labels: IntArray, tolerance: float, Q: IntArray, sides: Sides = CUBE
) -> Iterator[IntArray]:
    """Yield the image (n,) of each point, for each shift with which Q (3, 3) maps the set onto itself.

    The periods of the set are ``sides``, and Q exchanges equal ones only.
    """
    from scipy.spatial import cKDTree  # slow to import

    tree = cKDTree(_wrapped(points, sides), boxsize=sides)
    count = np.bincount(labels)
    rare = np.flatnonzero(labels == np.where(count > 0, count, len(labels) + 1).argmin())
    turned = points @ Q.T

    def nearest(rows: slice, shift: Array) -> tuple[Array, IntArray]:
        distance, index = tree.query(_wrapped(turned[rows] + shift, sides))
        return distance, np.asarray(index, dtype=np.int64)

    for goal in rare[:MOST_SHIFTS]:
        shift = points[goal] - turned[rare[0]]
        for rows in (slice(FIRST), slice(None)):
            distance, order = nearest(rows, shift)
            if (distance > tolerance).any() or (labels[order] != labels[rows]).any():
                break
        else:
            if len(np.unique(order)) == len(points):
                yield order


def _wrapped(points: Array, sides: Sides) -> Array:
    """Return points (n, 3) shifted by whole periods into the box from 0 to ``sides``."""
    within = points - np.floor(points / sides) * sides
    return np.where((within < 0) | (within >= sides), 0.0, within)


def kinds(values: Array, tolerance: float) -> IntArray:
    """Return a label for each row of values (n, k), equal for rows that differ by less than a tolerance."""
    labels = np.zeros(len(values), dtype=np.int64)
    for column in values.T:
        order = np.argsort(column, kind="stable")
        steps = np.concatenate([[False], np.diff(column[order]) > tolerance])
        number = np.empty(len(column), dtype=np.int64)
        number[order] = np.cumsum(steps)
        labels = np.unique(np.column_stack([labels, number]), axis=0, return_inverse=True)[1].reshape(-1)
    return labels


def group_of_voxels(solid: BoolArray, *, mirror: bool, sides: Sides = CUBE) -> PointGroup:
    """Return the point group of a cell of voxels (n₁, n₂, n₃) with these sides, exactly.

    With ``mirror`` they are the eighth of the cell, mirrored at its sides; else they are the whole cell.
    """
    box = np.array([sides, solid.shape])
    operations = [Q for Q in CUBE_OPERATIONS if np.array_equal(box @ np.abs(Q), box)]
    if mirror:
        flips = list(product((1, -1), repeat=3))
        return PointGroup.generated(
            [np.diag(signs) for signs in flips]
            # Reversed along an axis, the eighth is that of the cell shifted by half a period.
            + [
                Q
                for Q in operations
                if any(np.array_equal(_turned(_flipped(solid, signs), np.abs(Q)), solid) for signs in flips)
            ]
        )
    profiles = [solid.sum(axis=tuple(a for a in range(3) if a != axis)) for axis in range(3)]
    uniform = [np.array_equal(np.roll(solid, 1, axis=axis), solid) for axis in range(3)]

    def allowed(Q: IntArray) -> bool:
        along = []
        for axis, (old, sign) in enumerate(_axes(Q)):
            profile = profiles[old][::sign]
            shifts = [
                s for s in range(solid.shape[axis]) if np.array_equal(np.roll(profile, s), profiles[axis])
            ]
            along.append(shifts[:1] if uniform[axis] and uniform[old] else shifts)
        return _shifts_onto(_turned(solid, Q), solid, along)

    return PointGroup.generated([Q for Q in operations if allowed(Q)])


def _axes(Q: IntArray) -> list[tuple[int, int]]:
    """Return the axis that x → Q x maps onto each of the three, and its sign."""
    return [(int(np.abs(row).argmax()), int(row.sum())) for row in Q]


def _turned(voxels: BoolArray, Q: IntArray) -> BoolArray:
    """Return the voxels after x → Q x about the middle."""
    axes = _axes(Q)
    return _flipped(voxels.transpose([old for old, _ in axes]), tuple(sign for _, sign in axes))


def _flipped(voxels: BoolArray, signs: tuple[int, ...]) -> BoolArray:
    return voxels[tuple(slice(None, None, sign) for sign in signs)]


def _shifts_onto(one: BoolArray, other: BoolArray, along: list[list[int]]) -> bool:
    """Return whether one of the shifts by whole voxels ``along`` each axis maps one onto the other."""
    if np.prod([float(len(shifts)) for shifts in along]) > MOST_VOXEL_SHIFTS:
        return False
    shifts = np.stack(np.meshgrid(*along, indexing="ij"), axis=-1).reshape(-1, 3).astype(np.int64)
    n = np.array(one.shape)
    for at in np.random.default_rng(0).integers(0, n, (PROBES, 3)):
        if len(shifts) <= 1:
            break
        source = (at - shifts) % n
        shifts = shifts[one[source[:, 0], source[:, 1], source[:, 2]] == other[tuple(at)]]
    return any(
        np.array_equal(np.roll(one, tuple(int(s) for s in shift), axis=(0, 1, 2)), other)
        for shift in shifts[:MOST_SHIFTS]
    )


#: Tolerance of the image of a node, in lengths of the cell; files hold about ten digits.
SAME = 1e-6
#: Tolerance of the volume of the tetrahedra around a node, in volumes of the cell.
SAME_VOLUME = 1e-9

#: Image of each region by name; None where a region is not mapped onto one region.
RegionMap = Mapping[str, str] | None


def region_maps(mesh: Tetrahedra, sides: Sides = CUBE) -> dict[Rotation, RegionMap]:
    """Return the operations that map the mesh of a whole cell onto itself, each with the images of the regions.

    Nodes are mapped onto nodes and tetrahedra onto tetrahedra. A mesh may have fewer symmetries than its body.
    """
    half = np.array(sides) / 2
    wrapped = np.where(mesh.points == half, -half, mesh.points)
    points, number = np.unique(wrapped, axis=0, return_inverse=True)
    cells = np.sort(number.reshape(-1)[mesh.cells], axis=1)
    corners = number.reshape(-1)[mesh.cells[:, :4]]
    own = volumes(mesh.points, mesh.cells)
    around = np.bincount(corners.ravel(), np.repeat(own, 4), minlength=len(points))
    # Nodes and centres of tetrahedra are distinguished by their volumes.
    everything = np.concatenate([points, mesh.points[mesh.cells[:, :4]].mean(axis=1)])
    is_middle = np.arange(len(everything)) >= len(points)
    labels = kinds(np.column_stack([is_middle, np.concatenate([around, own])]), SAME_VOLUME)
    found: dict[Rotation, RegionMap] = {}
    for Q in CUBE_OPERATIONS:
        if not np.array_equal(np.abs(Q) @ half, half):
            continue
        maps = []
        for order in images_of_points(everything, labels, SAME, Q, sides):
            row = order[len(points) :] - len(points)
            if np.array_equal(np.sort(order[cells], axis=1), cells[row]):
                maps.append(_regions(mesh, row))
        if maps:
            best = min(maps, key=_preferred)
            known = found.get(as_rotation(Q), best)
            found[as_rotation(Q)] = min(known, best, key=_preferred)
    return found


def _regions(mesh: Tetrahedra, row: IntArray) -> RegionMap:
    """Return the images of the regions if each tetrahedron is mapped onto that of ``row``."""
    if len(mesh.region_names) < 2:
        return {}
    pairs = np.unique(np.column_stack([mesh.regions, mesh.regions[row]]), axis=0)
    names = mesh.region_names
    if len(pairs) > len(np.unique(pairs[:, 0])):
        return None
    return {names[a]: names[b] for a, b in pairs if a != b}


def _preferred(regions: RegionMap) -> int:
    """Return the rank of a map: regions that stay come first, regions that are not mapped come last."""
    return 10**6 if regions is None else len(regions)


#: Tolerance of displacements, in lengths of the cell.
EQUAL = 1e-7


def exchanged_axes(mesh: CellMesh, H: Array, u: Array) -> tuple[str, ...]:
    """Return the pairs of axes, "xz", whose exchange changes neither the mesh of the eighth nor u¹ (nodes, 3)."""
    found = []
    for i, j in ((0, 1), (0, 2), (1, 2)):
        order = _exchange(mesh, i, j)
        if order is None or abs(H[i, i] - H[j, j]) > EQUAL:
            continue
        if np.abs(u[order][:, _swapped(i, j)] - u).max() < EQUAL:
            found.append("xyz"[i] + "xyz"[j])
    return tuple(found)


def images(parity: str, swaps: Iterable[str]) -> set[str]:
    """Return the orbit of a parity class under exchanges of axes."""
    tables = [str.maketrans(pair, pair[::-1]) for pair in swaps]
    found, fresh = {parity}, [parity]
    while fresh:
        name = fresh.pop()
        for table in tables:
            image = "|".join("".join(sorted(part)) for part in name.translate(table).split("|"))
            if image not in found:
                found.add(image)
                fresh.append(image)
    return found


def axis_order(parity: str, image: str, swaps: Iterable[str]) -> tuple[int, int, int]:
    """Return the order of axes, product of exchanges, by which a parity class without a bar is mapped onto an image.

    What belongs to the axis a in ``image`` belongs to the axis order[a] in ``parity``.

    Raises
    ------
    ValueError
        It is no image.
    """
    found: list[tuple[int, int, int]] = [(0, 1, 2)]
    for order in found:
        if image == "".join(sorted("xyz"[order.index("xyz".index(axis))] for axis in parity)):
            return order
        for pair in swaps:
            i, j = ("xyz".index(axis) for axis in pair)
            further = list(order)
            further[i], further[j] = order[j], order[i]
            if (moved := (further[0], further[1], further[2])) not in found:
                found.append(moved)
    raise ValueError(f"'{image}' is no image of '{parity}' under exchanges of {joined(swaps)}")


@lru_cache(maxsize=24)
def _exchange(mesh: CellMesh, i: int, j: int) -> IntArray | None:
    """Return the node that the exchange of two axes maps onto each node; None without that symmetry."""
    points = mesh.points.round(9) + 0.0
    moved = points[:, _swapped(i, j)]
    sorted_points, sorted_images = np.lexsort(points.T), np.lexsort(moved.T)
    if not np.array_equal(points[sorted_points], moved[sorted_images]):
        return None
    order = np.empty(len(points), dtype=np.int64)
    order[sorted_points] = sorted_images
    cells = np.column_stack([np.sort(mesh.cells, axis=1), mesh.regions])
    image = np.column_stack([np.sort(order[mesh.cells], axis=1), mesh.regions])
    same = np.array_equal(cells[np.lexsort(cells.T)], image[np.lexsort(image.T)])
    return order if same else None


def _swapped(i: int, j: int) -> list[int]:
    axes = [0, 1, 2]
    axes[i], axes[j] = j, i
    return axes


#: Loads of each class of period one, out of the ten loads θ = (H row by row, p). The last four classes have no loads.
CLASSES: dict[str, tuple[int, ...]] = {
    "": (0, 4, 8, 9),
    "xy": (1, 3),
    "xz": (2, 6),
    "yz": (5, 7),
    "x": (),
    "y": (),
    "z": (),
    "xyz": (),
}
#: δH (3, 3) of a unit change of each of the ten loads, 0 for p.
UNIT_LOADS: Array = np.eye(10)[:, :9].reshape(10, 3, 3)


def classes(mesh: CellMesh) -> dict[str, tuple[int, ...]]:
    """Return the loads of each class of period one; the whole cell has one class."""
    return CLASSES if mesh.domain == "eighth" else {"": tuple(range(10))}


def odd_axes(parity: str, plane: int) -> str:
    """Return the axes under whose mirrors a class is odd, at X_a = 0 for ``plane`` 0 and at X_a = ½ for 1."""
    first, bar, second = parity.partition("|")
    return second if bar and plane else first


@lru_cache(maxsize=1)
def bloch_classes() -> dict[str, tuple[str, ...]]:
    """Return the eight classes of each wave vector, "000" to "111"; "110" is k = (π, π, 0)."""
    found: dict[str, tuple[str, ...]] = {}
    for wave in product((0, 1), repeat=3):
        names = []
        for signs in product((0, 1), repeat=3):
            first = "".join(a for a, odd in zip("xyz", signs, strict=True) if odd)
            second = "".join(a for a, odd, k in zip("xyz", signs, wave, strict=True) if odd != k)
            names.append(first if first == second else f"{first}|{second}")
        found["".join(map(str, wave))] = tuple(names)
    return found


def translation(parity: str) -> int | None:
    """Return the axis of the rigid translation in a class, the one under whose mirrors alone it is odd, or None."""
    return "xyz".index(parity) if parity in ("x", "y", "z") else None


def held_displacements(mesh: CellMesh, parity: str = "") -> BoolArray:
    """Return the components of u¹ that vanish, (nodes, 3), for the fields of a class.

    A rigid translation does not change the energy. It is excluded by holding one node, with its periodic images, on the
    whole cell, and one component of one node in a class of the eighth that contains it. So the inertia lacks the zero
    eigenvalue of the translation only.
    """
    held = np.zeros((len(mesh.points), 3), dtype=bool)
    if mesh.domain == "whole":
        held[mesh.periodic_class == 0] = True
        return held
    for plane, position in enumerate((mesh.low, mesh.high)):
        axes = odd_axes(parity, plane)
        for axis in range(3):
            there = mesh.points[:, axis] == position[axis]
            for i in range(3):
                if (i != axis) == ("xyz"[axis] in axes):
                    held[there, i] = True
    along = translation(parity)
    if along is not None:
        held[0, along] = True
    return held


def held_velocities(mesh: CellMesh, j: int) -> BoolArray:
    """Return the components of w^j that vanish, (nodes, 3), on the wall and by symmetry on the mirror planes.

    The flow under e_j is odd under the mirror of j and even under the others.
    """
    held = np.zeros((len(mesh.points), 3), dtype=bool)
    # The wall's facets at a node may belong to a periodic image of it.
    on_wall = np.zeros(int(mesh.periodic_class.max(initial=-1)) + 1, dtype=bool)
    on_wall[mesh.periodic_class[mesh.wall]] = True
    held[on_wall[mesh.periodic_class]] = True
    if mesh.domain == "eighth":
        on_plane = mesh.on_mirrors
        for i in {0, 1, 2} - {j}:
            held[on_plane[:, i] | on_plane[:, j], i] = True
    return held


def held_pressures(mesh: CellMesh, j: int) -> BoolArray:
    """Return the nodes where the pressure p̃^j vanishes because it is odd under the mirror of j, (nodes,)."""
    if mesh.domain == "whole":
        return np.zeros(len(mesh.points), dtype=bool)
    return mesh.on_mirrors[:, j]


def visible(mesh: CellMesh, parity: str = "") -> Array:
    """Return 1 for the components (3, 3) of a mean gradient that do not cancel between images of the domain, else 0."""
    if mesh.domain == "whole":
        return np.ones((3, 3))
    if not parity:
        return np.eye(3)
    i, j = ("xyz".index(axis) for axis in parity)
    mask = np.zeros((3, 3))
    mask[i, j] = mask[j, i] = 1.0
    return mask
