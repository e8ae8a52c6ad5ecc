"""Sensitivity studies without a cell: plans, where lines end, quantities, files, tables and figures."""

import csv
from dataclasses import replace

import numpy as np
import pytest

from porocore.commands.sensitivity.figures import FIGURES, known_figures, write_figures
from porocore.commands.sensitivity.plan import (
    LOADS,
    HalfLine,
    StudyPlan,
    Sweep,
    quantities,
    states_of,
)
from porocore.commands.sensitivity.results import Sensitivity, line_name, load, save, write_table
from porocore.errors import ConfigurationError, DataError
from porocore.macro.laws.closure import PulledBack
from porocore.report.figures.style import BLUE
from porocore.states import CellExtrema, CellResponse, CellTangent, MacroState, Status

PLAN = StudyPlan(
    {
        "uniaxial": Sweep(-0.3, 0.2, 0.1),
        "volumetric": Sweep(-0.2, 0.1, 0.1),
        "shear": Sweep(0.0, 0.2, 0.1),
        "pressure": Sweep(-0.4, 0.4, 0.2),
    }
)


def made_up(values, status):
    """n rows that grow with the load; NaN where the status has no values."""
    n = len(values)
    rng = np.random.default_rng(3)
    good = np.isin(status, [s for s in Status if s.has_values])
    scale = np.where(good, np.asarray(values), np.nan)

    def grown(*shape):
        return rng.uniform(0.1, 0.2, shape) * scale.reshape(n, *(1 for _ in shape))

    tangent = CellTangent(
        mean_grad_grad_u=grown(3, 3, 3, 3) - 0.2, mean_grad_p=grown(3, 3) - 0.11 * np.eye(3)
    )
    extrema = CellExtrema(abs(grown(3, 3)), *(abs(grown()) for _ in range(6)))
    return CellResponse(-grown(3, 3), np.array(status), grown(), grown(3, 3), 0.4 + grown(), tangent, extrema)


@pytest.fixture
def study():
    ends = {"uniaxial-": Status.overlap, "pressure-": Status.not_converged}
    lines = {}
    for name, sign, goal in PLAN.half_lines():
        key = line_name(name, sign)
        values = np.linspace(0, goal, 4)
        status = [Status.converged, Status.contact, Status.unstable, ends.get(key, Status.converged)]
        lines[key] = HalfLine(name, sign, values, made_up(values, status), np.arange(4.0))
    rest = made_up(np.zeros(1), [Status.converged])
    return Sensitivity(PLAN, "one", rest, 2 * np.eye(3), lines, {"config": "text"})


def test_a_load_moves_its_components_alike():
    states = states_of("volumetric", [0.1, -0.2])
    np.testing.assert_array_equal(states.grad_u, np.array([0.1, -0.2])[:, None, None] * np.eye(3))
    assert states_of("shear", 0.3).grad_u[0, 0, 1] == 0.3
    assert np.count_nonzero(states_of("shear", 0.3).grad_u) == 1
    np.testing.assert_array_equal(states_of("pressure", 0.3).p, [0.3])
    assert set(LOADS) == set(StudyPlan().sweeps)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Sweep(0.1, 0.2, 0.1), "lower ≤ 0 ≤ upper"),
        (lambda: Sweep(0.0, 0.0, 0.1), "not both 0"),
        (lambda: Sweep(-1.0, 1.0, 0.0), "positive step"),
        (lambda: Sweep(-1.0, np.inf, 0.1), "finite"),
        (lambda: StudyPlan({}), "at least one load"),
        (lambda: StudyPlan({"torsion": Sweep(-1, 1, 0.1)}), "unknown load 'torsion'"),
        (lambda: StudyPlan(tolerance=0.0), "a tolerance of at least 1e-09"),
    ],
)
def test_what_a_plan_refuses(make, message):
    with pytest.raises(ConfigurationError, match=message):
        make()


