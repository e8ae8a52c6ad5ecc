"""Rounded ridges between channels: volume of the rounded solid, projection of points onto the fillet.

A ball of radius f that touches two channels of radius r has its centre at the distance R = r + f from both axes, on an
arc of an ellipse, for instance (R cos t, R cos t, R sin t) between the channels along x and y. The directions of its
contact points with the channels differ by the angle θ, cos θ = sin² t. A ball that touches three channels is centred at
the end of three such arcs. So the rounded part of the wall is a canal surface with parts of spheres in the corners,
and the solid is the set of points within f of the solid with channels of radius R.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
from scipy.special import roots_legendre

from porocore.states import Array

#: Parameter at the corner with a third channel, in the middle of the quadrant of the ellipse.
CORNER = np.pi / 4


def opened_volume(
    sharp_volume: float, wall_area: float, radius: float, fillet: float, channels: int
) -> float:
    """Return the volume of the rounded solid, by Steiner's formula for the points within f of a sharp solid.

    Faces, arcs and corners of the sharp solid contribute a shell at the wall, the sectors of the canal surface and the
    sectors of the spheres. They do not overlap, since f is smaller than the wall's radius of curvature.

    Parameters
    ----------
    sharp_volume, wall_area
        Volume and wall area of the solid with sharp channels of radius R = ``radius`` + ``fillet``.
    radius, fillet
        Radii r and f.
    channels
        Number of channels, 2 or 3.
    """
    R, f = radius + fillet, fillet
    shell = wall_area * (R**2 - radius**2) / (2 * R)
    arcs, end = (24, CORNER) if channels == 3 else (8, np.pi / 2)
    x, weights = roots_legendre(40)
    t, dt = end * (x + 1) / 2, end / 2 * weights
    sine = np.sin(t)
    angle = np.arccos(sine**2)
    length = R * np.sqrt(1 + sine**2)
    turning = np.sqrt(2) / (1 + sine**2)  # curvature times length of the ellipse
    sectors = arcs * float(dt @ (f**2 / 2 * angle * length - 2 / 3 * f**3 * np.sin(angle / 2) * turning))
    # The directions of contact in a corner are 60° apart: an equilateral spherical triangle.
    solid_angle = 3 * np.arccos(1 / 3) - np.pi if channels == 3 else 0.0
    return sharp_volume + shell + sectors + 8 * solid_angle * f**3 / 3


def onto_fillet(points: Array, radius: float, fillet: float, axes: str) -> Array:
    """Return points (n, 3) of the eighth near the rounded wall, projected onto it along its normal.

    OpenCASCADE approximates fillets by splines, to some 1e-3 of their radius.
    """
    R = radius + fillet
    end = CORNER if len(axes) == 3 else np.pi / 2
    centres = []
    for i, j in combinations(("xyz".index(axis) for axis in axes), 2):
        centre = np.zeros_like(points)
        t = _nearest(np.sqrt(0.5) * (points[:, i] + points[:, j]), points[:, 3 - i - j], R, end)
        centre[:, i] = centre[:, j] = R * np.cos(t)
        centre[:, 3 - i - j] = R * np.sin(t)
        centres.append(centre)
    all_centres = np.stack(centres)
    nearest = np.linalg.norm(points - all_centres, axis=2).argmin(axis=0)
    centre = all_centres[nearest, np.arange(len(points))]
    away = points - centre
    return np.asarray(centre + fillet * away / np.linalg.norm(away, axis=1, keepdims=True))


def _nearest(a: Array, b: Array, R: float, end: float) -> Array:
    """Return t in [0, end] of the point (√2 R cos t, R sin t) of the ellipse nearest to (a, b), by Newton's method."""
    t = np.arctan2(np.sqrt(2) * np.maximum(b, 0.0), a)
    for _ in range(30):
        sine, cosine = np.sin(t), np.cos(t)
        slope = R * sine * cosine + np.sqrt(2) * a * -sine + b * cosine
        curvature = R * (cosine**2 - sine**2) - np.sqrt(2) * a * cosine - b * sine
        t = np.clip(t - slope / np.where(np.abs(curvature) > 1e-12, curvature, -1.0), 0.0, end)
    return t
