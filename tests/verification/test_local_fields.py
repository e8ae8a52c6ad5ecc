"""Local fields: averages and extrema of the response, exact unfolding, recovery at the nodes, files, pictures."""

import json
import subprocess
import sys
from ctypes.util import find_library
from functools import partial
from types import SimpleNamespace

import meshio
import numpy as np
import pytest

from porocore.cell.cell import Cell
from porocore.cell.meshing.mesh import MeshSettings, unfold_displacement
from porocore.cell.meshing.tetrahedra import shape_functions, tetrahedron_rule
from porocore.cli.entry import main
from porocore.commands.fields import pictures
from porocore.commands.fields.points import NodalFields, PointFields, recover_at_nodes
from porocore.commands.fields.solve import (
    PAPER_STATES,
    solve_and_write,
    solve_fields,
    state_text,
    write_fields,
)
from porocore.core.units import OutputUnits, ResultUnits, Scales, using_units
from porocore.errors import ConfigurationError, PorocoreError
from porocore.interfaces.cell import CellField, CellSolution
from porocore.interfaces.records import failed_response
from porocore.states import Status
from porocore.study.config.config import FemSettings

pytest.importorskip("porocore_fem_skfem")

#: What a cell solver's sums and those over the points of the core may differ by.
ROUND_OFF = 1e-12
CURVED = Cell(mesh=MeshSettings(size=0.3, fluid_size=0.3))
LINEAR = Cell(mesh=MeshSettings(size=0.25, fluid_size=0.3, element="linear"))
STATES = {"diagonal": {"H11": 0.1, "H22": -0.15, "p": 0.1}, "sheared": {"H12": 0.2, "H33": 0.05}}


@pytest.fixture(scope="module", params=["skfem", "dolfinx"])
def backend(request):
    if request.param == "dolfinx":
        pytest.importorskip("dolfinx")
        pytest.importorskip("porocore_fem_dolfinx")
    return FemSettings(backend=request.param)


@pytest.mark.parametrize(
    ("cell", "state"),
    [
        pytest.param(CURVED, "diagonal", id="curved-diagonal"),
        pytest.param(LINEAR, "diagonal", id="linear-diagonal"),
        pytest.param(LINEAR, "sheared", id="linear-sheared"),
        pytest.param(CURVED, "sheared", id="curved-sheared", marks=pytest.mark.slow),
    ],
)
def test_averages_and_peaks_are_those_of_the_response(backend, cell, state):
    """A diagonal state is solved on the eighth and unfolded; a sheared one on the whole cell."""
    response, points = solve_fields(cell, backend, STATES[state])
    np.testing.assert_allclose(points.mean(points.grad), response.mean_grad[0], atol=ROUND_OFF)
    J0 = np.linalg.det(np.eye(3) + points.grad_u)
    assert J0 - points.mean(points.J) == pytest.approx(response.fluid_volume[0], abs=ROUND_OFF)
    extrema = response.extrema
    assert points.mean(points.energy) == pytest.approx(extrema.energy_mean[0], abs=ROUND_OFF)
    assert points.energy.max() == pytest.approx(extrema.energy[0], abs=ROUND_OFF)
    assert points.J.min() == pytest.approx(extrema.min_jacobian[0], abs=ROUND_OFF)
    np.testing.assert_allclose(abs(points.grad).max(axis=(0, 1)), extrema.grad[0], atol=ROUND_OFF)
    # W = <Ψ + pJ>_s − p J₀, and P_E = <P + p cof F>_s − p cof F₀ = ∂W/∂H: without pressure it is <P>_s.
    potential = points.mean(points.energy) - points.p * response.fluid_volume[0]
    assert potential == pytest.approx(response.potential[0], abs=ROUND_OFF)
    if points.p == 0:
        np.testing.assert_allclose(points.mean(points.stress), response.stress[0], atol=ROUND_OFF)


