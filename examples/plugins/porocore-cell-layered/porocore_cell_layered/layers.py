"""Reading plane layers off the meshes of a cell, whatever geometry they were made from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from porocore import Cell, ConfigurationError

#: Of lengths and volumes, in lengths of the cell.
TOLERANCE = 1e-6


@dataclass(frozen=True)
class Layers:
    """Plane layers that fill a cell.

    Attributes
    ----------
    axis
        Across the layers: 0, 1 or 2.
    solids
        Material and share of the cell's volume of each solid part.
    channels
        Thickness of each layer of fluid.
    """

    axis: int
    solids: tuple[tuple[object, float], ...]
    channels: tuple[float, ...]

    @property
    def porosity(self) -> float:
        return sum(self.channels)


def layers_of(cell: Cell) -> Layers:
    """The layers of a cell.

    Raises
    ------
    ConfigurationError
        Its parts are no plane layers across one of the axes, or it is a supercell.
    """
    if cell.supercell != (1, 1, 1):
        raise ConfigurationError("cell.supercell: layered takes single cells; leave it out")
    parts = _parts(cell, "solid")
    fluid = _parts(cell, "fluid") if cell.geometry.porosity > 0 else {}
    for axis in range(3):
        spans = {name: _spans(corners[:, :, axis]) for name, corners in (parts | fluid).items()}
        # Spans of a cross-section of 1 hold at least the volume of a part; as much only if they are full of it.
        if all(
            abs(sum(high - low for low, high in spans[name]) - _volume(corners)) < TOLERANCE
            for name, corners in (parts | fluid).items()
        ):
            solids = tuple((_material(cell, name), _volume(corners)) for name, corners in parts.items())
            return Layers(axis, solids, _channels([span for name in fluid for span in spans[name]]))
    raise ConfigurationError(
        f"cell.geometry: layered solves plane layers across x, y or z only, got {cell.geometry.description}; "
        "choose another fem.backend"
    )


def _parts(cell: Cell, phase: str):
    """Corners (elements, 4, 3) of each region of a phase."""
    mesh = cell.make_mesh(phase, "whole")
    corners = mesh.points[mesh.cells[:, :4]]
    names = [(phase, name) for name in mesh.region_names]
    return {name: corners[mesh.regions == k] for k, name in enumerate(names)}


def _volume(corners) -> float:
    edges = corners[:, 1:] - corners[:, :1]
    return float(np.linalg.det(edges).sum() / 6)


def _spans(x) -> list[tuple[float, float]]:
    """Intervals that elements (elements, 4) cover together."""
    spans: list[tuple[float, float]] = []
    low, high = x.min(axis=1), x.max(axis=1)
    for first, last in zip(low[np.argsort(low)], high[np.argsort(low)], strict=True):
        if spans and first <= spans[-1][1] + TOLERANCE:
            spans[-1] = (spans[-1][0], max(spans[-1][1], last))
        else:
            spans.append((first, last))
    return spans


def _channels(spans: list[tuple[float, float]]) -> tuple[float, ...]:
    """Thicknesses; a layer that is cut by the end of the cell goes on at its beginning."""
    spans = sorted(spans)
    if len(spans) > 1 and spans[0][0] < -0.5 + TOLERANCE and spans[-1][1] > 0.5 - TOLERANCE:
        (_, first), (last, _) = spans[0], spans[-1]
        spans = [*spans[1:-1], (last, first + 1)]
    return tuple(float(high - low) for low, high in spans)


def _material(cell: Cell, name: tuple[str, str]):
    return cell.material if cell.material is not None else cell.materials[name[1]]
