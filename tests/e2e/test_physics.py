"""What comes out at the end of the pipeline, against closed forms that share no code with it."""

import json

import numpy as np
import pytest

from porocore.interfaces.solution import MacroSolution
from tests.e2e.study import HEIGHT, LOADS, porocore, succeeded

AREA = 0.1 * 0.1
LARGE, SMALL = LOADS


@pytest.fixture(scope="module")
def metrics(finished):
    return json.loads((finished / "metrics.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def history(finished):
    def load(law, load):
        return MacroSolution.load_file(finished / "solutions" / f"{law}_load{load!r}.h5").history

    return load


def test_a_small_load_is_answered_linearly(history):
    nonlinear, linear = history("mean-gradient", SMALL), history("linear", SMALL)
    np.testing.assert_array_equal(nonlinear.time, linear.time)
    np.testing.assert_allclose(nonlinear.settlement[1:], linear.settlement[1:], rtol=1e-3)
    np.testing.assert_allclose(nonlinear.pressure_max[1:-1], linear.pressure_max[1:-1], rtol=1e-2)


def test_linear_solutions_are_proportional_to_the_load(history):
    np.testing.assert_allclose(
        history("linear", LARGE).settlement * (SMALL / LARGE), history("linear", SMALL).settlement, rtol=1e-9
    )


def test_the_stress_is_uniform_in_a_column(metrics):
    for case in metrics["macro"]:
        assert case["nonlinear"]["stress_spread"] <= 1e-6
        assert case["linear"]["stress_spread"] <= 1e-6


def test_the_surrogate_meets_the_held_out_states(metrics):
    surrogate = metrics["surrogate"]
    assert len(surrogate["rms_error_percent_of_range"]) == 3
    assert all(0 < error <= 1 for error in surrogate["rms_error_percent_of_range"].values())
    assert all(0 < error <= 1 for error in surrogate["largest_error_percent_of_range"].values())


@pytest.mark.parametrize("case", [0, 1])
def test_the_linear_column_settles_as_its_stiffness_says(metrics, case):
    """|P| h / C_eff, and the fluid that leaves is α times that, up to what the drift says is still to come."""
    load, linear, cell = metrics["macro"][case]["load"], metrics["macro"][case]["linear"], metrics["cell"]
    settlement = abs(load) * HEIGHT / cell["C_eff_2222"]
    assert linear["steady_drift"] < 1e-3
    assert linear["final_settlement"] == pytest.approx(settlement, rel=linear["steady_drift"])
    assert linear["final_settlement"] < settlement
    drained = cell["biot_coefficient"] * settlement * AREA
    assert linear["drained"] == pytest.approx(drained, rel=linear["steady_drift"])


def test_the_steady_state_carries_the_load(metrics, study):
    """φ_s ∂Ψ/∂F(F̄) of the cell solved at the final strain, by the formula written out here, is the load."""
    final = metrics["macro"][0]["nonlinear"]
    assert final["steady_drift"] < 1e-3
    strain = -final["final_settlement"] / HEIGHT
    done = porocore("cell", study, "--grad-u", f"0 0 0; 0 {strain!r} 0; 0 0 0", "--json")
    cell = json.loads(succeeded(done))
    solid = 1 - cell["porosity"]
    F = np.diag([1, 1 + strain, 1]) + np.array(cell["mean_grad"]) / solid
    nu, J, inverse = 0.35, np.linalg.det(F), np.linalg.inv(F).T
    mu, lam = 1 / (2 * (1 + nu)), nu / ((1 + nu) * (1 - 2 * nu))
    stress = solid * (mu * (F - inverse) + lam * np.log(J) * inverse)
    assert stress[1, 1] == pytest.approx(LARGE, rel=2e-3)


def test_ratios_and_times_follow_from_the_histories(metrics, history):
    assert [case["load"] for case in metrics["macro"]] == list(LOADS)
    for case in metrics["macro"]:
        for kind, law in (("nonlinear", "mean-gradient"), ("linear", "linear")):
            solved = history(law, case["load"])
            for percent in (95, 99):
                time = case[kind][f"time_to_{percent}_percent"]
                reached = np.interp(time, solved.time, solved.settlement)
                assert reached == pytest.approx(percent / 100 * solved.settlement[-1], rel=1e-9)
            assert case[kind]["time_to_95_percent"] < case[kind]["time_to_99_percent"] < 240
        ratio = (
            history("mean-gradient", case["load"]).settlement[-1]
            / history("linear", case["load"]).settlement[-1]
        )
        assert case["settlement_ratio"] == pytest.approx(ratio, rel=1e-12)
    large, small = metrics["macro"]
    assert 0.9 < large["settlement_ratio"] < 0.99  # the compressed cell is stiffer
    assert small["settlement_ratio"] == pytest.approx(1, abs=1e-3)


def test_the_closures_own_error_is_stated(metrics):
    """At H_22 = −0.05 the mean-gradient closure is off by 2 % in P_E,22; of the whole range it is less than a tenth."""
    error = metrics["closure"]
    for what in ("stress", "fluid"):
        rms, largest = (error[f"{what}_{kind}_percent_of_range"] for kind in ("rms", "largest"))
        assert 0 < rms < largest < 10
