"""Rounded ridges between channels: volume of the rounded solid, projection of points onto the fillet.

A ball of radius f that touches two channels of radius r has its centre at the distance R = r + f from both axes, on an
arc of an ellipse, for instance (R cos t, R cos t, R sin t) between the channels along x and y. The directions of its
contact points with the channels differ by the angle θ, cos θ = sin² t. A ball that touches three channels is centred at
the end of three such arcs. So the rounded part of the wall is a canal surface with parts of spheres in the corners,
and the solid is the set of points within f of the solid with channels of radius R.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.special import roots_legendre

from porocore.cell.family.surfaces import Plane, Values, WallSurface, cylinder, sphere
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


@dataclass(frozen=True)
class _Canal:
    """Canal surface of the fillet between two channels, in the eighth.

    Attributes
    ----------
    pair, third
        Axes of the two channels, and the third axis.
    R, fillet
        Distance of the ball's centre from both axes, and its radius.
    """

    pair: tuple[int, int]
    third: int
    R: complex
    fillet: complex

    def value(self, points: Array) -> Values:
        away = self._away(points)
        return np.asarray(self.fillet - np.sqrt((away * away).sum(axis=1)))

    def gradient(self, points: Array) -> Array:
        away = self._away(points)
        return np.asarray(-away / np.linalg.norm(away, axis=1, keepdims=True))

    def _away(self, points: Array) -> Values:
        """Return the vectors from the nearest centres; to first order these do not depend on which is the nearest."""
        i, j = self.pair
        t = _nearest(
            np.sqrt(0.5) * (points[:, i] + points[:, j]), points[:, self.third], np.real(self.R), np.pi / 2
        )
        centre = np.zeros(points.shape, dtype=np.result_type(float, self.R))
        centre[:, i] = centre[:, j] = self.R * np.cos(t)
        centre[:, self.third] = self.R * np.sin(t)
        return np.asarray(points - centre)


def rounded_surfaces(radius: complex, fillet: complex, axes: str) -> list[WallSurface]:
    """Return the surfaces of the rounded wall in the eighth, and the planes in which they touch.

    A ball touches the channel i where r X_i = R X_j, and the sphere of a corner begins at the end of the ellipse.
    """
    R, places = radius + fillet, ["xyz".index(axis) for axis in axes]
    channels: list[WallSurface] = [cylinder(axis, radius) for axis in axes]
    canals: list[WallSurface] = []
    seams: list[WallSurface] = []
    corner: list[WallSurface] = []
    if len(axes) == 3:
        corner = [sphere(np.full(3, R * np.sqrt(0.5)), fillet)]
    for i, j in combinations(places, 2):
        canal = _Canal((i, j), 3 - i - j, R, fillet)
        canals.append(canal)
        for a, b in ((i, j), (j, i)):
            normal = np.zeros(3, dtype=np.result_type(float, R))
            normal[a], normal[b] = radius, -R
            seams.append(Plane(normal, 0.0, (channels[places.index(a)], canal)))
        if corner:
            normal = np.where(np.isin(range(3), [i, j]), -1.0, 1.0)
            seams.append(Plane(normal, -R * np.sqrt(0.5), (corner[0], canal)))
    return [*seams, *channels, *canals, *corner]
