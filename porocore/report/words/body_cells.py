"""Cells of a body for the report (BodyCells): regions, fields of the parameters, porosity and K at rest."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from porocore.core.units.results import ResultUnits
from porocore.interfaces.element_cells import ElementCells
from porocore.interfaces.solution import MacroSolution
from porocore.macro.body.mesh import BodyMesh
from porocore.report.format import number, percent
from porocore.states import Array


@dataclass(frozen=True, eq=False)
class BodyCells:
    """The cells of a body of many cells.

    Attributes
    ----------
    cells
        Regions, parameters and material axes of the elements.
    times
        Those of the profiles, to which ``cells`` belong.
    volumes : (elements,)
        Of the elements.
    conductivity : (elements, 3, 3)
        K of the undeformed cells at first, in the axes of the body.
    porosity : (elements,)
        φ_f of the undeformed cells at first; None: not known.
    quantities
        Quantity of each parameter; '' is a plain number.
    cell_names
        Name of the cell of each region, the rest of the body first; empty: one for all.
    """

    cells: ElementCells
    times: tuple[float, ...]
    volumes: Array
    conductivity: Array
    porosity: Array | None = None
    quantities: Mapping[str, str] = field(default_factory=dict)
    cell_names: tuple[str, ...] = ()

    def of_regions(self, regions: Collection[int], parameters: Sequence[str]) -> BodyCells:
        """Return the cells of some regions, with these of the parameters."""
        elements = np.flatnonzero(np.isin(self.cells.region, list(regions)))
        return replace(
            self,
            cells=self.cells.of_elements(elements, parameters),
            volumes=self.volumes[elements],
            conductivity=self.conductivity[elements],
            porosity=None if self.porosity is None else self.porosity[elements],
        )

    @property
    def shown(self) -> tuple[int, ...]:
        """Profiles whose fields are shown: the first and the last where they differ."""
        return (0, len(self.times) - 1) if self.cells.varies and len(self.times) > 1 else (0,)

    def field(self, name: str) -> list[tuple[float, Array]]:
        """Return time and values (elements,) of a parameter at the profiles that are shown."""
        at = [(self.times[i], self.cells.field(name, i)) for i in self.shown]
        same = len(at) > 1 and np.array_equal(at[0][1], at[1][1], equal_nan=True)
        return at[:1] if same else at

    def used(self) -> dict[str, tuple[float, float]]:
        """Return the least and the largest mean over an element of each parameter, at the kept times."""
        values = self.cells.values
        if values is None:
            return {}
        low, high = (end(values, axis=(0, 1)) for end in (np.nanmin, np.nanmax))
        return {
            name: (float(a), float(b)) for name, a, b in zip(self.cells.parameters, low, high, strict=True)
        }

    def over(self, name: str) -> tuple[Array, Array]:
        """Return the values of a parameter at all kept times, and the volumes that have them."""
        values = self.cells.values
        assert values is not None
        column = values[:, :, self.cells.parameters.index(name)]
        known = np.isfinite(column)
        return column[known], np.broadcast_to(self.volumes, column.shape)[known]


def volumes_of(solution: MacroSolution) -> Array:
    """Return the volumes (elements,) of the elements of a solution."""
    return np.asarray(BodyMesh(solution.points, solution.cells).weights.sum(axis=1))


def region_rows(body: BodyCells, units: ResultUnits) -> tuple[list[str], list[list[str]]]:
    """Return the headings and rows of the table of regions: share of the volume, parameters, porosity, K.

    The rest of the body has a row where there is any; a body without regions has one row.
    """
    cells, rows = body.cells, []
    heads = ["region", *(["cell"] if body.cell_names else []), "share of the volume"]
    heads += [units.titled(name, body.quantities.get(name, "")) for name in cells.parameters]
    at = "at t = 0" if cells.varies else "at rest"
    heads += [f"porosity {at}"] if body.porosity is not None else []
    heads.append(units.titled(f"K₂₂ {at}", "conductivity"))
    names = ["elsewhere" if cells.regions else "whole body", *cells.regions]
    for k, name in enumerate(names):
        inside = cells.region == k
        if not inside.any():
            continue
        row = [name, *([body.cell_names[k]] if body.cell_names else [])]
        row.append(percent(float(body.volumes[inside].sum() / body.volumes.sum())))
        for column, parameter in enumerate(cells.parameters):
            values = cells.values[:, inside, column] if cells.values is not None else np.zeros(0)
            row.append(_from_to(values * units.factor(body.quantities.get(parameter, ""))))
        if body.porosity is not None:
            row.append(_from_to(body.porosity[inside]))
        row.append(_from_to(body.conductivity[inside, 1, 1] * units.factor("conductivity")))
        rows.append(row)
    return heads, rows


def _from_to(values: Array) -> str:
    """Return the least and the largest of the finite values, or the only one; a dash without any."""
    known = values[np.isfinite(values)]
    if not known.size:
        return number(None)
    low, high = number(float(known.min())), number(float(known.max()))
    return low if low == high else f"{low} to {high}"
