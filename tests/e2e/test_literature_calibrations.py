"""The calibrations from the literature run, and their fits agree with estimates by hand.

The estimates share no code with porocore: Terzaghi's series, Poiseuille's law for the straight channels, and bounds of
the stiffness from columns of solid that no channel cuts and from Hashin & Shtrikman (1963).
"""

from __future__ import annotations

import json
from contextlib import ExitStack
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray
from scipy.optimize import least_squares

from porocore.commands.calibration.cells import families
from porocore.commands.calibration.experiment import ExperimentModel, StudiesModel
from porocore.commands.calibration.fit import fit
from porocore.commands.calibration.loading import read_plan
from porocore.commands.calibration.observations import curve_data
from porocore.commands.calibration.problem import Misfit
from porocore.core.console import Console
from tests.e2e.study import porocore, succeeded

pytestmark = pytest.mark.slow
FOLDER = Path(__file__).parents[2] / "examples" / "calibrations"


def calibrated(folder: Path, name: str) -> dict[str, Any]:
    """Results of the example, without the region in the plane of two unknowns."""
    for path in FOLDER.glob("*.csv"):
        (folder / path.name).write_bytes(path.read_bytes())
    config = yaml.safe_load((FOLDER / f"{name}.yaml").read_text(encoding="utf-8"))
    config["calibration"]["fit"] = {"starts": 1, "rays": 0}
    (folder / "study.yaml").write_text(yaml.safe_dump(config), encoding="utf-8")
    succeeded(
        porocore("calibrate", folder / "study.yaml", "--out", folder / "out", "--no-store", timeout=3600)
    )
    found: dict[str, Any] = json.loads((folder / "out" / "calibration.json").read_text(encoding="utf-8"))
    return found


def brain_data() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Minutes, and the settlement as a share of the final one."""
    rows = (FOLDER / "brain-consolidation.csv").read_text(encoding="utf-8").splitlines()
    minutes, share = np.array([[float(x) for x in row.split(",")] for row in rows if row[0].isdigit()]).T
    return minutes, share


def consolidated(times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Terzaghi's degree of consolidation at dimensionless times."""
    m = np.pi * (np.arange(400) + 0.5)[:, None]
    return np.asarray(1 - (2 / m**2 * np.exp(-(m**2) * times)).sum(axis=0))


