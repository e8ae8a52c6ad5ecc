"""What a check says of laws with memory."""

from __future__ import annotations

import numpy as np
import pytest

from porocore.core.units import using_units
from porocore.macro.problem import body_mesh
from porocore.study.config.loading import load_config
from porocore.study.notes.linear_reach import linear_solutions
from porocore.study.notes.magnitudes import formulas, left_out
from porocore.study.notes.memory import OsmoticPressures, law_lines, memory_warnings
from porocore.study.notes.reach import visited
from porocore.study.run.composition import with_memory
from porocore.testing.synthetic.response import linear_law
from tests.bad_input.bad_row import study
from tests.bad_input.rows_laws import FAMILY, SCALES

CHARGES = {"density": 0.2, "bath": 0.15, "temperature": 1}


@pytest.fixture
def load(tmp_path):
    def loaded(changes=None):
        path = tmp_path / "study.yaml"
        path.write_text(study(changes))
        return load_config(path)

    return loaded


def said(config, lines):
    with using_units(config.result_units):
        return list(lines(config, body_mesh(config.macro)))


def relaxing(*branches):
    return {"cell.material.relaxation": {"branches": [{"strength": g, "time": t} for g, t in branches]}}


def test_an_elastic_body_has_no_line(load):
    config = load()
    assert said(config, law_lines) == said(config, memory_warnings) == []


def test_each_law_has_a_line(load):
    config = load(
        {
            **FAMILY,
            **SCALES,
            **relaxing((0.5, "3 s"), (1, "2 s")),
            "macro.charges": {"density": "0.2 mEq/ml", "bath": "0.15 M", "initial": "as charged"},
            "macro.evolution": {
                "radius": {
                    "law": "growth",
                    "constants": {"growth_rate": "0.1 1/s", "homeostatic_stress": "2 kPa"},
                }
            },
        }
    )
    assert said(config, law_lines) == [
        "relaxation: 0.5 in 3 s, 1 in 2 s; a sudden strain meets 2.5 times the stiffness",
        "fixed charges: 200 mol/m³ of the fluid, in a bath of 150 mol/m³ at 298.15 K: osmotic pressure 150000 Pa in "
        "the undeformed body; the run begins undeformed",
        "radius evolves within [0.2, 0.3]: growth, growth_rate*(mean_stress - homeostatic_stress) per time, "
        "growth_rate = 0.1 1/s, homeostatic_stress = 2000 Pa",
    ]


def test_osmotic_pressures_are_those_of_all_places_and_times(load):
    """π = √(c_F² + 4 c*²) − 2 c* at T = 1 K in multiples of the scales; the points of Gauss lie inside the column."""
    charges = {**CHARGES, "density": "0.1 + 0.01*y", "bath": {"table": [[0, 0.15], [5, 1], [9, 0.1]]}}
    config = load({"macro.charges": charges})
    found = OsmoticPressures.of(config.macro, config.macro.charges, body_mesh(config.macro))
    y = body_mesh(config.macro).quadrature_points[..., 1]
    assert found.density == pytest.approx((0.1 + 0.01 * y.min(), 0.1 + 0.01 * y.max()), rel=1e-12)
    assert found.bath == (0.1, 1.0)
    low, high = found.density
    expected = (np.hypot(low, 2) - 2, np.hypot(high, 0.2) - 0.2)
    assert found.pressure == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize(
    ("high", "warned"), [(0.06, False), (0.05, True)], ids=["holds the osmotic pressure", "does not"]
)
def test_pressures_that_are_not_sampled_are_warned_of(load, high, warned):
    """π = √(0.2² + 0.3²) − 0.3 = 0.0606 at most."""
    config = load({"macro.charges": {**CHARGES, "density": 0.19}, "sampling.inputs.p.range": [-0.02, high]})
    lines = said(config, memory_warnings)
    assert bool(lines) is warned
    for line in lines:
        assert line == (
            "sampling.inputs.p: the osmotic pressure of the charged body is up to 0.0551 before it swells, but the "
            "largest that is sampled is 0.05; sample up to 0.069"
        )


def test_times_that_a_run_never_sees_are_warned_of(load):
    """The ramp has steps of 3, and the run ends at 12."""
    config = load(relaxing((0.5, 3.0), (0.2, 0.29), (0.0, 0.01), (1.0, 1199.0), (1.0, 1201.0)))
    short, long = said(config, memory_warnings)
    assert short.startswith(
        "cell.material.relaxation.branches.1.time: 0.29 is far below the shortest step, 3"
    )
    assert long.startswith(
        "cell.material.relaxation.branches.4.time: 1201 is far beyond the end of the run, 12"
    )


def test_the_reach_of_a_charged_body_is_that_of_its_cells(load):
    """The body's own pressure is the effective one, which is 0 where it drains; the pores hold the osmotic one."""
    config = load({"macro.charges": {**CHARGES, "initial": "as charged"}, "macro.loads": [1e-6]})
    (solution,) = linear_solutions(config, with_memory(linear_law(), config, linear=True))
    states, _ = visited(solution, config.result_units)
    own = np.concatenate([profile.p for profile in solution.after_rest])
    assert states.p.min() > 0
    assert own.max() < 0.001
    assert states.p.max() < config.macro.charges.osmotic_pressure(0.2, 0.15)


def test_a_rate_is_no_formula_of_the_place(load):
    rate = {"rate": "-k*flux*radius + 0*x", "constants": {"k": 0.1}}
    config = load({**FAMILY, **SCALES, "macro.evolution": {"radius": rate}, "macro.charges": {**CHARGES}})
    (line,) = formulas(config.macro, config.result_units)
    assert line.startswith(
        "macro.evolution.radius.rate: the formula '-k*flux*radius + 0*x' has x in multiples of"
    )
    assert not any("temperature" in each for each in left_out(config.macro, config.result_units))
