"""Region of two unknowns: an ellipse where the model is linear, open where a direction is not seen."""

import numpy as np
from calibration_models import Formula, misfit_of

from porocore.calibration.inference.infer import infer
from porocore.calibration.problem import Unknown

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


def test_the_region_of_a_product_is_a_valley_without_ends():
    unknowns = (Unknown("a", 2.0, 0.1, 50.0, "log"), Unknown("b", 3.0, 0.1, 50.0, "log"))
    misfit = misfit_of(Formula(unknowns, lambda v: v[0] * v[1] * np.exp(-T)), [2.0, 3.0], 0.02, NOISE)
    plane = infer(misfit, misfit.at(misfit.start), rays=8).plane
    # Along the valley it reaches the bounds of the search on both sides.
    open_ends = np.exp(plane.rim[~plane.closed])
    np.testing.assert_allclose(open_ends.prod(axis=1), 6.0, rtol=0.05)
    assert open_ends.max() > 40
    assert plane.closed.any()


def test_one_unknown_has_no_plane():
    misfit = misfit_of(
        Formula((Unknown("a", 2.0, 0.1, 50.0, "log"),), lambda v: v[0] * T), [2.0], 0.02, NOISE
    )
    assert infer(misfit, misfit.at(misfit.start)).plane is None