def test_a_plan_says_its_half_lines_and_describes_itself():
    assert next((name, sign) for name, sign, _ in PLAN.half_lines()) == ("shear", 1)
    assert {(name, sign): goal for name, sign, goal in PLAN.half_lines()}["pressure", -1] == -0.4
    assert ("shear", -1) not in [(name, sign) for name, sign, _ in PLAN.half_lines()]
    assert StudyPlan.from_description(PLAN.describe()) == PLAN


def test_quantities_by_their_definitions():
    """Against the formulas of the paper, entry by entry, for one state with everything different."""
    rng = np.random.default_rng(0)
    H, g = rng.uniform(-0.1, 0.1, (2, 3, 3))
    M, Q = rng.uniform(-0.2, 0.0, (3, 3, 3, 3)), rng.uniform(-0.2, 0.0, (3, 3))
    K = np.diag([1.0, 2.0, 3.0]) + 0.1
    extrema = CellExtrema(*(np.full((1, *s), 0.5) for s in ((3, 3), (), (), (), (), (), ())))
    response = CellResponse(g[None], np.zeros(1, int), tangent=CellTangent(M[None], Q[None]), extrema=extrema)
    found = quantities(MacroState.single(H, 0.1), response, 0.4, K)
    average = g / 0.6
    F, J_hat = np.eye(3) + H + average, np.linalg.det(np.eye(3) + average)
    inverse = np.linalg.inv(F)
    K_t = np.linalg.det(F) * inverse @ K @ inverse.T / np.linalg.det(F)
    expected = {
        "mean_grad_12": g[0, 1],
        "avg_grad_12": average[0, 1],
        "avg_energy": 0.5 / 0.6,
        "Kt_22": K_t[1, 1] / K[1, 1],
        "Kt_33": K_t[2, 2] / K[2, 2],
        "J_bar": np.linalg.det(F),
        "M_1231": M[0, 1, 2, 0],
        "M_hat_1231": J_hat * M[0, 1, 2, 0],
        "Q_13": Q[0, 2],
        "Q_hat_31": J_hat * Q[2, 0],
        "biot": -1 / np.trace(Q),
        "biot_hat": -1 / (J_hat * np.trace(Q)),
    }
    for name, value in expected.items():
        assert found[name] == pytest.approx(value, rel=1e-12), name
    pulled = PulledBack.from_states(
        MacroState.single(H, 0.1), g[None], np.zeros((1, 3)), 0.6, K, "piola-unrotated"
    )
    np.testing.assert_allclose(pulled.conductivity[0] / pulled.J[0], K_t, rtol=1e-12)


def test_there_is_no_ratio_where_nothing_flows():
    """Across a single channel K is round-off."""
    response = made_up(np.zeros(1), [Status.converged])
    found = quantities(MacroState.zeros(1), response, 0.4, np.diag([2.0, 1e-17, 0.0]))
    assert found["Kt_11"] == pytest.approx(1.0)
    assert np.isnan([found["Kt_22"], found["Kt_33"]]).all()


def test_a_file_gives_back_the_study(study, tmp_path):
    path = tmp_path / "sensitivity.h5"
    save(path, study)
    again = load(path)
    assert (again.plan, again.identity, again.provenance) == (study.plan, "one", {"config": "text"})
    assert again.complete
    for name, line in study.lines.items():
        np.testing.assert_array_equal(again.lines[name].values, line.values)
        np.testing.assert_array_equal(
            again.lines[name].response.tangent.mean_grad_grad_u, line.response.tangent.mean_grad_grad_u
        )
        assert (again.lines[name].load, again.lines[name].sign) == (line.load, line.sign)
    path.write_bytes(path.read_bytes()[:-400])
    with pytest.raises(DataError, match=r"sensitivity\.h5"):
        load(path)
    path.write_text("no HDF5")
    with pytest.raises(DataError, match=r"sensitivity\.h5"):
        load(path)


