"""Outcome of a study of sub-volumes in sentences: verdict, failures, uncertainty, settings."""

from __future__ import annotations

import math
from collections.abc import Iterator

from porocore.core.echo import joined
from porocore.core.units.results import length_text
from porocore.verification.representative.results import RepresentativeVolume
from porocore.verification.representative.settling import ERRORS, JUDGED, QUANTITIES, typical
from porocore.verification.representative.subvolume import SOLVED, Subvolume


def verdict(study: RepresentativeVolume) -> Iterator[str]:
    """Yield which size suffices, or why none does and what to do."""
    yield from _failures(study)
    settling, share = study.settling, f"{100 * study.settling.tolerance:g} %"
    sizes = sorted({size for name in JUDGED for size in settling.scatter[name].sizes})
    if len(sizes) < 2:
        yield from _porosity_alone(study, share)
        if study.plan.solve:
            yield "no size can be judged: sub-volumes of two sizes at least have to be solved; give more --sizes"
        return
    largest = sizes[-1]
    found = ", ".join(f"{QUANTITIES[name].title} {settling.settled[name] or '–'}" for name in JUDGED)
    yield f"means within {share} of those of {largest} voxels from this size on: {found} voxels"
    yield from _uncertain(study, largest, share)
    if settling.enough is not None:
        yield from _enough(study, settling.enough, share)
    elif settling.settled_all is not None:
        yield from _settled(study, settling.settled_all, share)
    else:
        moving = [QUANTITIES[name].title for name in JUDGED if settling.settled[name] is None]
        yield (
            f"no size suffices for {share}: {joined(moving)} still {'change' if len(moving) > 1 else 'changes'} up to "
            f"{largest} voxels; give larger --sizes, or a larger --count where single sub-volumes scatter"
        )


def _failures(study: RepresentativeVolume) -> Iterator[str]:
    failed = [each for each in study.subvolumes if each.status != SOLVED]
    for status in dict.fromkeys(each.status for each in failed):
        those = [each for each in failed if each.status == status]
        count = f"{len(those)} of {len(study.subvolumes)}"
        yield f"{count} {status}, such as that at {_place(those[0])}: {those[0].message}"
    if failed:
        yield "means are those of the others, which may differ from these"


def _porosity_alone(study: RepresentativeVolume, share: str) -> Iterator[str]:
    """Yield the size from which the voxels' porosity stays; cheap, and no more than a lower bound."""
    voxels, tolerance = study.voxels, study.settling.tolerance
    if len(voxels.sizes) < 2:
        return
    enough = next((size for size in voxels.sizes if voxels.suffices(size, tolerance)), None)
    if enough is None:
        yield f"the porosity of single sub-volumes scatters by more than {share} up to {voxels.sizes[-1]} voxels"
        return
    yield (
        f"the porosity of single sub-volumes is within {share} from {enough} voxels on; permeability and stiffness "
        "need larger ones as a rule"
    )


def _uncertain(study: RepresentativeVolume, largest: int, share: str) -> Iterator[str]:
    """Yield a note where the means of the largest size, with which the others are compared, are not known."""
    doubtful = []
    for name in JUDGED:
        count, mean, deviation = study.settling.scatter[name].at(largest)
        if count < 2:
            yield (
                f"note: of {largest} voxels, with which the others are compared, one sub-volume was solved, and its "
                "scatter is not known"
            )
            return
        error = ERRORS * deviation / math.sqrt(count) / abs(mean)
        if error > study.settling.tolerance:
            doubtful.append((error, QUANTITIES[name].title))
    if doubtful:
        error, title = max(doubtful)
        yield (
            f"note: the means of {largest} voxels are known to {_percent(error)} only ({title}, two standard errors), "
            f"so that {share} may be met by chance; a larger --count tells"
        )


def _enough(study: RepresentativeVolume, size: int, share: str) -> Iterator[str]:
    scatter, name = _worst(study, size)
    yield (
        f"{size} voxels{_metres(study, size)} suffice for {share}: the means have settled, and single sub-volumes "
        f"scatter by {_percent(scatter)} at most ({QUANTITIES[name].title})"
    )
    yield from _settings(study, size)


def _settled(study: RepresentativeVolume, size: int, share: str) -> Iterator[str]:
    scatter, name = _worst(study, size)
    if not math.isfinite(scatter):
        yield (
            f"no size suffices for {share} as far as is known: the means have settled at {size} voxels, where one "
            "sub-volume alone was solved; a larger --count tells its scatter"
        )
        return
    needed = max(study.settling.scatter[each].needed(size, study.settling.tolerance) for each in JUDGED)
    yield (
        f"no single sub-volume suffices for {share}: the means have settled at {size} voxels{_metres(study, size)}, "
        f"but single sub-volumes scatter by {_percent(scatter)} there ({QUANTITIES[name].title}); the mean of "
        f"{needed:.0f} of them is known to {share}, or a larger one may suffice"
    )
    yield from _settings(study, size)


def _settings(study: RepresentativeVolume, size: int) -> Iterator[str]:
    """Yield the lines of a configuration with the sub-volume of a size that is closest to the means."""
    chosen = typical(study.subvolumes, study.settling, size)
    if chosen is None:
        return
    crop = ", ".join(f"[{first}, {first + size}]" for first in chosen.corner)
    solid, fluid = study.scan.mesh_sizes(size)
    yield (
        f"the one closest to the means: cell.geometry.crop: [{crop}] with cell.mesh: {{size: {solid:g}, fluid_size: "
        f"{fluid:g}}}"
    )


def _worst(study: RepresentativeVolume, size: int) -> tuple[float, str]:
    """Return the largest scatter of single sub-volumes of a size, and of which quantity; infinite if one is unknown."""
    found = []
    for name in JUDGED:
        scatter = study.settling.scatter[name]
        relative = float(scatter.relative[scatter.sizes.index(size)]) if size in scatter.sizes else math.nan
        found.append((relative if math.isfinite(relative) else math.inf, name))
    return max(found)


def _metres(study: RepresentativeVolume, size: int) -> str:
    extents = study.scan.extents_of(size)
    return f", {length_text(*extents)}," if extents else ""


def _place(each: Subvolume) -> str:
    return f"{list(each.corner)} of {each.size} voxels"


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %"
