"""Geometries other than channels: what is drawn, what is refused, and how a fault in the configuration is told."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from porocore.cell.cell import Cell, Geometry
from porocore.cell.equilibrium.solver import PreparedCell
from porocore.cell.geometry.channels import OrthogonalChannels
from porocore.cell.geometry.drawn import CylinderArray, NoPores, SphereArray
from porocore.cell.meshing.mesh import MeshSettings, make_mesh
from porocore.cell.meshing.tetrahedra import tetrahedron_rule
from porocore.errors import ConfigurationError
from porocore.macro.reference import CellReference
from porocore.study.config.loading import load_config
from porocore.study.run.reference import solve_cell
from porocore.study.run.summary import published_values

EXAMPLE = Path(__file__).parents[2] / "examples" / "dehghani2022.yaml"
COARSE = MeshSettings(size=0.25, fluid_size=0.25)
SPHERES = SphereArray(kind="sphere-array", radius=0.4)
NECKS = SphereArray(kind="sphere-array", radius=0.45, neck=0.2)
TOUCHING = SphereArray(kind="sphere-array", radius=0.5, neck=0.2)
CYLINDERS = CylinderArray(kind="cylinder-array", radius=0.45)
SOLID = NoPores(kind="no-pores")
ALL = (SPHERES, NECKS, TOUCHING, CYLINDERS, SOLID)


def volume(mesh):
    """By the curved elements' own shape functions."""
    if not len(mesh.cells):
        return 0.0
    points, weights = tetrahedron_rule(4)
    b = np.column_stack([1 - points.sum(axis=1), points])
    grad = np.vstack([-np.ones(3), np.eye(3)])
    slopes = [(4 * b[:, [i]] - 1) * grad[i] for i in range(4)]
    for i, j in ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)):
        slopes.append(4 * (b[:, [i]] * grad[j] + b[:, [j]] * grad[i]))
    jacobian = np.einsum("eai,aqj->eqij", mesh.points[mesh.cells], np.array(slopes))
    return float((np.linalg.det(jacobian) @ weights).sum())


@pytest.mark.parametrize("geometry", ALL, ids=str)
def test_meshes_fill_both_phases(geometry):
    solid, fluid = (8 * volume(make_mesh(geometry, COARSE, phase, "eighth")) for phase in ("solid", "fluid"))
    assert solid + fluid == pytest.approx(1, abs=1e-12)
    assert fluid == pytest.approx(geometry.porosity, abs=2e-3)


def test_porosity_of_necks_by_counting():
    x = (np.arange(100) + 0.5) / 200  # the eighth
    X, Y, Z = np.meshgrid(x, x, x, indexing="ij")
    r = NECKS.radius
    inside = r**2 > X**2 + Y**2 + Z**2
    for a, b in ((X, Y), (Y, Z), (X, Z)):
        inside |= a**2 + b**2 < NECKS.neck**2
    assert 1 - inside.mean() == pytest.approx(NECKS.porosity, abs=5e-4)


@pytest.mark.parametrize("geometry", [NECKS, CYLINDERS], ids=str)
def test_opposite_faces_of_the_whole_cell_match(geometry):
    mesh = make_mesh(geometry, COARSE, "fluid", "whole")
    for axis in range(3):
        low, high = (mesh.points[mesh.points[:, axis] == side] for side in (-0.5, 0.5))
        others = [i for i in range(3) if i != axis]
        assert len(low)
        assert {tuple(p) for p in low[:, others]} == {tuple(p) for p in high[:, others]}


def test_elements_follow_the_gaps():
    """Across the narrowest place lies more than one layer of nodes, and finer settings refine it."""
    narrow = CylinderArray(kind="cylinder-array", radius=0.48)
    edges = []
    for size in (0.2, 0.1):
        mesh = make_mesh(narrow, MeshSettings(fluid_size=size), "fluid", "eighth")
        corners = mesh.points[np.unique(mesh.cells[:, :4])]
        beside = corners[(corners[:, 0] > 0.48) & (corners[:, 2] == 0)]
        edges.append(np.diff(np.sort(beside[beside[:, 0] == 0.5][:, 1]))[:3].max())
    assert edges[0] < 0.03
    assert edges[1] < 0.7 * edges[0]


def test_a_cylinder_array_is_one_element_high():
    mesh = make_mesh(CYLINDERS, COARSE, "fluid", "eighth")
    assert set(np.unique(mesh.points[np.unique(mesh.cells[:, :4]), 2])) == {0.0, 0.5}


class Solver:
    """Of which nothing may be asked."""

    def solid(self, cell, mesh):
        raise AssertionError

    def fluid(self, mesh):
        raise AssertionError


@pytest.mark.parametrize(
    ("geometry", "why"), [(SPHERES, "spheres do not touch; give"), (CYLINDERS, "cylinders do not touch")]
)
def test_a_loose_solid_is_refused(geometry, why):
    prepared = PreparedCell(Solver(), Cell(geometry=geometry, mesh=COARSE))
    for H in (np.zeros((3, 3)), np.eye(3)[::-1]):
        with pytest.raises(
            ConfigurationError, match=f"cell.geometry: .* is not connected across the periodic cell.*{why}"
        ):
            prepared.solid_for(H)


