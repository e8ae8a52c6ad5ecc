"""Mesh of a family, moved to the numbers of each member (member_mesh); undeformed members (rest_data)."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from annotated_types import Ge, Gt
from pydantic.fields import FieldInfo

from porocore.cell.conductivity.extension import BoundaryExtension, ends_of_edges
from porocore.cell.family.family import changed_numbers
from porocore.cell.family.wall import ON, TINY, WallMotion, lies_on
from porocore.cell.geometry.pore_geometry import PoreGeometry, WallSurface
from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.cell.materials.material import SWELLING
from porocore.cell.meshing.mesh import CellMesh, Domain, MeshSettings, make_mesh
from porocore.cell.meshing.tetrahedra import EDGES, Phase, least_stretch, rows_of, volumes
from porocore.core.files.yaml_document import Location
from porocore.core.models.strict import Place, walk, with_number
from porocore.core.units import Unit
from porocore.errors import ConfigurationError, MemberError
from porocore.interfaces.records import ParameterKind, RestData, rest_count
from porocore.states import Array, CellResponse, IntArray, MacroState

if TYPE_CHECKING:
    from porocore.cell.cell import Cell
    from porocore.cell.family.family import CellParameter


#: Families whose meshes are kept, and members of each.
FAMILIES, KEPT = 4, 16
#: Meshes of the bases, from which those of all members are moved.
_base_mesh = lru_cache(maxsize=4 * FAMILIES)(make_mesh)


@lru_cache(maxsize=FAMILIES * KEPT)
def member_mesh(
    base: PoreGeometry, settings: MeshSettings, phase: Phase, domain: Domain, geometry: PoreGeometry
) -> CellMesh:
    """Return the mesh of one phase of a member of a family: that of the base with its nodes moved.

    The wall moves by :class:`~porocore.cell.family.wall.WallMotion`, all other nodes by its harmonic extension, so the
    place of every node is a smooth function of the numbers. Elements, numbers of nodes, mirror planes and cell faces
    stay, periodic images move alike, and the eighth is part of the whole. Straight elements stay straight.

    Parameters
    ----------
    base
        Geometry that is meshed, at best in the middle of the ranges of its numbers.
    settings, phase, domain
        As of :func:`~porocore.cell.meshing.mesh.make_mesh`.
    geometry
        Geometry of the member, which differs from the base in numbers only. Where a mesh of its kind cannot be
        moved, that of the base is returned for equal numbers.

    Raises
    ------
    MemberError
        The mesh cannot be moved so far.
    ConfigurationError
        A mesh of this kind of geometry cannot be moved at all.
    ValueError
        The domain is the eighth of a cell without mirrors.
    """
    mesh = _base_mesh(base, settings, phase, domain)
    changed = changed_numbers(base, geometry)
    if not len(mesh.cells) or (not changed and base.wall_surfaces() is None):
        return mesh
    points = _moving_mesh(base, settings, phase).points(geometry)
    if domain == "whole" and base.unfolding != "whole":
        node, signs = _images(base, settings, phase)
        points = points[node] * signs + 0.0  # + 0.0 turns −0.0 into 0.0
    moved = replace(mesh, points=points)
    # The nodes on planes and faces are the same ones, so what depends on them alone is not computed again.
    for name in ("boundary", "wall", "on_mirrors", "periodic_class"):
        moved.__dict__[name] = getattr(mesh, name)
    return moved


def member_velocity(
    base: PoreGeometry,
    settings: MeshSettings,
    phase: Phase,
    domain: Domain,
    geometry: PoreGeometry,
    path: Location,
) -> Array:
    """Return the derivative (nodes, 3) of the places of a member's nodes by one number of its geometry.

    Parameters
    ----------
    base, settings, phase, domain, geometry
        As of :func:`member_mesh`.
    path
        Keys and indices of the number in the geometry, such as ``("radii", "0")``.

    Raises
    ------
    ConfigurationError
        The mesh cannot be moved.
    """
    if not len(_base_mesh(base, settings, phase, domain).cells):
        return np.zeros((0, 3))
    speed = _moving_mesh(base, settings, phase).velocity(geometry, path)
    if domain == "whole" and base.unfolding != "whole":
        node, signs = _images(base, settings, phase)
        speed = speed[node] * signs
    return speed


@lru_cache(maxsize=2 * FAMILIES)
def _moving_mesh(base: PoreGeometry, settings: MeshSettings, phase: Phase) -> MovingMesh:
    mesh = _base_mesh(base, settings, phase, "whole" if base.unfolding == "whole" else "eighth")
    return MovingMesh(base, mesh, straight=settings.element == "quadratic-straight")


@lru_cache(maxsize=2 * FAMILIES)
def _images(base: PoreGeometry, settings: MeshSettings, phase: Phase) -> tuple[IntArray, Array]:
    """Return the node (N,) of the eighth of which each node of the whole is an image, and the signs (N, 3)."""
    eighth, whole = (_base_mesh(base, settings, phase, domain).points for domain in ("eighth", "whole"))
    return rows_of(eighth + 0.0, np.abs(whole)), np.sign(whole)


class MovingMesh:
    """Mesh of one phase of the base whose nodes move with the numbers of the geometry; set up once.

    Parameters
    ----------
    base
        Geometry of the base.
    mesh
        Mesh of the base, on the eighth where the cell has mirrors, else on the whole cell.
    straight
        True if all elements have straight edges.

    Raises
    ------
    ConfigurationError
        A mesh of this kind of geometry cannot be moved.
    """

    def __init__(self, base: PoreGeometry, mesh: CellMesh, *, straight: bool) -> None:
        self.base, self._mesh = base, mesh
        surfaces = _surfaces(base)
        self._count = len(surfaces)
        held = (mesh.points == mesh.low) | (mesh.points == mesh.high)
        images = mesh.periodic_class
        nodes = np.flatnonzero(np.isin(images, images[np.unique(mesh.wall)]))
        follows = nodes[_follows_the_wall(mesh, nodes, surfaces, straight=straight)]
        classes, first = np.unique(images[follows], return_index=True)
        self._wall = WallMotion(
            mesh.points[follows[first]], held[follows[first]], _neighbours(mesh, classes), surfaces
        )
        #: Ends (2, k) of each wall node's edge among those that follow the wall; one that follows is both of its ends.
        self._ends = np.searchsorted(classes, images[ends_of_edges(mesh)[:, nodes]])
        self._ends[:, np.isin(nodes, follows)] = np.searchsorted(classes, images[follows])
        self._extend = BoundaryExtension(mesh, nodes, held, curved=mesh.order == 2 and not straight)
        self._ordered = _Ordered(mesh.points) if base.unfolding == "wedge" else None
        self._places: OrderedDict[PoreGeometry, Array] = OrderedDict()
        self._curved = mesh.order == 2 and not straight

    def points(self, geometry: PoreGeometry) -> Array:
        """Return the places (nodes, 3) of the nodes of a member.

        Raises
        ------
        MemberError
            The mesh cannot be moved so far: nodes find no place, or elements fold.
        """
        step = self._on_wall(geometry) - self._wall.points
        points = self._mesh.points + self._extend(step[self._ends].mean(axis=0))
        if self._ordered and geometry.unfolding == "wedge":
            points = self._ordered.symmetric(points)
        folded = int((volumes(points, self._mesh.cells) <= 0).sum())
        if not folded and self._curved:
            folded = int((least_stretch(points, self._mesh.cells) <= 0).sum())
        if folded:
            raise self._too_far(geometry, f"{folded} of its {len(self._mesh.cells):,} tetrahedra fold")
        return points

    def velocity(self, geometry: PoreGeometry, path: Location) -> Array:
        """Return the derivative (nodes, 3) of the places of a member's nodes by the number at a path."""
        varied = _surfaces(with_number(geometry, path, lambda number: complex(number, TINY)))
        speed = self._wall.velocity(self._on_wall(geometry), _surfaces(geometry), varied)
        return self._extend(speed[self._ends].mean(axis=0))

    def _on_wall(self, geometry: PoreGeometry) -> Array:
        """Return the places of the wall's nodes."""
        if geometry not in self._places:
            surfaces = _surfaces(geometry)
            try:
                if len(surfaces) != self._count:
                    raise MemberError(f"its wall has {len(surfaces)} surfaces, not {self._count}")
                self._places[geometry] = self._wall.moved(surfaces)
            except MemberError as error:
                raise self._too_far(geometry, str(error)) from None
            if len(self._places) > KEPT:
                self._places.popitem(last=False)
        return self._places[geometry]

    def _too_far(self, geometry: PoreGeometry, why: str) -> MemberError:
        """Return the error of a member that the mesh of the base does not reach."""
        changed = changed_numbers(self.base, geometry)
        ways = ", ".join(f"{key} from {a:.6g} to {b:.6g}" for key, (a, b) in changed.items())
        return MemberError(
            f"cell.geometry: the mesh of the {self._mesh.phase} cannot be moved so far, with {ways}: {why}; narrow the "
            "range, or split it into several cells with ranges of their own"
        )


