"""The example of a filmed plug: its files can be read, its data are those of another solution."""

from __future__ import annotations

import csv
import importlib.util
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from porocore import CellProblem
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
    """p obeys (α² + S H)/H dp/dt = (k p')' from undrained compression on: another grid, another integration."""
    n, end = 300, 2000.0
    d = column.HEIGHT / n
    middles = d * (np.arange(n) + 0.5)
    modulus = 1e-3 * np.interp(middles, column.HEIGHTS, column.MODULI)

    # α² + S H = 0.99² + 0.00852.
    storage = 0.98862

    def rate(_: float, p: np.ndarray) -> np.ndarray:
        # No flux at the base; on the piston, half a cell away, the pressure is zero.
        flux = np.r_[0.0, np.diff(p) / d, -2 * p[-1] / d]
        return np.asarray(modulus / storage * column.PERMEABILITY * np.diff(flux) / d)

    first = np.full(n, 0.99 / storage * 1e-3 * column.STRESS)
    p = solve_ivp(rate, (0, end), first, "BDF", rtol=1e-8, atol=1e-12).y[:, -1]
    settled = ((1e-3 * column.STRESS - 0.99 * p) / modulus * d).cumsum()
    heights, u, base = column.column(np.array([end]))
    np.testing.assert_allclose(-np.interp(middles + d / 2, heights, u[0]), settled, atol=2e-4 * settled[-1])
    assert base[0] == pytest.approx(p[0], rel=2e-3)


def test_a_column_of_one_modulus_follows_terzaghi(
    column: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(column, "MODULI", (200.0,) * 4)
    times = np.array([300.0, 1000.0, 4000.0])
    _, u, p = column.column(times)
    aggregate, odd = 0.2, np.pi / 2 * (2 * np.arange(60) + 1)
    c = 1e-2 * aggregate / (0.99**2 + 0.00852)
    decay = np.exp(-np.outer(times, odd**2) * c / 9)
    first = 0.5e-3 * 0.99 / (0.99**2 + 0.00852)
    np.testing.assert_allclose(p, 2 * first * decay @ (np.sin(odd) / odd), rtol=1e-5)
    mean = 2 * first * decay @ odd**-2.0
    np.testing.assert_allclose(u[:, -1], 3 * (0.99 * mean - 0.5e-3) / aggregate, rtol=1e-5)


@pytest.mark.slow  # One mesh of a cell, 10 s.
def test_the_column_has_the_coefficients_of_the_cell(column: ModuleType) -> None:
    """The fit can find the true values only if both have the same physics."""
    cell = read_plan(FOLDER / "filmed-plug.yaml", synthetic=False).experiments[0].config.cell
    found = CellProblem(cell, parameters={"stiffness": 0.6}, store=False).properties
    assert found.biot_tensor[1, 1] == pytest.approx(column.BIOT, abs=1e-4)
    assert found.confined_moduli[1] * found.storage == pytest.approx(column.STORAGE, rel=2e-3)
    # Biot and Willis (1957), for one solid with Lamé's constants 2 m and 2 l times the stiffness.
    solid = 0.6 * (2 * 8.2215 + 4 / 3 * 0.16779)
    drained = found.stiffness_voigt[:3, :3].sum() / 9
    assert 1 - drained / solid == pytest.approx(column.BIOT, abs=1e-4)
    assert (column.BIOT - found.porosity) / solid == pytest.approx(found.storage, rel=2e-3)


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
