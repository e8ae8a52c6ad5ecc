"""The coefficients of a cell in the report: one row for each axis along which they differ, labelled, with units."""

from dataclasses import replace

import numpy as np
import pytest

from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.core.units import OutputUnits, ResultUnits, Scales, using_units
from porocore.macro.laws.linear import LinearCoefficients
from porocore.report.context import CellSummary
from porocore.report.words.cell import cell_rows, linear_rows, mesh_rows, symmetric
from porocore.states import CellResponse, CellTangent

UNITS = ResultUnits(
    Scales(modulus=2e3, length=1e-2, pore=5e-6), OutputUnits(length="mm", stress="kPa", time="s")
)


def summary(K, Q=(-0.1, -0.1, -0.1), stiffer=0.0):
    """A cell with its conductivity, diagonal of Q, and M that is larger along the second axis."""
    M = np.zeros((1, 3, 3, 3, 3))
    for i in range(3):
        for j in range(3):
            M[0, i, i, j, j] = -0.23 if i == j else -0.075
    M[0, 1, 1, 1, 1] += stiffer
    tangent = CellTangent(mean_grad_grad_u=M, mean_grad_p=np.diag(Q)[None])
    response = CellResponse(np.zeros((1, 3, 3)), np.zeros(1, int), tangent=tangent)
    linear = LinearCoefficients.from_reference(response, 0.6, NeoHookean(), np.array(K, dtype=float))
    return CellSummary("a cell", 0.4, 2.0, linear)


def test_a_cell_that_is_the_same_along_all_axes_has_one_row_of_each():
    cell = summary(np.diag([2.0, 2.0, 2.0]))
    names = [row.name for row in cell_rows(cell, None)]
    assert names == [
        "porosity φ_f",
        "K₁₁ = K₂₂ = K₃₃ at μ_f = 2",
        "M₁₁₁₁ = M₂₂₂₂ = M₃₃₃₃",
        "M₂₂₁₁ and all other M_iijj",
        "Q₁₁ = Q₂₂ = Q₃₃",
    ]
    assert [name for name, _ in linear_rows(cell.properties)][-2:] == [
        "storage 1/M_B",
        "consolidation coefficient c_v along each axis",
    ]


def test_a_cell_that_swells_shows_the_stress_that_holds_it():
    cell = summary(np.diag([2.0, 2.0, 2.0]))
    swollen = replace(cell, linear=replace(cell.linear, stress=-0.05 * np.eye(3)))
    assert linear_rows(swollen.properties)[0] == (
        "stress while the swelling is held P_E,11 = P_E,22 = P_E,33",
        "−0.05000 E",
    )
    assert linear_rows(swollen.properties)[1:] == linear_rows(cell.properties)


def test_an_orthotropic_cell_shows_every_axis_with_its_unit():
    cell = summary(np.diag([0.1, 2.0, 8.0]), Q=(-0.1, -0.2, -0.3), stiffer=0.1)
    with using_units(UNITS):
        rows = {row.name: row.found for row in cell_rows(cell, None)}
        linear = dict(linear_rows(cell.properties))
    # μ_f is 2 times 1 Pa s; k = K μ_f d², d = 5 µm.
    assert {name: rows[f"permeability {name}"] for name in ("k₁₁", "k₂₂", "k₃₃")} == {
        "k₁₁": "5.000 · 10⁻¹² m²",
        "k₂₂": "1.000 · 10⁻¹⁰ m²",
        "k₃₃": "4.000 · 10⁻¹⁰ m²",
    }
    assert [name for name in rows if name.startswith("K")] == [f"K{i}{i} at μ_f = 2 Pa s" for i in "₁₂₃"]
    assert (rows["Q₂₂"], rows["M₂₂₂₂"]) == ("−0.1000 1/kPa", "−0.1300")
    found = {axis: float(linear[f"consolidation coefficient c_v along {axis}"].split()[0]) for axis in "xyz"}
    factor = UNITS.factor("diffusivity")
    assert found == {
        axis: pytest.approx(cell.linear.consolidation_coefficient(i) * factor, rel=1e-3)
        for i, axis in enumerate("xyz")
    }
    assert {"Biot coefficient α₁₁", "Biot coefficient α₂₂", "drained stiffness C_eff,2222"} <= linear.keys()


def test_components_that_differ_in_a_printed_digit_have_rows_of_their_own():
    """Q₁₁ = Q₂₂ = Q₃₃ and α₁₁ = α₂₂ = α₃₃ stood above −0.0032752, −0.0032769 and −0.0032784, and 0.93550 to 0.93559."""
    Q = np.diag([-0.131007, -0.131077, -0.131134])
    assert [name for name, _ in symmetric("Q", Q)] == ["Q₁₁", "Q₂₂", "Q₃₃"]
    assert [name for name, _ in symmetric("Q", np.diag([-0.131007, -0.131012, -0.131034]))] == [
        "Q₁₁ = Q₂₂ = Q₃₃"
    ]
    # In its unit one of the three rounds otherwise.
    odd = summary(np.diag([2.0, 2.0, 2.0]), Q=(-0.10001, -0.10004, -0.10004))
    assert "Q₁₁ = Q₂₂ = Q₃₃" in [row.name for row in cell_rows(odd, None)]
    tenth = ResultUnits(Scales(modulus=2e3 / 1.1, length=1e-2, pore=5e-6), OutputUnits(stress="kPa"))
    with using_units(tenth):
        rows = {row.name: row.found for row in cell_rows(odd, None)}
    assert {name: value for name, value in rows.items() if name[0] == "Q"} == {
        "Q₁₁": "−0.05501 1/kPa",
        "Q₂₂": "−0.05502 1/kPa",
        "Q₃₃": "−0.05502 1/kPa",
    }


def test_what_lies_off_the_diagonal_is_shown_where_it_is_more_than_the_mesh():
    K = np.diag([1.0, 1.0, 100.0])
    K[0, 1] = K[1, 0] = 0.01
    K[0, 2] = K[2, 0] = 0.005
    assert [name for name, _ in symmetric("K", K)] == ["K₁₁", "K₂₂", "K₃₃", "K₁₂"]
    along_one = np.diag([0.0, 0.0, 5.0])
    along_one[0, 1] = along_one[1, 0] = 1e-15
    assert [name for name, _ in symmetric("K", along_one)] == ["K₁₁", "K₂₂", "K₃₃"]


def test_counts_of_an_eighth_come_with_those_of_the_whole_cell():
    facts = {
        "element": "linear",
        "solid tetrahedra in the eighth": "4,680",
        "solid nodes in the eighth": "8,297",
    }
    assert mesh_rows(facts) == [
        ("element", "linear"),
        ("solid tetrahedra in one eighth of the cell, by symmetry", "4,680 (37,440 in the whole cell)"),
        ("solid nodes in one eighth of the cell, by symmetry", "8,297"),
    ]
    assert mesh_rows({"solid tetrahedra in the whole": "8"}) == [("solid tetrahedra in the whole cell", "8")]
