"""Requirements on a cell for the conductivity of the deformed pore."""

from __future__ import annotations

from porocore.cell.cell import Cell
from porocore.cell.conductivity.wall_displacement import wall_interpolation
from porocore.cell.meshing.mesh import Domain
from porocore.errors import ConfigurationError


def require_one_cell(cell: Cell) -> None:
    """Refuse a cell without pores, and a block of cells.

    Raises
    ------
    ConfigurationError
        No conductivity of a deformed pore belongs to it.
    """
    if cell.geometry.porosity == 0:
        raise ConfigurationError("conductivity: the cell has no pores; choose conductivity: piola")
    if cell.supercell != (1, 1, 1):
        raise ConfigurationError(
            "conductivity: the conductivity of the deformed pore is that of one cell, but cell.supercell has "
            "several; choose conductivity: piola, or cell.supercell: [1, 1, 1]"
        )


def require_one_wall(cell: Cell) -> None:
    """Refuse a cell whose two meshes approximate the pore wall too differently for one to follow the other.

    Raises
    ------
    ConfigurationError
        The wall of the fluid's mesh does not lie on that of the solid's.
    """
    domain: Domain = "eighth" if cell.mirrored else "whole"
    wall_interpolation(cell.make_mesh("solid", domain), cell.make_mesh("fluid", domain).quadratic)
