"""Region of two unknowns: an ellipse where the model is linear, open along a non-identifiable direction."""

import numpy as np
import pytest

from porocore.commands.calibration.infer import infer
from porocore.commands.calibration.problem import Unknown
from tests.helpers.calibration_models import Formula, misfit_of

T = np.linspace(0.1, 2.0, 15)
NOISE = np.random.default_rng(0).normal(size=15)


def test_the_region_of_a_linear_model_is_its_ellipse():
    unknowns = tuple(Unknown(name, 1.0, -90.0, 90.0) for name in ("level", "slope", "bend"))
    misfit = misfit_of(Formula(unknowns, lambda v: v[0] + v[1] * T + v[2] * T**2), [1, 2, 3], 0.1, NOISE)
    plane = infer(misfit, misfit.at(misfit.start), rays=12).plane
    assert plane.closed.all()
    np.testing.assert_allclose(plane.radii, plane.linear_radii, rtol=1e-7)
    np.testing.assert_allclose(plane.radii, 2.447746830680816, rtol=1e-7)
    # Every point of the rim is where the χ² of two degrees of freedom has its 95 % quantile.
    rows = np.stack([np.ones(15), T, T**2], axis=1) / 0.1
    covariance = np.linalg.inv(rows.T @ rows)[np.ix_(plane.indices, plane.indices)]
    offset = plane.rim - plane.best
    rise = np.einsum("ni,ij,nj->n", offset, np.linalg.inv(covariance), offset)
    np.testing.assert_allclose(rise, 5.991464547107979, rtol=1e-7)


def bent(upper):
    """Two exponents of one decay, told apart by its bend; up to a bound of the second."""
    unknowns = (Unknown("fast", 2.0, 0.1, 50.0, "log"), Unknown("slow", 0.5, 0.01, upper, "log"))
    model = Formula(unknowns, lambda v: np.exp(-v[0] * T) + np.exp(-v[1] * T))
    return misfit_of(model, [2.0, 0.5], 0.02, NOISE)


def test_the_region_of_a_bent_model_has_the_rise_everywhere():
    misfit = bent(50.0)
    found = infer(misfit, misfit.at(misfit.start), rays=8)
    assert found.plane.closed.all()
    rises = [2 * (misfit.at(x).cost - found.best.cost) for x in found.plane.rim]
    assert rises == pytest.approx([5.991464547107979] * 8, rel=2e-3)
    # The region to first order is another one.
    assert np.abs(found.plane.radii / found.plane.linear_radii - 1).max() > 0.05


def test_a_region_that_reaches_a_bound_is_open_there():
    # The interval of one unknown ends before the bound, the wider region of two does not.
    misfit = bent(0.57)
    found = infer(misfit, misfit.at(misfit.start), rays=8)
    assert found.intervals[1].high.value < 0.57
    open_ends = np.exp(found.plane.rim[~found.plane.closed, 1])
    assert len(open_ends) > 0
    np.testing.assert_allclose(open_ends, 0.57, rtol=1e-9)


def test_the_plane_of_a_product_has_no_region():
    unknowns = (Unknown("a", 2.0, 0.1, 50.0, "log"), Unknown("b", 3.0, 0.1, 50.0, "log"))
    misfit = misfit_of(Formula(unknowns, lambda v: v[0] * v[1] * np.exp(-T)), [2.0, 3.0], 0.02, NOISE)
    found = infer(misfit, misfit.at(misfit.start), rays=8)
    assert len(found.plane.rim) == 0
    # The paths of both profiles are the valley.
    for interval in found.data_intervals:
        np.testing.assert_allclose(np.exp(interval.coordinates).prod(axis=1), 6.0, rtol=0.05)


def test_one_unknown_has_no_plane():
    misfit = misfit_of(
        Formula((Unknown("a", 2.0, 0.1, 50.0, "log"),), lambda v: v[0] * T), [2.0], 0.02, NOISE
    )
    assert infer(misfit, misfit.at(misfit.start)).plane is None


def test_rays_between_alike_ones_are_spared_and_still_lie_on_the_rim():
    unknowns = (Unknown("fast", 2.0, 0.1, 50.0, "log"), Unknown("slow", 0.5, 0.01, 50.0, "log"))
    misfit = misfit_of(Formula(unknowns, lambda v: v[0] * np.exp(-v[1] * T)), [2.0, 0.5], 0.02, NOISE)
    told = []
    found = infer(misfit, misfit.at(misfit.start), rays=16, tell=told.append)
    assert len([words for words in told if "ray" in words]) < 16
    rises = [2 * (misfit.at(x).cost - found.best.cost) for x in found.plane.rim]
    # A radius within 0.5 %.
    assert rises == pytest.approx([5.991464547107979] * 16, rel=1e-2)


def test_few_rays_are_all_walked():
    misfit, told = bent(50.0), []
    infer(misfit, misfit.at(misfit.start), rays=4, tell=told.append)
    assert len([words for words in told if "ray" in words]) == 4
