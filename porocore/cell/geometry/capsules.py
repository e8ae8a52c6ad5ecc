"""Unions of spheres and round bars between them: level set, gradient and share of volume."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from porocore.states import Array

#: Margin around the cell within which bodies contribute to the level set at the faces.
MARGIN = 0.1
#: Lines along each of two axes on which the volume is integrated, exactly along each line.
LINES = 500
CHUNK = 20_000

Body = tuple[Array, Array, float]


class Capsules:
    """Union of capsules, each with ends and a radius; a sphere is one of length 0."""

    def __init__(self, bodies: Sequence[Body]) -> None:
        self.bodies = list(bodies)
        near = self.reaching(-0.5 - MARGIN, 0.5 + MARGIN, 0.0)
        self._start = np.array([a for a, _, _ in near])
        self._along = np.array([b - a for a, b, _ in near])
        self._radius = np.array([radius for _, _, radius in near])

    def reaching(self, low: float, high: float, touch: float) -> list[Body]:
        """Return the bodies that reach farther than ``touch`` into the box [low, high]³."""
        return [(a, b, r) for a, b, r in self.bodies if _distance(a, b, low, high) < r - touch]

    def value(self, points: Array) -> Array:
        """Return the distance (n,) of points (n, 3) to the union; inside it is negative, that to the nearest body."""
        return self._nearest(points)[0]

    def gradient(self, points: Array) -> Array:
        """Return the gradient (n, 3) of the distance at points (n, 3), away from the nearest body."""
        return self._nearest(points)[1]

    def _nearest(self, points: Array) -> tuple[Array, Array]:
        values, gradients = [np.empty(0)], [np.empty((0, 3))]
        square = np.maximum((self._along**2).sum(axis=1), 1e-30)
        for part in np.array_split(points, len(points) * len(self._radius) // 2_000_000 + 1):
            away = part[:, None] - self._start
            share = np.clip((away * self._along).sum(axis=2) / square, 0.0, 1.0)
            away -= share[:, :, None] * self._along
            distance = np.sqrt((away**2).sum(axis=2))
            nearest = (distance - self._radius).argmin(axis=1)
            row = np.arange(len(part))
            length = distance[row, nearest]
            values.append(length - self._radius[nearest])
            gradients.append(away[row, nearest] / np.maximum(length, 1e-30)[:, None])
        return np.concatenate(values), np.concatenate(gradients)

    def share(self, low: float, high: float) -> float:
        """Return the share of the box [low, high]³ in the bodies, bars without round ends, to about 5e-5."""
        count = round(LINES * (high - low))
        grid = low + (high - low) * (np.arange(count) + 0.5) / count
        lines = np.stack(np.meshgrid(grid, grid, indexing="ij"), axis=-1).reshape(-1, 2)
        bodies = self.reaching(low, high, 0.0)
        filled = 0.0
        for part in np.array_split(lines, len(lines) // CHUNK + 1):
            ends = [_crossing(part, *body) for body in bodies]
            enter = np.clip([a for a, _ in ends], low, high)
            leave = np.clip([b for _, b in ends], low, high)
            order = np.argsort(enter, axis=0)
            enter, leave = (np.take_along_axis(side, order, axis=0) for side in (enter, leave))
            before = np.maximum.accumulate(np.concatenate([np.full((1, len(part)), low), leave[:-1]]), axis=0)
            filled += float(np.maximum(leave - np.maximum(enter, before), 0.0).sum())
        return filled / ((high - low) * len(lines))


def _crossing(lines: Array, a: Array, b: Array, radius: float) -> tuple[Array, Array]:
    """Return the heights at which lines along z through points (n, 2) enter and leave a body; equal if never."""
    away = np.column_stack([lines - a[:2], np.full(len(lines), -a[2])])  # at z = 0
    length = float(np.linalg.norm(b - a))
    axis = (b - a) / length if length else np.zeros(3)
    # |away + z e − ((away + z e)·axis) axis|² = radius²
    rise = axis[2]
    along = away @ axis
    A = 1 - rise**2
    B = away[:, 2] - along * rise
    C = (away**2).sum(axis=1) - along**2 - radius**2
    if A > 1e-14:
        root = B**2 - A * C
        half = np.sqrt(np.maximum(root, 0.0)) / A
        enter, leave = -B / A - half, -B / A + half
        missed = root <= 0
    else:
        enter, leave = np.full(len(lines), -1e9), np.full(len(lines), 1e9)
        missed = C >= 0
    if length and abs(rise) > 1e-14:
        z = np.sort([-along / rise, (length - along) / rise], axis=0)
        enter, leave = np.maximum(enter, z[0]), np.minimum(leave, z[1])
    elif length:
        missed |= (along < 0) | (along > length)
    missed |= leave <= enter
    return np.where(missed, 0.0, enter), np.where(missed, 0.0, leave)


def _distance(a: Array, b: Array, low: float, high: float) -> float:
    """Return an upper bound of the distance of a straight line to the box [low, high]³; exact for a point."""
    points = a + np.linspace(0.0, 1.0, 201 if np.any(a != b) else 1)[:, None] * (b - a)
    return float(np.linalg.norm(points - np.clip(points, low, high), axis=1).min())
