"""Plan of a study of sub-volumes: sizes, numbers, seed of the places, overlap."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

from porocore.cell.level_sets.image import LARGEST, SMALLEST
from porocore.core.echo import echo
from porocore.core.models.bounds import LARGEST_SEED
from porocore.errors import ConfigurationError

#: Sizes that are looked at where none are given, as far as the image reaches [voxels].
LADDER = (8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384)
#: Sub-volumes of one size that may be solved, and elements' sizes that may be given [voxels].
MOST, THINNEST, THICKEST = 1000, 0.5, 100.0


@dataclass(frozen=True)
class SubvolumePlan:
    """Sub-volumes of an image, cubes of so many voxels along each edge.

    Attributes
    ----------
    sizes
        Edges [voxels], increasing; None: 8, 12, 16, 24 … 384, as far as image and elements allow.
    count
        Sub-volumes of each size that are solved, at most.
    seed
        Seed of the choice of their places. A larger ``count`` adds to the places of a smaller one.
    overlapping
        False: cubes of a grid, which do not overlap, in random order; True: cubes at random places.
    within_crop
        True: in the part that ``cell.geometry.crop`` names, else in the whole image.
    element
        Size of the tetrahedra of both phases [voxels]; None: as many voxels as in the cell of the configuration.
    tolerance
        Share by which means may differ from that of the largest size, and single sub-volumes may scatter.
    solve
        False: only the porosity of the voxels is looked at.

    Raises
    ------
    ConfigurationError
        A value is out of its bounds; the message begins with its name.
    """

    sizes: tuple[int, ...] | None = None
    count: int = 4
    seed: int = 0
    overlapping: bool = False
    within_crop: bool = False
    element: float | None = None
    tolerance: float = 0.05
    solve: bool = True

    def __post_init__(self) -> None:
        if self.sizes is not None:
            _check_sizes(self.sizes)
        if not 1 <= self.count <= MOST:
            raise ConfigurationError(f"count: expected 1 to {MOST:,} sub-volumes, got {echo(self.count)}")
        if not 0 <= self.seed <= LARGEST_SEED:
            raise ConfigurationError(
                f"seed: expected a whole number from 0 to {LARGEST_SEED}, got {echo(self.seed)}"
            )
        if self.element is not None and not THINNEST <= self.element <= THICKEST:
            raise ConfigurationError(
                f"element: expected {THINNEST:g} to {THICKEST:g} voxels, got {echo(self.element)}; three are usual"
            )
        if not (math.isfinite(self.tolerance) and 0 < self.tolerance < 1):
            raise ConfigurationError(
                f"tolerance: expected a share between 0 and 1, such as 0.05 for 5 %, got {echo(self.tolerance)}"
            )

    def describe(self) -> dict[str, Any]:
        """Return the plan as plain data."""
        found: Mapping[str, Any] = asdict(self)
        return {**found, "sizes": None if self.sizes is None else list(self.sizes)}


def _check_sizes(sizes: tuple[int, ...]) -> None:
    shown = ",".join(str(size) for size in sizes)
    if not sizes:
        raise ConfigurationError("sizes: expected at least one edge in voxels, got none")
    if any(later <= earlier for earlier, later in pairwise(sizes)):
        raise ConfigurationError(f"sizes: expected increasing edges such as 16,24,32, got {echo(shown)}")
    if not SMALLEST <= sizes[0] <= sizes[-1] <= LARGEST:
        raise ConfigurationError(
            f"sizes: expected edges of {SMALLEST} to {LARGEST} voxels, got {echo(shown)}"
        )
