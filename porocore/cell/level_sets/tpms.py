"""Pores by triply periodic minimal surfaces (TriplyPeriodic): level sets, level of a porosity."""

from __future__ import annotations

from functools import cached_property, lru_cache
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from porocore.cell.geometry.pore_geometry import Unfolding
from porocore.cell.level_sets.level_set import LevelSetGeometry
from porocore.core.tensors.point_group import CUBIC, PointGroup
from porocore.states import Array

Surface = Literal["gyroid", "schwarz-p", "diamond"]
#: Largest value of |f|.
LARGEST = {"gyroid": 1.5, "schwarz-p": 3.0, "diamond": 2**0.5}
#: Lines along each of two axes on which a void fraction is integrated, exactly along each line.
LINES = 800


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

    @model_validator(mode="after")
    def _one_of_both(self) -> TriplyPeriodic:
        if (self.level is None) == (self.void_fraction is None):
            raise ValueError(
                "expected one of the keys level and void_fraction, not both and not none of them"
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

        return float(brentq(lambda c: self._void_fraction(c) - wanted, *self._levels, xtol=1e-12))

    def _void_fraction(self, level: float) -> float:
        if self.solid == "sheet":
            return 1 - below(self.surface, level) + below(self.surface, -level)
        return below(self.surface, level)

    @property
    def porosity(self) -> float:
        """See :class:`~porocore.cell.geometry.pore_geometry.PoreGeometry`; to about 1e-6."""
        return self.void_fraction if self.void_fraction is not None else self._void_fraction(self.wall_level)

    @property
    def unfolding(self) -> Unfolding:
        """The eighth for Schwarz P, which alone has mirrors across the axes, else the whole cell."""
        return "eighth" if self.surface == "schwarz-p" else "whole"

    @property
    def point_group(self) -> PointGroup:
        """Point group of the cube; the space groups are I4₁32 (gyroid), Pm-3m (Schwarz P), Fd-3m (diamond) or more."""
        return CUBIC

    @property
    def description(self) -> str:
        name = {"gyroid": "gyroid", "schwarz-p": "Schwarz P", "diamond": "diamond"}[self.surface]
        return f"{name} {self.solid} of porosity {self.porosity:.4g}, level {self.wall_level:.4g}"

    def level_set(self) -> Nodal | Sheet:
        return (Sheet if self.solid == "sheet" else Nodal)(self.surface, self.wall_level)


class Nodal:
    """Level set f − level, the nodal approximation of a minimal surface."""

    def __init__(self, surface: Surface, level: float) -> None:
        self.surface, self.level = surface, level

    def value(self, points: Array) -> Array:
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
    """Return the share of the cell where f < level.

    Along a line in the direction of x every f is R cos(X − δ) + C, below the level on a share
    1 − arccos((level − C)/R)/π of its period.
    """
    angle = 2 * np.pi * (np.arange(LINES) + 0.5) / LINES
    y, z = angle[:, None], angle[None, :]
    if surface == "gyroid":
        R, C = np.hypot(np.cos(y), np.sin(z)), np.sin(y) * np.cos(z)
    elif surface == "schwarz-p":
        R, C = np.ones((LINES, LINES)), -(np.cos(y) + np.cos(z))
    else:
        R, C = np.hypot(np.cos(y - z), np.sin(y + z)), np.zeros((LINES, LINES))
    ratio = np.clip((level - C) / np.maximum(R, 1e-300), -1, 1)
    return float(1 - np.arccos(ratio).mean() / np.pi)
