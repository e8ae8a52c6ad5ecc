"""Rounded ridges: the solid is the union of all balls of the fillet's radius that fit into the sharp solid.

A ball of radius f that touches two channels of radius r has its centre at the distance R = r + f from both axes, on an
arc of an ellipse, for instance (R cos t, R cos t, R sin t) between the channels along x and y; its contact points
with the channels differ in direction by the angle θ, cos θ = sin² t. One that touches three channels sits at the end
of three such arcs. So the rounded part of the wall is a canal surface, a part of a sphere in the corners, and the
solid is the set of points within f of the solid with channels of radius R.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
from scipy.special import roots_legendre

from porocore.states import Array

#: A half of the ellipse's quadrant ends in the corner where the third channel comes in.
CORNER = np.pi / 4


def opened_volume(
    sharp_volume: float, wall_area: float, radius: float, fillet: float, channels: int
) -> float:
    """Volume of the rounded solid, by Steiner's formula for the set within f of the solid with channels of radius R.

    Faces, arcs and corners of that solid contribute the shell before the wall, the sectors of the canal surface and
    the sectors of the spheres; none of them overlap, since f is smaller than the wall's radius of curvature.

    Parameters
    ----------
    sharp_volume, wall_area
        Of the cell's solid with sharp channels of radius R = ``radius`` + ``fillet``.
    radius, fillet
        r and f.
    channels
        2 or 3.
    """
    R, f = radius + fillet, fillet
    shell = wall_area * (R**2 - radius**2) / (2 * R)
    arcs, end = (24, CORNER) if channels == 3 else (8, np.pi / 2)
    x, weights = roots_legendre(40)
    t, dt = end * (x + 1) / 2, end / 2 * weights
    sine = np.sin(t)
    angle = np.arccos(sine**2)
    length = R * np.sqrt(1 + sine**2)
    turning = np.sqrt(2) / (1 + sine**2)  # curvature times length; the ellipse turns towards the channels
    sectors = arcs * float(dt @ (f**2 / 2 * angle * length - 2 / 3 * f**3 * np.sin(angle / 2) * turning))
    # The directions of contact in a corner are 60° apart: an equilateral spherical triangle.
    solid_angle = 3 * np.arccos(1 / 3) - np.pi if channels == 3 else 0.0
    return sharp_volume + shell + sectors + 8 * solid_angle * f**3 / 3


def onto_fillet(points: Array, radius: float, fillet: float, axes: str) -> Array:
    """Points (n, 3) of the eighth near the rounded wall, moved onto it along its normal.

    OpenCASCADE fits splines to fillets, to some 1e-3 of their radius.
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
    on_fillet: Array = centre + fillet * away / np.linalg.norm(away, axis=1, keepdims=True)
    return on_fillet


def _nearest(a: Array, b: Array, R: float, end: float) -> Array:
    """Parameter in [0, end] of the point of the ellipse (√2 R cos t, R sin t) nearest to (a, b), by Newton's method."""
    t = np.arctan2(np.sqrt(2) * np.maximum(b, 0.0), a)
    for _ in range(30):
        sine, cosine = np.sin(t), np.cos(t)
        slope = R * sine * cosine + np.sqrt(2) * a * -sine + b * cosine
        curvature = R * (cosine**2 - sine**2) - np.sqrt(2) * a * cosine - b * sine
        t = np.clip(t - slope / np.where(np.abs(curvature) > 1e-12, curvature, -1.0), 0.0, end)
    return t
