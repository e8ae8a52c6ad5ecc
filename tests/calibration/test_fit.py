"""Search of the unknowns on closed forms: known answers, bounds, starts, failures; killed fits; data without a fit."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from porocore.commands.calibration.fit import (
    ALIKE,
    ROUGH,
    CalibrationFit,
    FitQuality,
    RecordedModel,
    _progress,
    at_bounds,
    far_from_start,
    fit,
)
from porocore.commands.calibration.problem import (
    CurveData,
    CurveModel,
    CurvePrediction,
    Misfit,
    NormalPrior,
    Unknown,
)
from porocore.commands.calibration.settings import FitSettings
from porocore.core.console import Console
from porocore.errors import DataError, RunFolderError, SolveError
from porocore.states import Array

TIMES = np.linspace(0.1, 5, 40)
TRUE = np.array([2.0, 0.7])
UNKNOWNS = (Unknown("height", 1.0, 0.1, 10.0, "log"), Unknown("rate", 2.0, 0.05, 5.0))


class Relaxation(CurveModel):
    """a (1 − exp(−b t)), which cannot be computed where b is above a bound."""

    def __init__(
        self, unknowns: tuple[Unknown, ...] = UNKNOWNS, most: float = np.inf, last: int | None = None
    ) -> None:
        self.unknowns, self.most, self.last, self.count = unknowns, most, last, 0

    def curves(self, values: Array) -> CurvePrediction:
        a, b = values
        if self.count == self.last:
            raise KeyboardInterrupt
        self.count += 1
        if b > self.most:
            raise SolveError(f"no solution at {b:g}")
        e = np.exp(-b * TIMES)
        return CurvePrediction(a * (1 - e), np.stack([1 - e, a * TIMES * e], axis=1))


def data(noise: float = 0.0, seed: int = 0) -> CurveData:
    exact = Relaxation().curves(TRUE).values
    values = exact + noise * np.random.default_rng(seed).standard_normal(len(exact))
    return CurveData(
        values, np.full(len(exact), noise or 0.01), np.zeros(len(exact), np.int64), TIMES, ("curve",)
    )


def fitted(model: CurveModel, measured: CurveData, **settings: Any) -> tuple[Misfit, CalibrationFit]:
    misfit = Misfit(model, measured)
    return misfit, fit(misfit, FitSettings(**settings), Console(io.StringIO()))


def test_exact_data_give_the_exact_unknowns_from_every_start() -> None:
    misfit, found = fitted(Relaxation(), data(), starts=4)
    np.testing.assert_allclose(misfit.values(found.best.coordinates), TRUE, rtol=1e-8)
    assert found.converged
    ends = [each.end for each in found.searches if each.end is not None]
    assert len(ends) == 4
    # The later searches end roughly where they are no better than the first.
    assert max(end.cost for end in ends) <= found.best.cost * (1 + ROUGH) + ALIKE


def test_noisy_data_give_the_minimum_of_the_sum_of_squares() -> None:
    """Against a fine grid of the sum of squares around it, without any slope."""
    measured = data(0.05)
    misfit, found = fitted(Relaxation(), measured)
    a, b = misfit.values(found.best.coordinates)

    def cost(a: float, b: float) -> float:
        return float(np.sum(((a * (1 - np.exp(-b * TIMES)) - measured.values) / measured.deviations) ** 2))

    least = cost(a, b)
    assert least == pytest.approx(2 * found.best.cost, rel=1e-12)
    around = [(a * (1 + i * 1e-4), b * (1 + j * 1e-4)) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j]
    assert all(cost(*point) > least for point in around)


def test_a_prior_moves_the_answer_as_a_measurement_would() -> None:
    """With one unknown and a straight model: the mean weighted by the inverse variances."""

    class Constant(CurveModel):
        unknowns = (Unknown("x", 1.0, -10.0, 10.0, prior=NormalPrior(0.0, 0.5)),)

        def curves(self, values: Array) -> CurvePrediction:
            return CurvePrediction(np.full(4, values[0]), np.ones((4, 1)))

    measured = CurveData(np.full(4, 3.0), np.full(4, 1.0), np.zeros(4, np.int64), np.arange(4.0), ("c",))
    misfit, found = fitted(Constant(), measured)
    assert misfit.values(found.best.coordinates)[0] == pytest.approx(4 * 3.0 / (4 + 4), rel=1e-8)


def test_the_bounds_hold() -> None:
    narrow = (UNKNOWNS[0], Unknown("rate", 1.5, 1.0, 5.0))
    misfit, found = fitted(Relaxation(narrow), data())
    a, b = misfit.values(found.best.coordinates)
    assert 1.0 <= b == pytest.approx(1.0, abs=1e-6)
    assert a != pytest.approx(2.0, rel=0.05)


def test_steps_to_where_nothing_can_be_computed_are_shortened() -> None:
    model = Relaxation(most=2.1)
    misfit, found = fitted(model, data(), starts=5)
    np.testing.assert_allclose(misfit.values(found.best.coordinates), TRUE, rtol=1e-8)
    assert any("no solution" in each.failure for each in found.searches)


def test_no_start_that_can_be_computed_is_one_message() -> None:
    with pytest.raises(SolveError, match="at none of the 2 starts; no solution at"):
        fitted(Relaxation(most=0.01), data(), starts=2)


def recorded(model: CurveModel, path: Path, identity: str = "one") -> RecordedModel:
    return RecordedModel(model.unknowns, lambda: model, path, identity)


def test_an_evaluation_of_very_many_values_has_a_file_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is read again is what was returned, to the last bit; a damaged file is told."""
    monkeypatch.setattr("porocore.commands.calibration.fit.MANY_VALUES", 3)
    path, model = tmp_path / "evaluations.jsonl", Relaxation()
    first = recorded(model, path)
    at = np.array([one.start for one in model.unknowns])
    made, exact, count = first.curves(at), model.curves(at), model.count
    np.testing.assert_array_equal(made.values, exact.values)
    np.testing.assert_allclose(made.slopes, exact.slopes, rtol=1e-6)
    again = recorded(model, path)
    for found in (again.curves(at), next(iter(again))[1]):
        assert found is not None
        np.testing.assert_array_equal(found.values, made.values)
        np.testing.assert_array_equal(found.slopes, made.slopes)
    assert model.count == count
    (tmp_path / "evaluations-1.npz").write_bytes(b"no file of arrays")
    with pytest.raises(RunFolderError, match=r"evaluations-1.npz cannot be read: .*; start again"):
        again.curves(at)


