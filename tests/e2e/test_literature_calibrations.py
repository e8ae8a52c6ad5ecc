"""The calibrations from the literature run, and their fits agree with estimates by hand.

The estimates share no code with porocore: Terzaghi's series, Poiseuille's law for the straight channels, and bounds of
the stiffness from columns of solid that no channel cuts and from Hashin & Shtrikman (1963).
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray
from scipy.optimize import least_squares

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


def consolidated(times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Terzaghi's degree of consolidation at dimensionless times."""
    m = np.pi * (np.arange(400) + 0.5)[:, None]
    return np.asarray(1 - (2 / m**2 * np.exp(-(m**2) * times)).sum(axis=0))


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
    rows = (FOLDER / "brain-consolidation.csv").read_text(encoding="utf-8").splitlines()
    data = [[float(x) for x in row.split(",")] for row in rows if row[0].isdigit()]
    minutes, share = np.array(data).T
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
