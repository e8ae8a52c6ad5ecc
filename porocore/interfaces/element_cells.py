"""Cells of a body's elements at the kept times (ElementCells): their regions, parameters and material axes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from porocore.core.hdf5 import Contents
from porocore.states import Array, IntArray, MacroState

#: Group of a file that holds them.
GROUP = "element_cells"


@dataclass(frozen=True, eq=False)
class ElementCells:
    """Regions, parameters and material axes of a body's elements, means over each element.

    What does not change with time is there once, else once for each profile of the solution.

    Attributes
    ----------
    region : (elements,)
        Number of the region: 0 is the rest of the body, the others count from 1 in the order of ``regions``.
    regions
        Names of the regions.
    parameters
        Names of the cell's parameters.
    values : (1 or profiles, elements, m)
        Values of the m parameters; NaN where the cell of a region has not one.
    axes : (1 or profiles, elements, 3, 3)
        Rotations whose columns are the material axes; None where they are those of the body.

    Examples
    --------
    >>> import numpy as np
    >>> from porocore import ElementCells
    >>> cells = ElementCells(np.array([0, 1]), ("top",), ("radius",), np.array([[[0.2], [0.25]]]))
    >>> cells.field("radius", 3)
    array([0.2 , 0.25])
    """

    region: IntArray
    regions: tuple[str, ...] = ()
    parameters: tuple[str, ...] = ()
    values: Array | None = None
    axes: Array | None = None

    @property
    def varies(self) -> bool:
        """True if anything changes with time."""
        return any(array is not None and len(array) > 1 for array in (self.values, self.axes))

    def field(self, name: str, profile: int) -> Array:
        """Return the values (elements,) of a parameter at the time of a profile, by its place among them."""
        values = self.values_at(profile)
        assert values is not None
        return np.asarray(values[:, self.parameters.index(name)])

    def values_at(self, profile: int) -> Array | None:
        """Return the values (elements, parameters) at the time of a profile; None without parameters."""
        return None if self.values is None else _at(self.values, profile)

    def axes_at(self, profile: int) -> Array | None:
        """Return the material axes (elements, 3, 3) at the time of a profile."""
        return None if self.axes is None else _at(self.axes, profile)

    def given_to(self, states: MacroState, profile: int, elements: Any = slice(None)) -> MacroState:
        """Return n states of a profile as their cells see them: in the material axes, with their parameters.

        Parameters
        ----------
        states
            States in the axes of the body.
        profile
            Number of the profile.
        elements
            Element of each state (n,); by default there is one state for each element.
        """
        H, theta = states.grad_u, None
        if self.axes is not None:
            R = _at(self.axes, profile)[elements]
            H = R.swapaxes(1, 2) @ H @ R
        if self.values is not None:
            theta = _at(self.values, profile)[elements]
        return replace(states, grad_u=H, parameters=theta)

    def of_elements(self, elements: IntArray, parameters: Sequence[str]) -> ElementCells:
        """Return the cells of some elements, with these of the parameters, in this order."""
        columns = [self.parameters.index(name) for name in parameters]
        return replace(
            self,
            region=self.region[elements],
            parameters=tuple(parameters),
            values=None if self.values is None or not columns else self.values[:, elements][:, :, columns],
            axes=None if self.axes is None else self.axes[:, elements],
        )

    def save(self, file: Any) -> None:
        """Write them into an open HDF5 file."""
        file[f"{GROUP}/region"] = self.region
        for name in ("regions", "parameters"):
            if names := getattr(self, name):
                file[f"{GROUP}/{name}"] = list(names)
        for name in ("values", "axes"):
            if (array := getattr(self, name)) is not None:
                file[f"{GROUP}/{name}"] = array

    @classmethod
    def read(cls, file: Contents) -> ElementCells | None:
        """Read what :meth:`save` wrote; None where there is nothing.

        Raises
        ------
        ValueError
            The arrays do not fit together.
        """
        there = file.members(GROUP)
        if not there:
            return None
        region = file.array(f"{GROUP}/region", "elements", kind="int")
        names = {
            name: tuple(file.texts(f"{GROUP}/{name}", name)) if name in there else ()
            for name in ("regions", "parameters")
        }
        if len(region) and not 0 <= region.min() <= region.max() <= len(names["regions"]):
            raise ValueError(f"'{GROUP}/region' names a region that is not there")
        shapes = {"values": ("elements", "parameters"), "axes": ("elements", 3, 3)}
        arrays = {
            name: file.array(f"{GROUP}/{name}", f"times of {name}", *shape, finite=False)
            for name, shape in shapes.items()
            if name in there
        }
        return cls(region, names["regions"], names["parameters"], arrays.get("values"), arrays.get("axes"))


def _at(arrays: Array, profile: int) -> Array:
    return np.asarray(arrays[profile if len(arrays) > 1 else 0])
