"""Symmetry planes of a body: problem of the part that is solved, solution of the whole specimen.

A study speaks of the whole specimen. A macro solver sees the part between the planes: the force on a plate is divided
among the parts before a solve, and forces and volumes are those of the whole after it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from porocore.core.formulas import TimeFunction, Value
from porocore.errors import ConfigurationError
from porocore.interfaces.law import MacroResponse
from porocore.interfaces.sensitivities import HistoryWeights, MacroSensitivities
from porocore.interfaces.solution import CONTACT, MacroSolution
from porocore.macro.body.mesh import BodyMesh, Facets
from porocore.macro.boundary.rigid import RigidIndenter
from porocore.macro.problem import Boundary, MacroProblem, MacroSetup, body_mesh
from porocore.states import Array

#: Cosines and places closer than this, the latter as a share of the body, are the same.
SAME = 1e-6


@dataclass(frozen=True, eq=False)
class SurfaceOfWhole:
    """A named surface of the part, continued across the symmetry planes that it touches.

    Attributes
    ----------
    copies
        Pieces like that of the part.
    projection : (3, 3)
        By which the force on a piece becomes the mean of the forces on all pieces.
    normal : (3,)
        Outward; None: the whole surface is not plane.
    """

    copies: float
    projection: Array
    normal: Array | None


@dataclass(frozen=True, eq=False)
class Symmetry:
    """The symmetry planes of a part.

    Attributes
    ----------
    mesh
        Of the part.
    normals
        Outward ones of the planes, by the names of their surfaces.
    """

    mesh: BodyMesh
    normals: Mapping[str, Array]

    @classmethod
    def of(cls, setup: MacroSetup) -> Symmetry:
        """Return the planes that the user names, else those of the body's kind that slide along themselves.

        Raises
        ------
        ConfigurationError
            A surface that the user names is no symmetry plane, the planes do not bound one part of a whole, or an
            indenter moves off a plane on which it stands.
        """
        mesh, body, normals = body_mesh(setup), setup.body, dict[str, Array]()
        for name in body.symmetry_planes:
            normal = _normal(Facets(mesh, mesh.surface(name, "macro.body.symmetry")))
            fault = "is not plane" if normal is None else _fault(setup, mesh, name, normal)
            if normal is not None and not fault:
                normals[name] = normal
            elif body.symmetry is not None:
                raise ConfigurationError(
                    f"macro.body.symmetry: '{name}' is no symmetry plane, because it {fault}; give it "
                    f"'{name}: {{normal: 0}}' alone in macro.boundary, or leave it out here"
                )
        _require_one_whole(normals)
        found = cls(mesh, normals)
        for name, indenter in setup.contact.items():
            found.require_along(indenter, f"macro.contact.{name}")
        return found

    @property
    def copies(self) -> float:
        """Parts that make up the whole."""
        return _copies(list(self.normals.values()))

    def surface(self, name: str) -> SurfaceOfWhole:
        """Return a surface of the whole that is no symmetry plane; one that is not of the mesh is taken as it is."""
        if name not in self.mesh.surfaces:
            return SurfaceOfWhole(1.0, np.eye(3), None)
        normals = [n for plane, n in self.normals.items() if self._touch(name, plane)]
        # Forces along the normal of a plane and its image cancel.
        across = np.array(normals).reshape(-1, 3)
        projection = np.eye(3) - np.linalg.pinv(across) @ across
        normal = _normal(Facets(self.mesh, self.mesh.surfaces[name]))
        bent = normal is None or bool((np.abs(across @ normal) > SAME).any())
        return SurfaceOfWhole(_copies(normals), projection, None if bent else normal)

    def contact_factors(self, indenter: RigidIndenter) -> Array:
        """Return the factors (7,) from the columns of the contact of a part to those of the whole indenter."""
        copies = self.indenter_copies(indenter)
        by_name = {"force": copies, "area": copies, "radius": math.sqrt(copies), "outflow": copies}
        return np.array([by_name.get(name, 1.0) for name, *_ in CONTACT])

    def indenter_copies(self, indenter: RigidIndenter) -> float:
        """Return how many parts of the whole an indenter touches: those about the planes that its axis lies in."""
        return _copies([self.normals[plane] for plane in self._planes_of(indenter)])

    def require_along(self, indenter: RigidIndenter, key: str) -> None:
        """Refuse an indenter that stands on a symmetry plane and moves off it, away from its image.

        Raises
        ------
        ConfigurationError
            It does; the message begins with ``key``.
        """
        for plane in self._planes_of(indenter):
            if abs(indenter.along @ self.normals[plane]) > SAME:
                raise ConfigurationError(
                    f"{key}.direction: expected one along the symmetry plane '{plane}', on which the indenter stands, "
                    f"got {list(indenter.direction)}; in the whole it would part from its image: turn the direction, "
                    "or solve the whole body"
                )

    def _planes_of(self, indenter: RigidIndenter) -> list[str]:
        """Return the planes on which the place of an indenter lies."""
        place, size = np.array(indenter.place), np.ptp(self.mesh.points, axis=0).max()
        depths = {
            plane: (place - self.mesh.points[self.mesh.surfaces[plane][0, 0]]) @ normal
            for plane, normal in self.normals.items()
        }
        return [plane for plane, depth in depths.items() if abs(depth) <= SAME * size]

    def _touch(self, name: str, plane: str) -> bool:
        return bool(np.isin(self.mesh.surfaces[name], self.mesh.surfaces[plane]).any())


#: Stress across the plane of a flat body, as a share of the stiffness, that is the error of a cell's mesh.
ACROSS = 0.01
#: Components of a stress or of H that a mirror at the plane z = 0 turns into their opposites.
_ODD = np.array([[False, False, True], [False, False, True], [True, True, False]])


def across_plane(response: MacroResponse) -> float:
    """Return the largest shear stress out of the plane by what happens in it, as a share of the largest stiffness.

    It vanishes for a cell that is its own mirror image in the plane z = 0, as a body in two dimensions needs.
    """
    tangent = response.tangent
    assert tangent is not None
    stiffness = tangent.stress_grad_u
    largest = float(np.abs(stiffness).max(initial=0.0)) or 1.0
    parts = (stiffness[:, _ODD][:, :, ~_ODD], tangent.stress_p[:, _ODD], response.stress[:, _ODD])
    return max(float(np.abs(part).max(initial=0.0)) for part in parts) / largest


def part_problem(problem: MacroProblem) -> MacroProblem:
    """Return the problem of the part: the force on each plate is that on the part's piece of it."""
    plates = {name: b for name, b in problem.boundary.items() if b.plate is not None}
    pressed = {name: each for name, each in problem.contact.items() if each.force is not None}
    if not (plates or problem.contact) or not problem.body.symmetry_planes:
        return problem
    symmetry, boundary, contact = Symmetry.of(problem), dict(problem.boundary), dict(problem.contact)
    for name, face in plates.items():
        boundary[name] = face.model_copy(update={"plate": _shared(face.plate, symmetry.surface(name).copies)})
    for name, indenter in pressed.items():
        force = _shared(indenter.force, symmetry.indenter_copies(indenter))
        contact[name] = indenter.model_copy(update={"force": force})
    return problem.model_copy(update={"boundary": boundary, "contact": contact})