class _Ordered:
    """Nodes of an eighth with the symmetry of the cube, each as an image of one with 0 ≤ x ≤ y ≤ z ≤ ½."""

    def __init__(self, points: Array) -> None:
        self._order = np.argsort(points, axis=1, kind="stable")
        ordered = np.take_along_axis(points, self._order, axis=1)
        self._node = rows_of(points + 0.0, ordered + 0.0)
        self._equal = ordered[:, 1:] == ordered[:, :-1]

    def symmetric(self, points: Array) -> Array:
        """Return places (nodes, 3) that are symmetric to round-off, with exact symmetry."""
        of_wedge = points[self._node]
        for i in range(2):
            of_wedge[:, i + 1] = np.where(self._equal[:, i], of_wedge[:, i], of_wedge[:, i + 1])
        found = np.empty_like(points)
        np.put_along_axis(found, self._order, of_wedge, axis=1)
        return found


def _surfaces(geometry: PoreGeometry) -> Sequence[WallSurface]:
    surfaces = geometry.wall_surfaces()
    if surfaces is None:
        raise ConfigurationError(
            f"cell.geometry: the mesh of {geometry.description} cannot be moved, so its numbers cannot have ranges; "
            "give one number instead of each range"
        )
    return surfaces


def _follows_the_wall(
    mesh: CellMesh, nodes: IntArray, surfaces: Sequence[WallSurface], *, straight: bool
) -> Array:
    """Return True for the corners among some nodes on the wall, and for mid-edge nodes that lie on a surface."""
    corner = np.zeros(len(mesh.points), dtype=bool)
    corner[mesh.cells[:, :4]] = True
    follows = corner[nodes]
    if not straight:
        follows |= np.abs(lies_on(mesh.points[nodes], surfaces)[1]) <= ON
    return follows


