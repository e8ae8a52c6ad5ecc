"""The examples in a coarse form: what each is there to show, and the figures that this form had."""

from __future__ import annotations

import numpy as np
import pytest

from porocore.macro.indentation import ElasticIndentation, Sphere
from tests.e2e.coarse_examples import COARSE, run

#: For bodies whose states need the whole cell.
GENERAL = COARSE | {"sampling.sampler": "latin-hypercube", "sampling.tolerance": None}
#: Relative; beyond round-off a figure moves by what quadrature and solvers are changed to.
SAME = 1e-4


def test_confined_compression_relaxes(tmp_path):
    found = run(
        tmp_path,
        "cartilage-confined",
        COARSE
        | {
            "sampling.options": {"count": 12, "corners": True},
            "macro.body.elements": [1, 5, 1],
            "macro.time.tolerance": 1e-2,
        },
    )["potential_load1.0"]
    force = found.compression["y+"] / (np.pi * 0.5**2)
    t = found.history.time
    assert t[force.argmax()] == pytest.approx(0.2, abs=1e-9)  # at the end of the ramp
    assert force.max() > 1.4 * force[-1]
    np.testing.assert_allclose(found.reactions["y-"][1:, 1], -found.reactions["y+"][1:, 1], rtol=1e-7)
    assert found.probes["half height"][-1, 1] == pytest.approx(-0.075, rel=1e-6)  # uniform at last
    assert found.history.pressure_max[-1] < 1e-4
    assert (force.max(), force[-1]) == pytest.approx(CONFINED, rel=SAME)


@pytest.mark.slow
def test_a_filter_conducts_less_where_it_is_squeezed_and_as_much_as_a_whole(tmp_path):
    """The undeformed pore pulled back would let more through the more the filter is squeezed."""
    changes = COARSE | {
        "sampling.options": {"count": 12, "corners": True},
        "macro.body.elements": [1, 6, 1],
        "macro.loads": [0.02, 0.12],
        "macro.time": {"end": 4.0, "step": 0.5, "ramp_increments": 2, "ramp_step": 0.05, "profiles": [0.1]},
    }
    rates = {}
    for kind in ("deformed", "piola"):
        found = run(tmp_path / kind, "filter", changes | {"conductivity": kind})
        for load in (0.02, 0.12):
            solution = found[f"potential_load{load}"]
            through = solution.inflow
            assert through["y+"][-1] == pytest.approx(-through["y-"][-1], rel=1e-3)  # steady
            rates[kind, load] = through["y+"][-1] / load
            squeezed = solution.profiles[-1].spatial_conductivity[:, 1, 1]
            linear = found[f"linear_load{load}"].profiles[-1].conductivity[0, 1, 1]
            if kind == "deformed" and load == 0.12:
                assert squeezed.min() < 0.75 * linear < linear < squeezed.max()
    assert 0.97 < rates["deformed", 0.12] / rates["deformed", 0.02] < 1.02
    assert rates["piola", 0.12] / rates["piola", 0.02] > 1.08
    flow = rates["deformed", 0.02], rates["deformed", 0.12]
    assert flow == pytest.approx(FILTER, rel=SAME)
    assert flow == pytest.approx(FILTER_DIRECT, rel=1e-4)


@pytest.mark.slow
def test_unconfined_compression_widens_and_its_axis_bears_more_for_a_while(tmp_path):
    found = run(
        tmp_path,
        "cartilage-unconfined",
        GENERAL | {"sampling.options": {"count": 16}, "macro.body.elements": [3, 1, 1]},
    )["potential_load1.0"]
    t, p, wide = found.history.time, found.probes["axis"][:, 3], found.probes["rim"][:, 0]
    loaded = int(np.flatnonzero(np.isclose(t, 0.008))[0])
    peak = int(p.argmax())
    assert peak > loaded  # Mandel–Cryer
    assert p[peak] > 1.05 * p[loaded]
    assert wide.argmax() <= loaded + 2
    assert wide[-1] < 0.75 * wide.max()
    assert (p[loaded], p[peak], wide.max(), wide[-1]) == pytest.approx(UNCONFINED, rel=SAME)


@pytest.mark.slow
def test_soil_settles_under_the_strip_and_is_dragged_along_beside_it(tmp_path):
    found = run(
        tmp_path,
        "soil-strip",
        GENERAL
        | {
            "sampling.options": {"count": 14},
            "macro.body.elements": [6, 4, 1],
            "macro.time.tolerance": 1e-2,
            "macro.time.profiles": [0.5],
        },
    )["potential_load0.04"]
    down = {name: -values[-1, 1] for name, values in found.probes.items()}
    assert down["centre"] > down["beneath"] > down["beside"] > 0
    # The base bears the load of the strip, of which 1 × 0.5 is solved.
    assert found.reactions["y-"][-1, 1] == pytest.approx(0.04 * 0.5 * 2, rel=1e-6)
    assert found.history.pressure_max[-1] < 0.02 * found.history.pressure_max.max()
    assert (down["centre"], down["beneath"], down["beside"]) == pytest.approx(SOIL, rel=SAME)


@pytest.mark.slow
def test_an_indenter_feels_the_brain_relax(tmp_path):
    found = run(
        tmp_path,
        "brain-indentation",
        GENERAL
        | {
            "sampling.options": {"count": 30},
            "macro.body.elements": [8, 5],
            "macro.time.tolerance": 1e-2,
        },
    )["potential_load1.0"]
    force = 200 * found.contact["ball"][:, 0]  # 2 kPa · (10 mm)², in mN
    undrained, drained = (
        ElasticIndentation(Sphere(6.0), 0.2473, nu, thickness=10.0).force(0.6) for nu in (0.499, 0.291)
    )
    assert found.history.iterations.max() <= 8
    assert 1.1 * force[-1] < force.max() < undrained
    # The cubic cell is stiffer along its axes than the mean over all directions.
    assert drained < force[-1] < 1.2 * drained


#: Greatest and last stress on the piston.
CONFINED = (0.13891430, 0.07789690)
#: Flow per pressure under the two.
FILTER = (0.01971802, 0.01962596)
#: The same by ``porocore solve RUN --law direct``, within 0.002 %. Ranges in which pore walls touch at a corner, where
#: there is no conductivity, were 0.01 % and 0.06 % off.
FILTER_DIRECT = (0.01971811, 0.01962566)
#: Pressure on the axis when the load is there and at its peak; greatest and last widening.
UNCONFINED = (0.01545034, 0.01779981, 0.03510832, 0.02116112)
#: Settlements of the three probes.
SOIL = (0.25962891, 0.17913854, 0.04868870)