def test_both_signs_are_one_curve_and_the_undeformed_state_is_there_once(study):
    along = study.loads["uniaxial"]
    np.testing.assert_allclose(along.values, [-0.3, -0.2, -0.1, 0, 0.2 / 3, 0.4 / 3, 0.2])
    assert Status(along.status[0]) is Status.overlap
    assert np.isnan(along.quantities["biot"][0])
    assert np.isfinite(along.quantities["biot"][1:]).all()
    assert len(study.loads["shear"].values) == 4


def test_the_table_has_a_row_for_each_state(study, tmp_path):
    with open(write_table(tmp_path, study), encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == sum(len(along.values) for along in study.loads.values())
    first = rows[0]
    assert (first["load"], first["value"], first["status"]) == ("uniaxial", "-0.3", "overlap")
    assert first["M_1111"] == "nan"
    expected = study.loads["uniaxial"].quantities["max_grad_21"][2]
    assert float(rows[2]["max_grad_21"]) == pytest.approx(expected, rel=1e-7)


def drawn(figure, colour):
    """(line, marks) of one colour in the first panel."""
    lines = [line for line in figure.axes[0].get_lines() if line.get_color() == colour]
    return [line for line in lines if line.get_ls() != "None"], [
        line for line in lines if line.get_ls() == "None"
    ]


def test_every_figure_shows_every_state_and_marks_its_status(study):
    made = {name: FIGURES[name](study) for name in known_figures(study)}
    assert set(made) == set(FIGURES)
    assert len(made) == 12
    lines, marks = drawn(made["psi_Av"], BLUE)
    (line,) = lines
    along = study.loads["uniaxial"]
    np.testing.assert_allclose(line.get_xdata(), along.values)
    np.testing.assert_allclose(line.get_ydata(), along.quantities["avg_energy"])
    contact, unstable, end = marks
    np.testing.assert_allclose(contact.get_xdata(), along.values[along.status == Status.contact])
    np.testing.assert_allclose(unstable.get_xdata(), along.values[along.status == Status.unstable])
    assert unstable.get_markerfacecolor() == "white"
    np.testing.assert_allclose(end.get_xdata(), [-0.2])
    names = [text.get_text() for text in made["psi_Av"].legends[0].get_texts()]
    assert names == ["in contact", "unstable", "not solved beyond"]


def test_without_peaks_the_largest_values_and_the_energy_are_unknown(study, tmp_path, undrawn):
    """A cell solver need not provide them; all else is there."""
    lines = {
        name: replace(line, response=replace(line.response, extrema=None))
        for name, line in study.lines.items()
    }
    bare = replace(study, rest=replace(study.rest, extrema=None), lines=lines)
    save(tmp_path / "sensitivity.h5", bare)
    for found in (bare, load(tmp_path / "sensitivity.h5")):
        along, known = found.loads["shear"].quantities, study.loads["shear"].quantities
        assert along.keys() == known.keys()
        unknown = {name for name, values in along.items() if np.isnan(values).all()}
        assert unknown == {"avg_energy", "max_energy", *(f"max_grad_{i}{j}" for i in "123" for j in "123")}
        np.testing.assert_array_equal(along["biot"], known["biot"])
    made = {name: FIGURES[name](bare) for name in known_figures(bare)}
    assert set(FIGURES) - set(made) == {"dyu1_max_1", "dyu1_max_2", "psi_Av", "psi_max"}
    assert all(drawn(figure, BLUE)[0] for name, figure in made.items() if name != "Biot_Modulus")
    assert set(write_figures(tmp_path / "figures", bare)) == set(made)


def test_a_part_of_the_loads_and_figures_can_be_drawn(study, tmp_path):
    plan = StudyPlan({"shear": PLAN.sweeps["shear"]})
    part = Sensitivity(plan, "", study.rest, study.conductivity, study.lines, {})
    paths = write_figures(tmp_path, part, ["Q_11"])
    assert list(paths) == ["Q_11"]
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in paths.values())