def _neighbours(mesh: CellMesh, classes: IntArray) -> IntArray:
    """Return the pairs of neighbours on the wall, by their places in the periodic classes that follow it."""
    facets = mesh.periodic_class[mesh.wall]
    ends = facets[:, EDGES[:3]].reshape(-1, 2)
    if mesh.order == 2:
        middle = facets[:, 3:].reshape(-1, 1)
        kept = np.isin(middle[:, 0], classes)
        halves = [np.concatenate([ends[kept][:, [i]], middle[kept]], axis=1) for i in range(2)]
        ends = np.concatenate([ends[~kept], *halves])
    ends = np.unique(np.sort(ends, axis=1), axis=0)
    return np.asarray(np.searchsorted(classes, ends[ends[:, 0] != ends[:, 1]]))


#: Name of Poisson's ratio in a material.
POISSON = "poisson_ratio"


def parameter_kinds(cell: Cell) -> tuple[ParameterKind, ...]:
    """Return the kind of each parameter of a cell, as :class:`~porocore.interfaces.records.RestData` has them."""
    places = {place.path: place for place in walk(type(cell), cell)}
    return tuple(_kind(parameter, places[parameter.path]) for parameter in cell.parameters)


def _kind(parameter: CellParameter, place: Place) -> ParameterKind:
    if parameter.shape:
        unit = place.metadata if place.above is None else place.metadata + place.above.metadata
        length = any(isinstance(each, Unit) for each in unit)
        declared = [each.metadata if isinstance(each, FieldInfo) else [each] for each in place.metadata]
        not_negative = any(isinstance(each, Gt | Ge) for each in chain.from_iterable(declared))
        return "length" if length and not_negative and parameter.lower > 0 else "other"
    if parameter.path == ("viscosity",):
        return "viscosity"
    if parameter.path[-1] == POISSON:
        return "poisson_ratio"
    return "swelling" if parameter.path[-1] == SWELLING and parameter.region is None else "other"


