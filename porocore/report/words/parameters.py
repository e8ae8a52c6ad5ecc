"""Cells over their parameters (FamilySummary) and cells of a body (BodyCells), for the report."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from porocore.core.units import units_now
from porocore.interfaces.cell import ElementCells
from porocore.interfaces.solution import MacroSolution
from porocore.macro.body.mesh import BodyMesh
from porocore.report.format import number, percent
from porocore.report.words.held_out import OutputCheck
from porocore.states import Array

#: Outputs whose errors are shown over a parameter: start of their plain names, and a label.
GROUPS = {
    "⟨∇u¹⟩": r"$\langle\nabla_Y u^1\rangle$",
    "P_E": "$P_E$",
    "fluid volume": r"$\varphi$",
    "K": "$K$",
}
#: Digits of a mean over an element that are not round-off.
MEAN_DIGITS = 12


@dataclass(frozen=True)
class ParameterRange:
    """A parameter of the cell.

    Attributes
    ----------
    name, key
        Its name, and its key in the configuration.
    lower, upper
        Ends of its range.
    quantity
        Of :data:`porocore.core.units.QUANTITIES`; '' is a plain number.
    solved
        Whether the solved undeformed members can be held against the law over it. They cannot over a swelling of the
        whole solid, or where this has a fixed one: they are solved before it swells, and the law has that exactly.
    """

    name: str
    key: str
    lower: float
    upper: float
    quantity: str = ""
    solved: bool = True

    def label(self) -> str:
        """Return the name with its unit."""
        return units_now().titled(self.name, self.quantity)


@dataclass(frozen=True, eq=False)
class RestField:
    """A property of the undeformed cell over the parameters.

    Attributes
    ----------
    label, plain
        In matplotlib's mathematics and in plain text.
    quantity
        Of :data:`porocore.core.units.QUANTITIES`; '' is a plain number.
    members : (k,)
        Of the solved members.
    curves : (m, points)
        By the surrogate over each of the m parameters, the others in the middle of their ranges.
    low, high : (m, points)
        Least and largest of it where the others go through their ranges.
    """

    label: str
    plain: str
    quantity: str
    members: Array
    curves: Array
    low: Array
    high: Array


@dataclass(frozen=True, eq=False)
class FamilySummary:
    """Undeformed members of a family of cells, and the surrogate between them.

    Attributes
    ----------
    parameters
        The m parameters in their order.
    members : (k, m)
        Parameters of the solved members.
    points : (m, points)
        Values of each parameter at which the surrogate was asked.
    fields
        Properties of the undeformed cell.
    failed
        Members that have no solution.
    """

    parameters: tuple[ParameterRange, ...]
    members: Array
    points: Array
    fields: tuple[RestField, ...]
    failed: int = 0


@dataclass(frozen=True, eq=False)
class GroupErrors:
    """Errors of one output of the surrogate on the counted held-out states, the largest of its components.

    Attributes
    ----------
    label, plain
        In matplotlib's mathematics and in plain text.
    parameters : (n, m)
        Of the states.
    percent : (n,)
        Largest error of a component, in per cent of the range of the component that varies most.
    """

    label: str
    plain: str
    parameters: Array
    percent: Array


def group_errors(checks: Sequence[OutputCheck]) -> list[GroupErrors]:
    """Return the errors of each output, all components together, on the counted states."""
    found = []
    for start, label in GROUPS.items():
        members = [c for c in checks if c.plain.startswith(start) and c.parameters is not None]
        if not members:
            continue
        span = max(check.span for check in members)
        errors = np.abs([check.predicted - check.solved for check in members]).max(axis=0)
        counted, first = members[0].counted, members[0]
        assert first.parameters is not None
        found.append(
            GroupErrors(
                label, "fluid volume φ" if start == "fluid volume" else start, first.parameters[counted],
                100 * errors[counted] / span,
            )
        )  # fmt: skip
    return found


def binned_rms(x: Array, values: Array, edges: Array) -> Array:
    """Return the root mean square of the values in each bin between ``edges``, NaN where there are none."""
    bins = len(edges) - 1
    at = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, bins - 1)
    count = np.bincount(at, minlength=bins)
    squares = np.bincount(at, values**2, minlength=bins)
    mean = np.divide(squares, count, out=np.full(bins, np.nan), where=count > 0)
    return np.asarray(np.sqrt(mean))


def family_figures(
    family: FamilySummary, errors: Sequence[GroupErrors], used: Mapping[str, tuple[float, float]]
) -> list[dict[str, object]]:
    """Return range, use in the body and held-out errors of each parameter, ready for ``metrics.json``.

    ``used`` are least and largest mean over an element of the body. Errors are those in the three thirds of the range.
    """
    found: list[dict[str, object]] = []
    for k, parameter in enumerate(family.parameters):
        edges = np.linspace(parameter.lower, parameter.upper, 4)
        thirds = {
            each.plain: [
                float(rms) if np.isfinite(rms) else None
                for rms in binned_rms(each.parameters[:, k], each.percent, edges)
            ]
            for each in errors
        }
        found.append(
            {
                "name": parameter.name,
                "key": parameter.key,
                "range": [parameter.lower, parameter.upper],
                "in_body": [_rounded(end) for end in used[parameter.name]]
                if parameter.name in used
                else None,
                "rms_error_percent_by_third": thirds,
                "held_out_members_by_third": _members(errors, k, edges),
            }
        )
    return found


def _members(errors: Sequence[GroupErrors], k: int, edges: Array) -> list[int]:
    """Return how many members the counted held-out states have in each bin of the parameter of number k."""
    if not errors:
        return [0] * (len(edges) - 1)
    members = np.unique(errors[0].parameters, axis=0)[:, k]
    return [int(count) for count in np.histogram(members, edges)[0]]


def _rounded(value: float) -> float:
    """Return a mean without the round-off of its weights: 1 rather than 0.9999999999999998."""
    return float(f"{value:.{MEAN_DIGITS}g}")


def parameter_rows(
    family: FamilySummary, used: Mapping[str, tuple[float, float]]
) -> list[tuple[str, str, str, str]]:
    """Return name, key, range and least and largest mean over an element of the body of each parameter."""
    rows = []
    for each in family.parameters:
        factor = units_now().factor(each.quantity)

        def text(ends: tuple[float, float], factor: float = factor) -> str:
            low, high = (number(end * factor) for end in ends)
            return low if low == high else f"{low} to {high}"

        body = text(used[each.name]) if each.name in used else "–"
        rows.append((each.label(), each.key, text((each.lower, each.upper)), body))
    return rows


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
    return np.asarray(BodyMesh.of(solution).weights.sum(axis=1))


def region_rows(body: BodyCells) -> tuple[list[str], list[list[str]]]:
    """Return the headings and rows of the table of regions: share of the volume, parameters, porosity, K.

    The rest of the body has a row where there is any; a body without regions has one row.
    """
    units, cells, rows = units_now(), body.cells, []
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
            row.append(from_to(values * units.factor(body.quantities.get(parameter, ""))))
        if body.porosity is not None:
            row.append(from_to(body.porosity[inside]))
        row.append(from_to(body.conductivity[inside, 1, 1] * units.factor("conductivity")))
        rows.append(row)
    return heads, rows


def from_to(values: Array) -> str:
    """Return the least and the largest of the finite values, or the only one; a dash without any."""
    known = values[np.isfinite(values)]
    if not known.size:
        return number(None)
    low, high = number(float(known.min())), number(float(known.max()))
    return low if low == high else f"{low} to {high}"
