"""``porocore units`` with the scales of a configuration."""

import pytest

from porocore.core.units import QUANTITIES
from porocore.study.config.loading import load_config
from tests.helpers.invoked import BENCHMARK, invoke, refusal

BRAIN = BENCHMARK.with_name("brain-indentation.yaml")


def rows(*words):
    done = invoke("units", *words)
    assert done.exception is None, done.output
    return {line.split()[0]: line.split() for line in done.output.splitlines()[1:]}


def test_values_are_converted_with_the_scales_of_a_configuration():
    """Of 2 kPa, 10 mm and 5 µm: only the scales as numbers could be given."""
    found = rows(BRAIN, "time=0.5", "p=1 kPa", "length=2")
    assert found["time"][1:6] == ["0.5", "1000", "s", "1000", "s"]
    assert found["p"][1:6] == ["0.5", "1000", "Pa", "1000", "Pa"]
    assert found["length"][1:6] == ["2", "20", "mm", "0.02", "m"]


def test_without_values_the_factors_of_all_quantities_are_those_of_python():
    found, units = rows(BRAIN), load_config(BRAIN).result_units
    assert list(found) == list(QUANTITIES)
    for name, row in found.items():
        assert float(row[2]) == pytest.approx(units.factor(name), rel=1e-3)


def test_a_value_with_a_unit_needs_one_set_of_scales():
    assert rows("--scenario", "soil", "time=1 h")["time"][1:3] == ["216", "3600"]
    said = refusal("units", "time=1 h")
    assert "'time=1 h' has a unit, and there are several scales; give a configuration, one --scenario" in said


@pytest.mark.parametrize(
    ("words", "part"),
    [
        ((BENCHMARK.with_name("filter.yaml"),), "expected 'scales:' with modulus, pore and length, got none"),
        ((BRAIN, "--viscosity", "2"), "expected either a configuration, which has scales of its own, or"),
        ((BRAIN, "--scenario", "soil"), "expected either a configuration, which has scales of its own, or"),
        ((BRAIN, "stress=1 mm"), "'stress': expected a stress, such as 2 kPa, got '1 mm', which is a length"),
        (("absent.yaml",), "absent.yaml: no such file"),
    ],
)
def test_what_cannot_be_converted_is_told(words, part):
    assert part in refusal("units", *words)