def test_a_field_of_the_eighth_is_unfolded_by_its_mirrors():
    eighth, whole = CURVED.make_mesh("solid", "eighth"), CURVED.make_mesh("solid", "whole")
    u = np.sin(2 * np.pi * eighth.points) * (1 + eighth.points[:, [1, 2, 0]] ** 2)
    unfolded = unfold_displacement(eighth.points, u, whole.points)
    expected = np.sin(2 * np.pi * whole.points) * (1 + whole.points[:, [1, 2, 0]] ** 2)
    np.testing.assert_allclose(unfolded, expected, atol=1e-15)
    with pytest.raises(ValueError, match="no mirror images"):
        unfold_displacement(eighth.points[1:], u[1:], whole.points)


def affine(cell, gradient):
    """u¹ with the same gradient everywhere, which no periodic field has, to look at integration and recovery alone."""
    mesh = cell.make_mesh("solid", "whole")
    field = CellField(np.diag([0.1, 0.0, -0.1]), 0.2, "whole", mesh.points @ np.asarray(gradient).T)
    return PointFields.from_cell_field(cell, field)


@pytest.mark.parametrize("cell", [CURVED, LINEAR], ids=["curved", "linear"])
def test_an_affine_field_has_its_gradient_everywhere(cell):
    gradient = np.array([[0.1, 0.2, 0.0], [-0.1, 0.05, 0.0], [0.0, 0.3, -0.1]])
    points = affine(cell, gradient)
    nodal = NodalFields(points)
    np.testing.assert_allclose(points.grad, np.broadcast_to(gradient, points.grad.shape), atol=1e-12)
    np.testing.assert_allclose(nodal.grad, np.broadcast_to(gradient, nodal.grad.shape), atol=1e-12)
    F = np.eye(3) + points.grad_u + gradient
    np.testing.assert_allclose(nodal.J, np.linalg.det(F))
    assert nodal.energy == pytest.approx(float(cell.material.energy_density(F)))
    cauchy = cell.material.stress(F) @ F.T / np.linalg.det(F)
    np.testing.assert_allclose(nodal.cauchy, np.broadcast_to(cauchy, nodal.cauchy.shape), atol=1e-12)
    np.testing.assert_allclose(cauchy, cauchy.T, atol=1e-12)
    deviator = cauchy - np.trace(cauchy) / 3 * np.eye(3)
    assert nodal.von_mises == pytest.approx(np.sqrt(1.5 * (deviator**2).sum()))
    moved = points.mesh.points @ (points.grad_u + gradient).T
    np.testing.assert_allclose(nodal.displacement, moved, atol=1e-12)


def test_recovery_keeps_to_the_values_around_a_node():
    points = affine(LINEAR, np.zeros((3, 3)))
    middles = points.mesh.points[points.mesh.cells].mean(axis=1)
    found = recover_at_nodes(points, (np.abs(middles[:, 0]) > 0.3).astype(float)[:, None])
    assert found.min() == 0.0
    assert found.max() == 1.0
    assert ((found > 0) & (found < 1)).any()


def test_recovery_of_a_linear_function_is_linear_inside():
    """|x|: the elements keep the plane x = 0, and on both faces of the cell it is the same."""
    points = affine(CURVED, np.zeros((3, 3)))
    mesh = points.mesh
    N, _ = shape_functions(tetrahedron_rule(2)[0], 10)
    found = recover_at_nodes(points, np.abs(np.einsum("eai,qa->eqi", mesh.points[mesh.cells], N)[..., 0]))
    x = np.abs(mesh.points[:, 0])
    inside = (np.abs(mesh.points) < 0.45).all(axis=1) & (x > 0.05)
    off = np.abs(found - x)[inside]
    assert np.median(off) < 0.02
    assert off.max() < 0.1


def test_a_crease_does_not_overshoot():
    response, points = solve_fields(CURVED, FemSettings(), {"H22": -0.3})
    nodal = NodalFields(points)
    assert nodal.energy.max() <= response.extrema.energy[0] + ROUND_OFF
    assert nodal.energy.min() >= 0
    assert nodal.J.min() >= response.extrema.min_jacobian[0] - ROUND_OFF


