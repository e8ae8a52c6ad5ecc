"""Characteristic values: the factors that the paper states, and what a user may ask for wrongly."""

import pytest
from typer.testing import CliRunner

from porocore.cli.entry import app
from porocore.core.units import QUANTITIES, SCENARIOS, Scales
from porocore.errors import ConfigurationError

#: Dehghani & Zilian (2022), end of the numerical example.
PUBLISHED = [
    ("brain-tissue", "displacement", 1e-3, 1e-12),
    ("brain-tissue", "pressure", 1e3, 1e-12),
    ("brain-tissue", "time", 250, 1e-12),
    ("brain-tissue", "velocity", 4e-6, 1e-12),
    ("soil", "displacement", 1, 1e-12),
    ("soil", "pressure", 1.5e6, 1e-12),
    ("soil", "time", 16.6, 5e-3),
    ("soil", "velocity", 6e-2, 1e-12),
]


@pytest.mark.parametrize(("scenario", "quantity", "factor", "tolerance"), PUBLISHED)
def test_factors_are_the_published_ones(scenario, quantity, factor, tolerance):
    assert SCENARIOS[scenario].factor(quantity) == pytest.approx(factor, rel=tolerance)


def test_scales_belong_together():
    """Darcy: w = K ∇p; storage: volume over volume; consolidation: t c_v/h² is a number."""
    scales = Scales(force=0.7, pore=3e-7, viscosity=2e-3, length=5e-3)
    f = {name: scales.factor(name) for name in QUANTITIES}
    assert f["velocity"] == pytest.approx(f["conductivity"] * f["pressure"] / f["displacement"], rel=1e-12)
    assert f["velocity"] * f["time"] == pytest.approx(f["displacement"], rel=1e-12)
    assert f["volume"] == pytest.approx(f["displacement"] ** 3, rel=1e-12)


def test_an_unknown_quantity_is_named_with_what_there_is():
    with pytest.raises(ConfigurationError, match="unknown quantity 'mass'; expected one of displacement"):
        SCENARIOS["soil"].factor("mass")


def run(*words):
    return CliRunner().invoke(app, ["units", *words])


def test_the_command_converts():
    printed = run("time=38", "--scenario", "brain-tissue").stdout.split()
    assert "9500" in printed
    assert "soil" not in printed


def test_a_scenario_of_ones_own():
    printed = run("pressure=2", "--force", "3", "--pore", "1e-6", "--length", "0.5").stdout.split()
    assert "24" in printed


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["time"], "expected a quantity and its dimensionless value, such as time=38, got 'time'"),
        (["time=nan"], "got 'time=nan'"),
        (["mass=1"], "unknown quantity 'mass'"),
        (["--scenario", "moon"], "unknown scenario 'moon'; expected one of brain-tissue, soil"),
        (["--force", "1"], "--pore and --length are missing"),
        (
            ["--force", "-1", "--pore", "1", "--length", "1"],
            "--force: expected a number from 1e-30 to 1e+30, got -1",
        ),
    ],
)
def test_bad_use_is_refused(words, message):
    assert message in str(run(*words).exception)
