"""The .vtu series: read back by meshio, and its XML looked at without it."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import replace

import meshio
import numpy as np
import pytest

from porocore.core.units import OutputUnits, ResultUnits, Scales, value_of
from porocore.errors import RunFolderError
from porocore.interfaces.cell import ElementCells
from porocore.report.vtk import write_vtu_series


@pytest.fixture
def solution(column):
    return column(elements=(1, 6, 2))


def test_fields_come_back(solution, tmp_path):
    write_vtu_series(tmp_path, "column", solution)
    for i, profile in enumerate(solution.profiles):
        mesh = meshio.read(tmp_path / f"column-{i:03d}.vtu")
        np.testing.assert_array_equal(mesh.points, solution.points)
        (block,) = mesh.cells
        assert block.type == "hexahedron27"
        np.testing.assert_array_equal(block.data, solution.cells)
        np.testing.assert_array_equal(mesh.point_data["u"], profile.u)
        np.testing.assert_array_equal(mesh.point_data["p"], profile.p)
        cells = {name: blocks[0] for name, blocks in mesh.cell_data.items()}
        for name, expected in {
            "H": profile.grad_u,
            "mean_grad": profile.mean_grad,
            "deformation": profile.deformation,
            "K_t": profile.conductivity,
            "P_E": profile.stress,
            "flux": profile.flux,
            "element_p": profile.element_p,
            "flagged": profile.flagged,
            "fluid_volume": profile.fluid_volume,
        }.items():
            np.testing.assert_array_equal(cells.pop(name), expected.reshape(len(expected), -1).squeeze())
        assert not cells


def test_tensors_are_written_row_by_row(solution, tmp_path):
    grad_u = np.arange(9.0).reshape(3, 3) + np.zeros((len(solution.cells), 1, 1))
    profile = replace(solution.profiles[0], grad_u=grad_u)
    write_vtu_series(tmp_path, "x", replace(solution, profiles=(profile,)))
    (read,) = meshio.read(tmp_path / "x-000.vtu").cell_data["H"]
    np.testing.assert_array_equal(read[0], np.arange(9.0))


def test_series_lists_existing_files_with_their_times(solution, tmp_path):
    path = write_vtu_series(tmp_path / "new", 'a "quoted" & <odd> name', solution)
    assert path.suffix == ".pvd"
    entries = ET.parse(path).getroot().findall("./Collection/DataSet")
    assert [float(entry.attrib["timestep"]) for entry in entries] == [1.0, 10.0, 40.0, 100.0]
    for entry in entries:
        root = ET.parse(path.parent / entry.attrib["file"]).getroot()
        assert root.attrib["type"] == "UnstructuredGrid"
    written = {file.name for file in path.parent.iterdir()}
    assert written == {path.name, *(entry.attrib["file"] for entry in entries)}  # nothing temporary is left


def test_times_keep_all_their_digits(solution, tmp_path):
    time = 0.1 + 0.2
    path = write_vtu_series(
        tmp_path, "x", replace(solution, profiles=(replace(solution.profiles[0], time=time),))
    )
    (entry,) = ET.parse(path).getroot().iter("DataSet")
    assert float(entry.attrib["timestep"]) == time


@pytest.mark.parametrize("name", ["", "a/b", "..", "/tmp/x"])
def test_a_name_with_a_folder_is_refused(solution, tmp_path, name):
    with pytest.raises(ValueError, match="plain file name"):
        write_vtu_series(tmp_path, name, solution)


def test_a_solution_without_profiles_is_refused(solution, tmp_path):
    with pytest.raises(ValueError, match="no profiles"):
        write_vtu_series(tmp_path, "x", replace(solution, profiles=()))
    assert not list(tmp_path.iterdir())


def test_an_unwritable_folder_is_named(solution, tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(RunFolderError, match=r"cannot write .*file/x-000\.vtu"):
        write_vtu_series(tmp_path / "file", "x", solution)


def test_with_scales_places_times_and_fields_have_units(solution, tmp_path):
    """They were dimensionless, and no name said so."""
    units = ResultUnits(
        Scales(modulus=2e3, length=1e-2, pore=5e-6), OutputUnits(length="mm", stress="mmHg", time="min")
    )
    path = write_vtu_series(tmp_path, "column", solution, units)
    times = [
        float(entry.attrib["timestep"]) for entry in ET.parse(path).getroot().findall("./Collection/DataSet")
    ]
    np.testing.assert_allclose(times, np.array([1, 10, 40, 100]) * 1e-4 / (2e3 * 25e-12) / 60, rtol=1e-14)
    mesh, profile = meshio.read(tmp_path / "column-000.vtu"), solution.profiles[0]
    np.testing.assert_allclose(mesh.points, 10 * solution.points, rtol=1e-14)
    np.testing.assert_allclose(mesh.point_data["u [mm]"], 10 * profile.u, rtol=1e-14)
    np.testing.assert_allclose(mesh.point_data["p [mmHg]"], 2e3 / 133.322387415 * profile.p, rtol=1e-14)
    (profile,) = [replace(solution.profiles[0], time=value_of("0.3 min", "time", units.scales))]
    path = write_vtu_series(tmp_path, "column", replace(solution, profiles=(profile,)), units)
    assert 'timestep="0.3"' in path.read_text(encoding="utf-8")
    names = {"H", "mean_grad", "deformation", "K_t [mm²/(mmHg min)]", "P_E [mmHg]", "flux [mm/min]"}
    assert set(mesh.cell_data) == names | {"element_p [mmHg]", "flagged", "fluid_volume"}


def test_a_body_of_many_cells_has_regions_parameters_and_axes(solution, tmp_path):
    e, count = len(solution.cells), len(solution.profiles)
    values = np.random.default_rng(0).random((count, e, 2))
    axes = np.broadcast_to(np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]), (1, e, 3, 3))
    region = np.arange(e) % 2
    cells = ElementCells(region, ("top",), ("c10", "flux"), values, axes)
    units = ResultUnits(
        Scales(modulus=1e4, pore=1e-4, viscosity=1e-3, length=1e-2), OutputUnits(stress="kPa")
    )
    write_vtu_series(tmp_path, "x", replace(solution, element_cells=cells), units, {"c10": "stress"})
    for i in range(count):
        data = {
            name: blocks[0] for name, blocks in meshio.read(tmp_path / f"x-{i:03d}.vtu").cell_data.items()
        }
        np.testing.assert_array_equal(data["region"], region)
        assert data["region"].dtype.kind == "i"
        np.testing.assert_allclose(data["c10 [kPa]"], 10 * values[i, :, 0], rtol=1e-14)
        # A parameter called like a field of the solution.
        np.testing.assert_array_equal(data["parameter flux"], values[i, :, 1])
        np.testing.assert_array_equal(data["axis_1"], np.tile([0.0, 1, 0], (e, 1)))
        np.testing.assert_array_equal(data["axis_2"], np.tile([-1.0, 0, 0], (e, 1)))


def remembering(solution):
    """The column with an overstress, fixed charges and a radius that evolves beside a field that does not."""
    e, rng = len(solution.cells), np.random.default_rng(3)
    cells = ElementCells(
        np.zeros(e, int), (), ("radius", "swelling"), rng.random((len(solution.profiles), e, 2))
    )
    quantities = {
        "radius": "",
        "overstress_1": "stress",
        "pore_pressure": "pressure",
        "charge": "concentration",
    }
    quantities["mean_grad"] = ""
    profiles = tuple(
        replace(
            each,
            internal={
                "radius": rng.random(e),
                "overstress_1": rng.random((e, 3, 3)),
                "pore_pressure": each.element_p + rng.random(e),
                "charge": rng.random(e),
                "mean_grad": each.mean_grad,
            },
            cell_p=each.element_p + 0.5 * (each.time > 1),
        )
        for each in solution.profiles
    )
    return replace(solution, profiles=profiles, element_cells=cells, quantities=quantities)


def test_what_the_law_remembers_has_units(solution, tmp_path):
    given, units = remembering(solution), ResultUnits(Scales(modulus=1e4, pore=1e-4, length=1e-2))
    write_vtu_series(tmp_path, "x", given, units)
    for i, profile in enumerate(given.profiles):
        mesh = meshio.read(tmp_path / f"x-{i:03d}.vtu")
        assert set(mesh.point_data) == {"u [m]", "effective_p [Pa]"}
        data, internal = {name: blocks[0] for name, blocks in mesh.cell_data.items()}, profile.internal
        per_volume = 1e4 / 8.31446261815324
        J = np.linalg.det(np.eye(3) + profile.grad_u)
        for name, expected in {
            "overstress_1 [Pa]": 1e4 * internal["overstress_1"].reshape(-1, 9),
            "pore_pressure [Pa]": 1e4 * internal["pore_pressure"],
            "charge [mol/m³]": per_volume * internal["charge"],
            "osmotic_pressure [Pa]": 1e4 * (internal["pore_pressure"] - profile.element_p),
            "fixed_charge_density [mol/m³]": per_volume * internal["charge"] / profile.fluid_volume,
            "swelling_stretch": J ** (1 / 3),
            "cell_p [Pa]": 1e4 * profile.cell_p,
            "element_effective_p [Pa]": 1e4 * profile.element_p,
            "radius": given.element_cells.field("radius", i),
            "swelling": given.element_cells.field("swelling", i),
        }.items():
            np.testing.assert_allclose(data.pop(name), expected, rtol=1e-12, err_msg=name)
        # Once each: the mean gradient is a field of every law, and the radius one of the cells.
        assert {name.partition(" [")[0] for name in data} == {
            "H", "mean_grad", "deformation", "K_t", "P_E", "flux", "flagged", "fluid_volume"
        }  # fmt: skip