def test_the_file_holds_the_fields(tmp_path):
    response, points = solve_fields(CURVED, FemSettings(), STATES["diagonal"])
    nodal = NodalFields(points)
    mesh = meshio.read(write_fields(tmp_path / "new" / "a.vtu", nodal))
    (block,) = mesh.cells
    assert block.type == "tetra10"
    np.testing.assert_array_equal(block.data, points.mesh.cells)
    np.testing.assert_array_equal(mesh.points, points.mesh.points)
    np.testing.assert_array_equal(mesh.point_data["u1"], points.u)
    np.testing.assert_array_equal(mesh.point_data["energy"], nodal.energy)
    np.testing.assert_array_equal(mesh.point_data["F"].reshape(-1, 3, 3), nodal.F)
    assert {"displacement", "grad_u1", "J", "P", "cauchy", "von_mises", "u1_magnitude"} < set(mesh.point_data)
    with using_units(ResultUnits(Scales(modulus=2e3, length=1e-2, pore=5e-6), OutputUnits(stress="kPa"))):
        measured = meshio.read(write_fields(tmp_path / "b.vtu", nodal))
    np.testing.assert_array_equal(measured.point_data["energy [kPa]"], 2 * nodal.energy)
    np.testing.assert_array_equal(measured.point_data["J"], nodal.J)
    assert {"P [kPa]", "cauchy [kPa]", "von_mises [kPa]"} < set(measured.point_data)
    assert {"mean_energy [kPa]", "mean_J", "max_energy [kPa]"} == set(measured.cell_data)
    volume = points.volume.sum(axis=1)
    mean = volume @ mesh.cell_data["mean_energy"][0]
    assert mean == pytest.approx(response.extrema.energy_mean[0], abs=ROUND_OFF)
    assert mesh.cell_data["max_energy"][0].max() == pytest.approx(response.extrema.energy[0], abs=ROUND_OFF)


def test_what_cannot_be_written(tmp_path):
    with pytest.raises(ConfigurationError, match="H11, H12"):
        solve_fields(LINEAR, FemSettings(), {"q": 0.1})
    with pytest.raises(PorocoreError, match=r"p = −0.9 has no local fields to write, its status is"):
        solve_and_write(LINEAR, FemSettings(), tmp_path, {"p": -0.9})
    assert list(tmp_path.iterdir()) == []


def test_states_in_words():
    assert state_text({"H22": -0.2, "p": 0.1, "H11": 0.0}) == "H22 = −0.2, p = 0.1"
    assert state_text({}) == "the undeformed state"
    with using_units(ResultUnits(Scales(modulus=2e3, length=1e-2, pore=5e-6), OutputUnits(stress="kPa"))):
        assert state_text({"H22": -0.2, "p": 0.1}) == "H22 = −0.2, p = 0.2 kPa"
    assert state_text({"H12": 0.4, "p": 0.1}, mathtext=True) == "$H_{12}$ = 0.4, $p$ = 0.1"
    assert set(PAPER_STATES) == {"pressure", "uni", "shear"}


def test_without_pyvista_the_file_is_written_and_the_message_says_what_to_install(monkeypatch, tmp_path):
    monkeypatch.setattr(pictures, "find_spec", lambda name: None)
    with pytest.raises(PorocoreError, match=r"pip install pyvista"):
        solve_and_write(LINEAR, FemSettings(), tmp_path, {"p": 0.1}, name="a")
    assert [path.name for path in tmp_path.iterdir()] == ["a.vtu"]


def test_where_vtk_ends_the_process_the_message_says_what_to_install(monkeypatch, tmp_path):
    """As it does without EGL: the child dies of a signal, and this process goes on."""
    monkeypatch.setattr(pictures, "find_spec", lambda name: True)
    asked = []

    def run(words, *, env, **how):
        asked.append(env["VTK_DEFAULT_OPENGL_WINDOW"])
        return subprocess.run([sys.executable, "-c", "import os; os.abort()"], **how, env=env)

    monkeypatch.setattr(pictures.subprocess, "run", _once_removed(run))
    with pytest.raises(
        PorocoreError, match=r"signal 6.*apt-get install libegl1.*a\.vtu is written"
    ) as raised:
        solve_and_write(LINEAR, FemSettings(), tmp_path, {"p": 0.1}, name="a")
    assert "\n" not in str(raised.value)
    assert asked == list(pictures.WINDOWS)
    assert [path.name for path in tmp_path.iterdir()] == ["a.vtu"]


