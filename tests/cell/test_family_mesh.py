"""One mesh moved to the numbers of each member of a family, and its velocity."""

from functools import reduce
from typing import NamedTuple

import numpy as np
import pytest

from porocore.cell.cell import Cell
from porocore.cell.family.family import changed_numbers, replaced
from porocore.cell.family.mesh import member_mesh, member_velocity
from porocore.cell.geometry.pore_geometry import PoreGeometry
from porocore.cell.meshing.mesh import MeshSettings, make_mesh
from porocore.cell.meshing.tetrahedra import least_stretch, volume
from porocore.errors import ConfigurationError, MemberError

COARSE = {"size": 0.3, "fluid_size": 0.3}


def geometry(kind, **numbers):
    return Cell(geometry={"kind": kind, **numbers}).geometry


class Family(NamedTuple):
    base: PoreGeometry
    settings: MeshSettings

    def mesh(self, *member):
        return member_mesh(*self, *member)

    def velocity(self, *member):
        return member_velocity(*self, *member)


def family_of(base, **settings):
    # A coarser mesh of thin sheets is refused.
    fine = {"size": 0.12, "fluid_size": 0.12} if getattr(base, "solid", "") == "sheet" else {}
    return Family(base, MeshSettings(**{**COARSE, **fine, **settings}))


def path(key):
    return tuple(key.split("."))


def at(base, key, number):
    """The member with another number, checked as a configuration is."""
    return type(base).model_validate(replaced(base, {path(key): number}))


def number_at(base, key):
    return reduce(
        lambda value, part: value[int(part)] if part.isdigit() else getattr(value, part), path(key), base
    )


def kind(*arguments, name, slow=True):
    return pytest.param(*arguments, id=name, marks=[pytest.mark.slow] * slow)


CHANNELS = geometry("orthogonal-channels", radius=0.225)
UNEQUAL = geometry("orthogonal-channels", radii=[0.21, 0.24, 0.2])
TWO_SPHERES = geometry(
    "sphere-pores",
    centres=[[-0.2, 0.02, 0.1], [0.28, -0.05, 0.03]],
    radii=[0.28, 0.31],
    throats=[{"join": [0, 1], "radius": 0.12}],
)
#: Base, key of a number, and two more numbers.
FAMILIES = [
    kind(CHANNELS, "radius", 0.15, 0.3, name="channels", slow=False),
    kind(UNEQUAL, "radii.0", 0.2, 0.22, name="unequal channels"),
    kind(
        geometry("orthogonal-channels", radii=[0.2, 0.2, 0.2]), "radii.1", 0.18, 0.22, name="radii that part"
    ),
    kind(geometry("orthogonal-channels", radius=0.2, axes="xz"), "radius", 0.19, 0.22, name="two channels"),
    kind(geometry("orthogonal-channels", radius=0.2, fillet=0.08), "fillet", 0.06, 0.1, name="fillets"),
    kind(
        geometry("orthogonal-channels", radius=0.2, fillet=0.08),
        "radius",
        0.18,
        0.22,
        name="channels with fillets",
    ),
    kind(
        geometry("orthogonal-channels", radius=0.2, fillet=0.1, axes="xy"),
        "fillet",
        0.08,
        0.12,
        name="two, rounded",
    ),
    kind(geometry("sphere-array", radius=0.35), "radius", 0.3, 0.4, name="spheres", slow=False),
    kind(geometry("sphere-array", radius=0.4, neck=0.2), "neck", 0.15, 0.25, name="necks"),
    kind(geometry("cylinder-array", radius=0.3), "radius", 0.25, 0.35, name="cylinders"),
    kind(geometry("sphere-pores", lattice="cubic", radius=0.56), "radius", 0.53, 0.59, name="windows"),
    kind(
        geometry("sphere-pores", lattice="bcc", radius=0.3, throat=0.15),
        "throat",
        0.14,
        0.155,
        name="throats",
    ),
    kind(TWO_SPHERES, "radii.1", 0.305, 0.315, name="given spheres"),
    kind(TWO_SPHERES, "throats.0.radius", 0.1, 0.14, name="given throat"),
    kind(TWO_SPHERES, "centres.0.2", 0.08, 0.12, name="given centre"),
    kind(geometry("tpms", surface="gyroid", level=0.1), "level", 0.05, 0.15, name="gyroid"),
    kind(
        geometry("tpms", surface="schwarz-p", void_fraction=0.45),
        "void_fraction",
        0.4,
        0.55,
        name="void fraction",
    ),
    kind(geometry("tpms", surface="diamond", level=0.4, solid="sheet"), "level", 0.3, 0.5, name="sheet"),
]


def domain_of(base):
    return "whole" if base.unfolding == "whole" else "eighth"


@pytest.mark.parametrize(("base", "key", "low", "high"), FAMILIES)
@pytest.mark.parametrize("phase", ["solid", "fluid"])
def test_the_mesh_of_a_member_fills_its_phase(base, key, low, high, phase):
    family, domain = family_of(base), domain_of(base)
    parts = 8 if domain == "eighth" else 1
    first = make_mesh(base, family.settings, phase, domain)
    for number in (low, number_at(base, key), high):
        member = at(base, key, number)
        mesh = family.mesh(phase, domain, member)
        share = member.porosity if phase == "fluid" else 1 - member.porosity
        error = abs(
            parts * volume(first.points, first.cells)
            - (1 - base.porosity if phase == "solid" else base.porosity)
        )
        assert parts * volume(mesh.points, mesh.cells) == pytest.approx(share, abs=3 * error + 1e-5)
        assert least_stretch(mesh.points, mesh.cells).min() > 0
        assert ((mesh.points == first.low) == (first.points == first.low)).all()
        assert ((mesh.points == first.high) == (first.points == first.high)).all()
        assert (mesh.cells == first.cells).all()


