"""Region of 95 % of two unknowns by profile likelihood along rays (ParameterPlane)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from porocore.calibration.inference.minimise import Minimum, Objective
from porocore.calibration.inference.profile import End, ProfileWalk
from porocore.states import Array

#: Root of the 95 % quantile of χ² with two degrees of freedom.
ROOT_95_OF_TWO = 2.447746830680816
#: So many rays or more are walked every other one first. One between two whose radii, over those to first order,
#: differ by less than this share has their mean, which no picture tells from its own.
MANY, ALIKE = 8, 0.02


@dataclass(frozen=True, eq=False)
class ParameterPlane:
    """Region of two unknowns, the others optimised.

    Attributes
    ----------
    indices
        The two unknowns.
    best : (2,)
        Coordinates of the best point.
    axes : (2, 2)
        Half axes of a region of one standard deviation to first order, one a row, none longer than the search.
    angles : (n,)
        Of the rays, even and ascending, in units of the half axes.
    radii : (n,)
        Lengths of the rays in the same units; one whose neighbours are alike has their mean.
    closed : (n,) bool
        True where the region ends there; elsewhere it goes on, or the model could not be followed.
    linear_radii : (n,)
        The same to first order; very large where the data see nothing.
    """

    indices: tuple[int, int]
    best: Array
    axes: Array
    angles: Array
    radii: Array
    closed: npt.NDArray[np.bool_]
    linear_radii: Array

    def points(self, angles: Array, radii: Array) -> Array:
        """Return coordinates (n, 2) of points at angles and radii (n,)."""
        directions = np.stack([np.cos(angles), np.sin(angles)], axis=1) @ self.axes
        return np.asarray(self.best + radii[:, None] * directions)

    @property
    def rim(self) -> Array:
        """Coordinates of the ends of the rays, (n, 2)."""
        return self.points(self.angles, self.radii)


def parameter_plane(
    objective: Objective,
    best: Minimum,
    indices: tuple[int, int],
    rays: int,
    tell: Callable[[str], None] = lambda text: None,
) -> ParameterPlane:
    """Return the region of two unknowns by walks along rays, which are even in the scales of a fit to first order.

    Without rays the plane has the best point and the scales alone.
    """
    pair = np.array(indices)
    axes = _scales(objective, best, pair)
    angles = 2 * np.pi * np.arange(rays) / max(rays, 1)
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1) @ axes
    walks = [ProfileWalk(objective, best, pair, each, ROOT_95_OF_TWO, strict=False) for each in directions]
    linear = np.array([walk.linear_distance for walk in walks])
    radii, closed = np.full(rays, np.nan), np.zeros(rays, bool)
    names = " and ".join(objective.misfit.unknowns[i].name for i in indices)
    spared = [*range(1, rays, 2)] if rays >= MANY and rays % 2 == 0 else []
    for n in [*(n for n in range(rays) if n not in spared), *spared]:
        between = np.array([n - 1, n + 1]) % rays
        shares = radii[between] / linear[between]
        if n in spared and closed[between].all() and abs(np.log(shares[1] / shares[0])) < ALIKE:
            radii[n], closed[n] = linear[n] * np.sqrt(shares.prod()), True
            continue
        tell(f"plane of {names}, ray {n + 1} of {rays}")
        walk = walks[n].run()
        closed[n] = walk.end is End.crossed
        furthest = max(each.distance for each in walk.points if each.root <= ROOT_95_OF_TWO)
        radii[n] = walk.distance if closed[n] else furthest
    return ParameterPlane(indices, best.fitted.coordinates[pair], axes, angles, radii, closed, linear)


def _scales(objective: Objective, best: Minimum, pair: npt.NDArray[np.int64]) -> Array:
    """Return the half axes of the region to first order, one a row, none longer than the search."""
    from scipy.linalg import svd

    scale = objective.scale
    rows = best.fitted.jacobian * scale
    others = np.delete(rows, pair, axis=1)
    own = rows[:, pair]
    if others.shape[1]:
        own = own - others @ np.linalg.lstsq(others, own, rcond=1e-10)[0]
    _, values, axes = svd(own, full_matrices=False)
    room = (objective.upper - objective.lower)[pair] / scale[pair]
    most = 1 / np.sqrt(((axes / room) ** 2).sum(axis=1))
    return np.asarray(axes * np.minimum(1 / np.maximum(values, 1e-300), most)[:, None] * scale[pair])
