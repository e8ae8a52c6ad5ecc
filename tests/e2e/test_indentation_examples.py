"""Examples of indentation in a coarse form: forces against the elastic layer, and Newton's iterations."""

from __future__ import annotations

import numpy as np
import pytest

from porocore.macro.indentation import ElasticIndentation, Sphere
from tests.e2e.coarse_examples import COARSE, run

pytestmark = pytest.mark.slow

COARSER = COARSE | {
    "sampling.sampler": "latin-hypercube",
    "sampling.tolerance": None,
    "sampling.options": {"count": 24},
    "macro.body.elements": [10, 6],
    "macro.time.tolerance": 1e-2,
}
#: Iterations of a step, at most.
NEWTON = 8
#: Shear modulus [kPa] and Poisson's ratio of the cell, means over all directions.
SHEAR, POISSON = 2.448, 0.312


def layer(poisson):
    return ElasticIndentation(Sphere(2.0), SHEAR, poisson, thickness=3.0, base="smooth")


def pressed(folder, name):
    """Solve the example, and return its solution with the law of the cell; all solutions keep to NEWTON iterations."""
    found = run(folder, name, COARSER)
    assert max(each.history.iterations.max() for each in found.values()) <= NEWTON
    return found["potential_load1.0"]


def test_a_ball_that_is_held_is_relieved_as_the_gel_drains(tmp_path):
    solution = pressed(tmp_path, "gel-indentation")
    force = 20.0 * solution.contact["ball"][:, 0]  # 20 kPa mm²
    # The mesh and the cubic cell, which is stiffer along its axes, are the difference.
    assert force.max() == pytest.approx(layer(0.499).force(0.1), rel=0.08)
    assert layer(POISSON).force(0.1) < force[-1] < 0.87 * force.max()
    assert np.isclose(solution.history.time[force.argmax()], 1.0)


def test_a_ball_under_a_force_sinks_as_the_gel_drains(tmp_path):
    solution = pressed(tmp_path, "gel-creep")
    force, depth = solution.contact["ball"][:, :2].T
    loaded = int(np.flatnonzero(np.isclose(solution.history.time, 1.0))[0])
    np.testing.assert_allclose(20.0 * force[loaded:], 0.6, rtol=1e-8)
    assert layer(0.499).force(depth[loaded]) == pytest.approx(0.6, rel=0.08)
    # The force grows as the power 3/2 of the depth.
    assert depth[-1] > 1.1 * depth[loaded]


def test_a_porous_punch_is_relieved_as_cartilage_drains(tmp_path):
    solution = pressed(tmp_path, "cartilage-indentation")
    force, depth = solution.contact["punch"][:, :2].T
    assert depth[force.argmax()] == pytest.approx(0.03, rel=1e-8)
    # The layer of averaged moduli goes from 40.9 to 20.6 mN; the cell is far from isotropic.
    assert 1.3 < force.max() / force[-1] < 40.9 / 20.6
