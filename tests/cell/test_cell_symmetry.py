"""The point group of a cell comes from its pores and its material."""

from itertools import product

import numpy as np
import pytest
from pydantic import TypeAdapter

from porocore.cell.cell import Cell, Geometry
from porocore.cell.level_sets.tpms import Nodal
from porocore.cell.materials.hyperelastic import AnyMaterial, Composite
from porocore.cell.meshing.tetrahedra import Tetrahedra
from porocore.cell.symmetry import group_of_voxels, region_maps
from porocore.core.tensors import CUBE_OPERATIONS, CUBIC

geometry = TypeAdapter(Geometry).validate_python
material = TypeAdapter(AnyMaterial).validate_python
HGO = {"kind": "holzapfel-gasser-ogden", "shear_modulus": 0.1, "bulk_modulus": 0.3, "k1": 0.2, "k2": 1.0}
FORMULA = {
    "kind": "expression",
    "energy": "mu/2*(I1 - 3 - 2*log(J)) + k*(J - 1)**2 + a*(I4 - 1)**2 + b*(I6 - 1)**2",
    "parameters": {"mu": 0.4, "k": 0.5, "a": 0.1, "b": 0.3},
}
BCC = {"kind": "sphere-pores", "lattice": "bcc", "radius": 0.3, "throat": 0.1}
CENTRE, OTHER = [0.1, 0.2, 0.3], [-0.4, -0.3, -0.2]


def spheres(*centres, **more):
    return {"kind": "sphere-pores", "centres": list(centres), "radius": 0.2, **more}


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        ({}, "m-3m"),
        ({"axes": "xy"}, "4/mmm"),
        ({"axes": "x"}, "4/mmm"),
        ({"radii": [0.2, 0.2, 0.3]}, "4/mmm"),
        ({"radii": [0.2, 0.25, 0.3]}, "mmm"),
        ({"kind": "sphere-array", "radius": 0.3}, "m-3m"),
        ({"kind": "cylinder-array", "radius": 0.3}, "4/mmm"),
        ({"kind": "no-pores"}, "m-3m"),
        (BCC, "m-3m"),
        (spheres(CENTRE), "m-3m"),
        (spheres(CENTRE, OTHER), "m-3m"),  # a shifted bcc lattice
        (spheres(CENTRE, OTHER, radius=None, radii=[0.2, 0.25]), "m-3m"),  # and that of caesium chloride
        (spheres(CENTRE, [0.1, 0.2, 0.6]), "4/mmm"),
        (spheres(CENTRE, [0.3, 0.2, 0.3], [0.1, 0.1, 0.3]), "2/m"),
        (spheres(CENTRE, [0.3, 0.2, 0.35], [0.1, 0.1, 0.3]), "-1"),
        (spheres(CENTRE, throat=0.1, throats=[{"join": [0, 0], "shift": [1, 0, 0]}]), "4/mmm"),
        (spheres(CENTRE, throat=0.1, throats=[{"join": [0, 0], "shift": [1, 1, 0]}]), "mmm"),
        (spheres(CENTRE, throat=0.1, throats=[{"join": [0, 0], "shift": [1, 1, 1]}]), "-3m"),
        ({"kind": "tpms", "surface": "gyroid", "level": 0.2}, "m-3m"),
        ({"kind": "tpms", "surface": "diamond", "level": 0.2, "solid": "sheet"}, "m-3m"),
    ],
)
def test_geometries(kind, name):
    assert geometry(kind).point_group.name == name


@pytest.mark.parametrize("surface", ["gyroid", "schwarz-p", "diamond"])
def test_triply_periodic_surfaces_have_the_group_of_the_cube(surface):
    """For each rotation, or it with the inversion, some shift by eighths of the period leaves f alone, or its sign."""
    f = Nodal(surface, 0.0).value
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (12, 3))
    shifts = np.array(list(product(range(8), repeat=3))) / 8
    for Q in CUBIC.matrices:
        images = [f((points @ (s * Q).T + shifts[:, None]).reshape(-1, 3)).reshape(-1, 12) for s in (1, -1)]
        assert min(np.abs(image - f(points)).max(axis=1).min() for image in images) < 1e-12


def pyritohedral():
    """The eighth of three crossing channels of 0.75 × 0.25, on 8³ voxels; True in the solid."""
    x, y, z = np.indices((8, 8, 8))
    pore = ((y < 6) & (z < 2)) | ((z < 6) & (x < 2)) | ((x < 6) & (y < 2))
    return ~pore


def whole(eighth):
    for axis in range(3):
        eighth = np.concatenate([np.flip(eighth, axis), eighth], axis)
    return eighth


def test_voxels():
    """The same whether they are an eighth or a whole cell, wherever that begins."""
    solid = pyritohedral()
    assert group_of_voxels(solid, mirror=True).name == "m-3"
    assert group_of_voxels(np.roll(whole(solid), (3, 5, 1), (0, 1, 2)), mirror=False).name == "m-3"
    bar = np.zeros((8, 8, 8), dtype=bool)
    bar[3:5, 1:5] = True
    assert group_of_voxels(bar, mirror=False).name == "mmm"
    x, y, _ = np.indices((8, 8, 8))
    assert group_of_voxels((x + y) % 4 == 0, mirror=False).name == "mmm"
    assert group_of_voxels(x < 3, mirror=False).name == "4/mmm"
    noise = np.random.default_rng(0).random((12, 12, 12)) < 0.5
    assert group_of_voxels(noise, mirror=False).name == "-1"
    assert group_of_voxels(noise, mirror=True).name == "mmm"


