"""Boundary data of a problem: conditions of its surfaces, frames of oblique ones, loads, following pressures."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations, product
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from porocore.core.echo import joined
from porocore.core.formulas import TimeFunction, Value
from porocore.core.units import units_now
from porocore.errors import ConfigurationError
from porocore.macro.body.mesh import BodyMesh, Facets
from porocore.macro.boundary.contact import Contact, ContactScales, IndenterChanges, NoContact, inside, united
from porocore.macro.boundary.reactions import Share, Support, shares
from porocore.macro.boundary.rigid import CylindricalIndenter, RigidIndenter
from porocore.macro.problem import Boundary, MacroProblem
from porocore.states import Array, BoolArray, IntArray

#: Of the largest motion of the body as one that is held, below which another one is not held.
FREE = 1e-9


#: Sine of an angle between two directions below which they are one; also of the difference of their values, of these.
SAME = 1e-6
#: Times between 0 and the end at which the force on an indenter is looked at, beside its corners.
TIMES = 1000


class Constraint(NamedTuple):
    """Displacement that is prescribed along one direction."""

    direction: Array  #: (3,) a unit vector
    function: int  #: number of its time function
    factor: float  #: on that
    source: str  #: what prescribes it, for messages


def in_frames(
    mesh: BodyMesh,
    oblique: Mapping[int, list[Constraint]],
    others: Callable[[int], list[Constraint]],
    functions: int,
    kept: Mapping[int, Sequence[int]] | None = None,
) -> tuple[Any, tuple[IntArray, Array]]:
    """Return the rotation into the frames, and the prescribed values there.

    Parameters
    ----------
    oblique
        Constraints of each node on an oblique surface.
    others
        The constraints on Cartesian components of a node.
    functions
        How many there are.
    kept
        Axes of nodes that stay an unknown of their own, those along which plates move; at right angles to what is
        prescribed there.

    Returns
    -------
    rotation, (unknowns, values)
        Orthogonal matrix (unknowns, unknowns), None without oblique surfaces; prescribed unknowns (k,) of these nodes
        and their values (k, functions) for a unit of each time function.

    Raises
    ------
    ConfigurationError
        Constraints of a node depend on each other, and contradict.
    """
    if not oblique:
        return None, (np.empty(0, dtype=np.int64), np.empty((0, functions)))
    rotation = sparse.identity(mesh.size, format="lil")
    unknowns, values = [], []
    for node, constraints in oblique.items():
        frame, rows, prescribed = _frame([*constraints, *others(node)], functions, (kept or {}).get(node, ()))
        own = slice(3 * node, 3 * node + 3)
        rotation[own, own] = frame
        unknowns += [3 * node + row for row in rows]
        values += prescribed
    order = np.argsort(unknowns)
    return rotation.tocsr(), (np.array(unknowns, dtype=np.int64)[order], np.array(values)[order])


def _frame(
    constraints: list[Constraint], functions: int, kept: Sequence[int]
) -> tuple[Array, list[int], list[Array]]:
    """Return an orthonormal frame (3, 3), its prescribed rows and their values (functions,).

    The kept axes keep their places; the directions that are prescribed take the first of the others.
    """
    basis = [(np.eye(3)[axis], np.zeros(functions)) for axis in kept]
    for direction, function, factor, source in constraints:
        # What the rows so far leave of it (Gram–Schmidt).
        rest, value = direction.copy(), factor * np.eye(functions)[function]
        for row, known in basis:
            share = row @ direction
            rest, value = rest - share * row, value - share * known
        length = np.linalg.norm(rest)
        if length > SAME:
            basis.append((rest / length, value / length))
        elif np.abs(value).max() > SAME * max(
            abs(factor), *(float(np.abs(known).max()) for _, known in basis)
        ):
            others = dict.fromkeys(each.source for each in constraints if each.source != source)
            raise ConfigurationError(
                f"{source} contradicts what {joined(others)} prescribe where they meet; prescribe it on one of "
                "them only"
            )
    prescribed = basis[len(kept) :]
    for axis in np.eye(3):
        rest = axis - sum((row @ axis) * row for row, _ in basis)
        length = np.linalg.norm(rest)
        if len(basis) < 3 and length > 0.5:
            basis.append((rest / length, np.zeros(functions)))
    places = [*kept, *(i for i in range(3) if i not in kept)]
    frame = np.empty((3, 3))
    frame[places] = [row for row, _ in basis]
    first = len(kept)
    return frame, places[first : first + len(prescribed)], [value for _, value in prescribed]


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


@dataclass(frozen=True, eq=False)
class BoundaryData:
    """Boundary data by the unknowns' numbers in the mesh, for a unit of each time function.

    Attributes
    ----------
    time_functions
        1.0 for the common ramp, then every other time function that occurs.
    prescribed : (k,)
        Unknowns that are prescribed, ascending.
    values : (k, functions)
        Their values.
    external : (functions, unknowns)
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
    contacts
        Rigid indenters.
    turns
        Axes about which nothing holds the body against a rotation; its tangent is singular, or small beside the load.
    """

    time_functions: tuple[Value, ...]
    prescribed: IntArray
    values: Array
    external: Array
    plates: tuple[IntArray, ...] = ()
    followers: tuple[tuple[int, float, Facets], ...] = ()
    rotation: Any = None
    supports: Mapping[str, Share] = field(default_factory=dict)
    drains: Mapping[str, Share] = field(default_factory=dict)
    turns: tuple[str, ...] = ()
    contacts: tuple[Contact, ...] = ()

    @property
    def acting(self) -> Array:
        """Time functions that act on anything, (functions,) bool."""
        acts = (self.values != 0).any(axis=0) | (self.external != 0).any(axis=1)
        for function, factor, _ in self.followers:
            acts[function] |= factor != 0
        for contact in self.contacts:
            acts[contact.function] |= contact.factor != 0
        return np.asarray(acts)

    def amplitudes(self, problem: MacroProblem, time: float) -> Array:
        """Return the values (functions,) of the time functions at ``time``, the load included."""
        return problem.load * np.array([problem.factor(function, time) for function in self.time_functions])


@dataclass(frozen=True, eq=False)
class Loads:
    """Prescribed values and loads at one time.

    Attributes
    ----------
    values : (k,)
        Of the prescribed unknowns.
    external : (local unknowns,)
        Dead loads and rates of prescribed fluxes, where owned.
    pressures
        Of each surface with a pressure that follows it.
    indenters
        Displacement of each indenter, or the force on it.
    motions
        Displacement of each indenter, as Newton's method has it; empty: those under a force are where they rest.
    offsets, radii
        Of changes of the loads: those of the place of each indenter along its direction, and of its radius; empty:
        none.
    stiffening
        Of changes of the loads: the relative one of the penalty of all indenters.
    conducting
        Of changes of the loads: the relative one of the conductance of the surfaces that indenters drain.
    """

    values: Array
    external: Array
    pressures: tuple[float, ...] = ()
    indenters: tuple[float, ...] = ()
    motions: tuple[float, ...] = ()
    offsets: tuple[float, ...] = ()
    radii: tuple[float, ...] = ()
    stiffening: float = 0.0
    conducting: float = 0.0

    @property
    def indenter_changes(self) -> list[IndenterChanges]:
        """Changes of what is given of each indenter, of loads that are a change."""
        nothing = (0.0,) * len(self.indenters)
        return [
            IndenterChanges(*each, self.stiffening, self.conducting)
            for each in zip(self.indenters, self.offsets or nothing, self.radii or nothing, strict=True)
        ]


def boundary_data(mesh: BodyMesh, problem: MacroProblem) -> BoundaryData:
    """Return the boundary data of a problem.

    Raises
    ------
    ConfigurationError
        There is no such surface, two surfaces load the same faces or prescribe different values where they meet, a load
        acts along a displacement that is prescribed, one surface holds the edge of another's plate along the axis of
        that, two plates with one axis share an edge, a plate or a normal displacement is on a curved surface, or the
        body, or a piece of it, is not held.
    """
    return Collector(mesh, problem).result()


class Collector:
    """Collector of the boundary data of a problem, surface by surface."""

    def __init__(self, mesh: BodyMesh, problem: MacroProblem) -> None:
        self.mesh, self.problem = mesh, problem
        self.time_functions: list[Value] = [1.0]
        #: TimeFunction and factor of each prescribed unknown; −1 where nothing is.
        self.function = np.full(mesh.size, -1)
        self.factor = np.zeros(mesh.size)
        #: Keys of surfaces, and for each prescribed unknown the position of that which prescribes it.
        self.keys: list[str] = []
        self.by = np.full(mesh.size, -1)
        self.external: dict[int, Array] = {}
        self.oblique: dict[int, list[Constraint]] = {}
        self.plates: dict[str, IntArray] = {}
        self.followers: list[tuple[int, float, Facets]] = []
        self.held: dict[str, Support] = {}
        self.drains: dict[str, Support] = {}
        self.contacts: list[Contact] = []
        self.turns: list[str] = []
        self._faces: dict[str, dict[tuple[int, ...], int]] = {}

    def result(self) -> BoundaryData:
        self.mesh.require_surfaces(self.problem.boundary, "macro.boundary")
        self._require_one_load_on_each_face()
        self._require_loads_that_act()
        if self.mesh.flat:
            self._stay_in_plane()
        for name, boundary in self.problem.boundary.items():
            key = f"macro.boundary.{name}"
            facets = Facets(self.mesh, self.mesh.surface(name, key))
            if len(facets.nodes):
                SurfaceConditions(self, name, key, facets, boundary).collect()
        for name, indenter in self.problem.contact.items():
            self.contacts.append(self._contact(name, indenter))
        self._body_force()
        self._check()
        rotation, oblique = in_frames(
            self.mesh, self.oblique, self._cartesian_constraints, len(self.time_functions), self._pushed()
        )
        plain = np.flatnonzero(self.function >= 0)
        plain = plain[~np.isin(plain // 3, list(self.oblique)) | (plain >= self.mesh.n_u)]
        values = np.zeros((self.mesh.size, len(self.time_functions)))
        values[plain, self.function[plain]] = self.factor[plain]
        unknowns, rows = oblique
        values[unknowns] = rows
        prescribed = np.union1d(plain, unknowns).astype(np.int64)
        external = np.zeros((len(self.time_functions), self.mesh.size))
        for function, force in self.external.items():
            external[function] += force
        return BoundaryData(
            tuple(self.time_functions),
            prescribed,
            values[prescribed],
            external,
            tuple(self.plates.values()),
            tuple(self.followers),
            rotation,
            shares(self.mesh, self.held),
            shares(self.mesh, self.drains, fluid=True),
            tuple(self.turns),
            tuple(self.contacts),
        )

    def split(self, value: Value) -> tuple[int, float]:
        """Return the number of the value's time function, and the factor on it."""
        if not isinstance(value, TimeFunction):
            return 0, float(value)
        if value not in self.time_functions:
            self.time_functions.append(value)
        return self.time_functions.index(value), 1.0

    def load(self, value: Value, force: Array) -> None:
        """Add ``force`` (unknowns,) times the value."""
        function, factor = self.split(value)
        if factor:
            self.external[function] = self.external.get(function, np.zeros(self.mesh.size)) + factor * force

    def prescribe(self, unknowns: IntArray, value: Value, name: str, key: str) -> None:
        function, factor = self.split(value)
        known = self.function[unknowns] >= 0
        clash = known & ((self.function[unknowns] != function) | (self.factor[unknowns] != factor))
        clash &= ~(known & (self.factor[unknowns] == 0) & (factor == 0))
        if clash.any():
            other = unknowns[clash][0]
            before = self.time_functions[self.function[other]] if self.function[other] else self.factor[other]
            raise ConfigurationError(
                f"{key}: {name} = {_show(value, name)} contradicts {name} = {_show(before, name)} of "
                f"{self.keys[self.by[other]]} where they meet; prescribe it on one of them only"
            )
        if key not in self.keys:
            self.keys.append(key)
        self.by[unknowns] = self.keys.index(key)
        self.function[unknowns], self.factor[unknowns] = function, factor

    def faces(self, name: str) -> dict[tuple[int, ...], int]:
        """Rows of a surface's faces by their corners."""
        if name not in self._faces:
            facets = self.mesh.surface(name, f"macro.boundary.{name}")
            self._faces[name] = {corners: row for row, corners in enumerate(self.mesh.corners_of(facets))}
        return self._faces[name]

    def _require_one_load_on_each_face(self) -> None:
        """Refuse faces that belong to two surfaces whose conditions cannot both be meant there."""
        for (one, first), (other, second) in combinations(self.problem.boundary.items(), 2):
            if not (fault := _contradiction(first, second)):
                continue
            ours, theirs = self.faces(one), self.faces(other)
            if both := len(ours.keys() & theirs.keys()):
                raise ConfigurationError(
                    f"macro.boundary.{other}: {both} of its {len(theirs)} faces belong to the surface '{one}' "
                    f"too, and there {fault}; prescribe it on one of the two, or take these faces out of the other"
                )

    def _require_loads_that_act(self) -> None:
        """Refuse tractions and followers on faces whose displacement along them is prescribed."""
        for (name, loaded), (other, held) in product(self.problem.boundary.items(), repeat=2):
            t = np.array([value != 0 for value in loaded.traction])
            follows, axes = loaded.follower != 0, [u is not None for u in held.displacement]
            if not ((t.any() and held.normal is not None) or (follows and held.is_held)):
                continue
            facets = self.mesh.surface(name, f"macro.boundary.{name}")
            theirs = self.faces(other)
            both = [row for corners, row in self.faces(name).items() if corners in theirs]
            n = np.abs(Facets(self.mesh, facets[both]).directions.reshape(-1, 3)) > SAME
            if held.normal is not None:
                along = n[:, t].any(axis=1) & (
                    (n.sum(axis=1) == 1) | (t.sum() == 1)
                )  # else they may be perpendicular
                idle, what = along.any() or (follows and len(n)), "the normal displacement"
            else:
                idle, what = (
                    follows and (n[:, axes].any(axis=1) & ~n[:, np.invert(axes)].any(axis=1)).any(),
                    "u",
                )
            if idle:
                load = "follower, which acts along the normal," if follows else "traction along the normal"
                raise ConfigurationError(
                    f"macro.boundary.{name}: the {load} does nothing on {len(both)} of its {len(facets)} faces, "
                    f"on which macro.boundary.{other} prescribes {what}; keep one of the two"
                )

    def _stay_in_plane(self) -> None:
        """Prescribe that a body in two dimensions does not move along z, and one of revolution not off its axis.

        Raises
        ------
        ConfigurationError
            Something moves or pushes it across its plane, or begins with a gradient that it cannot have.
        """
        across = (
            "around the axis, about which it does not turn"
            if self.mesh.revolved
            else "along z, across its plane"
        )
        what = "an axisymmetric body" if self.mesh.revolved else "a body in plane strain"
        said = f"{what} has none {across}; give 0 there"
        for name, face in self.problem.boundary.items():
            if face.displacement[2] not in (None, 0) or face.traction[2] != 0:
                key = "traction" if face.traction[2] != 0 else "displacement"
                raise ConfigurationError(f"macro.boundary.{name}.{key}: got a third component; {said}")
        if self.problem.body_force[2] != 0:
            raise ConfigurationError(f"macro.body_force: got a third component; {said}")
        H = np.array(self.problem.initial.gradient)
        fits = not H[2, :2].any() and not H[:2, 2].any()
        fits &= H[2, 2] == H[0, 0] and not H[0, 1] and not H[1, 0] if self.mesh.revolved else H[2, 2] == 0
        if not fits:
            wanted = (
                "[[a, 0, 0], [0, b, 0], [0, 0, a]]"
                if self.mesh.revolved
                else "[[a, b, 0], [c, d, 0], [0, 0, 0]]"
            )
            raise ConfigurationError(
                f"macro.initial.gradient: expected {wanted}, with which {what} may begin"
            )
        nodes = np.arange(len(self.mesh.points))
        self.prescribe(3 * nodes + 2, 0.0, "u_3", "macro.body")
        self.prescribe(3 * self.mesh.on_axis, 0.0, "u_1", "macro.body (the axis of revolution)")

    def _contact(self, name: str, indenter: RigidIndenter) -> Contact:
        """Return an indenter with its facets.

        Raises
        ------
        ConfigurationError
            There is no such surface, other conditions stand in its way there, or it begins inside the body.
        """
        key, problem = f"macro.contact.{name}", self.problem
        facets = united(self.mesh, [self.mesh.surface(each, f"{key}.surfaces") for each in indenter.surfaces])
        self._require_free_surfaces(key, indenter, facets)
        if self.mesh.flat:
            self._require_in_plane(key, indenter)
        indenter.shape.check_beside(float(np.ptp(self.mesh.points, axis=0).max()), f"{key}.shape")
        contact = Contact(name, indenter, facets, *self.split(indenter.motion))
        if contact.by_force:
            self._require_push(key, contact)
            try:
                contact.state(np.zeros(self.mesh.size), 0.0, ContactScales())
            except NoContact as failure:
                raise ConfigurationError(
                    f"{failure}; move its place, or give the surfaces on its way"
                ) from None
        near = int(contact.distance(contact.arms(np.zeros(self.mesh.size)).reshape(-1, 3), 0.0).gap.argmin())
        if facets.directions.reshape(-1, 3)[near] @ contact.along > SAME:
            raise ConfigurationError(
                f"{key}.direction: the indenter would move out of the body, since the outward normal of the surface "
                "beside it points the same way; turn its direction round"
            )
        motion = 0.0 if contact.by_force else problem.load * problem.factor(indenter.motion, 0.0)
        depth, place = inside(contact, problem.initial.gradient, motion)
        if not contact.by_force and depth > SAME * np.ptp(self.mesh.points, axis=0).max():
            said = units_now()
            raise ConfigurationError(
                f"{key}: the indenter begins {said.text(depth, 'displacement', 3)} deep inside the body, at "
                f"{said.texts(place, quantity='displacement', digits=3)}; move its place back, against its direction"
            )
        return contact

    def _require_push(self, key: str, contact: Contact) -> None:
        """Refuse a force that pulls at some time of the run."""
        problem, said = self.problem, units_now()
        # Those of the study come first, and a later one must be worse by more than round-off.
        own = (*problem.corners, problem.time.end_of_ramp, problem.time.end)
        times = [*own, *np.linspace(0, problem.time.end, TIMES).tolist()]
        function = self.time_functions[contact.function]
        forces = np.array([contact.factor * problem.load * problem.factor(function, t) for t in times])
        worst = int((forces <= forces.min() + SAME * np.abs(forces).max()).argmax())
        if forces[worst] < -SAME * np.abs(forces).max():
            raise ConfigurationError(
                f"{key}.force: the indenter cannot pull, but its force is {said.text(forces[worst], 'force', 3)} at "
                f"t = {said.text(times[worst], 'time', 4)}; give one of at least 0, along the direction into the body"
            )

    def _require_in_plane(self, key: str, indenter: RigidIndenter) -> None:
        """Refuse an indenter that a body in two dimensions cannot be pressed by."""
        along, place, kind = indenter.along, indenter.place, self.problem.body.kind
        if self.mesh.revolved and (place[0] != 0 or place[2] != 0 or abs(along[1]) < 1 - SAME):
            raise ConfigurationError(
                f"{key}: a body of kind '{kind}' is pressed along its axis alone; give place: [0, y, 0] and direction: "
                "[0, -1, 0] or [0, 1, 0]"
            )
        if indenter.shape.kind == "surface":
            raise ConfigurationError(
                f"{key}.shape: a surface of triangles is pressed against bodies in three dimensions, and that of kind "
                f"'{kind}' has two; give another kind of shape, or mesh the body in three dimensions"
            )
        if self.mesh.revolved and indenter.shape.kind == "cylinder":
            raise ConfigurationError(
                f"{key}.shape: a cylinder on its side is no body of revolution, and a body of kind '{kind}' is pressed "
                "by such ones alone; give a sphere, punch, cone or plane, or mesh the body in three dimensions"
            )
        if place[2] != 0 or abs(along[2]) > SAME:
            raise ConfigurationError(
                f"{key}: a body of kind '{kind}' is pressed in its plane alone; give 0 as third component of place and "
                "direction"
            )
        if isinstance(indenter.shape, CylindricalIndenter) and any(indenter.shape.axis[:2]):
            raise ConfigurationError(
                f"{key}.shape.axis: expected [0, 0, 1], along which a body of kind '{kind}' is long, got "
                f"{list(indenter.shape.axis)}; leave the axis out, or mesh the body in three dimensions"
            )

    def _require_free_surfaces(self, key: str, indenter: RigidIndenter, facets: Facets) -> None:
        """Refuse conditions on the facets of an indenter that would act there beside it."""
        rows = {corners: row for row, corners in enumerate(self.mesh.corners_of(facets.nodes))}
        n = facets.directions
        for name, face in self.problem.boundary.items():
            both = [rows[corners] for corners in self.faces(name) if corners in rows]
            if not both:
                continue
            held = np.array([u is not None for u in face.displacement])
            along = face.normal is not None or (np.abs(n[both][..., held]) > SAME).any()
            loaded = face.follower != 0 or face.plate is not None or any(t != 0 for t in face.traction)
            wet = indenter.drains and (face.pressure is not None or face.flux != 0)
            if along or loaded or wet:
                what = (
                    "is held along its normal"
                    if along
                    else "is loaded"
                    if loaded
                    else "has a pressure or a flux, beside which 'under' and 'outside' mean nothing"
                )
                raise ConfigurationError(
                    f"{key}.surfaces: {len(both)} of the {len(rows)} faces belong to macro.boundary.{name}, which "
                    f"{what}; keep one of the two there"
                )

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
        """Return the prescribed Cartesian components of a node."""
        functions, factors = (each[3 * node : 3 * node + 3].tolist() for each in (self.function, self.factor))
        return [
            Constraint(
                np.eye(3)[i], functions[i], factors[i], f"{self.keys[self.by[3 * node + i]]}: u_{i + 1}"
            )
            for i in range(3)
            if functions[i] >= 0
        ]

    def _pushed(self) -> dict[int, list[int]]:
        """Return the axes along which plates move each node."""
        axes: dict[int, list[int]] = {}
        for unknowns in self.plates.values():
            for unknown in unknowns.tolist():
                axes.setdefault(unknown // 3, []).append(unknown % 3)
        return axes

    def _check(self) -> None:
        for name in self.plates:
            self._check_plate(name)
        pieces = self.mesh.pieces
        for piece in range(pieces.max() + 1):
            slides, turns = self._free(pieces == piece)
            self.turns += [axis for axis in turns if axis not in self.turns]
            if slides:
                raise ConfigurationError(not_held(slides, turns, _name_of_piece(self.mesh, piece)))

    def _free(self, piece: BoolArray) -> tuple[list[str], list[str]]:
        """Return the directions along which, and the axes about which, a piece (nodes,) may move as one."""
        mesh = self.mesh
        stiff = self.function[: mesh.n_u] >= 0
        if mesh.revolved:  # a circle that moves outwards is stretched
            stiff[::3] = True
        held = np.flatnonzero(stiff & np.repeat(piece, 3))
        nodes, directions = [held // 3], [np.eye(3)[held % 3]]
        for node, constraints in self.oblique.items():
            if piece[node]:
                nodes.append(np.full(len(constraints), node))
                directions.append(np.array([each.direction for each in constraints]))
        x = (mesh.points - mesh.points.mean(axis=0)) / np.ptp(mesh.points, axis=0).max()
        d = np.concatenate(directions)
        rows = [np.concatenate([d, np.cross(x[np.concatenate(nodes)], d)], axis=1)]
        for plate in self.plates.values():  # its nodes move alike
            unknowns = plate[piece[plate // 3]]
            if not len(unknowns):
                continue
            arms = x[unknowns // 3] - x[unknowns[0] // 3]
            across = np.eye(3)[unknowns % 3]
            rows.append(np.concatenate([np.zeros_like(arms), np.cross(arms, across)], axis=1))
        return _directions(_null_space(d)), [
            axis
            for axis, turn in zip("xyz", _null_space(np.concatenate(rows))[:, 3:].T, strict=True)
            if np.linalg.norm(turn) > FREE
        ]

    def _prescribing(self, unknowns: IntArray) -> str:
        """Return the keys of the surfaces that prescribe some of the unknowns."""
        return joined(self.keys[i] for i in np.unique(self.by[unknowns]) if i >= 0)

    def _check_plate(self, name: str) -> None:
        """Refuse other conditions on nodes of a plate along its axis."""
        unknowns = self.plates[name]
        axis = int(unknowns[0] % 3)
        if (self.function[unknowns] >= 0).any():
            raise ConfigurationError(
                f"macro.boundary.{name}: the plate moves as one, but {self._prescribing(unknowns)} prescribes "
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
                        f"macro.boundary.{name}: the plate moves along {'xyz'[axis]}, but {source} prescribes the "
                        f"displacement of the common edge along ({normal}), a direction that is not perpendicular "
                        f"to {'xyz'[axis]}; end the plate before that surface"
                    )


def not_held(slides: Sequence[str], turns: Sequence[str], what: str = "the body") -> str:
    """Return the complaint about a body, or a piece of it, that may move along directions and turn about axes."""
    ways = [f"in direction{'s' * (len(slides) > 1)} {joined(slides)}"] if slides else []
    ways += [f"against a rotation about {joined(turns)}"] if turns else []
    wanted = [f"u_{name}" for name in slides if len(name) == 1] or ["a displacement that this moves"]
    return (
        f"macro.boundary: nothing holds {what} {' and '.join(ways)}; prescribe {joined(wanted)} on some surface, or "
        "on a small patch of one (macro.surfaces)"
    )


def _name_of_piece(mesh: BodyMesh, piece: int) -> str:
    """Return the words for a piece of a body, with its place where there are several."""
    count = int(mesh.pieces.max()) + 1
    if count == 1:
        return "the body"
    low, high = (end(mesh.points[mesh.pieces == piece], axis=0) for end in (np.min, np.max))
    reach = ", ".join(f"{a:.4g} to {b:.4g}" for a, b in zip(low, high, strict=True))
    return f"the piece at ({reach}), one of {count} of the body that share no node,"


def _null_space(rows: Array) -> Array:
    """Return orthonormal vectors (k, n) that all ``rows`` (m, n) take to 0."""
    n = rows.shape[1]
    _, sizes, vectors = np.linalg.svd(np.linalg.qr(np.concatenate([rows, np.zeros((n, n))]), mode="r"))
    return np.asarray(vectors[sizes <= FREE * max(float(sizes[0]), 1.0)])


def _directions(free: Array) -> list[str]:
    """Return the directions (k, 3) as text: the numbers of axes among them, and the others as vectors."""
    axes = [i for i in range(3) if np.linalg.norm(free[:, i]) > 1 - FREE]
    others = _null_space(np.concatenate([np.eye(3)[axes], _null_space(free) if len(free) else np.eye(3)]))
    signed = (np.round(v * np.sign(v[np.abs(v).argmax()]), 6) + 0.0 for v in others)
    return [*(str(i + 1) for i in axes), *(f"({', '.join(f'{x:.3g}' for x in v)})" for v in signed)]


def _contradiction(one: Boundary, other: Boundary) -> str:
    """Return what cannot be meant where a face has the conditions of two surfaces; empty where they go together."""
    loads = [
        {
            *(f"a traction t_{i + 1}" for i, t in enumerate(each.traction) if t != 0),
            *(["a pressure on the deformed surface"] if each.follower != 0 else []),
            *(["a force on a plate"] if each.plate is not None else []),
        }
        for each in (one, other)
    ]
    if all(loads):
        apart = not loads[0] & loads[1] and all(load.startswith("a traction") for load in loads[0] | loads[1])
        if not apart:
            return f"{' and '.join(sorted(loads[0] | loads[1]))} would act twice or on top of each other"
    if one.flux != 0 and other.flux != 0:
        return "both prescribe a flux, which would be counted twice"
    for a, b in ((one, other), (other, one)):
        if a.pressure is not None and b.flux != 0:
            return "one prescribes a pressure, beside which the flux of the other does nothing"
        for i, (u, t) in enumerate(zip(a.displacement, b.traction, strict=True)):
            if u is not None and t != 0:
                return f"one prescribes u_{i + 1}, beside which the traction of the other does nothing"
    pairs = {
        f"u_{i + 1}": each for i, each in enumerate(zip(one.displacement, other.displacement, strict=True))
    }
    pairs |= {"p": (one.pressure, other.pressure), "the normal displacement": (one.normal, other.normal)}
    for name, (a_value, b_value) in pairs.items():
        if a_value is not None and b_value is not None and a_value != b_value:
            return f"each of them prescribes another value of {name}"
    return ""


def _show(value: Value, name: str) -> str:
    if isinstance(value, TimeFunction):
        return "a function of time"
    return units_now().text(value + 0.0, "pressure" if name == "p" else "displacement", 6)


def follower_forces(facets: Facets, u: Array, pressure: float) -> Array:
    """Return the nodal forces (nodes, 3) ∫ p n N da, with the current outward normal n and area a.

    n da = (∂x/∂ξ × ∂x/∂η) dξ dη, so that no deformation gradient is needed. Positive pressure pushes inward; in the
    residual ∫ P:∇N − ∫ t·N it stands with this sign.

    Parameters
    ----------
    facets
        On which it acts.
    u : (nodes, 3)
        Displacement of the whole body.
    pressure
        [E].
    """
    reference = facets.mesh.element.facet
    t = facets.tangents_of(facets.mesh.points + u)
    area = np.cross(t[..., 0], t[..., 1]) * reference.weights[:, None]
    local = pressure * np.einsum("fqi,qa->fai", area, reference.values)
    total = np.zeros_like(u)
    np.add.at(total, facets.nodes, local)
    return total


def follower_tangent(facets: Facets, u: Array, pressure: float) -> Any:
    """Return the derivative of :func:`follower_forces` by u, sparse (3 nodes, 3 nodes); symmetric but for the edge."""
    reference = facets.mesh.element.facet
    t = facets.tangents_of(facets.mesh.points + u)
    # δ(t1 × t2)_i = ε_ijk (t2_k δt1_j − t1_k δt2_j)
    slopes = [sign * np.einsum("ijk,fqk->fqij", _EPSILON, t[..., other]) for sign, other in ((1, 1), (-1, 0))]
    w, N = reference.weights, reference.values
    first, second = (
        np.einsum("q,qa,qbkj,fqik->faibj", w, N, by_nodes, slope, optimize=True)
        for by_nodes, slope in zip(facets.tangent_slopes, slopes, strict=True)
    )
    blocks = first + second
    dofs = (3 * facets.nodes[:, :, None] + np.arange(3)).reshape(len(facets.nodes), -1)
    m = dofs.shape[1]
    rows, columns = np.repeat(dofs, m, axis=1).ravel(), np.tile(dofs, (1, m)).ravel()
    n = u.size
    return sparse.csr_matrix((pressure * blocks.ravel(), (rows, columns)), shape=(n, n))


_EPSILON = np.zeros((3, 3, 3))
for _i, _j, _k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    _EPSILON[_i, _j, _k], _EPSILON[_i, _k, _j] = 1.0, -1.0
