"""What is prescribed at which unknown of the body, and what loads and flows through its surface amount to there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from porocore.core.formulas.time_function import TimeFunction, Value
from porocore.errors import ConfigurationError
from porocore.macro.body.mesh import BodyMesh
from porocore.macro.body.surfaces import Facets
from porocore.macro.boundary.frames import SAME, Constraint, in_frames
from porocore.macro.boundary.reactions import Share, Support, shares
from porocore.macro.problem import Boundary, MacroProblem
from porocore.states import Array, IntArray


@dataclass(frozen=True, eq=False)
class BoundaryData:
    """By the unknowns' numbers in the mesh, for a unit of each course.

    Attributes
    ----------
    courses
        1.0 for the common ramp, then every other course that occurs.
    prescribed : (k,)
        Unknowns that are prescribed, ascending.
    values : (k, courses)
        Their values.
    external : (courses, unknowns)
        −∫ t̄ N dS − ∫ b N dX of the displacements, less the force on a plate in the first of its unknowns, and
        ∫ q̄ N dS of the pressures.
    plates
        Unknowns that are one, ascending, for each rigid plate.
    followers
        TimeFunction, its factor and the facets of each pressure that follows the surface.
    rotation
        (unknowns, unknowns) orthogonal matrix Q from Cartesian unknowns to those that are solved for, which differ
        at nodes of oblique surfaces; None where all are Cartesian.
    supports
        By which the reactions at all unknowns are summed up to the force on each surface that is held or moved.
    drains
        The same for the fluid that enters through each surface with a prescribed pressure.
    """

    courses: tuple[Value, ...]
    prescribed: IntArray
    values: Array
    external: Array
    plates: tuple[IntArray, ...] = ()
    followers: tuple[tuple[int, float, Facets], ...] = ()
    rotation: Any = None
    supports: Mapping[str, Share] = field(default_factory=dict)
    drains: Mapping[str, Share] = field(default_factory=dict)

    @property
    def acting(self) -> Array:
        """(courses,) bool, which of them do anything."""
        acts = (self.values != 0).any(axis=0) | (self.external != 0).any(axis=1)
        for course, factor, _ in self.followers:
            acts[course] |= factor != 0
        return np.asarray(acts)

    def amplitudes(self, problem: MacroProblem, time: float) -> Array:
        """(courses,) what acts at ``time``, the load included."""
        return problem.load * np.array([problem.factor(course, time) for course in self.courses])


def boundary_data(mesh: BodyMesh, problem: MacroProblem) -> BoundaryData:
    """From the problem's surfaces.

    Raises
    ------
    ConfigurationError
        There is no such surface, two surfaces prescribe different values where they meet, one holds the edge of
        another's plate along the axis of that, two plates with one axis share an edge, a plate or a normal displacement
        is on a curved surface, or a translation is not held.
    """
    return _Collector(mesh, problem).result()


class _Collector:
    def __init__(self, mesh: BodyMesh, problem: MacroProblem) -> None:
        self.mesh, self.problem = mesh, problem
        self.courses: list[Value] = [1.0]
        #: TimeFunction and factor of each prescribed unknown; −1 where nothing is.
        self.course = np.full(mesh.size, -1)
        self.factor = np.zeros(mesh.size)
        self.external: dict[int, Array] = {}
        self.oblique: dict[int, list[Constraint]] = {}
        self.plates: dict[str, IntArray] = {}
        self.followers: list[tuple[int, float, Facets]] = []
        self.held: dict[str, Support] = {}
        self.drains: dict[str, Support] = {}

    def result(self) -> BoundaryData:
        for name, boundary in self.problem.boundary.items():
            key = f"macro.boundary.{name}"
            facets = Facets(self.mesh, self.mesh.surface(name, key))
            if len(facets.nodes):
                _Surface(self, name, key, facets, boundary).collect()
        self._body_force()
        self._check()
        rotation, oblique = in_frames(
            self.mesh, self.oblique, self._cartesian_constraints, len(self.courses), self._pushed()
        )
        plain = np.flatnonzero(self.course >= 0)
        plain = plain[~np.isin(plain // 3, list(self.oblique)) | (plain >= self.mesh.n_u)]
        values = np.zeros((self.mesh.size, len(self.courses)))
        values[plain, self.course[plain]] = self.factor[plain]
        unknowns, rows = oblique
        values[unknowns] = rows
        prescribed = np.union1d(plain, unknowns).astype(np.int64)
        external = np.zeros((len(self.courses), self.mesh.size))
        for course, force in self.external.items():
            external[course] += force
        return BoundaryData(
            tuple(self.courses),
            prescribed,
            values[prescribed],
            external,
            tuple(self.plates.values()),
            tuple(self.followers),
            rotation,
            shares(self.mesh, self.held),
            shares(self.mesh, self.drains, fluid=True),
        )

    def split(self, value: Value) -> tuple[int, float]:
        """Number of its course, and the factor on that."""
        if not isinstance(value, TimeFunction):
            return 0, float(value)
        if value not in self.courses:
            self.courses.append(value)
        return self.courses.index(value), 1.0

    def load(self, value: Value, force: Array) -> None:
        """Add ``force`` (unknowns,) times the value."""
        course, factor = self.split(value)
        if factor:
            self.external[course] = self.external.get(course, np.zeros(self.mesh.size)) + factor * force

    def prescribe(self, unknowns: IntArray, value: Value, name: str, key: str) -> None:
        course, factor = self.split(value)
        known = self.course[unknowns] >= 0
        clash = known & ((self.course[unknowns] != course) | (self.factor[unknowns] != factor))
        clash &= ~(known & (self.factor[unknowns] == 0) & (factor == 0))
        if clash.any():
            other = unknowns[clash][0]
            before = self.courses[self.course[other]] if self.course[other] else self.factor[other]
            raise ConfigurationError(
                f"{key}: {name} = {_show(value)} contradicts {name} = {_show(before)} of a "
                "neighbouring surface where they meet; prescribe it on one of them only"
            )
        self.course[unknowns], self.factor[unknowns] = course, factor

    def _body_force(self) -> None:
        element = self.mesh.element
        local = self.mesh.weights @ element.values(element.points)
        volumes = np.bincount(self.mesh.cells.ravel(), local.ravel(), len(self.mesh.points))
        for i, value in enumerate(self.problem.body_force):
            if value != 0:
                force = np.zeros(self.mesh.size)
                force[i : self.mesh.n_u : 3] = -volumes
                self.load(value, force)

    def _cartesian_constraints(self, node: int) -> list[Constraint]:
        """What components of a node are prescribed."""
        found = []
        for i in range(3):
            course = self.course[3 * node + i]
            if course >= 0:
                factor = float(self.factor[3 * node + i])
                found.append(Constraint(np.eye(3)[i], int(course), factor, f"macro.boundary: u_{i + 1}"))
        return found

    def _pushed(self) -> dict[int, list[int]]:
        """Axes along which plates move each node."""
        axes: dict[int, list[int]] = {}
        for unknowns in self.plates.values():
            for unknown in unknowns.tolist():
                axes.setdefault(unknown // 3, []).append(unknown % 3)
        return axes

    def _check(self) -> None:
        held = [bool((self.course[i : self.mesh.n_u : 3] >= 0).any()) for i in range(3)]
        normals = [each.direction for constraints in self.oblique.values() for each in constraints]
        for i in range(3):
            if not held[i] and not any(abs(normal[i]) > SAME for normal in normals):
                raise ConfigurationError(
                    f"macro.boundary: nothing holds the body in direction {i + 1}; "
                    f"prescribe u_{i + 1} on some surface"
                )
        for name in self.plates:
            self._check_plate(name)

    def _check_plate(self, name: str) -> None:
        """Refuse what would hold some of its nodes, or move them otherwise, along its axis."""
        unknowns = self.plates[name]
        axis = int(unknowns[0] % 3)
        if (self.course[unknowns] >= 0).any():
            raise ConfigurationError(
                f"macro.boundary.{name}: the plate moves as one, but a neighbouring surface prescribes "
                f"u_{axis + 1} on their common edge; leave that component free there"
            )
        for other, theirs in self.plates.items():
            if other != name and np.isin(unknowns, theirs).any():
                raise ConfigurationError(
                    f"macro.boundary.{name}: the plate moves as one, but shares an edge with the plate '{other}', "
                    "which moves along the same axis; make one plate of both, or leave a gap"
                )
        for node in (unknowns // 3).tolist():
            for direction, _, _, source in self.oblique.get(node, ()):
                if abs(direction[axis]) > SAME:
                    normal = ", ".join(f"{x:.3g}" for x in direction)
                    raise ConfigurationError(
                        f"macro.boundary.{name}: the plate moves as one along {'xyz'[axis]}, but {source} is "
                        f"prescribed on their common edge, along ({normal}), which is not at right angles to that; "
                        "end the plate before that surface"
                    )


@dataclass(frozen=True)
class _Surface:
    """One surface, as it adds itself to the collection."""

    to: _Collector
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
        directions = [
            axis
            for axis, value in zip(np.eye(3), self.boundary.displacement, strict=True)
            if value is not None
        ]
        for i, value in enumerate(self.boundary.displacement):
            if value is not None:
                self.to.prescribe(3 * self.nodes + i, value, f"u_{i + 1}", self.key)
        if self.boundary.normal is not None:
            directions.append(self._normal(self.boundary.normal))
        if directions:
            self.to.held[self.name] = Support(self.facets, np.array(directions))

    def _normal(self, value: Value) -> Array:
        """The direction that is held, (3,)."""
        normal = self.facets.plane(f"{self.key}.normal")
        axis = int(np.abs(normal).argmax())
        if abs(normal[axis]) > 1 - 1e-9:
            signed = value if normal[axis] > 0 else _opposite(value, self.key)
            self.to.prescribe(3 * self.nodes + axis, signed, f"u_{axis + 1}", self.key)
            return np.asarray(np.eye(3)[axis])
        course, factor = self.to.split(value)
        for node in self.nodes:
            source = f"{self.key}.normal"
            self.to.oblique.setdefault(int(node), []).append(Constraint(normal, course, factor, source))
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
            f"{key}.normal: the outward normal is against an axis here, and a course cannot be turned round; "
            "prescribe the component of the displacement"
        )
    return -value


def _show(value: Value) -> str:
    return "a function of time" if isinstance(value, TimeFunction) else f"{value:g}"