def _once_removed(run):
    """``run`` with the real subprocess.run inside."""
    real = subprocess.run

    def outer(words, **how):
        if words[1:2] == ["-m"]:
            return run(words, **how)
        return real(words, **how)

    return outer


def test_pictures_are_drawn_without_a_display(monkeypatch, tmp_path, capfd):
    pytest.importorskip("pyvista")
    if find_library("EGL") is None:
        pytest.skip("no EGL library; on Debian: apt-get install libegl1 libgl1-mesa-dri")
    from matplotlib.image import imread

    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.setattr(pictures, "View", partial(pictures.View, size=(240, 240)))
    found = solve_and_write(LINEAR, FemSettings(), tmp_path, {"H22": -0.1, "p": 0.1}, name="a")
    assert {kind: path.name for kind, path in found.pictures.items()} == {
        "disp": "disp_a.png",
        "energy": "energy_a.png",
    }
    for path in found.pictures.values():
        image = imread(path)[..., :3]
        colours = np.unique((image * 15).astype(int).reshape(-1, 3), axis=0)
        assert len(colours) > 200  # a drawn cell and a colour bar, not an empty page
    assert capfd.readouterr() == ("", "")


def test_views_of_a_deformed_cell_hold_all_of_it():
    points = affine(LINEAR, np.zeros((3, 3)))
    nodal = NodalFields(points)
    box, bounds = pictures.box_of(points.mesh.points, np.eye(3) + points.grad_u, nodal.displacement)
    np.testing.assert_allclose(bounds, [-0.55, 0.55, -0.5, 0.5, -0.45, 0.45])
    edges = np.array(box).reshape(12, 2, 3)
    lengths = np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1)
    np.testing.assert_allclose(sorted(lengths), [0.9] * 4 + [1.0] * 4 + [1.1] * 4)
    assert json.loads(json.dumps(box)) == box


def command(monkeypatch, capsys, *words):
    monkeypatch.setattr(sys, "argv", ["porocore", *map(str, words)])
    with pytest.raises(SystemExit) as ended:
        main()
    return ended.value.code, *capsys.readouterr()


def test_the_command_writes_the_file(monkeypatch, capsys, tmp_path):
    words = ("cell", "fields", "--at", "H22=-0.05, p=0.1", "--no-pictures", "--out", tmp_path)
    status, out, err = command(monkeypatch, capsys, *words)
    assert status in (0, None)
    assert err == ""
    path = tmp_path / "H22_-0.05_p_0.1.vtu"
    assert out.splitlines()[0] == "status: converged"
    assert out.splitlines()[-1] == str(path)
    assert len(meshio.read(path).points) > 1000


@pytest.mark.parametrize(
    ("at", "why"),
    [
        ("H22", "expected a state such as H22=-0.2,p=0.1, got 'H22'"),
        ("H22=x", "H22: expected a finite number, got 'x'; write a state such as H22=-0.2,p=0.1"),
        ("H22=0.1,H22=0.2", "H22 is given twice; expected a state such as H22=-0.2,p=0.1"),
        ("H22=nan", "H22: expected a finite number, got 'nan'; write a state such as H22=-0.2,p=0.1"),
        ("", "expected a state such as H22=-0.2,p=0.1, got ''"),
    ],
)
def test_the_command_refuses_what_is_no_state(monkeypatch, capsys, tmp_path, at, why):
    status, _, err = command(monkeypatch, capsys, "cell", "fields", "--at", at, "--out", tmp_path / "out")
    assert status == 2
    assert f"--at: {why}" in err
    assert not (tmp_path / "out").exists()


def test_a_backend_without_fields_is_refused(monkeypatch):
    solver = SimpleNamespace(solve=lambda *_, **__: CellSolution(failed_response(Status.lost)))
    monkeypatch.setattr("porocore.commands.fields.solve.prepare_stored", lambda *_: (solver, None, None))
    with pytest.raises(
        ConfigurationError, match="backend 'mine' gives no fields of its cell; choose one that does"
    ):
        solve_fields(CURVED, FemSettings(backend="mine"), {"H22": -0.1})
