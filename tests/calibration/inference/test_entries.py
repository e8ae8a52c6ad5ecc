"""Entries for JSON: what an open interval, an unseen direction and an infinite gain become."""

import json

import numpy as np
import pytest

from porocore.commands.calibration.infer import infer
from porocore.commands.calibration.problem import Unknown
from porocore.commands.calibration.results import (
    direction_entries,
    precision_entries,
    suggestion_entries,
    unknown_entries,
)
from porocore.core.files.plain_data import json_ready
from tests.helpers.calibration_models import Formula, experiment, misfit_of

T = np.linspace(0.1, 2.0, 15)
UNKNOWNS = (
    Unknown("a", 2.0, 0.1, 50.0, "log", unit="kPa"),
    Unknown("b", 3.0, 0.1, 50.0, "log"),
    Unknown("rate", 1.0, 0.01, 20.0, "log"),
)


def test_entries_of_a_product():
    misfit = misfit_of(Formula(UNKNOWNS, lambda v: v[0] * v[1] * np.exp(-v[2] * T)), [2.0, 3.0, 1.3], 0.02)
    best = misfit.at(misfit.start)
    alone = experiment("a alone", Formula(UNKNOWNS, lambda v: v[0] * T), best.coordinates, np.full(15, 0.02))
    found = infer(misfit, best, rays=0, further=[alone])
    unknowns, directions, precision, suggestions = (
        json_ready(entries(found))
        for entries in (unknown_entries, direction_entries, precision_entries, suggestion_entries)
    )
    assert unknowns["a"]["interval95"] == [None, None]
    assert unknowns["a"]["unit"] == "kPa"
    assert set(unknowns["a"]["open_ends"]) == {"low", "high"}
    assert unknowns["a"]["identifiable"] is False
    assert unknowns["a"]["deviation"] is None
    low, high = unknowns["rate"]["interval95"]
    assert low < 1.3 < high
    assert unknowns["rate"]["identifiable"] is True
    (direction,) = directions
    assert direction["direction"] == pytest.approx({"a": 0.5**0.5, "b": -(0.5**0.5), "rate": 0.0}, abs=1e-9)
    assert direction["deviation"] is None
    assert "Only the product a·b is identifiable, not the two separately" in direction["words"]
    assert precision["correlations"]["a"]["b"] == pytest.approx(-1, abs=1e-6)
    assert suggestions[0]["data"] == "a alone"
    assert suggestions[0]["gain"] is None
    # Nothing of it is a number that JSON lacks.
    for entries in (unknowns, directions, precision, suggestions):
        json.dumps(entries, allow_nan=False)
