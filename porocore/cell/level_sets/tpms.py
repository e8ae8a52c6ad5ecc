"""Pores by triply periodic minimal surfaces (TriplyPeriodic): level sets, level of a porosity."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property, lru_cache
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from porocore.cell.geometry.pore_geometry import Unfolding, Values, WallSurface
from porocore.cell.level_sets.cutting import LevelSetGeometry
from porocore.core.tensors import CUBIC, PointGroup
from porocore.states import Array

Surface = Literal["gyroid", "schwarz-p", "diamond"]
#: Largest value of |f|.
LARGEST = {"gyroid": 1.5, "schwarz-p": 3.0, "diamond": 2**0.5}
#: Values |f| of its critical points, where the share of the cell below a level is not smooth.
CRITICAL = {"gyroid": (2**0.5, 1.5), "schwarz-p": (1.0, 3.0), "diamond": (1.0, 2**0.5)}
#: Points of the rule between two roots, by which a void fraction is integrated.
POINTS = 63


class TriplyPeriodic(LevelSetGeometry):
    """Pores where f < level, with X = 2πx, … and f after von Schnering & Nesper, Z. Phys. B 83 (1991) 407–412.

    ``gyroid`` sin X cos Y + sin Y cos Z + sin Z cos X; ``schwarz-p`` −(cos X + cos Y + cos Z), whose pores are a
    chamber in the middle of the cell and channels along the axes; ``diamond`` sin X sin Y sin Z + sin X cos Y cos Z +
    cos X sin Y cos Z + cos X cos Y sin Z. At the level 0 pores and solid are congruent, and the wall is close to the
    minimal surface. With ``solid: sheet`` the solid is |f| < level, and the pores are the two labyrinths that it parts.
    """

    kind: Literal["tpms"]
    """Pores bounded by a triply periodic surface, where its function f is below a level."""
    surface: Surface
    """Family of the surface, which says what f is."""
    level: float | None = None
    """Value of f on the pore wall, 0 near the minimal surface; this or ``void_fraction``."""
    void_fraction: Annotated[float | None, Field(gt=0, lt=1)] = None
    """φ_f, for which the level is solved; this or ``level``."""
    solid: Literal["network", "sheet"] = "network"
    """What is solid: the side of the surface where f is larger, or the neighbourhood of the surface."""

    #: The space groups are I4₁32 (gyroid), Pm-3m (Schwarz P), Fd-3m (diamond) or more.
    point_group: ClassVar[PointGroup] = CUBIC

    @model_validator(mode="after")
    def _one_of_both(self) -> TriplyPeriodic:
        if (self.level is None) == (self.void_fraction is None):
            raise ValueError(
                "expected one of the keys level and void_fraction, got "
                + ("neither" if self.level is None else "both")
            )
        if self.level is not None:
            low, high = self._levels
            if not low < self.level < high:
                raise ValueError(
                    f"expected a level between {low:.6g} and {high:.6g}, beyond which there is no surface, got "
                    f"{self.level:g}"
                )
        return self

    @property
    def _levels(self) -> tuple[float, float]:
        largest = LARGEST[self.surface]
        return (0.0 if self.solid == "sheet" else -largest), largest

    @cached_property
    def wall_level(self) -> float:
        """Level of the wall, given or solved for."""
        if self.level is not None:
            return self.level
        wanted = self.void_fraction
        assert wanted is not None
        from scipy.optimize import brentq  # slow to import

        low, high = self._levels
        return float(brentq(lambda c: self._void_fraction(c) - wanted, low, high, xtol=1e-15))

    def _void_fraction(self, level: float) -> float:
        if self.solid == "sheet":
            return 1 - below(self.surface, level) + below(self.surface, -level)
        return below(self.surface, level)

    @property
    def porosity(self) -> float:
        """See :class:`~porocore.cell.geometry.pore_geometry.PoreGeometry`; to round-off."""
        return self.void_fraction if self.void_fraction is not None else self._void_fraction(self.wall_level)

    @property
    def unfolding(self) -> Unfolding:
        """The eighth for Schwarz P, which alone has mirrors across the axes, else the whole cell."""
        return "eighth" if self.surface == "schwarz-p" else "whole"

    @property
    def description(self) -> str:
        name = {"gyroid": "gyroid", "schwarz-p": "Schwarz P", "diamond": "diamond"}[self.surface]
        return f"{name} {self.solid} of porosity {self.porosity:.4g}, level {self.wall_level:.4g}"

    def wall_surfaces(self) -> Sequence[WallSurface] | None:
        level = self._complex_level()
        sides = [level, -level] if self.solid == "sheet" else [level]
        return [Nodal(self.surface, side) for side in sides]

    def _complex_level(self) -> complex:
        """Return the level of the wall; of a complex void fraction to first order in the imaginary part."""
        wanted = self.void_fraction
        if not isinstance(wanted, complex):
            return self.wall_level if self.level is None else self.level
        level = self.model_copy(update={"void_fraction": wanted.real}).wall_level
        slope = slope_of_below(self.surface, level)
        if self.solid == "sheet":
            slope = -slope - slope_of_below(self.surface, -level)
        return level + 1j * wanted.imag / slope

    def level_set(self) -> Nodal | Sheet:
        return (Sheet if self.solid == "sheet" else Nodal)(self.surface, self.wall_level)


class Nodal:
    """Level set f − level, the nodal approximation of a minimal surface."""

    def __init__(self, surface: Surface, level: complex) -> None:
        self.surface, self.level = surface, level

    def value(self, points: Array) -> Values:
        (sx, sy, sz), (cx, cy, cz) = np.sin(2 * np.pi * points.T), np.cos(2 * np.pi * points.T)
        f: Array
        if self.surface == "gyroid":
            f = sx * cy + sy * cz + sz * cx
        elif self.surface == "schwarz-p":
            f = -(cx + cy + cz)
        else:
            f = sx * sy * sz + sx * cy * cz + cx * sy * cz + cx * cy * sz
        return f - self.level

    def gradient(self, points: Array) -> Array:
        (sx, sy, sz), (cx, cy, cz) = np.sin(2 * np.pi * points.T), np.cos(2 * np.pi * points.T)
        if self.surface == "gyroid":
            components = [cx * cy - sz * sx, cy * cz - sx * sy, cz * cx - sy * sz]
        elif self.surface == "schwarz-p":
            components = [sx, sy, sz]
        else:
            components = [
                cx * sy * sz + cx * cy * cz - sx * sy * cz - sx * cy * sz,
                sx * cy * sz - sx * sy * cz + cx * cy * cz - cx * sy * sz,
                sx * sy * cz - sx * cy * sz - cx * sy * sz + cx * cy * cz,
            ]
        return np.asarray(2 * np.pi * np.stack(components, axis=1))


class Sheet:
    """Level set level² − f², positive within the sheet."""

    def __init__(self, surface: Surface, level: float) -> None:
        self._f, self.level = Nodal(surface, 0.0), level

    def value(self, points: Array) -> Array:
        return self.level**2 - self._f.value(points) ** 2

    def gradient(self, points: Array) -> Array:
        return -2 * self._f.value(points)[:, None] * self._f.gradient(points)


@lru_cache(maxsize=256)
def below(surface: Surface, level: float) -> float:
    """Return the share of the cell where f < level, to round-off; it is smooth between the critical values of f.

    Along a line in the direction of x every f is R cos(X − δ) + C, below the level on a share
    1 − arccos((level − C)/R)/π of its period. This is integrated over a part of the two other angles that symmetry
    allows, by the tanh–sinh rule between the places where it becomes 0 or 1.
    """
    outer, first = _split(_outer_ends(surface, level)[None])
    y = outer.ravel()[:, None]
    z, second = _split(_inner_ends(surface, level, y))
    if surface == "gyroid":
        R, C = np.hypot(np.cos(y), np.sin(z)), np.sin(y) * np.cos(z)
    elif surface == "schwarz-p":
        R, C = np.ones_like(z), -(np.cos(y) + np.cos(z))
    else:  # the sum and the difference of the two angles
        R, C = np.hypot(np.cos(y), np.sin(z)), np.zeros_like(z)
    on_lines = 1 - np.arccos(np.clip((level - C) / R, -1, 1)) / np.pi
    return float(first.ravel() @ (second * on_lines).sum(axis=1))


def slope_of_below(surface: Surface, level: float) -> float:
    """Return the derivative of the share of the cell below a level, by a difference of eighth order."""
    h = min(0.01, *(abs(abs(level) - c) / 5 for c in CRITICAL[surface]))
    shares = [below(surface, level + k * h) - below(surface, level - k * h) for k in (1, 2, 3, 4)]
    return float(np.dot([4 / 5, -1 / 5, 4 / 105, -1 / 280], shares)) / h


def _outer_ends(surface: Surface, level: float) -> Array:
    """Return the range of the first angle, and between its ends the places where the rule is split."""
    square = level**2
    if surface == "gyroid":
        root = np.sqrt(max(2 - square, 0.0))
        height = np.sqrt((1 + np.sqrt(max(9 - 4 * square, 0.0)) * np.array([1, -1]) * (square > 2)) / 2)
        sines = [*(s * (level + t * root) / 2 for s in (1, -1) for t in (1, -1)), *height, *-height]
        return np.sort([-np.pi / 2, *np.arcsin(np.clip(sines, -1, 1)), np.pi / 2])
    if surface == "schwarz-p":
        return np.sort([0.0, *np.arccos(np.clip([-level, -level - 2, -level + 2], -1, 1)), np.pi])
    return np.sort([0.0, *np.arccos(np.sqrt(np.clip([square, square - 1], 0, 1))), np.pi / 2])


def _inner_ends(surface: Surface, level: float, y: Array) -> Array:
    """Return the range of the second angle for each first one (n, 1), and the places of the roots in it, (n, 4)."""
    if surface == "gyroid":
        s = np.sin(y)
        root = np.sqrt(np.maximum(2 + s**2 - s**4 - level**2, 0.0))
        ends = np.arccos(np.clip((level * s + root * [-1, 1]) / (1 + s**2), -1, 1))
    elif surface == "schwarz-p":
        ends = np.arccos(np.clip(np.array([-1, 1]) - level - np.cos(y), -1, 1))
    else:
        ends = np.arcsin(np.sqrt(np.clip(level**2 - np.cos(y) ** 2, 0, 1))) * [1, 1]
    high = np.full_like(y, np.pi / 2 if surface == "diamond" else np.pi)
    return np.sort(np.concatenate([np.zeros_like(y), ends, high], axis=1), axis=1)


def _split(ends: Array) -> tuple[Array, Array]:
    """Return points and weights (n, q) of the tanh–sinh rule between ends (n, k); the weights sum to 1."""
    t = np.linspace(-3.1, 3.1, POINTS)
    share = 1 / (1 + np.exp(-np.pi * np.sinh(t)))
    weight = np.cosh(t) * share * (1 - share)
    low, width = ends[:, :-1, None], np.diff(ends, axis=1)[:, :, None]
    length = (ends[:, -1] - ends[:, 0])[:, None, None]
    points, weights = low + width * share, width / length * weight / weight.sum()
    return points.reshape(len(ends), -1), weights.reshape(len(ends), -1)
