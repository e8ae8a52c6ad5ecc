"""Share of 95 % intervals that cover the truth, over 200 made-up experiments."""

import numpy as np
import pytest

from porocore.commands.calibration.infer import infer
from porocore.commands.calibration.problem import Unknown
from tests.helpers.calibration_models import Consolidation, Formula, misfit_of

REPEATS = 200
TIMES = np.linspace(0.1, 2.0, 15)
DECAY = Formula(
    (Unknown("size", 1.0, 0.01, 20.0, "log"), Unknown("rate", 1.0, 0.01, 20.0)),
    lambda v: v[0] * np.exp(-v[1] * TIMES),
)
CONSOLIDATION = Consolidation(
    (Unknown("modulus", 1.0, 0.01, 100.0, "log"), Unknown("conductivity", 1.0, 0.01, 100.0, "log")),
    np.geomspace(1e-3, 3.0, 25),
)


@pytest.mark.parametrize(
    ("model", "truth", "deviation"),
    [(DECAY, (2.0, 1.3), 0.15), (CONSOLIDATION, (1.2, 0.8), 0.004)],
    ids=["decay", "consolidation"],
)
def test_intervals_cover_the_truth(model, truth, deviation):
    rng, covered, widths = np.random.default_rng(5), np.zeros(2), []
    count = len(model.curves(np.array(truth)).values)
    for _ in range(REPEATS):
        misfit = misfit_of(model, truth, deviation, rng.normal(size=count))
        ends = [each.values for each in infer(misfit, misfit.at(misfit.start), rays=0).intervals]
        covered += [low < value < high for (low, high), value in zip(ends, truth, strict=True)]
        widths.append(ends[1][1] / ends[1][0])
    assert (covered >= 0.90 * REPEATS).all(), covered
    assert (covered <= 0.99 * REPEATS).all(), covered
    # The intervals are wide enough for the model not to be linear in them.
    assert np.median(widths) > 1.1