def relaxing(x: NDArray[np.float64], times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Settlement of Terzaghi's layer whose stiffness relaxes, by Talbot's inversion of its Laplace transform.

    ``x`` are ln of the final settlement and of c_v/H² at rest, then strength and ln time of each branch.
    """
    count = 24
    angle = np.arange(1, count) * np.pi / count
    cot = 1 / np.tan(angle)
    s = 2 / 5 * np.concatenate([[count], np.arange(1, count) * np.pi * (cot + 1j)]) / times[:, None]
    weights = np.concatenate([[0.5], 1 + 1j * angle * (1 + cot**2) - 1j * cot])
    branches = zip(x[2::2], np.exp(x[3::2]), strict=True)
    stiffness = 1 + sum(strength * s * time / (1 + s * time) for strength, time in branches)
    q = np.sqrt(s / (np.exp(x[1]) * stiffness))
    transform = np.exp(x[0]) / (s * stiffness) * np.tanh(q) / q
    found = 2 / (5 * times) * (weights * np.exp(s * times[:, None]) * transform).real.sum(axis=1)
    return np.asarray(found)


def stiffness_bounds(radius: float, poisson: float) -> tuple[float, float]:
    """Bounds of the confined modulus of three crossing channels, in Young's moduli of the solid."""
    pores = 3 * np.pi * radius**2 - 8 * np.sqrt(2) * radius**3
    shear, bulk = 1 / (2 * (1 + poisson)), 1 / (3 * (1 - 2 * poisson))
    upper_bulk = bulk + pores / (-1 / bulk + 3 * (1 - pores) / (3 * bulk + 4 * shear))
    weak = 6 * (1 - pores) * (bulk + 2 * shear) / (5 * shear * (3 * bulk + 4 * shear))
    upper_shear = shear + pores / (-1 / shear + weak)
    return (1 - 2 * radius) ** 2, upper_bulk + 4 / 3 * upper_shear


def edge(permeability: float, radius: float) -> float:
    """Edge of a cell with a straight channel of this radius, a share of the edge, by Poiseuille's law."""
    return float(np.sqrt(permeability / (np.pi * radius**4 / 8)))


def test_brain_tissue_has_the_pore_size_and_stiffness_of_an_estimate_by_hand(tmp_path):
    found = calibrated(tmp_path, "brain-consolidation")
    minutes, share = brain_data()
    half, load = 3.45e-3, 4.24e3

    def off(x: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.exp(x[0]) * consolidated(np.exp(x[1]) * 60 * minutes / half**2) - 81 * share

    final, coefficient = np.exp(least_squares(off, np.log([80, 1e-8])).x)  # um, m²/s
    modulus = load / (1e-6 * final / (2 * half))
    assert modulus == pytest.approx(388e3, rel=0.01)
    assert coefficient == pytest.approx(1.10e-8, rel=0.01)
    low, high = stiffness_bounds(0.1625, 0.499)
    unknowns = found["unknowns"]
    assert modulus / high < 1e3 * unknowns["modulus"]["value"] < modulus / low
    # Where channels cross, the fluid flows more easily than in straight ones: the cell is a little smaller.
    by_hand = edge(0.89e-3 * coefficient / modulus, 0.1625)
    assert 0.85 < 1e-9 * unknowns["pore"]["value"] / by_hand < 1.0
    assert all(one["identifiable"] for one in unknowns.values())
    # No constant coefficient of consolidation fits both halves of the curve, and the report says so.
    assert found["reduced_misfit"] > 4
    assert "no values of the unknowns explain the data" in found["warnings"][0]


def test_brain_tissue_that_relaxes_has_the_branches_of_a_layer_in_closed_form(tmp_path):
    """The search alone; the intervals of six unknowns take a quarter of an hour."""
    minutes, share = brain_data()

    def off(x: NDArray[np.float64]) -> NDArray[np.float64]:
        return (relaxing(x, minutes) - 81 * share) / 1.6

    hand = least_squares(off, [np.log(80), np.log(0.2), 1.0, np.log(2), 1.0, np.log(20)], x_scale="jac")
    final, rate = np.exp(hand.x[:2])
    modulus, coefficient = 4.24e3 / (1e-6 * final / 6.9e-3), rate / 60 * 3.45e-3**2
    assert 2 * hand.cost == pytest.approx(3.70, abs=0.05)
    plan = read_plan(FOLDER / "brain-relaxation.yaml")
    with ExitStack() as stack:
        (cells,) = families(plan, tmp_path, stack, Console(StringIO()), None)
        cells.learn()
        (experiment,) = plan.experiments
        model = ExperimentModel(experiment, plan.unknowns, cells.laws()(experiment.config))
    misfit = Misfit(StudiesModel([each.unknown for each in plan.unknowns], [model]), curve_data(plan.curves))
    found = fit(misfit, plan.fit, Console(StringIO()))
    assert 2 * found.best.cost == pytest.approx(2 * hand.cost, rel=0.05)
    _, pore, *branches = misfit.values(found.best.coordinates)
    np.testing.assert_allclose(branches[::2], hand.x[2::2], rtol=0.1)
    np.testing.assert_allclose(branches[1::2], np.exp(hand.x[3::2]), rtol=0.1)
    assert 0.85 < 1e-9 * pore / edge(0.89e-3 * coefficient / modulus, 0.1625) < 1.0


def test_pores_of_cartilage_are_a_few_nanometres_wide_and_their_share_is_not_seen(tmp_path):
    found = calibrated(tmp_path, "cartilage-confined-compression")
    radius, modulus, pore = (found["unknowns"][name] for name in ("radius", "modulus", "pore"))
    low, high = stiffness_bounds(radius["value"], 0.49)
    assert 0.64 / high < modulus["value"] < 0.64 / low
    by_hand = edge(1e-3 * 3.62e-16, radius["value"])
    assert 0.7 < 1e-9 * pore["value"] / by_hand < 1.0
    assert 1.5 < radius["value"] * pore["value"] < 2.5  # nm
    assert found["reduced_misfit"] < 1
    (unseen,) = found["directions"]
    assert set(unseen["direction"]) == {"radius", "modulus", "pore"}
    assert not any(one["identifiable"] for one in found["unknowns"].values())
    assert radius["interval95_without_prior"] == [None, None]
