"""Results of a study of sub-volumes (RepresentativeVolume), and its files."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from porocore.verification.representative.outlook import SizeOutlook
from porocore.verification.representative.plan import SubvolumePlan
from porocore.verification.representative.scan import Scan
from porocore.verification.representative.settling import Settling, SizeStatistics
from porocore.verification.representative.subvolume import SOLVED, Subvolume


@dataclass(frozen=True, eq=False)
class RepresentativeVolume:
    """Results of a study and the files that show them.

    Attributes
    ----------
    plan
        What was asked for.
    scan
        The image and how cells are made of it.
    outlooks
        Sizes with the porosities of their voxels, expected costs, and why some were not solved.
    subvolumes
        Results of single sub-volumes, by size.
    settling
        Sizes at which the results settle.
    record
        ``rev.json``, dimensionless, with all tensors.
    tables
        ``sizes.csv`` and ``subvolumes.csv``.
    pictures
        ``rev.png`` and ``rev.svg``.
    """

    plan: SubvolumePlan
    scan: Scan
    outlooks: tuple[SizeOutlook, ...]
    subvolumes: tuple[Subvolume, ...]
    settling: Settling
    record: Path
    tables: tuple[Path, ...] = ()
    pictures: tuple[Path, ...] = ()

    @cached_property
    def voxels(self) -> SizeStatistics:
        """Porosity by the voxels of many sub-volumes of each size."""
        return SizeStatistics.of({each.size: list(each.porosities) for each in self.outlooks})

    def solved(self, size: int) -> tuple[int, int]:
        """Return how many sub-volumes of a size have all results, and how many were tried."""
        tried = [each for each in self.subvolumes if each.size == size]
        return sum(each.status == SOLVED for each in tried), len(tried)
