"""The misfit of a closed form: residuals by hand, slopes against differences."""

import numpy as np
import pytest

from porocore.commands.calibration.problem import (
    CurveData,
    CurveModel,
    CurvePrediction,
    Misfit,
    NormalPrior,
    Unknown,
)

TIMES = np.linspace(0.1, 2.0, 7)


class Decay(CurveModel):
    """a exp(−b t)."""

    unknowns = (
        Unknown(
            "a", start=2.0, lower=0.1, upper=10.0, scale="log", prior=NormalPrior(mean=0.5, deviation=0.2)
        ),
        Unknown("b", start=0.7, lower=0.0, upper=5.0),
    )
    calls = 0

    def curves(self, values):
        self.calls += 1
        a, b = values
        decay = np.exp(-b * TIMES)
        return CurvePrediction(a * decay, np.stack([decay, -a * TIMES * decay], axis=1))


@pytest.fixture
def misfit():
    data = CurveData(1.5 * np.exp(-TIMES), np.full(7, 0.01), np.zeros(7, int), TIMES, ("decay",))
    return Misfit(Decay(), data)


def test_residuals_are_weighted_and_priors_come_last(misfit):
    found = misfit.at(misfit.start)
    assert found.residuals[:-1] == pytest.approx((2 * np.exp(-0.7 * TIMES) - 1.5 * np.exp(-TIMES)) / 0.01)
    assert found.residuals[-1] == pytest.approx((np.log(2) - 0.5) / 0.2)
    assert found.cost == pytest.approx(0.5 * (found.residuals**2).sum())


def test_the_jacobian_is_the_slope_by_the_coordinates(misfit):
    x, h = misfit.start, 1e-6
    slopes = [(misfit.at(x + h * e).residuals - misfit.at(x - h * e).residuals) / (2 * h) for e in np.eye(2)]
    np.testing.assert_allclose(misfit.at(x).jacobian, np.transpose(slopes), rtol=1e-7, atol=1e-6)


def test_the_last_evaluation_is_kept(misfit):
    assert misfit.at(misfit.start) is misfit.at(misfit.start)
    assert misfit.model.calls == 1


def test_bounds_are_those_of_the_coordinates(misfit):
    low, high = misfit.bounds
    assert misfit.values(low) == pytest.approx([0.1, 0.0])
    assert misfit.values(high) == pytest.approx([10.0, 5.0])


class Line(CurveModel):
    """Values at three places, which the data see only at the first."""

    unknowns = tuple(
        Unknown(f"a[{i}]", start=1.0, lower=0.0, upper=2.0, smoothing=0.1 if i else None) for i in range(3)
    )

    def curves(self, values):
        return CurvePrediction(values[:1], np.eye(3)[:1])


def test_smoothing_is_a_prior_of_differences():
    misfit = Misfit(
        Line(), CurveData(np.array([1.5]), np.array([0.01]), np.zeros(1, int), np.ones(1), ("a",))
    )
    found = misfit.at(np.array([1.5, 1.7, 1.6]))
    assert found.residuals == pytest.approx([0.0, 2.0, -1.0])
    np.testing.assert_allclose(found.jacobian, [[100, 0, 0], [-10, 10, 0], [0, -10, 10]], rtol=1e-14)
    step = np.linalg.lstsq(found.jacobian, -found.residuals, rcond=None)[0]
    np.testing.assert_allclose(found.coordinates + step, 1.5, rtol=1e-12)


def test_reduced_points_have_the_sums_of_squares_and_steps_of_whole_ones():
    """At most k + 1 rows of data and the rows of priors, with the same cost, gradient and normal matrix."""
    data = CurveData(np.exp(-TIMES), np.full(7, 0.01), np.zeros(7, int), TIMES, ("decay",))
    whole = Misfit(Decay(), data).at(np.array([0.4, 0.9]))
    few, step = whole.reduced, np.array([0.1, -0.2])
    assert (len(whole.residuals), len(few.residuals), few.priors) == (8, 4, 1)
    for one, other in ((few, whole), (few.of_data, whole.of_data)):
        assert one.cost == pytest.approx(other.cost, rel=1e-12)
        np.testing.assert_allclose(
            one.jacobian.T @ one.jacobian, other.jacobian.T @ other.jacobian, rtol=1e-11
        )
        np.testing.assert_allclose(
            one.jacobian.T @ one.residuals, other.jacobian.T @ other.residuals, rtol=1e-11
        )
        moved = [np.linalg.norm(each.residuals + each.jacobian @ step) for each in (one, other)]
        assert moved[0] == pytest.approx(moved[1], rel=1e-12)
    assert few.reduced.cost == pytest.approx(whole.cost, rel=1e-12)
