"""``porocore cell`` in a study with scales: values with units in and out."""

import json

import numpy as np
import pytest

from porocore.cli.cell import BELONGS, as_text
from porocore.study.run import pipeline
from tests.helpers.invoked import BENCHMARK, invoke, refusal

BRAIN = BENCHMARK.with_name("brain-indentation.yaml")


@pytest.fixture
def asked(monkeypatch):
    """States that the command asked for; no cell is solved."""
    found = []

    def solve(config, H, p, **how):
        found.append((np.array(H), p))
        missing = np.full((3, 3), np.nan)
        return {
            "porosity": 0.4,
            "conductivity": 2 * np.eye(3),
            "status": "converged",
            "stress": 0.1 * np.eye(3),
            "potential": None,
            "tangent": {"mean_grad_p": missing, "fluid_volume_p": 0.3},
        }

    monkeypatch.setattr(pipeline, "solve_cell", solve)
    return found


def test_a_state_is_given_and_answered_in_units(asked):
    """Of 2 kPa and 5 µm: ``--p "1 kPa"`` was refused, and the answer had no unit."""
    done = invoke("cell", BRAIN, "--p", "1 kPa")
    assert done.exception is None, done.output
    assert asked[0][1] == 0.5
    lines = done.stdout.splitlines()
    assert "stress [Pa]:" in lines
    assert lines[lines.index("stress [Pa]:") + 1].split() == ["200", "0", "0"]
    assert "conductivity [mm²/(Pa s)] (of the undeformed cell):" in lines
    assert "  fluid_volume_p [1/Pa]: 0.00015" in lines
    assert not any("mean_grad_p" in line or "potential" in line for line in lines)
    found = json.loads(invoke("cell", BRAIN, "--p", "7.5 mmHg", "--json").stdout)
    assert found["stress"]["unit"] == "Pa"
    assert found["stress"]["value"][1] == [0, 200, 0]
    assert found["stress"]["dimensionless"][1] == [0, 0.1, 0]
    assert found["tangent"]["mean_grad_p"]["value"][0] == [None, None, None]
    assert found["porosity"] == 0.4
    assert asked[1][1] == pytest.approx(7.5 * 133.322387415 / 2000, rel=1e-14)


def test_the_state_is_repeated_in_units(asked):
    """p=5 was 5 times the modulus of 500 kPa, and the answer that of another pressure than was meant."""
    first = invoke("cell", BRAIN, "--at", "H22=-0.1,p=5").stdout.splitlines()[0]
    assert first == (
        "state: H22 = -0.1, p = 10000 Pa; a p without a unit is a multiple of 2000 Pa: write 'p=5 Pa' "
        "if that is meant"
    )
    assert invoke("cell", BRAIN, "--at", "p=5 Pa").stdout.splitlines()[0] == "state: p = 5 Pa"


def test_a_deformed_state_says_what_is_of_the_undeformed_cell(asked):
    """At H22 = −0.1 the porosity at rest was printed beside a smaller fluid volume, and nothing said of which cell."""
    lines = invoke("cell", BRAIN, "--at", "H22=-0.1").stdout.splitlines()
    assert lines[:2] == ["state: H22 = -0.1", "porosity (of the undeformed cell): 0.4"]
    assert invoke("cell", BRAIN).stdout.splitlines()[0] == "porosity: 0.4"
    told = as_text({"fluid_volume": 0.533}, BELONGS)
    assert told == (
        "fluid_volume (volume of fluid in this state / volume of the undeformed cell; equals the porosity if H = 0 "
        "and p = 0): 0.533"
    )


def test_a_small_number_of_a_large_unit_is_no_zero():
    """A conductivity of 6e-15 m²/(Pa s) was printed as 0; round-off of the solver is 0 in any unit."""
    figure = {"value": [[6e-15, 2e-9]], "unit": "m²/(Pa s)", "dimensionless": [[0.004, 1e-16]]}
    text = as_text({"conductivity": figure, "potential": 1e-16})
    assert text.split() == ["conductivity", "[m²/(Pa", "s)]:", "6e-15", "0", "potential", "[E]:", "0"]


def test_without_scales_numbers_stay_plain(asked):
    done = invoke("cell", BENCHMARK, "--p", "0.25", "--json")
    assert json.loads(done.stdout)["stress"][0] == [0.1, 0, 0]
    assert asked[0][1] == 0.25


@pytest.mark.parametrize(
    ("study", "text", "words"),
    [
        (BRAIN, "1 mm", "--p: expected a pressure, such as 2 kPa, got '1 mm', which is a length"),
        (BRAIN, "much", "--p: expected a number, or a pressure, such as 2 kPa, got 'much'"),
        (BRAIN, "1e9 kPa", "times the solid's 2000 Pa, got 1e+12 Pa"),
        (BENCHMARK, "1 kPa", "--p: '1 kPa' has a unit, but the configuration has no scales"),
    ],
)
def test_what_is_no_pressure_is_refused(study, text, words):
    assert words in refusal("cell", study, "--p", text)


def test_a_state_by_names_may_have_a_unit_too():
    words = refusal("cell", "fields", BRAIN, "--at", "H22=-0.1,p=3 mm")
    assert words.endswith(
        "--at p: expected a pressure, such as 2 kPa, got '3 mm', which is a length; did you mean 'mmHg'?"
    )
