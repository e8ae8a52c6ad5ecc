"""Values of formulas with derivatives: against complex steps, and where a slope is infinite."""

from __future__ import annotations

import numpy as np
import pytest

from porocore.core.dual_numbers import value_and_slopes
from porocore.core.formulas import CONSTANTS, FUNCTIONS, Expression

STEP = 2.0**-100
RNG = np.random.default_rng(4)
X, Y = RNG.uniform(0.2, 1.2, (2, 7))


@pytest.mark.parametrize(
    "text",
    [
        *(f"{name}(x*y - 0.01)" for name in FUNCTIONS if name != "abs"),
        "abs(x - y)**3",
        "-x + +y - (x*y)/(1 + y**2)",
        "x**y + y**-2.5 - 2**x",
        "exp(-x*sin(pi*y)**2)/sqrt(1 + log(x + 3)*tanh(y)) + 3",
    ],
)
def test_derivatives_are_those_of_complex_steps(text):
    expression = Expression.parse(text, ("x", "y"))
    value, slopes = value_and_slopes(expression, {"x": X, "y": Y})
    np.testing.assert_array_equal(value, expression(x=X, y=Y))
    functions = FUNCTIONS | {"abs": lambda z: np.where(z.real < 0, -z, z)}
    for name in ("x", "y"):
        moved = CONSTANTS | {"x": X, "y": Y} | {name: {"x": X, "y": Y}[name] + 1j * STEP}
        expected = expression.convert(lambda of, moved=moved: moved[of], functions).imag / STEP
        np.testing.assert_allclose(slopes[name], expected, rtol=1e-13, atol=1e-14)


def test_a_formula_of_numbers_alone_has_no_derivatives():
    value, slopes = value_and_slopes(Expression.parse("2*pi", ("x",)), {"x": X})
    assert float(value) == 2 * np.pi
    assert slopes == {}


@pytest.mark.parametrize(
    ("text", "by_x", "by_n"), [("x**n", 0.0, 0.0), ("x**0", 0.0, None), ("sqrt(x*n)", np.inf, 0.0)]
)
def test_derivatives_at_zero(text, by_x, by_n):
    values = {"x": np.array([0.0]), "n": np.array([2.0])}
    _, slopes = value_and_slopes(Expression.parse(text, ("x", "n")), values)
    assert slopes["x"] == [by_x]
    assert by_n is None or slopes["n"] == [by_n]


def test_a_quantity_that_stands_still_adds_nothing_to_an_infinite_slope():
    values = {"x": np.array([1.0]), "y": np.array([2.0])}
    _, slopes = value_and_slopes(Expression.parse("sqrt((x - 1)**2)*y", ("x", "y")), values)
    assert slopes["x"] == [0.0]
    assert slopes["y"] == [0.0]
