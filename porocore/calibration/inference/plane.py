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


@dataclass(frozen=True, eq=False)
class ParameterPlane:
    """Region of two unknowns, the others optimised.

    Attributes
    ----------
    indices
        The two unknowns.
    best : (2,)
        Coordinates of the best point.
    rim : (n, 2)
        Coordinates of the furthest point of each ray, counter-clockwise.
    closed : (n,) bool
        True where the region ends there; elsewhere it goes on, or the model could not be followed.
    ellipse : (n, 2)
        The region to first order, along the same rays; not finite where the data see nothing.
    """

    indices: tuple[int, int]
    best: Array
    rim: Array
    closed: npt.NDArray[np.bool_]
    ellipse: Array


def parameter_plane(
    objective: Objective,
    best: Minimum,
    indices: tuple[int, int],
    rays: int,
    tell: Callable[[str], None] = lambda text: None,
) -> ParameterPlane:
    """Return the region of two unknowns by walks along rays, which are even in the scales of a fit to first order."""
    pair = np.array(indices)
    start = best.fitted.coordinates[pair]
    scales = _scales(objective, best, pair)
    angles = 2 * np.pi * np.arange(rays) / rays
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1) @ scales
    rim, closed, ellipse = np.empty((rays, 2)), np.zeros(rays, bool), np.empty((rays, 2))
    names = " and ".join(objective.misfit.unknowns[i].name for i in indices)
    for n, direction in enumerate(directions):
        tell(f"plane of {names}, ray {n + 1} of {rays}")
        walk = ProfileWalk(objective, best, pair, direction, ROOT_95_OF_TWO, strict=False).run()
        closed[n] = walk.end is End.crossed
        furthest = max(each.distance for each in walk.points if each.root <= ROOT_95_OF_TWO)
        rim[n] = start + direction * (walk.distance if closed[n] else furthest)
        slope = walk.points[0].slope
        ellipse[n] = start + direction * (ROOT_95_OF_TWO / slope if slope > 0 else np.inf)
    order = np.argsort(np.arctan2(*(rim - start).T[::-1]))
    return ParameterPlane(indices, start, rim[order], closed[order], ellipse[order])


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