def isotropic_solid(cell: Cell) -> tuple[float | None, float | str | None]:
    """Return Young's modulus [E] and Poisson's ratio of small strains, or the parameter that this is; None, None.

    They are known where the solid is isotropic and the same everywhere, and varies in Poisson's ratio alone.
    """
    material = cell.material
    if cell.materials is not None or material is None or not material.isotropic:
        return None, None
    varied = [each for each in cell.parameters if each.solid_key and each.solid_key != (SWELLING,)]
    if not varied:
        young, shear = material.mean_moduli()
        return young, young / (2 * shear) - 1
    only = varied[0]
    if len(varied) == 1 and isinstance(material, NeoHookean) and only.solid_key == (POISSON,):
        return material.mean_moduli()[0], only.name
    return None, None


def undeformed_count(cell: Cell) -> int:
    """Return how many undeformed members describe a family; a swelling and the viscosity need none of their own."""
    learned = [kind for kind in parameter_kinds(cell) if kind not in ("swelling", "viscosity")]
    return rest_count(len(learned), isotropic=isotropic_solid(cell)[1] is not None)


@dataclass(frozen=True)
class UnstressedFamily:
    """Family of the members as they are before their whole solid swells, which is no parameter of theirs.

    Where regions have swelling stretches of their own they stay, and the members have a stress.

    Attributes
    ----------
    family
        The family, whose values of parameters choose the members.
    """

    family: Cell

    @property
    def parameters(self) -> tuple[CellParameter, ...]:
        """Parameters of the family."""
        return self.family.parameters

    def at(self, values: npt.ArrayLike) -> Cell:
        """Return the member with the parameters (m,), without stress if there is such a state.

        Raises
        ------
        ConfigurationError
            There is none.
        """
        return self.family.at(values).unstressed


def rest_data(cell: Cell, states: MacroState, responses: CellResponse) -> RestData:
    """Return the solved undeformed members of a family, and what is known of its parameters.

    Parameters
    ----------
    cell
        The family.
    states, responses
        Its undeformed members, before their whole solid swells, with their conductivity and the slopes of the
        Hessian; those without a stable response are left out.
    """
    good = np.flatnonzero(responses.stable)
    states, responses = states[good], responses[good]
    hessian = None if responses.slopes is None else responses.slopes.hessian
    kinds, (young, poisson) = parameter_kinds(cell), isotropic_solid(cell)
    theta, fluid = states.parameters, responses.fluid_volume
    assert theta is not None
    assert fluid is not None
    stressed = cell.materials is not None and (cell.solid.swells or any(map(_swells, cell.parameters)))
    dry = theta.copy()
    dry[:, [kind == "swelling" for kind in kinds]] = 1.0
    varied = "swelling" in kinds or cell.material is None
    return RestData(
        states.with_parameters(dry),
        responses,
        np.array([cell.at(values).mesh_porosity for values in theta]) if stressed else fluid,
        kinds,
        young,
        poisson,
        hessian if hessian is None or np.isfinite(hessian).all() else None,
        1.0 if varied or cell.material is None else cell.material.swelling,
    )


def _swells(parameter: CellParameter) -> bool:
    return parameter.path[-1] == SWELLING