@pytest.mark.parametrize(
    ("solid", "name"),
    [
        ({**HGO, "directions": [[1, 0, 0]]}, "4/mmm"),
        ({**HGO, "directions": [[1, 1, 0]]}, "mmm"),
        ({**HGO, "directions": [[1, 1, 1]]}, "-3m"),
        ({**HGO, "directions": [[1, 2, 0]]}, "2/m"),
        ({**HGO, "directions": [[1, 2, 3]]}, "-1"),
        ({**HGO, "directions": [[1, 2, 3]], "dispersion": 1 / 3}, "m-3m"),
        ({**HGO, "directions": [[1, 1, 0], [1, -1, 0]]}, "4/mmm"),
        ({**HGO, "directions": [[1, 0, 0], [0, 1, 0], [0, 0, -1]]}, "m-3m"),
        ({**FORMULA, "directions": [[1, 1, 0], [1, -1, 0]]}, "mmm"),
        ({**FORMULA, "directions": [[1, 0, 0], [0, 1, 0]]}, "mmm"),
        ({"kind": "neo-hookean"}, "m-3m"),
    ],
)
def test_materials(solid, name):
    """A group is that of the energy: Ψ(Q F Qᵀ) = Ψ(F) for its operations, and for no others."""
    solid = material(solid)
    group = CUBIC.kept(lambda Q: solid.allows(Q, None))
    assert group.name == name
    F = np.eye(3) + np.random.default_rng(1).uniform(0.0, 0.3, (6, 3, 3))
    for Q in CUBE_OPERATIONS:
        same = np.abs(solid.energy_density(Q @ F @ Q.T) - solid.energy_density(F)).max() < 1e-12
        assert same == (Q in group)


def test_a_cell_has_what_pores_material_and_block_have_in_common():
    """Fibres along [1, 1, 0] in bcc spheres leave the mirrors z and x ↔ y."""
    cell = Cell.model_validate({"geometry": BCC, "material": {**HGO, "directions": [[1, 1, 0]]}})
    assert len(cell.point_group) == 4
    assert np.diag([1, 1, -1]) in cell.point_group
    assert np.array([[0, 1, 0], [1, 0, 0], [0, 0, 1]]) in cell.point_group
    assert np.diag([1, -1, 1]) not in cell.point_group
    assert Cell(supercell=(2, 2, 1)).point_group.name == "4/mmm"
    one = {"geometry": {"radii": [0.2, 0.25, 0.3]}, "material": {**HGO, "directions": [[1, 1, 0]]}}
    assert Cell.model_validate(one).point_group.name == "2/m"


def layers():
    """A box of 2 × 2 × 2 cubes of six tetrahedra each, symmetric about their long diagonals; below and above z = 0."""
    n = 2
    corner = np.array(list(product(range(n + 1), repeat=3)))
    number = {tuple(c): k for k, c in enumerate(corner)}
    cells = []
    for at in product(range(n), repeat=3):
        for order in ((0, 1, 2), (1, 2, 0), (2, 0, 1), (0, 2, 1), (1, 0, 2), (2, 1, 0)):
            path = [np.array(at)]
            for axis in order:
                path.append(path[-1] + np.eye(3, dtype=int)[axis])
            cells.append([number[tuple(p)] for p in path])
    points, cells = corner / n - 0.5, np.array(cells)
    upper = points[cells].mean(axis=1)[:, 2] > 0
    return Tetrahedra(points, cells, upper.astype(np.int64), ("lower", "upper"))


def test_meshes_and_their_regions():
    """Six tetrahedra around a diagonal of each cube have its symmetry, -3m; the layers leave 2/m of it."""
    mesh = layers()
    maps = region_maps(mesh)
    assert len(maps) == 6
    stay = [Q for Q, regions in maps.items() if regions is not None]
    assert len(stay) == 2
    one, other = material({"kind": "neo-hookean"}), material({"kind": "neo-hookean", "poisson_ratio": 0.2})
    for solid in (Composite({"lower": one, "upper": one}), Composite({"lower": one, "upper": other})):
        allowed = [Q for Q, regions in maps.items() if solid.allows(np.reshape(Q, (3, 3)), regions)]
        # Shifted by half a cell, or turned about the middle, each layer is the other.
        assert sorted(allowed) == sorted(stay)


def test_regions_that_change_places_need_materials_that_do():
    """A mirror that takes one fibre to the other, and one region to the other."""
    one, other = (material({**HGO, "directions": [d]}) for d in ([1, 1, 0], [1, -1, 0]))
    both = Composite({"left": one, "right": other})
    mirror = np.diag([-1, 1, 1])
    assert both.allows(mirror, {"left": "right", "right": "left"})
    assert not both.allows(mirror, {})
    assert not both.allows(np.eye(3, dtype=int), None)
