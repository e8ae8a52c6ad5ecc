"""Unknowns of a macro run (changes of its data); derivatives of its histories (MacroSensitivities)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Literal, TypeAlias

import numpy as np

from porocore.states import Array

#: What a surface may prescribe, as ``macro.boundary.SURFACE`` has it.
BoundaryQuantity = Literal["displacement", "normal", "traction", "follower", "plate", "pressure", "flux"]


@dataclass(frozen=True)
class HatFunction:
    """Piecewise multilinear function of some coordinates: 1 at one node of a grid, 0 at the others, constant beyond it.

    Attributes
    ----------
    axes
        Of the coordinates: 0, 1 or 2, ascending.
    places
        Coordinates of the grid along each of them, ascending.
    index
        Place along each of the node at which it is 1.
    """

    axes: tuple[int, ...]
    places: tuple[tuple[float, ...], ...]
    index: tuple[int, ...]

    @classmethod
    def along(cls, axis: int, places: Sequence[float], index: int) -> HatFunction:
        """Return the function of one coordinate."""
        return cls((axis,), (tuple(places),), (index,))

    @classmethod
    def grid(cls, lines: Mapping[int, Sequence[float]]) -> list[HatFunction]:
        """Return the functions of all nodes of a grid, the first coordinate running fastest; lines by their axes."""
        axes = tuple(sorted(lines))
        places = tuple(tuple(lines[axis]) for axis in axes)
        every = product(*(range(len(line)) for line in reversed(places)))
        return [cls(axes, places, index[::-1]) for index in every]

    @property
    def node(self) -> dict[int, float]:
        """Coordinates of the node at which it is 1, by their axes."""
        rows = zip(self.axes, self.places, self.index, strict=True)
        return {axis: line[i] for axis, line, i in rows}

    def values(self, points: Array) -> Array:
        """Return the values (n,) at points (n, 3)."""
        found = np.ones(len(points))
        for axis, line, i in zip(self.axes, self.places, self.index, strict=True):
            found = found * np.interp(points[:, axis], line, np.eye(len(line))[i])
        return found


@dataclass(frozen=True)
class CellParameterChange:
    """Change of a parameter of the cell by the same number everywhere, or of the factor of its field.

    Attributes
    ----------
    name
        Parameter of the law.
    region
        Region in which it changes; None: wherever the field of the body holds, which is where no region has a field of
        its own of that name.
    factor
        The derivative is by the factor of the field, 1 at present, in place of the number that is added to it.
    weight
        Share of the change that each point takes; None: all of it. With the hat functions of its nodes the changes are
        those of the values of a table along an axis, or on a grid.
    """

    name: str
    region: str | None = None
    factor: bool = False
    weight: HatFunction | None = None


@dataclass(frozen=True)
class ModulusChange:
    """Relative change of the modulus E of the solid, of all its materials alike: d/d ln E with W = E w(H, p/E).

    Loads, prescribed displacements and pressures, and the conductivity at given states stay as they are in physical
    units, so a stiffer body settles less.

    Attributes
    ----------
    region
        Region of which the solid changes; None: the whole body.
    """

    region: str | None = None


@dataclass(frozen=True)
class ViscosityChange:
    """Relative change of the viscosity μ of the fluid, to which the flux is in inverse proportion: d/d ln μ.

    So is the flux through a surface that an indenter drains.
    """


@dataclass(frozen=True)
class LoadChange:
    """Change of the load, the common factor of all prescribed values, as ``load`` of a macro problem."""


@dataclass(frozen=True)
class BoundaryChange:
    """Change of one prescribed value.

    The derivative is by the number as the boundary conditions have it, before the load and the ramp; where the value is
    a function of time, it is by a factor of that function, 1 at present.

    Attributes
    ----------
    surface
        Name of the surface.
    quantity
        Of which the value is.
    component
        Component 0, 1 or 2 of a displacement or a traction.
    """

    surface: str
    quantity: BoundaryQuantity
    component: int = 0


#: What changes of an indenter: what is prescribed of it, the radius of its shape, or its place along its direction.
IndenterQuantity = Literal["displacement", "force", "radius", "offset"]


@dataclass(frozen=True)
class IndenterChange:
    """Change of an indenter of ``macro.contact``.

    The derivative by its displacement or force is as that by a prescribed value (:class:`BoundaryChange`), and that by
    its radius keeps the tip where it is. The offset is a way of its place along its direction.

    Attributes
    ----------
    indenter
        Name of the indenter.
    quantity
        What changes.
    """

    indenter: str
    quantity: IndenterQuantity


@dataclass(frozen=True)
class InitialPressureChange:
    """Change of the pressure with which the body begins, everywhere."""


#: Series of the history that have derivatives, as :class:`~porocore.interfaces.solution.History` has them.
HISTORY_SERIES = ("settlement", "heave", "pressure_max", "pressure_min", "drained")

#: Changes of what the points of a body consist of.
PointChange: TypeAlias = CellParameterChange | ModulusChange | ViscosityChange
MacroChange: TypeAlias = PointChange | LoadChange | BoundaryChange | IndenterChange | InitialPressureChange


@dataclass(frozen=True, eq=False)
class HistoryWeights:
    """Weights of f sums over all values of the histories of a run, whose gradients by the unknowns are wanted.

    The shapes are those of :class:`MacroSensitivities` with f in the place of k. A series that is left out weighs
    nothing.

    Attributes
    ----------
    count
        Number f of the sums.
    settlement, heave, pressure_max, pressure_min, drained : (steps, f)
        Of the history; None: nothing.
    probes : name → (steps, 4, f)
        Of u_1, u_2, u_3 and p of each probe.
    reactions : name → (steps, 3, f)
        Of the force on each surface that is held or moved.
    inflow : name → (steps, f)
        Of the inflow through each surface with a prescribed pressure.
    contact : name → (steps, 7, f)
        Of the columns of each indenter.
    compression : name → (steps, f)
        Of the compressive force on each plane surface; of a study, a solver takes none.
    profiles : (profiles, unknowns, f)
        Of the nodal fields in the profiles of the solution, displacements first: 3 · node + component, then the
        pressures at the corners; None: nothing.
    """

    count: int
    settlement: Array | None = None
    heave: Array | None = None
    pressure_max: Array | None = None
    pressure_min: Array | None = None
    drained: Array | None = None
    probes: Mapping[str, Array] = field(default_factory=dict)
    reactions: Mapping[str, Array] = field(default_factory=dict)
    inflow: Mapping[str, Array] = field(default_factory=dict)
    contact: Mapping[str, Array] = field(default_factory=dict)
    compression: Mapping[str, Array] = field(default_factory=dict)
    profiles: Array | None = None


@dataclass(frozen=True, eq=False)
class MacroSensitivities:
    """Derivatives of the histories of a :class:`~porocore.interfaces.solution.MacroSolution` by k unknowns.

    Times and lengths of the steps are held fixed, also where an error control has chosen them. Where the largest
    settlement or heave, or the largest or least pressure, moves from one node to another, its derivative is that of the
    node where it is.

    Attributes
    ----------
    changes
        The unknowns.
    settlement, heave, pressure_max, pressure_min, drained : (steps, k)
        Of the history.
    probes : name → (steps, 4, k)
        Of u_1, u_2, u_3 and p of each probe.
    reactions : name → (steps, 3, k)
        Of the force on each surface that is held or moved.
    inflow : name → (steps, k)
        Of the inflow through each surface with a prescribed pressure.
    compression : name → (steps, k)
        Of the compressive force on each plane surface; of a study.
    profiles : (profiles, unknowns, k)
        Of the nodal fields in the profiles of the solution, displacements first: 3 · node + component, then the
        pressures at the corners; None: they were not asked for.
    contact : name → (steps, 7, k)
        Of the columns of each indenter, as :class:`~porocore.interfaces.solution.MacroSolution` has them; those of the
        initial state are 0, and that of the largest pressure is of the point where it is.
    """

    changes: tuple[MacroChange, ...]
    settlement: Array
    heave: Array
    pressure_max: Array
    pressure_min: Array
    drained: Array
    probes: Mapping[str, Array]
    reactions: Mapping[str, Array]
    inflow: Mapping[str, Array]
    compression: Mapping[str, Array]
    profiles: Array | None = None
    contact: Mapping[str, Array] = field(default_factory=dict)