@pytest.mark.parametrize("killed_after", [0, 1, 2, 7, 15, 20])
def test_a_fit_that_was_killed_goes_on_to_the_same_answer(killed_after: int, tmp_path: Path) -> None:
    path = tmp_path / "evaluations.jsonl"
    measured, settings = data(0.05), {"starts": 4, "tolerance": 1e-10}
    whole = Relaxation()
    _, through = fitted(whole, measured, **settings)
    assert whole.count > 20
    with pytest.raises(KeyboardInterrupt):
        fitted(recorded(Relaxation(last=killed_after), path), measured, **settings)
    with path.open("a", encoding="utf-8") as file:
        file.write('{"unknowns": [1.0, 0.')  # half a line, as a kill leaves it
    rest = Relaxation()
    _, resumed = fitted(recorded(rest, path), measured, **settings)
    np.testing.assert_array_equal(resumed.best.coordinates, through.best.coordinates)
    np.testing.assert_array_equal(resumed.best.jacobian, through.best.jacobian)
    assert len(recorded(rest, path)) == killed_after + rest.count


def test_failures_are_kept_and_other_records_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "evaluations.jsonl"
    model = recorded(Relaxation(most=1.0), path)
    for _ in range(2):
        with pytest.raises(SolveError, match="no solution at 3"):
            model.curves(np.array([1.0, 3.0]))
    assert [found for _, found in recorded(Relaxation(), path)] == [None]
    with pytest.raises(RunFolderError, match="holds evaluations of another calibration"):
        recorded(Relaxation(), path, "other")
    path.write_text("nonsense\n", encoding="utf-8")
    with pytest.raises(DataError, match="not a complete record of evaluations"):
        recorded(Relaxation(), path)


