"""The two calibrations from the literature: their files can be read, and the computed data are those of the theory."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from porocore.commands.calibration.loading import read_plan

FOLDER = Path(__file__).parents[2] / "examples" / "calibrations"


@pytest.fixture(scope="module")
def theory() -> ModuleType:
    spec = importlib.util.spec_from_file_location("confined_relaxation", FOLDER / "confined_relaxation.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("name", "unknowns", "count"),
    [
        ("brain-consolidation", ["modulus", "pore"], 30),
        (
            "brain-relaxation",
            ["modulus", "pore", *(f"relaxation.{k}.{name}" for k in (1, 2) for name in ("strength", "time"))],
            30,
        ),
        ("cartilage-confined-compression", ["radius", "modulus", "pore"], 20),
    ],
)
def test_the_configurations_and_their_data_can_be_read(name, unknowns, count):
    plan = read_plan(FOLDER / f"{name}.yaml", synthetic=False)
    assert [each.unknown.name for each in plan.unknowns] == unknowns
    (curve,) = plan.curves
    assert len(curve) == count
    assert curve.measured is not None
    assert plan.notes == ()


def test_the_file_of_the_cartilage_is_what_the_script_writes(theory):
    text = (FOLDER / "cartilage-confined-compression.csv").read_text(encoding="utf-8")
    assert text == theory.table()


def test_the_relaxation_is_that_of_finite_differences(theory):
    """The displacement diffuses; cells become smaller towards the piston."""
    h, c = theory.HEIGHT, theory.MODULUS * theory.PERMEABILITY
    z = h * (1 - np.linspace(1, 0, 121) ** 2)  # dense at the piston, z = h

    def rate(t, inner):
        u = np.concatenate([[0.0], inner, [-theory.STRAIN * h * min(t / theory.RAMP, 1.0)]])
        slope = np.diff(u) / np.diff(z)
        return c * np.diff(slope) / (0.5 * (z[2:] - z[:-2]))

    times = np.array(theory.TIMES, dtype=float)
    parts, state = [], np.zeros(len(z) - 2)
    for first, last in ((0.0, theory.RAMP), (theory.RAMP, times[-1])):
        wanted = times[(times > first) & (times <= last)]
        run = solve_ivp(rate, (first, last), state, "BDF", wanted, rtol=1e-7, atol=1e-12)
        piston = -theory.STRAIN * h * np.minimum(wanted / theory.RAMP, 1.0)
        parts.append((run.y[-1] - piston) / (z[-1] - z[-2]))
        state = run.y[:, -1]
    np.testing.assert_allclose(theory.stress(times), theory.MODULUS * np.concatenate(parts), rtol=3e-3)
