"""Cells whose wall is a level set: volumes, walls, periodicity and quality of the meshes; what is refused."""

from itertools import product

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from porocore.cell.cell import Cell, Geometry
from porocore.cell.geometry.spheres import SpherePores, Throat
from porocore.cell.level_sets.cutting import body_centred
from porocore.cell.level_sets.tpms import TriplyPeriodic, below
from porocore.cell.meshing.mesh import MeshSettings, make_mesh
from porocore.cell.meshing.tetrahedra import least_stretch, volume, volumes
from porocore.cell.quality import dihedral_angles, unmatched


def tpms(surface, **keys):
    return TriplyPeriodic(kind="tpms", surface=surface, **keys)


GYROID = tpms("gyroid", level=0.3)
CHANNEL = SpherePores(
    kind="sphere-pores",
    centres=((0.3, 0.1, -0.2), (0.45, 0.45, 0.4)),
    radii=(0.3, 0.2),
    throat=0.12,
    throats=(Throat(join=(0, 0), shift=(1, 0, 0)), Throat(join=(0, 1), radius=0.1)),
)
KINDS = {
    "gyroid": GYROID,
    "gyroid at 0": tpms("gyroid", level=0.0),
    "gyroid sheet": tpms("gyroid", void_fraction=0.5, solid="sheet"),
    "schwarz-p": tpms("schwarz-p", void_fraction=0.4),
    "diamond": tpms("diamond", level=-0.2),
    "spheres": CHANNEL,
}


def both(geometry, size, element="quadratic-curved", domain="whole"):
    settings = MeshSettings(size=size, fluid_size=size, element=element)
    return [make_mesh(geometry, settings, phase, domain) for phase in ("solid", "fluid")]


def test_the_lattice_fills_its_box_with_equal_tetrahedra():
    for periodic in (False, True):
        lattice = body_centred(4, -0.5, 0.5, periodic=periodic)
        sizes = volumes(lattice.points, lattice.cells)
        assert sizes.sum() == pytest.approx(1, abs=1e-14)
        # Whole ones, and halves beside the sides.
        assert set(np.rint(sizes * 12 * 4**3 * 2)) == {1.0, 2.0}
        assert dihedral_angles(lattice.points, lattice.cells).min() == pytest.approx(45)
        assert (len(np.unique(lattice.first)) < len(lattice.points)) == periodic


@pytest.mark.parametrize("name", KINDS)
@pytest.mark.parametrize("element", [pytest.param("linear", marks=pytest.mark.slow), "quadratic-curved"])
def test_meshes_fill_the_cell_and_match_across_faces(name, element):
    solid, fluid = both(KINDS[name], 0.2, element)
    shares = [volume(mesh.points, mesh.cells) for mesh in (solid, fluid)]
    assert sum(shares) == pytest.approx(1, abs=1e-12)
    for mesh in (solid, fluid):
        assert (volumes(mesh.points, mesh.cells) > 0).all()
        assert least_stretch(mesh.points, mesh.cells).min() > 0.15
    # The wall of one phase is that of the other.
    facets = [
        {frozenset(map(tuple, mesh.points[facet])) for facet in mesh.wall} - in_faces(mesh)
        for mesh in (solid, fluid)
    ]
    assert facets[0] == facets[1]
    assert unmatched([solid, fluid]) == 0


def in_faces(mesh):
    return {
        frozenset(map(tuple, mesh.points[facet]))
        for facet in mesh.wall
        if (np.abs(mesh.points[facet[:3]]) == 0.5).all(axis=0).any()
    }


@pytest.mark.parametrize(("name", "within"), [("gyroid", 2e-3), ("schwarz-p", 1e-3), ("diamond", 2e-3)])
def test_porosity_and_shape_of_elements_of_resolved_cells(name, within):
    solid, fluid = both(KINDS[name], 0.14)
    assert volume(fluid.points, fluid.cells) == pytest.approx(KINDS[name].porosity, abs=within)
    for mesh in (solid, fluid):
        assert dihedral_angles(mesh.points, mesh.cells).min() > 5