@pytest.mark.parametrize(("base", "key", "low", "high"), FAMILIES)
def test_nodes_of_the_wall_stay_on_it(base, key, low, high):
    family, domain = family_of(base), domain_of(base)
    first = family.mesh("fluid", domain, base)
    nodes = np.unique(first.wall)

    def distance(mesh, member):
        return np.min([np.abs(s.value(mesh.points[nodes])) for s in member.wall_surfaces()], axis=0)

    # Edges that would fold on so coarse a mesh stay straight, and their middles off the wall.
    on = distance(first, base) < 1e-6
    assert on.mean() > 0.6
    for number in (low, high):
        member = at(base, key, number)
        assert distance(family.mesh("fluid", domain, member), member)[on].max() <= 1e-13


@pytest.mark.parametrize(("base", "key", "low", "high"), FAMILIES)
def test_the_velocity_is_the_derivative_of_the_places(base, key, low, high):
    family, domain = family_of(base), domain_of(base)
    h = 1e-3 * (high - low)
    for number in (number_at(base, key), low):
        places = [family.mesh("solid", domain, at(base, key, number + k * h)).points for k in (-2, -1, 1, 2)]
        difference = (8 * (places[2] - places[1]) - (places[3] - places[0])) / (12 * h)
        velocity = family.velocity("solid", domain, at(base, key, number), path(key))
        assert np.abs(velocity - difference).max() <= 1e-8 * np.abs(velocity).max()


def test_the_eighth_is_part_of_the_whole_and_of_cubic_symmetry():
    family, member = family_of(CHANNELS), at(CHANNELS, "radius", 0.27)
    eighth, whole = (family.mesh("solid", domain, member) for domain in ("eighth", "whole"))
    places = {tuple(place) for place in eighth.points}
    assert {tuple(place) for place in np.abs(whole.points)} == places
    assert {tuple(place) for place in eighth.points[:, [1, 2, 0]]} == places
    assert {tuple(place) for place in eighth.points[:, [1, 0, 2]]} == places
    wrapped = np.where(whole.points == 0.5, -0.5, whole.points)
    assert len(np.unique(wrapped, axis=0)) == whole.periodic_class.max() + 1
    velocity = {d: family.velocity("solid", d, member, ("radius",)) for d in ("eighth", "whole")}
    row = {tuple(place): i for i, place in enumerate(eighth.points)}
    image = [row[tuple(place)] for place in np.abs(whole.points)]
    assert (velocity["whole"] == velocity["eighth"][image] * np.sign(whole.points)).all()


@pytest.mark.parametrize("element", ["linear", "quadratic-straight"])
def test_straight_elements_stay_straight(element):
    family = family_of(CHANNELS, element=element)
    mesh = family.mesh("solid", "eighth", at(CHANNELS, "radius", 0.27))
    assert least_stretch(mesh.points, mesh.cells).min() == pytest.approx(1, abs=1e-10)


def test_an_unmoved_member_has_the_mesh_of_the_base_and_every_mesh_is_made_once():
    family = family_of(CHANNELS)
    base = make_mesh(CHANNELS, family.settings, "fluid", "whole")
    mesh = family.mesh("fluid", "whole", CHANNELS)
    assert np.abs(mesh.points - base.points).max() < 1e-12
    assert family.mesh("fluid", "whole", at(CHANNELS, "radius", 0.225)) is mesh


def test_a_throat_between_given_spheres_covers_no_wall_behind_them():
    # Its axis, drawn on, runs through the wall on the other sides of both.
    base = geometry(
        "sphere-pores",
        centres=[[-0.2, 0.02, 0.1], [0.28, -0.05, 0.03]],
        radii=[0.2, 0.24],
        throats=[{"join": [0, 1], "radius": 0.1}],
    )
    family = family_of(base, element="linear")
    mesh = family.mesh("fluid", "whole", at(base, "radii.1", 0.235))
    assert least_stretch(mesh.points, mesh.cells).min() > 0


def test_a_member_too_far_from_the_base_is_refused():
    family = family_of(CHANNELS)
    with pytest.raises(MemberError, match=r"radius from 0\.225 to 0\.49: .* narrow the range, or split it"):
        family.mesh("solid", "eighth", at(CHANNELS, "radius", 0.49))


def test_ridges_that_part_are_refused():
    base = geometry("orthogonal-channels", radii=[0.2, 0.2, 0])
    with pytest.raises(MemberError, match="that meet in one place no longer do"):
        family_of(base).mesh("solid", "eighth", at(base, "radii.0", 0.22))


def test_a_kind_that_cannot_be_moved_is_refused_but_for_the_base():
    base = geometry("no-pores")
    family = family_of(base)
    assert family.mesh("solid", "eighth", base) is make_mesh(base, family.settings, "solid", "eighth")
    with pytest.raises(ConfigurationError, match="differ in numbers only"):
        family.mesh("solid", "eighth", CHANNELS)


def test_what_a_geometry_has_computed_is_none_of_its_numbers():
    base = geometry("tpms", surface="gyroid", void_fraction=0.6)
    assert base.wall_level > 0  # kept with the geometry from here on
    assert changed_numbers(base, at(base, "void_fraction", 0.62)) == {"void_fraction": (0.6, 0.62)}


def test_numbers_are_found_by_their_keys():
    assert changed_numbers(UNEQUAL, at(UNEQUAL, "radii.1", 0.23)) == {"radii.1": (0.24, 0.23)}
