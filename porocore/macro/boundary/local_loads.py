"""Prescribed values and loads of one process, from the boundary data of the body (LocalLoads)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from porocore.macro.boundary.conditions import BoundaryData, Loads
from porocore.states import Array, IntArray


@dataclass(frozen=True, eq=False)
class LocalLoads:
    """Prescribed values and loads for a unit of each time function.

    Attributes
    ----------
    values : (k, functions)
        Of the local prescribed unknowns.
    external : (functions, local unknowns)
        Dead loads and prescribed fluxes, where owned.
    followers
        Time function and factor of each pressure that follows its surface.
    """

    values: Array
    external: Array
    followers: tuple[tuple[int, float], ...] = ()

    @classmethod
    def of(cls, boundary: BoundaryData, unknowns: IntArray, owned: int, rotation: Any) -> LocalLoads:
        """Return those of a process.

        Parameters
        ----------
        unknowns : (local unknowns,)
            Number of each in the mesh's order.
        owned
            How many of them, from the first, belong to the process.
        rotation
            Sparse (local unknowns, local unknowns), from Cartesian ones; None where all are Cartesian.
        """
        place = np.full(boundary.external.shape[1], -1)
        place[boundary.prescribed] = np.arange(len(boundary.prescribed))
        places = place[unknowns]
        external = np.where(np.arange(len(unknowns)) < owned, boundary.external[:, unknowns], 0.0)
        if rotation is not None:
            external = external @ rotation.T
        followers = tuple((function, factor) for function, factor, _ in boundary.followers)
        return cls(boundary.values[places[places >= 0]], external, followers)

    def at(self, amplitudes: Array) -> Loads:
        """Return the loads at the values (functions,) of the time functions."""
        pressures = tuple(float(factor * amplitudes[function]) for function, factor in self.followers)
        return Loads(self.values @ amplitudes, amplitudes @ self.external, pressures)