@pytest.mark.slow
def test_the_error_of_the_volume_falls_with_its_order():
    """Straight facets leave out h², curved ones h⁴, on average over sizes that cut the wall differently."""
    geometry = tpms("schwarz-p", level=-0.4)
    for element, least in (("linear", 1.8), ("quadratic-curved", 3.5)):
        sizes = 0.5 / np.arange(3, 11)
        errors = []
        for size in sizes:
            (fluid,) = both(geometry, size, element, "eighth")[1:]
            errors.append(abs(8 * volume(fluid.points, fluid.cells) - geometry.porosity))
        slope = np.polyfit(np.log(sizes), np.log(errors), 1)[0]
        assert slope > least, element


@pytest.mark.parametrize("surface", ["gyroid", "schwarz-p", "diamond"])
def test_void_fractions_by_counting(surface):
    for level in (-0.5, 0.0, 0.7):
        geometry = tpms(surface, level=level)
        x = (np.arange(72) + 0.5) / 72 - 0.5
        points = np.stack(np.meshgrid(x, x, x, indexing="ij"), axis=-1).reshape(-1, 3)
        assert (geometry.level_set().value(points) < 0).mean() == pytest.approx(geometry.porosity, abs=2e-3)
        # The two sides of a surface are congruent.
        assert below(surface, level) + below(surface, -level) == pytest.approx(1, abs=1e-5)
    assert below(surface, 0.0) == pytest.approx(0.5, abs=1e-12)


def test_a_void_fraction_is_solved_for():
    for keys in ({"void_fraction": 0.62}, {"void_fraction": 0.62, "solid": "sheet"}):
        geometry = tpms("gyroid", **keys)
        again = tpms("gyroid", level=geometry.wall_level, solid=geometry.solid)
        assert geometry.porosity == 0.62
        assert again.porosity == pytest.approx(0.62, abs=1e-9)


def test_gradients_are_those_of_the_values():
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (40, 3))
    functions = [KINDS[name].level_set() for name in ("gyroid", "schwarz-p", "diamond", "gyroid sheet")]
    for function in (*functions, CHANNEL.pores()):
        step = 1e-6 * np.eye(3)
        slopes = [(function.value(points + d) - function.value(points - d)) / 2e-6 for d in step]
        np.testing.assert_allclose(function.gradient(points), np.stack(slopes, axis=1), atol=1e-6)


@pytest.mark.parametrize(
    "geometry",
    [
        SpherePores(kind="sphere-pores", lattice="cubic", radius=0.35, throat=0.15),
        SpherePores(kind="sphere-pores", lattice="bcc", radius=0.45),
        pytest.param(
            SpherePores(kind="sphere-pores", lattice="fcc", radius=0.25, throat=0.1), marks=pytest.mark.slow
        ),
        CHANNEL,
    ],
    ids=["cubic", "bcc", "fcc", "given"],
)
def test_porosity_of_spheres_by_counting(geometry):
    low = 0.0 if geometry.lattice else -0.5
    x = low + (0.5 - low) * (np.arange(32) + 0.5) / 32
    points = np.stack(np.meshgrid(x, x, x, indexing="ij"), axis=-1).reshape(-1, 3)
    assert (geometry.pores().value(points) < 0).mean() == pytest.approx(geometry.porosity, abs=6e-3)


def test_closed_forms_of_spheres():
    one = SpherePores(kind="sphere-pores", centres=((0.2, 0.45, 0.1),), radius=0.3)
    assert one.porosity == pytest.approx(4 / 3 * np.pi * 0.3**3, abs=2e-5)
    # A sphere and bars along the axes: the complement of the array of spheres with necks.
    array = TypeAdapter(Geometry).validate_python({"kind": "sphere-array", "radius": 0.35, "neck": 0.15})
    lattice = SpherePores(kind="sphere-pores", lattice="cubic", radius=0.35, throat=0.15)
    assert lattice.porosity == pytest.approx(1 - array.porosity, abs=5e-5)
    (_, fluid) = both(lattice, 0.2, domain="eighth")
    assert 8 * volume(fluid.points, fluid.cells) == pytest.approx(lattice.porosity, abs=2e-4)


