"""Conditions of one surface: displacements, normal motion, plate, tractions, pressures and fluxes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from porocore.core.formulas.time_function import TimeFunction, Value
from porocore.errors import ConfigurationError
from porocore.macro.body.surfaces import Facets
from porocore.macro.boundary.frames import Constraint
from porocore.macro.boundary.reactions import Support
from porocore.macro.problem import Boundary
from porocore.states import Array, IntArray

if TYPE_CHECKING:
    from porocore.macro.boundary.conditions import Collector


@dataclass(frozen=True)
class SurfaceConditions:
    """Surface that adds its conditions to a collector."""

    to: Collector
    name: str
    key: str
    facets: Facets
    boundary: Boundary

    def collect(self) -> None:
        self._displacements()
        self._plate()
        self._loads()
        self._fluid()

    @cached_property
    def nodes(self) -> IntArray:
        return np.unique(self.facets.nodes)

    def _displacements(self) -> None:
        directions = []
        for i, value in enumerate(self.boundary.displacement):
            if value is not None:
                directions.append(np.eye(3)[i])
                self.to.prescribe(3 * self.nodes + i, value, f"u_{i + 1}", self.key)
        if self.boundary.normal is not None:
            directions.append(self._normal(self.boundary.normal))
        if directions:
            self.to.held[self.name] = Support(self.facets, np.array(directions))

    def _normal(self, value: Value) -> Array:
        """Prescribe the normal displacement and return its direction (3,)."""
        normal = self.facets.plane(f"{self.key}.normal")
        axis = int(np.abs(normal).argmax())
        if abs(normal[axis]) > 1 - 1e-9:
            signed = value if normal[axis] > 0 else _opposite(value, self.key)
            self.to.prescribe(3 * self.nodes + axis, signed, f"u_{axis + 1}", self.key)
            return np.asarray(np.eye(3)[axis])
        function, factor = self.to.split(value)
        for node in self.nodes:
            source = f"{self.key}.normal"
            self.to.oblique.setdefault(int(node), []).append(Constraint(normal, function, factor, source))
        return normal

    def _plate(self) -> None:
        if self.boundary.plate is None:
            return
        normal = self.facets.plane(f"{self.key}.plate")
        axis = int(np.abs(normal).argmax())
        if abs(normal[axis]) < 1 - 1e-9:
            raise ConfigurationError(
                f"{self.key}.plate: this surface is oblique; a plate moves along x, y or z, on a surface across it"
            )
        unknowns = 3 * self.nodes + axis
        force = np.zeros(self.to.mesh.size)
        force[unknowns[0]] = -1.0
        self.to.plates[self.name] = unknowns
        self.to.load(self.boundary.plate, force)

    def _loads(self) -> None:
        n_u = self.to.mesh.n_u
        if any(value != 0 for value in self.boundary.traction):
            areas = self.facets.shares(self.to.mesh.element.facet.values)
            for i, value in enumerate(self.boundary.traction):
                force = np.zeros(self.to.mesh.size)
                force[i:n_u:3] = -areas
                self.to.load(value, force)
        if self.boundary.follower != 0:
            self.to.followers.append((*self.to.split(self.boundary.follower), self.facets))

    def _fluid(self) -> None:
        mesh = self.to.mesh
        places = np.searchsorted(mesh.p_nodes, self.nodes[np.isin(self.nodes, mesh.p_nodes)])
        if self.boundary.pressure is not None:
            self.to.prescribe(mesh.n_u + places, self.boundary.pressure, "p", self.key)
            self.to.drains[self.name] = Support(self.facets, np.ones((1, 1)))
        if self.boundary.flux != 0:
            force = np.zeros(mesh.size)
            force[mesh.n_u :] = self.facets.shares(mesh.element.facet.corner_values)[mesh.p_nodes]
            self.to.load(self.boundary.flux, force)


def _opposite(value: Value, key: str) -> Value:
    if isinstance(value, TimeFunction):
        raise ConfigurationError(
            f"{key}.normal: the outward normal is against an axis here, and a function of time cannot be negated; "
            "prescribe the component of the displacement"
        )
    return -value
