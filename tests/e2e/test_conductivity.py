"""A run with the conductivity of the deformed pore: learned, closed both ways, and as direct FE²."""

from __future__ import annotations

import json

import numpy as np
import pytest

from porocore.interfaces.solution import MacroSolution
from porocore.sampling.datasets.dataset import Dataset
from tests.e2e.study import message, porocore, succeeded, write_study

pytestmark = pytest.mark.slow
DEFORMED = {
    "conductivity": "deformed",
    "closure": "potential",
    "cell.mesh": {"size": 0.35, "fluid_size": 0.25},
    "sampling.sampler": "sobol",
    "sampling.tolerance": None,
    "sampling.inputs": {"p": {"range": [-0.01, 0.06]}, "H22": {"range": [-0.12, 0.02]}},
    "sampling.options": {"count": 14, "corners": True},
    "sampling.test": {"count": 5, "seed": 1},
    "surrogate": {"backend": "polynomial"},
    "macro.loads": [-0.04],
    "macro.body.elements": [1, 3, 1],
    "macro.time": {"end": 40, "step": 10, "ramp_increments": 2, "ramp_step": 1.5, "profiles": [10]},
}


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """With the conductivity of the deformed pore, and with that of the undeformed one carried along."""
    folder = tmp_path_factory.mktemp("conductivity")
    for name in ("deformed", "piola"):
        config = write_study(folder / f"{name}.yaml", DEFORMED | {"conductivity": name})
        succeeded(porocore("run", config, "--out", folder / name))
    return folder


def history(run, law):
    return MacroSolution.load_file(run / "solutions" / f"{law}_load-0.04.h5").history


def test_the_samples_hold_it_and_the_others_do_not(runs):
    found = Dataset.open(runs / "deformed" / "samples.h5").responses()
    assert np.linalg.eigvalsh(found.conductivity).min() > 0
    assert found.min_fluid_jacobian.min() > 0
    assert Dataset.open(runs / "piola" / "samples.h5").responses().conductivity is None
    told = json.loads(succeeded(porocore("data", "info", runs / "deformed", "--json")))
    assert told[0]["with_conductivity"] == told[0]["states"] == 14
    succeeded(porocore("data", "check", runs / "deformed"))


def test_its_error_is_reported(runs):
    metrics = json.loads((runs / "deformed" / "metrics.json").read_text(encoding="utf-8"))
    errors = metrics["surrogate"]["rms_error_percent_of_range"]
    assert {"K₁₁", "K₂₂", "K₃₃"} <= set(errors)
    assert max(errors[name] for name in ("K₁₁", "K₂₂", "K₃₃")) < 0.5


def test_the_deformed_pore_slows_consolidation_down_and_leaves_the_end_alone(runs):
    deformed, piola = (history(runs / name, "potential").settlement for name in ("deformed", "piola"))
    assert deformed[3] < 0.99 * piola[3]
    linear = [history(runs / name, "linear").settlement for name in ("deformed", "piola")]
    assert (linear[0] == linear[1]).all()


def test_the_cell_itself_agrees(runs):
    succeeded(porocore("solve", runs / "deformed", "--law", "direct"))
    learned, direct = (history(runs / "deformed", law) for law in ("potential", "direct-potential"))
    np.testing.assert_allclose(learned.settlement, direct.settlement, rtol=1e-3)


def test_an_unknown_law_is_refused(tmp_path):
    config = write_study(tmp_path / "study.yaml", {"conductivity": "kozeny"})
    assert "conductivity: expected 'piola', 'piola-unrotated' or 'deformed'" in message(
        porocore("run", config, "--out", tmp_path / "run")
    )
