"""Rigid indenters as they are drawn: their front at the present place, by the signed distance of the shape."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from porocore.interfaces.solution import MacroSolution, Profile
from porocore.macro.boundary.rigid import RigidIndenter
from porocore.states import Array

#: Steps at most toward the surface of a shape, and of the search for the end of its front.
STEPS, HALVINGS = 200, 40
#: Points from the tip to the end of the front.
POINTS = 60
#: An indenter is drawn up to this share of the body's largest length behind its tip.
SHOWN = 0.3


def drawn_indenters(
    solution: MacroSolution, profile: Profile, indenters: Mapping[str, RigidIndenter]
) -> Iterator[tuple[RigidIndenter, float]]:
    """Yield the indenters of the solution with their displacement at the time of the profile."""
    for name, series in solution.contact.items():
        if name in indenters:
            yield indenters[name], float(np.interp(profile.time, solution.history.time, series[:, 1]))


def front_of(indenter: RigidIndenter, motion: float, directions: Array, length: float) -> Array:
    """Return the front of an indenter as lines (n, points, 3) from its tip outward.

    Parameters
    ----------
    motion
        Its displacement.
    directions : (n, 3)
        Unit vectors across its direction, along which the lines go out.
    length
        Of the body; a front ends at that distance from the axis, or a share :data:`SHOWN` of it behind the tip.
    """
    axis, deep = -indenter.along, SHOWN * length

    def depth(rho: Array) -> Array:
        """Return how far behind the tip the surface is at distances (n, k) from the axis; infinite beside the shape."""
        places = (rho[:, :, None] * directions[:, None]).reshape(-1, 3)
        z = gap = np.zeros(len(places))
        for _ in range(STEPS):
            gap = indenter.shape.distance(places + z[:, None] * axis, axis).gap
            z = np.where(z > deep, z, z + np.maximum(gap, 0.0))
            if gap.max() <= 1e-6 * length:
                break
        # Beside a steep flank the way goes on for ever.
        return np.where((z > deep) | (gap > 1e-6 * length), np.inf, z).reshape(rho.shape)

    low, high = np.zeros(len(directions)), np.full(len(directions), length)
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        inside = np.isfinite(depth(middle[:, None])[:, 0])
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    rho = low[:, None] * np.sin(np.linspace(0, np.pi / 2, POINTS))
    z = depth(rho)
    z = np.where(np.isfinite(z), z, deep)
    lines = rho[:, :, None] * directions[:, None] + z[:, :, None] * axis
    # The wall of a punch goes on along the axis.
    ends = lines[:, -1] + (deep - z[:, -1:]) * axis
    wall = np.abs(indenter.shape.distance(ends, axis).gap) < 1e-3 * length
    lines = np.concatenate([lines, np.where(wall[:, None], ends, lines[:, -1])[:, None]], axis=1)
    return np.asarray(lines + np.array(indenter.place) + motion * indenter.along)


def across(indenter: RigidIndenter, angles: Array) -> Array:
    """Return unit vectors (n, 3) across the direction of an indenter, at angles about it."""
    along = indenter.along
    first = np.eye(3)[np.abs(along).argmin()]
    first = first - (first @ along) * along
    first /= np.linalg.norm(first)
    return np.asarray(np.cos(angles)[:, None] * first + np.sin(angles)[:, None] * np.cross(along, first))


def section_of(indenter: RigidIndenter, motion: float, length: float, *, revolved: bool) -> Array:
    """Return the outline (n, 2) of an indenter in the plane of a flat body, of a meridian its half at x ≥ 0."""
    side = np.cross(indenter.along, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side)
    side = side if side[0] >= 0 else -side
    lines = front_of(indenter, motion, np.stack([side, -side]), length)
    if revolved:
        tip = lines[0, 0]
        behind = tip - ((tip - lines[0, -1]) @ indenter.along) * indenter.along
        return np.asarray(np.concatenate([lines[0], behind[None]])[:, :2])
    return np.asarray(np.concatenate([lines[1, ::-1], lines[0]])[:, :2])
