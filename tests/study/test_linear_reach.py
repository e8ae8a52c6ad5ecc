"""Steps of the linear solution of ``porocore check``, and what it says of a body that goes unlikely far."""

import numpy as np
import pytest
import yaml

from porocore.core.units import ResultUnits
from porocore.macro.body.kinds import Box
from porocore.macro.laws.linear import LinearCoefficients
from porocore.study.config.loading import load_config
from porocore.study.notes import linear_reach
from porocore.study.notes.linear_reach import predicted_reach
from porocore.study.notes.reach import visited
from porocore.testing.macro_checks.bodies import write_tetrahedra
from tests.helpers.invoked import BENCHMARK

ONE = np.eye(3)
#: λ = μ = 1 before the confined modulus of 3.
SWAP = np.einsum("ik,jl->ijkl", ONE, ONE)
C = np.einsum("ij,kl->ijkl", ONE, ONE) + SWAP + SWAP.swapaxes(2, 3)
ALPHA, STORAGE, CONDUCTIVITY, HEIGHT = 0.8, 0.1, 0.5, 2.0
SIDES = {name: {"normal": 0} for name in ("x-", "x+", "z-", "z+", "y-")}
#: Of the slowest part of the pressure.
CONSOLIDATION = CONDUCTIVITY / (ALPHA**2 / 3 + STORAGE)
SLOWEST = (2 * HEIGHT / np.pi) ** 2 / CONSOLIDATION


def coefficients():
    zero = np.zeros((3, 3, 3, 3)), np.zeros((3, 3))
    return LinearCoefficients(C, ALPHA * ONE, ALPHA * ONE, STORAGE, CONDUCTIVITY * ONE, *zero)


def study(tmp_path, top, elements=8, scales=None, body=None, **time):
    data = yaml.safe_load(BENCHMARK.with_name("soil-strip.yaml").read_text(encoding="utf-8"))
    ranges = {"H22": [-0.05, 0.05], "p": [-0.01, 0.01]}
    data["sampling"]["inputs"] = {name: {"range": ends} for name, ends in ranges.items()}
    data["macro"] = {
        "body": body or {"kind": "box", "size": [1, HEIGHT, 1], "elements": [1, elements, 1]},
        "boundary": SIDES | {"y+": top | {"pressure": 0}},
        "loads": [1],
        "time": {"step": SLOWEST, "ramp_increments": 10, "ramp_step": 0.1, "profiles": []} | time,
    }
    if scales:
        data["scales"] = scales
        data["cell"]["viscosity"] = "50 mPa s"
    path = tmp_path / "study.yaml"
    path.write_text(yaml.safe_dump(data), encoding="utf-8")
    return load_config(path)


def unloaded(tmp_path, **settings):
    """A column under 0.01 for 40 times of the slowest part, unloaded within two of them."""
    table = [[0, 0], [SLOWEST, -0.01], [40 * SLOWEST, -0.01], [42 * SLOWEST, 0]]
    top = {"traction": [0, {"table": table}, 0]}
    return study(tmp_path, top, **{"end": 80 * SLOWEST, "tolerance": 1e-3} | settings)


def test_the_suction_of_an_unloading_is_that_of_the_series(tmp_path):
    """One step told 23 % less; the series is that of a pressure that grows with the load and decays."""
    (solution,) = linear_reach.linear_solutions(unloaded(tmp_path), coefficients())
    k = 2 * np.arange(200) + 1
    rates = k**2 / SLOWEST
    grown = 0.01 / (2 * SLOWEST) * ALPHA / 3 / (ALPHA**2 / 3 + STORAGE)
    signs = np.where(k % 4 == 1, 1, -1)
    base = -grown * float(np.sum(4 / np.pi / k * signs * (1 - np.exp(-2 * SLOWEST * rates)) / rates))
    assert float(visited(solution, ResultUnits())[0].p.min()) == pytest.approx(base, rel=0.045)


def test_large_bodies_take_fewer_steps_and_none_is_shorter_than_given(tmp_path, monkeypatch):
    config = unloaded(tmp_path)
    steps = [len(linear_reach._times(config.macro, parts)) for parts in (1, 8)]
    size = linear_reach.body_mesh(config.macro).size
    monkeypatch.setattr(linear_reach, "MOST", size * steps[0])
    assert not linear_reach.too_large(config.macro)
    assert len(linear_reach._plan(config.macro).profiles) == steps[0] < steps[1]
    monkeypatch.undo()
    times = linear_reach._plan(config.macro).profiles
    assert len(times) == steps[1]
    assert {1, 40, 42, 80} <= {round(t / SLOWEST, 9) for t in times}
    given = unloaded(tmp_path, step=SLOWEST, tolerance=None)
    later = [t for t in linear_reach._plan(given.macro).profiles if t > 40.5 * SLOWEST]
    assert np.diff(later).min() == pytest.approx(SLOWEST)


def test_what_goes_unlikely_far_names_its_causes_before_ranges(tmp_path):
    """Pores of a tenth of their size reached H22 = 1.2, and the only advice was a range up to 1.8."""
    scales = {"modulus": 3.0e6, "length": 0.03, "pore": 6.0e-6, "viscosity": 0.05}
    far = {"traction": [0, 3, 0]}
    said = list(predicted_reach(study(tmp_path, far, scales=scales, end=40), coefficients()))
    assert "which no cell is likely to bear; is one of these out by a factor of ten" in said[0]
    for cause in ("loads", "scales.modulus = 3e+06 Pa", "scales.pore = 6 µm", "cell.viscosity = "):
        assert cause in said[1]
    assert "only if all of these are meant, write under 'sampling.inputs:'" in said[2]
    near = "\n".join(predicted_reach(study(tmp_path, {"traction": [0, 0.3, 0]}, end=40), coefficients()))
    assert "at one time; write under 'sampling.inputs:'" in near
    assert "factor of ten" not in near


def test_components_that_a_coarse_mesh_makes_are_told(tmp_path):
    """A confined column of tetrahedra was to sample H11, H12 and H13, which are zero but for its mesh."""
    write_tetrahedra(tmp_path / "column.msh", Box(size=(1, HEIGHT, 1), elements=(2, 4, 2)))
    body, load = {"kind": "file", "path": str(tmp_path / "column.msh")}, {"traction": [0, -0.3, 0]}
    for given, told in ((body, True), (None, False)):
        said = "\n".join(predicted_reach(study(tmp_path, load, body=given, end=40), coefficients()))
        assert ("may come from the mesh alone" in said) == told