def test_data_that_nothing_explains_are_told_in_one_sentence() -> None:
    misfit, found = fitted(Relaxation(), data(0.05))
    quality = FitQuality.of_fit(misfit, found.best)
    assert 0.5 < quality.reduced < 1.5
    assert quality.complaint == ""
    falling = CurveData(-data().values, data().deviations, data().curve, TIMES, ("force",))
    misfit, found = fitted(Relaxation(), falling)
    quality = FitQuality.of_fit(misfit, found.best)
    assert "no values of the unknowns explain the data" in quality.complaint
    assert "units, signs and zero of its columns ('offset:' is subtracted)" in quality.complaint
    assert "the curve 'force' is off by" in quality.complaint
    film = replace(quality, films=frozenset({"force"})).complaint
    assert "the film 'force' is off by" in film
    assert "offset:" not in film


def test_deviations_that_are_too_large_are_told_with_their_factor() -> None:
    noisy = data(0.05)
    wide = CurveData(noisy.values, 20 * noisy.deviations, noisy.curve, TIMES, ("force",))
    misfit, found = fitted(Relaxation(), wide)
    quality = FitQuality.of_fit(misfit, found.best)
    assert quality.explains
    assert quality.reduced == pytest.approx(1 / 400, rel=0.5)
    assert "the standard deviations are too large: the reduced chi-square is 0.00" in quality.complaint
    assert f"by its root, {quality.reduced**0.5:.2g}" in quality.complaint
    assert "Multiply 'deviation:', 'deviation_share:' or the deviations" in quality.complaint
    film = replace(quality, films=frozenset({"force"})).complaint
    assert "Multiply 'deviation:', 'pressure_deviation:' or the deviations" in film
    assert not replace(quality, freedom=9, chi_square=9 * quality.reduced).complaint


def test_a_bound_is_widened_only_after_a_look_at_the_units() -> None:
    misfit = Misfit(Relaxation(), data())
    at = np.array([np.log(10.0), 1.0])
    (plain,) = at_bounds(misfit, at, explained=True)
    (other,) = at_bounds(misfit, at, explained=False)
    assert plain == "the fitted height lies at the bound of the search, 10; widen the bounds"
    assert other.endswith(
        "10; check the units and signs of the data first; where they are right, widen the bounds"
    )


def test_a_value_far_from_its_start_is_told() -> None:
    unknowns = (Unknown("modulus", 0.5, 0.1, 5000.0, "log", unit="MPa"), Unknown("rate", 0.01, 0.0, 5.0))
    misfit = Misfit(Relaxation(unknowns), data())
    assert far_from_start(misfit, np.array([np.log(500.0), 4.0])) == [
        "the fitted modulus, 500 MPa, is 1e+03 times its start value, 0.5 MPa; check the units of the data and of the "
        "study"
    ]
    assert not far_from_start(misfit, np.array([np.log(40.0), 4.0]))


class Valley(CurveModel):
    """A bent valley (x, x²) whose floor falls by less than anything that counts."""

    unknowns = (Unknown("x", -1.2, -3.0, 3.0), Unknown("y", 1.44, -1.0, 9.0))

    def curves(self, values: Array) -> CurvePrediction:
        x, y = values
        slopes = np.array([[-2e3 * x, 1e3], [0.05, 0.0]])
        return CurvePrediction(np.array([1e3 * (y - x**2), 0.05 * (x - 1)]), slopes)


def test_a_search_does_not_creep_along_a_valley(monkeypatch: pytest.MonkeyPatch) -> None:
    measured = CurveData(np.zeros(2), np.ones(2), np.zeros(2, np.int64), np.arange(2.0), ("curve",))
    _, found = fitted(Valley(), measured, starts=1, evaluations=500)
    assert found.converged
    assert 2 * found.best.cost < 0.02
    assert found.searches[0].evaluations < 20
    monkeypatch.setattr("porocore.commands.calibration.fit.GAIN", 0.0)
    _, whole = fitted(Valley(), measured, starts=1, evaluations=500)
    assert whole.searches[0].evaluations > 2 * found.searches[0].evaluations


def test_the_time_left_does_not_count_evaluations_that_no_search_needs():
    """After eight of the sixty that are allowed, fewer than ten more are expected."""
    told = []

    class Told:
        def update(self, done, total, *, detail, work):
            told.append(work)

    show = _progress(Told(), 0, 1)
    for evaluation in range(1, 9):
        show(evaluation, 1.0)
    (reached, left), (earlier, _) = told[-1], told[3]
    pace = (reached - earlier) / 4
    assert left / pace < 10
