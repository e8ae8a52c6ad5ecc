"""The example of a filmed plug: its files can be read, its data are those of another solution."""

from __future__ import annotations

import csv
import importlib.util
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from porocore.commands.calibration.loading import read_plan

FOLDER = Path(__file__).parents[2] / "examples" / "calibrations"


@pytest.fixture(scope="module")
def column() -> ModuleType:
    spec = importlib.util.spec_from_file_location("filmed_plug", FOLDER / "filmed_plug.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(("name", "counts"), [("filmed-plug", [1200]), ("plug-curves", [20, 20])])
def test_the_configurations_and_their_data_can_be_read(name: str, counts: list[int]) -> None:
    plan = read_plan(FOLDER / f"{name}.yaml", synthetic=False)
    assert [each.unknown.name for each in plan.unknowns] == [*(f"stiffness[{i}]" for i in range(7)), "pore"]
    assert [len(curve) for curve in plan.curves] == counts
    assert all(curve.measured is not None for curve in plan.curves)
    assert plan.notes == ()


def test_the_column_is_that_of_a_solution_for_the_pressure(column: ModuleType) -> None:
    """p obeys dp/dt = H (k p')': another unknown, another grid, another integration."""
    n, end = 300, 2000.0
    d = column.HEIGHT / n
    middles = d * (np.arange(n) + 0.5)
    modulus = 1e-3 * np.interp(middles, column.HEIGHTS, column.MODULI)

    def rate(_: float, p: np.ndarray) -> np.ndarray:
        # No flux at the base; on the piston, half a cell away, the pressure is zero.
        flux = np.r_[0.0, np.diff(p) / d, -2 * p[-1] / d]
        return np.asarray(modulus * column.PERMEABILITY * np.diff(flux) / d)

    first = np.full(n, 1e-3 * column.STRESS)
    p = solve_ivp(rate, (0, end), first, "BDF", rtol=1e-8, atol=1e-12).y[:, -1]
    settled = ((1e-3 * column.STRESS - p) / modulus * d).cumsum()
    heights, u, base = column.column(np.array([end]))
    np.testing.assert_allclose(-np.interp(middles + d / 2, heights, u[0]), settled, atol=2e-4 * settled[-1])
    assert base[0] == pytest.approx(p[0], rel=2e-3)


def test_the_files_are_those_of_the_column_with_noise(column: ModuleType) -> None:
    with (FOLDER / "filmed-plug.csv").open(encoding="utf-8") as file:
        found = np.array([[float(x) for x in row] for row in list(csv.reader(file))[1:]])
    heights, u, _ = column.column(np.unique(found[:, 2]))
    exact = [
        1e3 * np.interp(y, np.r_[0, heights], np.r_[0, u[column.FRAMES.index(t)]]) for _, y, t, _ in found
    ]
    residual = (found[:, 3] - exact) / column.DEVIATION
    assert np.abs(residual).max() < 5
    # 1,200 normal numbers: the mean square is 1 ± 0.041, three deviations of it are allowed.
    assert np.mean(residual**2) == pytest.approx(1.0, abs=0.125)
