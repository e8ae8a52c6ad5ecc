"""Studies with other materials by command: an energy as a formula, a solid of several materials, refusals."""

from __future__ import annotations

import meshio
import numpy as np
import pytest

from porocore.cell.cell import Cell
from porocore.cell.meshing.mesh import MeshSettings
from porocore.interfaces.solution import MacroSolution
from tests.e2e.study import ONE_LOAD, message, porocore, succeeded, write_study

#: Linear elements, few states, a polynomial, two elements and a few steps.
SHORT = ONE_LOAD | {
    "cell.mesh.element": "linear",
    "sampling.test.count": 2,
    "surrogate": {"backend": "polynomial"},
    "macro.body.elements": [1, 2, 1],
    "macro.time": {"end": 30, "step": 10, "ramp_increments": 2, "ramp_step": 1.5, "profiles": [10]},
}
NU = 0.35
FORMULA = {
    "kind": "expression",
    "energy": "mu/2*(I1 - 3) - mu*log(J) + lam/2*log(J)**2",
    "parameters": {"mu": 1 / (2 * (1 + NU)), "lam": NU / ((1 + NU) * (1 - 2 * NU))},
}
ACROSS = {
    "kind": "expression",
    "energy": "c*(I1*J**(-2/3) - 3) + k/4*(J**2 - 1 - 2*log(J)) + f*(I4 - 1)**2",
    "parameters": {"c": 0.19, "k": 1.1, "f": 0.3},
    "directions": [[0, 1, 0]],
}


def settlement(run, closure):
    return MacroSolution.load_file(run / f"solutions/{closure}_load-0.04.h5").history.settlement


def finished(folder, changes):
    config = write_study(folder / "study.yaml", SHORT | changes)
    succeeded(porocore("run", config, "--out", folder / "run"))
    return folder / "run"


@pytest.mark.slow
def test_a_study_with_an_energy_of_ones_own(tmp_path):
    """Stiffer along the fibres than without them; both closures; the report says what the solid is."""
    run = finished(tmp_path, {"cell.material": ACROSS})
    report = (run / "report.html").read_text(encoding="utf-8")
    assert "solid with the energy c*(I1*J**(-2/3) - 3)" in report
    succeeded(porocore("run", run / "config.yaml", "--closure", "potential", "--out", run, "--resume"))
    paper, exact = settlement(run, "mean-gradient"), settlement(run, "potential")
    linear = settlement(run, "linear")
    assert (np.diff(np.abs(exact)) >= 0).all()
    assert 0.8 < paper[-1] / exact[-1] < 1.2
    assert 0.8 < linear[-1] / exact[-1] < 1.3


@pytest.mark.slow
def test_the_formula_of_the_neo_hookean_solid_gives_its_study(tmp_path):
    own, formula = finished(tmp_path / "own", {}), finished(tmp_path / "formula", {"cell.material": FORMULA})
    for law in ("mean-gradient", "linear"):
        np.testing.assert_allclose(settlement(formula, law), settlement(own, law), rtol=1e-8)


def test_wrong_energies_are_refused_with_file_line_and_place(tmp_path):
    config = write_study(
        tmp_path / "study.yaml", SHORT | {"cell.material": ACROSS | {"energy": "c*I1 + k*J + f*open(J)"}}
    )
    line = 1 + next(i for i, text in enumerate(config.read_text().splitlines()) if "energy:" in text)
    done = porocore("run", config, "--out", tmp_path / "run")
    assert done.returncode == 2
    place = f"{config}:{line}: cell.material.energy: 'open(J)' at character 16 of 'c*I1 + k*J + f*open(J)': "
    assert message(done).startswith(f"{place}unknown function")
    assert not (tmp_path / "run").exists()


@pytest.mark.slow
def test_a_study_of_several_materials(tmp_path):
    """A mesh file with a stiff octant; a region that is forgotten is named."""
    cell = Cell(mesh=MeshSettings(size=0.2, fluid_size=0.2, element="linear"))
    solid, fluid = (cell.make_mesh(phase, "whole") for phase in ("solid", "fluid"))
    corner = (solid.points[solid.cells].mean(axis=1) > 0).all(axis=1)
    points = np.concatenate([solid.points, fluid.points])
    cells = np.concatenate([solid.cells, fluid.cells + len(solid.points)])
    _, first, number = np.unique(points.round(9), axis=0, return_index=True, return_inverse=True)
    tags = np.concatenate([1 + corner, np.full(len(fluid.cells), 3)])
    meshio.Mesh(points[first], [("tetra", number.reshape(-1)[cells])], cell_data={"phase": [tags]}).write(
        tmp_path / "cell.vtu"
    )
    changes = {
        "cell.geometry": {"kind": "mesh-file", "path": "cell.vtu", "solid": [1, 2], "fluid": [3]},
        "cell.material": None,
        "cell.materials": {
            "1": {"poisson_ratio": NU},
            "2": {"kind": "mooney-rivlin", "c10": 3, "c01": 1, "bulk_modulus": 9},
        },
        "closure": "potential",
    }
    run = finished(tmp_path, changes)
    assert (np.diff(np.abs(settlement(run, "potential"))) >= 0).all()
    soft = finished(tmp_path / "soft", {"closure": "potential"})
    assert 0.5 < settlement(run, "potential")[-1] / settlement(soft, "potential")[-1] < 0.98

    config = write_study(
        tmp_path / "study.yaml", SHORT | changes | {"cell.materials": {"1": {"poisson_ratio": NU}}}
    )
    done = porocore("run", config, "--out", tmp_path / "other")
    assert done.returncode == 2
    assert "cell.materials: expected a material for each region of the solid, got none for 2" in message(done)
