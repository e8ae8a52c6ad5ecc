"""Cases of conductivity: a straight channel, arrays of spheres and of cylinders."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from porocore.cell.cell import Cell
from porocore.cell.geometry.kinds import CylinderArray, Geometry, OrthogonalChannels, SphereArray
from porocore.cell.meshing.mesh import MeshSettings
from porocore.interfaces.cell import CellSolver
from porocore.states import Array
from porocore.verification.ladder.case import Check, VerificationCase, observed_order, relative_check

#: Drag F = 6π μ a 𝒦 U of a sphere of radius a in a simple cubic array of concentration c (Zick & Homsy, table 2).
SPHERES = {0.027: 2.008, 0.064: 2.810, 0.125: 4.292, 0.216: 7.442, 0.343: 15.4, 0.45: 28.1, np.pi / 6: 42.1}
#: Drag F/(μ U) of a cylinder in a square array of concentration c (Sangani & Acrivos, table 1).
CYLINDERS = {
    0.05: 15.56,
    0.1: 24.83,
    0.2: 51.53,
    0.3: 102.90,
    0.4: 217.89,
    0.5: 532.55,
    0.6: 1763,
    0.7: 13520,
    0.75: 126300,
}
#: Of spheres that touch: it fills the gap where no mesh resolves it, and where next to nothing flows; short and long.
NECKS = 0.15, 0.1
#: Elements are not larger than this, and than 0.8 radii, on the coarsest mesh of a sequence.
COARSE = 0.2
ALLOWED = 0.01


def conductivities(
    solver: CellSolver, geometry: Geometry, radius: float, levels: Sequence[float], *, flat: bool = False
) -> tuple[list[float], list[Array]]:
    """Mean element sizes, and K μ_f (3, 3), on meshes finer than the coarsest by the factors ``levels``.

    The size is the edge of a cube of the elements' mean volume, or with ``flat`` of a square of their mean area: near
    narrow gaps and small radii the elements are smaller than the setting.
    """
    sizes, found = [], []
    for level in levels:
        mesh = MeshSettings(size=COARSE, fluid_size=min(COARSE, 0.8 * radius) / level)
        cell = Cell(geometry=geometry, viscosity=1.0, mesh=mesh)
        found.append(solver.conductivity(solver.prepare(cell)))
        count = len(cell.make_mesh("fluid", "eighth").cells)
        sizes.append((geometry.porosity / count) ** (1 / 2 if flat else 1 / 3))
    return sizes, found


def _levels(count: int, ratio: float = 1.4, first: int = 0) -> list[float]:
    return [ratio**i for i in range(first, first + count)]


def _check(quantity: str, reference: float, sizes: list[float], values: list[float], note: str = "") -> Check:
    order = observed_order(sizes, values) if len(values) > 3 else None
    return relative_check(quantity, reference, values[-1], ALLOWED, order=order, note=note)


def channel(radius: float, solver: CellSolver, long: bool) -> Sequence[Check]:
    """K μ = π r⁴/8, and nothing across."""
    geometry = OrthogonalChannels(radius=radius, axes="z")
    levels = _levels(5 if long else 3)
    _, K = conductivities(solver, geometry, radius, levels)
    exact = np.pi * radius**4 / 8
    values = [float(k[2, 2]) for k in K]
    order = observed_order([1 / level for level in levels], values, exact)
    return [
        relative_check("K μ along it", exact, values[-1], 1e-3, order=order),
        Check("K across it, of that along it", float(abs(K[-1][0, 0]) / values[-1]), 1e-5),
    ]


def spheres(concentration: float, solver: CellSolver, long: bool) -> Sequence[Check]:
    """K μ = 1/(6π a 𝒦)."""
    radius = min((3 * concentration / (4 * np.pi)) ** (1 / 3), 0.5)
    touching = radius > 0.499
    neck = NECKS[long] if touching else 0.0
    geometry = SphereArray(kind="sphere-array", radius=0.5 if touching else radius, neck=neck)
    narrow = concentration > 0.4
    if touching or not long:
        levels = _levels(1, first=int(long or not narrow))
    else:
        levels = _levels(4 if narrow else 5)
    sizes, K = conductivities(solver, geometry, radius, levels)
    note = f"touching: a neck of radius {neck} fills the gap" if touching else ""
    reference = 1 / (6 * np.pi * radius * SPHERES[concentration])
    return [_check("K μ", reference, sizes, [float(k[0, 0]) for k in K], note)]


def cylinders(concentration: float, solver: CellSolver, long: bool) -> Sequence[Check]:
    """K μ = 1/F across the axis."""
    radius = float(np.sqrt(concentration / np.pi))
    geometry = CylinderArray(kind="cylinder-array", radius=radius)
    narrow = concentration > 0.72
    count = 6 - narrow if long else 4 - 2 * narrow
    sizes, K = conductivities(solver, geometry, radius, _levels(count), flat=True)
    values = [float(k[0, 0] + k[1, 1]) / 2 for k in K]
    checks = [_check("K μ across the axis", 1 / CYLINDERS[concentration], sizes, values)]
    if narrow:
        reference = 2**1.5 / (9 * np.pi) * (1 - 2 * radius) ** 2.5
        note = "leading term of lubrication theory for a narrow gap, for comparison"
        checks.append(
            relative_check("K μ across the axis, lubrication", reference, values[-1], ALLOWED, note=note)
        )
    return checks


def _items(solve: Callable[..., Sequence[Check]], keys: Sequence[float], name: str) -> dict[str, Any]:
    return {f"{name} = {key:.4g}": partial(solve, key) for key in keys}


CHANNEL = VerificationCase(
    "channel", "Straight channel", "Hagen–Poiseuille", "cell solver", _items(channel, (0.15, 0.25), "r")
)
SPHERE_ARRAY = VerificationCase(
    "spheres",
    "Simple cubic array of spheres",
    "Zick & Homsy 1982, J. Fluid Mech. 115, table 2",
    "cell solver",
    _items(spheres, tuple(SPHERES), "c"),
)
CYLINDER_ARRAY = VerificationCase(
    "cylinders",
    "Square array of cylinders",
    "Sangani & Acrivos 1982, Int. J. Multiphase Flow 8, table 1",
    "cell solver",
    _items(cylinders, tuple(CYLINDERS), "c"),
)