def whole_specimen(solution: MacroSolution, problem: MacroSetup) -> MacroSolution:
    """Return the solution of a part with the forces and volumes of the whole, and the compressive force on planes.

    Forces on symmetry planes, which are inside the whole, are left out. Where the whole has a surface twice, on either
    side, the force is that on one of the two, as a testing machine measures it; the inflow is that through both.
    """
    symmetry = Symmetry.of(problem)
    copies, history = symmetry.copies, solution.history
    reactions, compression = _of_whole(symmetry, solution.reactions)
    return replace(
        solution,
        copies=copies,
        history=replace(
            history, drained=copies * history.drained, drained_paper=copies * history.drained_paper
        ),
        reactions=reactions,
        compression=compression,
        inflow={name: copies * rate for name, rate in solution.inflow.items()},
        contact={
            name: values * symmetry.contact_factors(problem.contact[name])
            for name, values in solution.contact.items()
        },
    )


def whole_sensitivities(found: MacroSensitivities, problem: MacroSetup) -> MacroSensitivities:
    """Return derivatives of the histories of a part as those of the whole; see :func:`whole_specimen`.

    The unknowns stay those of the part, such as its share of the force on a plate (:func:`part_problem`).
    """
    symmetry = Symmetry.of(problem)
    reactions, compression = _of_whole(symmetry, found.reactions)
    return replace(
        found,
        drained=symmetry.copies * found.drained,
        reactions=reactions,
        compression=compression,
        inflow={name: symmetry.copies * rate for name, rate in found.inflow.items()},
        contact={
            name: each * symmetry.contact_factors(problem.contact[name])[:, None]
            for name, each in found.contact.items()
        },
    )


def part_weights(weights: HistoryWeights, problem: MacroSetup) -> HistoryWeights:
    """Return weights of the histories of a part from those of the whole; transposes :func:`whole_sensitivities`."""
    symmetry, forces = Symmetry.of(problem), dict[str, Array]()
    whole = dict(weights.reactions)
    for name, each in weights.compression.items():
        normal = symmetry.surface(name).normal
        assert normal is not None
        whole[name] = whole.get(name, 0.0) - each[:, None] * normal[:, None]
    for name, force in whole.items():
        surface = symmetry.surface(name)
        forces[name] = surface.copies * np.einsum("sjf,ij->sif", force, surface.projection)
    return replace(
        weights,
        drained=None if weights.drained is None else symmetry.copies * weights.drained,
        reactions=forces,
        compression={},
        inflow={name: symmetry.copies * each for name, each in weights.inflow.items()},
        contact={
            name: each * symmetry.contact_factors(problem.contact[name])[:, None]
            for name, each in weights.contact.items()
        },
    )