def test_without_pores_nothing_flows_and_nothing_is_studied():
    cell = Cell(geometry=SOLID, mesh=COARSE)
    assert (PreparedCell(Solver(), cell).conductivity == 0).all()
    with pytest.raises(ConfigurationError, match="has no pores"):
        CellReference.compute(Solver(), None, cell, "")


def test_what_kind_is_meant():
    geometry = TypeAdapter(Geometry)
    assert geometry.validate_python({"radius": 0.3}) == OrthogonalChannels(radius=0.3)
    assert geometry.validate_python({"kind": "sphere-array", "radius": 0.4}) == SPHERES
    assert geometry.validate_python(NECKS) is NECKS
    for kind in ALL:
        assert geometry.validate_python(kind.model_dump()) == kind
        assert kind.description
    # A cell of one kind is not one of another with the same numbers.
    identities = {
        Cell(geometry=kind).identity for kind in (SPHERES, CylinderArray(kind="cylinder-array", radius=0.4))
    }
    assert len(identities) == 2


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"kind": "sphere-array", "radius": 0.3, "neck": 0.3}, "neck = 0.3 is not below the radius 0.3"),
        ({"kind": "sphere-array", "radius": 0.5}, "leaves a gap below 0.002 .* give a neck"),
        ({"kind": "cylinder-array", "radius": 0.4999}, "leaves a gap below 0.002"),
    ],
)
def test_what_no_mesh_resolves_is_refused(values, message):
    with pytest.raises(ValidationError, match=message):
        TypeAdapter(Geometry).validate_python(values)


@pytest.mark.parametrize(
    ("text", "key", "message"),
    [
        (
            "{kind: sphere-aray, radius: 0.3}",
            "cell.geometry.kind",
            "expected one of orthogonal-channels, sphere-array, cylinder-array, no-pores, "
            "sphere-pores, tpms, voxels, mesh-file, got 'sphere-aray'; "
            "did you mean 'sphere-array'?",
        ),
        (
            "{kind: sphere-array, radius: 0.7}",
            "cell.geometry.radius",
            "expected a number with 0 < radius <= 0.5, got 0.7",
        ),
        (
            "{kind: cylinder-array, radius: 0.5}",
            "cell.geometry.radius",
            "expected a number with 0 < radius < 0.5, got 0.5",
        ),
        ("{kind: sphere-array}", "cell.geometry.radius", "missing; add 'radius:' under 'cell.geometry:'"),
        (
            "{kind: sphere-array, radius: 0.3, nek: 0.1}",
            "cell.geometry.nek",
            "unknown key; did you mean 'neck'? the keys here are kind, radius, neck",
        ),
        ("{kind: no-pores, axes: x}", "cell.geometry.axes", "unknown key; remove it; the keys here are kind"),
        ("{kind: 3}", "cell.geometry.kind", "expected one of orthogonal-channels, "),
        ("{axes: xx}", "cell.geometry.axes", "expected one of x, y, z, xy, xz, yz, xyz, got 'xx'"),
    ],
)
def test_faults_name_the_keys_of_their_own_kind(tmp_path, text, key, message):
    whole = EXAMPLE.read_text(encoding="utf-8")
    section = re.search(r"  geometry:.*?(?=\n  \w)", whole, re.DOTALL)[0]
    path = tmp_path / "study.yaml"
    path.write_text(whole.replace(section, f"  geometry: {text}"), encoding="utf-8")
    with pytest.raises(ConfigurationError) as error:
        load_config(path)
    line = whole[: whole.index(section)].count("\n") + 1
    assert str(error.value).startswith(f"{path}:{line}: {key}: {message}")


def test_only_the_papers_cell_is_the_benchmark():
    config = load_config(EXAMPLE)
    assert published_values(config)
    other = config.cell.model_copy(update={"geometry": NECKS})
    assert not published_values(config.model_copy(update={"cell": other}))


def test_of_a_disconnected_cell_the_command_shows_what_there_is():
    pytest.importorskip("porocore_fem_skfem")
    config = load_config(EXAMPLE)
    cell = Cell(geometry=SPHERES, mesh=COARSE, viscosity=1.0)
    config = config.model_copy(update={"cell": cell})
    found = solve_cell(config, np.zeros((3, 3)), 0.0)
    assert found["porosity"] == cell.mesh_porosity == pytest.approx(SPHERES.porosity, abs=0.02)
    drag = 1 / (6 * np.pi * SPHERES.radius * found["conductivity"][0, 0])
    assert 7.442 < drag < 15.4  # Zick & Homsy's at concentrations of 0.216 and 0.343; this is 0.268
    assert found["solid"].startswith("disconnected: its spheres do not touch")
    with pytest.raises(ConfigurationError, match="is not connected across the periodic cell"):
        solve_cell(config, np.zeros((3, 3)), 0.1)