def test_images_of_given_centres_are_the_same_pores():
    """A centre beyond the cell, and a throat through its face."""
    moved = tuple(
        tuple(np.array(c) + shift) for c, shift in zip(CHANNEL.centres, ((1, 0, 0), (0, -2, 0)), strict=True)
    )
    other = CHANNEL.model_copy(update={"centres": moved})
    points = np.random.default_rng(1).uniform(-0.5, 0.5, (200, 3))
    np.testing.assert_allclose(other.pores().value(points), CHANNEL.pores().value(points), atol=1e-12)
    for axis, side in product(range(3), (-0.5, 0.5)):
        points[:, axis] = side
        there = points.copy()
        there[:, axis] = -side
        near = np.abs(CHANNEL.pores().value(points)) < 0.05
        np.testing.assert_allclose(
            CHANNEL.pores().value(points[near]), CHANNEL.pores().value(there[near]), atol=1e-12
        )


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"kind": "tpms", "surface": "gyroid"}, "one of the keys level and void_fraction"),
        ({"kind": "tpms", "surface": "gyroid", "level": 0, "void_fraction": 0.5}, "one of the keys level"),
        ({"kind": "tpms", "surface": "gyroid", "level": 1.6}, "a level between -1.5 and 1.5"),
        (
            {"kind": "tpms", "surface": "diamond", "level": -0.1, "solid": "sheet"},
            "a level between 0 and 1.41",
        ),
        ({"kind": "sphere-pores", "radius": 0.3}, "one of the keys lattice and centres"),
        ({"kind": "sphere-pores", "lattice": "bcc"}, "one of the keys radius and radii"),
        ({"kind": "sphere-pores", "centres": [], "radius": 0.2}, "expected 1 to 64 centres, got 0"),
        (
            {"kind": "sphere-pores", "lattice": "bcc", "radius": 0.1, "throat": 0.2},
            "throat = 0.2 is not below",
        ),
        (
            {"kind": "sphere-pores", "centres": [[0, 0, 0]], "radii": [0.1, 0.2]},
            "expected 1 radii, one for each centre, got 2",
        ),
        ({"kind": "sphere-pores", "centres": [[0, 0, 0]], "radius": 0.2, "throat": 0.1}, "say which centres"),
        (
            {
                "kind": "sphere-pores",
                "centres": [[0, 0, 0]],
                "radius": 0.2,
                "throat": 0.1,
                "throats": [{"join": [0, 1]}],
            },
            "expected places from 0 to 0",
        ),
        (
            {
                "kind": "sphere-pores",
                "centres": [[0, 0, 0]],
                "radius": 0.2,
                "throat": 0.1,
                "throats": [{"join": [0, 0]}],
            },
            "give shift",
        ),
    ],
)
def test_contradictions_are_refused(keys, message):
    with pytest.raises(ValidationError, match=message):
        TypeAdapter(Geometry).validate_python(keys)


def test_a_cell_without_mirrors_is_always_the_whole():
    cell = Cell(geometry=GYROID)
    assert not cell.symmetric
    assert not cell.mirrored
    assert Cell(geometry=KINDS["schwarz-p"]).mirrored
    with pytest.raises(ValueError, match="no mirrors"):
        cell.make_mesh("solid", "eighth")


def test_curved_elements_between_spheres_that_just_overlap_do_not_fold():
    """Where the rims of the pores meet under a small angle, elements that followed both walls would."""
    geometry = SpherePores(kind="sphere-pores", lattice="fcc", radius=0.36)
    for mesh in both(geometry, 0.25, domain="eighth"):
        assert least_stretch(mesh.points, mesh.cells).min() >= 0.02