def _of_whole(symmetry: Symmetry, forces: Mapping[str, Array]) -> tuple[dict[str, Array], dict[str, Array]]:
    """Return forces (steps, 3, ...) on the surfaces of the whole, and the compressive ones on those that are plane."""
    reactions, compression = {}, {}
    for name, force in forces.items():
        if name in symmetry.normals:
            continue
        surface = symmetry.surface(name)
        reactions[name] = surface.copies * np.einsum("si...,ij->sj...", force, surface.projection)
        if surface.normal is not None:
            compression[name] = -np.einsum("si...,i->s...", reactions[name], surface.normal)
    return reactions, compression


def _normal(facets: Facets) -> Array | None:
    """Return the outward normal of facets; None where they are not plane."""
    try:
        return facets.plane("") if len(facets.nodes) else None
    except ConfigurationError:
        return None


def _fault(setup: MacroSetup, mesh: BodyMesh, name: str, normal: Array) -> str:
    """Return why a plane surface is no symmetry plane; empty if it is one."""
    face, depth = setup.boundary.get(name, Boundary()), mesh.points @ normal
    if fault := _crossed(face):
        return fault
    own = set(mesh.corners_of(mesh.surfaces[name]))
    for other, its in setup.boundary.items():
        if (
            other != name
            and (fault := _crossed(its))
            and own.intersection(mesh.corners_of(mesh.surface(other, f"macro.boundary.{other}")))
        ):
            return f"shares faces with '{other}', which {fault}"
    if mesh.revolved and abs(normal[0]) > SAME:
        return "goes around the axis of revolution"
    held = [i for i, u in enumerate(face.displacement) if u is not None and not (mesh.flat and i == 2)]
    along = len(held) == 1 and abs(normal[held[0]]) > 1 - SAME and face.displacement[held[0]] == 0
    if not along and (face.normal is None or face.normal != 0):
        return "does not slide along itself"
    if depth.max() > depth[mesh.surfaces[name][0, 0]] + SAME * np.ptp(depth):
        return "has parts of the body on both sides"
    if any(b != 0 and abs(n) > SAME for b, n in zip(setup.body_force, normal, strict=True)):
        return "bears a body force across it"
    H = np.array(setup.initial.gradient)
    shear = (np.eye(3) - np.outer(normal, normal)) @ np.column_stack([H @ normal, H.T @ normal])
    return "" if np.abs(shear).max() <= SAME * np.abs(H).max() else "is sheared by the initial gradient"


def _crossed(face: Boundary) -> str:
    """Return why something crosses a surface with these conditions; empty if nothing does."""
    if face.pressure is not None or face.flux != 0:
        return "lets fluid through"
    if any(t != 0 for t in face.traction) or face.follower != 0 or face.plate is not None:
        return "is loaded"
    return ""


def _require_one_whole(normals: dict[str, Array]) -> None:
    """Refuse planes that do not bound one part of a whole.

    Raises
    ------
    ConfigurationError
        Two face each other, or more than two are oblique to each other.
    """
    names = list(normals)
    for i, one in enumerate(names):
        for other in names[:i]:
            if normals[one] @ normals[other] < SAME - 1:
                raise ConfigurationError(
                    f"macro.body.symmetry: '{other}' and '{one}' face each other, and images between two mirrors "
                    "have no end; name one of them"
                )
    apart = np.array(_distinct(list(normals.values()))).reshape(-1, 3)
    if (np.abs(np.triu(apart @ apart.T, 1)) > SAME).sum() > 1:
        raise ConfigurationError(
            f"macro.body.symmetry: expected planes at right angles, two of which may be oblique, got "
            f"{', '.join(names)}; name fewer"
        )


def _distinct(normals: list[Array]) -> list[Array]:
    """Return the normals, of those that are the same the first."""
    return [n for i, n in enumerate(normals) if all(n @ other < 1 - SAME for other in normals[:i])]


def _copies(normals: list[Array]) -> float:
    """Return how many images of a part between planes with these outward normals make up the whole."""
    apart, found = _distinct(normals), 1.0
    for i, one in enumerate(apart):
        found *= 2
        for other in apart[:i]:
            # Two planes at the angle θ have 2π/θ parts around their common line.
            found *= math.pi / 2 / math.acos(float(-one @ other))
    return round(found) if abs(found - round(found)) < SAME else found


def _shared(value: Value | None, parts: float) -> Value | None:
    """Return a value divided by the number of parts."""
    if not isinstance(value, TimeFunction):
        return None if value is None else value / parts
    if value.expression is not None:
        return value.model_copy(update={"expression": f"({value.expression})/{parts!r}"})
    if value.ramp is not None:
        return value.model_copy(update={"ramp": value.ramp / parts})
    return value.model_copy(update={"table": tuple((time, each / parts) for time, each in value.table)})
