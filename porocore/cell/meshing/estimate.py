"""Refusal of a mesh with too many elements, by an estimate, before it is made."""

from __future__ import annotations

from porocore.errors import ConfigurationError

#: Tetrahedra of unit size in a unit cube; measured on drawn cells and level sets, 8 to 17.
PER_CUBE = 12.0
#: Tetrahedra along the fillets of a cell of unit size, times their radius; measured at radii of 0.02.
PER_FILLET = 1300.0
#: Largest number of elements; the memory that meshing so many takes was not measured.
MOST = 3_000_000


def require_few(count: float, key: str) -> None:
    """Refuse a mesh with too many elements, by their approximate number and the key of the size that decides.

    Raises
    ------
    ConfigurationError
        There are too many elements.
    """
    if not count <= MOST:
        shown = f"{count:,.0f}" if count < 1e12 else f"{count:.0e}"
        raise ConfigurationError(
            f"{key}: about {shown} tetrahedra would be made, at most {MOST:,} are; take larger elements, or wider "
            "pores and rounder ridges, which decide where they are narrower than the elements"
        )
