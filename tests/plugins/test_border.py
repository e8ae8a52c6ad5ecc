"""The border to plugins: wrong things are refused where they come in, with the name of the plugin."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest

from porocore.core.inputs import InputSpace
from porocore.errors import PluginError
from porocore.interfaces.cell import CellField, CellSolution
from porocore.interfaces.sampler import Request
from porocore.plugins.border import (
    CheckedSampler,
    body_solution_of,
    conductivity_of,
    prediction_of,
    solution_of,
)
from porocore.plugins.foreign_code import note_origin, origin_of
from porocore.sampling.campaign import is_complete
from porocore.sampling.datasets.dataset import Dataset
from porocore.states import MacroState, Status
from porocore.testing.synthetic.cell import respond
from porocore.testing.synthetic.response import confined_column
from tests.helpers.made_up_column import make_column

STATES = MacroState(
    np.array([np.zeros((3, 3)), np.diag([0, -0.1, 0]), np.diag([0.01, 0, 0])]), np.array([0, 0.02, 0.01])
)
RIGHT = respond(STATES)
FIELD = CellField(np.zeros((3, 3)), 0.0, "eighth", np.zeros((5, 3)))


class Says:
    """A plugin of every kind that says what it was told to say."""

    done = False
    expected = 3

    def __init__(self, answer):
        self.answer = answer

    def solve(self, prepared, *asked, **how):
        return self.answer

    def conductivity(self, prepared):
        return self.answer

    def predict(self, states, *, tangent=True):
        return self.answer

    def ask(self):
        return self.answer


note_origin(Says, "plugin 'says' of acme 1.0")
WHO = f"plugin 'says' of acme 1.0 ({__file__}) returned something wrong: "


def refused(call, *arguments):
    """What is said to be wrong."""
    with pytest.raises(PluginError) as caught:
        call(*arguments)
    text = str(caught.value)
    assert text.startswith(WHO)
    assert text.endswith("; report this to its authors")
    assert "\n" not in text
    assert len(text) < 500
    return text.removeprefix(WHO).removesuffix("; report this to its authors")


def changed(name, at, value, response=RIGHT):
    """A response with one number changed."""
    holder, _, field = name.rpartition("/")
    array = getattr(getattr(response, holder) if holder else response, field).copy()
    array[at] = value
    if holder:
        return replace(response, **{holder: replace(getattr(response, holder), **{field: array})})
    return replace(response, **{field: array})


#: What a cell solver or a surrogate may say, and what is told about it.
RESPONSES = {
    "nothing": (None, "expected a CellResponse, got NoneType"),
    "an array": (np.zeros(3), "expected a CellResponse, got ndarray"),
    "derivatives of another kind": (replace(RIGHT, tangent={}), "expected a CellTangent, got dict"),
    "extrema of another kind": (replace(RIGHT, extrema=RIGHT), "expected a CellExtrema, got CellResponse"),
    "NaN in a stress": (
        changed("stress", 1, np.nan),
        "stress: row 1, with status 'converged', holds numbers that are not finite",
    ),
    "inf in a derivative": (
        changed("tangent/stress_p", 2, np.inf),
        "tangent/stress_p: row 2, with status 'converged'",
    ),
    "NaN in a mean": (changed("mean_grad", (0, 1, 2), np.nan), "mean_grad: row 0, with status 'converged'"),
    "values of a failed row": (
        changed("status", 1, int(Status.inverted)),
        "row 1, with status 'inverted', holds values, and NaN",
    ),
    "a status that there is not": (changed("status", 1, 99), "status: 99 of row 1 is no status"),
    "one row too few": (RIGHT[:2], "expected shape (3, 3, 3), got (2, 3, 3)"),
    "transposed": (
        replace(RIGHT, stress=RIGHT.stress.reshape(3, 9)),
        "stress: expected shape (3, 3, 3), got (3, 9)",
    ),
    "a list": (
        replace(RIGHT, potential=[0.0, 0.0, 0.0]),
        "potential: expected an array of shape (3,), got list",
    ),
    "complex numbers": (
        replace(RIGHT, potential=np.zeros(3, complex)),
        "potential: expected numbers of type float64, got complex128",
    ),
    "texts": (
        replace(RIGHT, potential=np.array(["a", "b", "c"])),
        "potential: expected numbers of type float64, got <U1",
    ),
    "no means": (replace(RIGHT, mean_grad=None), "mean_grad: is missing"),
    "no status": (replace(RIGHT, status=None), "status: is missing"),
    "a fractional status": (
        replace(RIGHT, status=np.zeros(3)),
        "status: expected numbers of type int64, got float64",
    ),
}


@pytest.mark.parametrize("name", RESPONSES)
def test_a_wrong_response_is_refused(name):
    """From a cell solver and from a surrogate."""
    response, words = RESPONSES[name]
    assert words in refused(prediction_of, Says(response), STATES)
    assert words in refused(solution_of, Says(CellSolution(response)), None, STATES)


@pytest.mark.parametrize(
    ("solution", "words"),
    [
        (None, "expected a CellSolution, got None"),
        (RIGHT, "expected a CellSolution, got CellResponse("),
        (CellSolution(RIGHT, [FIELD]), "fields: expected 3, one for each state, or None, got [CellField("),
        (
            CellSolution(RIGHT, [None, "u", None]),
            "fields: row 1: expected a CellField of the eighth or the whole, got 'u'",
        ),
        (
            CellSolution(RIGHT, [replace(FIELD, domain="half"), None, None]),
            "row 0: expected a CellField of the eighth",
        ),
        (
            CellSolution(RIGHT, [None, None, replace(FIELD, u=np.zeros(15))]),
            "row 2: expected finite displacements u (nodes, 3), got shape (15,)",
        ),
        (
            CellSolution(RIGHT, [None, None, replace(FIELD, u=np.full((5, 3), np.nan))]),
            "row 2: expected finite displacements",
        ),
    ],
)
def test_a_wrong_solution_of_a_cell_is_refused(solution, words):
    assert words in refused(solution_of, Says(solution), None, STATES)


@pytest.mark.parametrize(
    ("K", "words"),
    [
        (1.0, "conductivity: expected (3, 3) numbers of type float64, got 1.0"),
        (np.ones(3), "got shape (3,) of type float64"),
        (np.eye(3, dtype=complex), "got shape (3, 3) of type complex128"),
        (np.diag([1.0, np.nan, 1.0]), "conductivity: holds numbers that are not finite"),
    ],
)
def test_a_wrong_conductivity_is_refused(K, words):
    assert words in refused(conductivity_of, Says(K), None)


def test_what_is_right_comes_through_as_it_is():
    failed = RIGHT
    for name in ("mean_grad", "potential", "stress", "fluid_volume"):
        failed = changed(name, 1, np.nan, failed)
    for name in vars(RIGHT.tangent):
        if getattr(RIGHT.tangent, name) is not None:
            failed = changed(f"tangent/{name}", 1, np.nan, failed)
    failed = changed("status", 1, int(Status.not_converged), failed)
    failed = replace(failed, extrema=None)
    for response in (RIGHT, failed):
        assert prediction_of(Says(response), STATES) is response
        solution = CellSolution(response, [FIELD, None, None])
        assert solution_of(Says(solution), None, STATES) is solution
    K = np.eye(3)
    assert conductivity_of(Says(K), None) is K


def test_beyond_its_range_a_surrogate_may_say_anything():
    """And so it may where Newton's iteration asks for what is no state."""
    nothing = replace(changed("stress", 1, np.nan), extrema=None)
    flagged = replace(nothing, doubt=np.array([0, 1, 0]))
    assert prediction_of(Says(flagged), STATES) is flagged
    no_state = MacroState(STATES.grad_u, np.array([0.0, np.nan, 0.0]))
    assert prediction_of(Says(nothing), no_state) is nothing
    other = replace(nothing, doubt=np.array([1, 0, 2]))
    assert "stress: row 0" in refused(prediction_of, Says(other), STATES)


def test_the_border_costs_nothing_beside_an_evaluation():
    """At the points of the benchmark's column, 2,250; with all derivatives."""
    rng = np.random.default_rng(7)
    states = MacroState(0.02 * rng.normal(size=(2250, 3, 3)), 0.01 * rng.normal(size=2250))
    response = respond(states)

    def fastest(call):
        times = []
        for _ in range(20):
            began = time.perf_counter()
            call()
            times.append(time.perf_counter() - began)
        return min(times)

    surrogate = Says(response)
    assert fastest(lambda: prediction_of(surrogate, states)) < 2e-3  # measured: 0.24 ms


# ---- samplers -------------------------------------------------------------------------------------

INPUTS = InputSpace(("p", "H22"), (-0.1, -0.4), (0.2, 0.1))


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        (None, "ask: expected a list of Request, got None"),
        ("state", "ask: expected a list of Request, got 'state'"),
        (["state"], "ask: expected a list of Request, got 'state' in it"),
        ([Request(7, (0.0, 0.0))], "key: expected a text of 1 to 200 letters, got 7"),
        ([Request("", (0.0, 0.0))], "key: expected a text of 1 to 200 letters, got ''"),
        ([Request("x" * 201, (0.0, 0.0))], "key: expected a text of 1 to 200 letters, got 'xxx"),
        ([Request("a\nb", (0.0, 0.0))], r"got 'a\nb'"),
        ([Request("a", (0.0, 0.0)), Request("a", (0.1, 0.0))], "key: 'a' is asked for twice"),
        ([Request("a", (0.0, 0.0), 3)], "start of 'a': expected the key of another state or None, got 3"),
        ([Request("a", (0.0,))], "x of 'a': expected a tuple of 2 numbers, got (0.0,)"),
        ([Request("a", [0.0, 0.0])], "x of 'a': expected a tuple of 2 numbers, got [0.0, 0.0]"),
        ([Request("a", (0.0, "0"))], "x of 'a': expected a finite number for H22, got '0'"),
        ([Request("a", (0.0, float("nan")))], "x of 'a': expected a finite number for H22, got nan"),
        ([Request("a", (float("inf"), 0.0))], "x of 'a': expected a finite number for p, got inf"),
        ([Request("a", (0.3, 0.0))], "x of 'a': p = 0.3 is outside its range [-0.1, 0.2]"),
        ([Request("a", (0.0, -0.4001))], "x of 'a': H22 = -0.4001 is outside its range [-0.4, 0.1]"),
    ],
)
def test_a_wrong_request_is_refused(tmp_path, asked, words):
    assert words in refused(CheckedSampler(Says(asked), INPUTS).ask)
    dataset = Dataset.create(tmp_path / "data.h5", inputs=INPUTS, identity="a")
    assert words in refused(is_complete, Says(asked), dataset)


def test_right_requests_come_through_and_keys_are_never_repeated():
    asked = [Request("a", (0.2, 0.1)), Request("b", (-0.1 - 1e-12, -0.4), "a")]
    sampler = CheckedSampler(Says(asked), INPUTS)
    assert sampler.ask() == asked
    assert "key: 'a' is asked for twice" in refused(sampler.ask)
    assert (sampler.done, sampler.expected) == (False, 3)
    sampler.sampler.expected = float("nan")
    assert "expected: must be a number, got nan" in refused(lambda: sampler.expected)


# ---- macro solvers --------------------------------------------------------------------------------

PROBLEM = confined_column(40, time={"end": 100.0})
COLUMN = make_column()


def with_profile(**fields):
    return replace(COLUMN, profiles=(replace(COLUMN.profiles[0], **fields), *COLUMN.profiles[1:]))


def with_history(**fields):
    return replace(COLUMN, history=replace(COLUMN.history, **fields))


STEPS, NODES, ELEMENTS = len(COLUMN.history.time), len(COLUMN.points), len(COLUMN.cells)
NOTHING = np.full(STEPS, np.nan)


@pytest.mark.parametrize(
    ("solution", "words"),
    [
        (None, "expected a MacroSolution, got None"),
        (replace(COLUMN, points=None), "points: expected numbers of shape (0, 3), got None"),
        (
            replace(COLUMN, points=COLUMN.points[:, :2]),
            f"points: expected numbers of shape ({NODES}, 3), got shape ({NODES}, 2)",
        ),
        (
            replace(COLUMN, cells=COLUMN.cells.astype(float)),
            "cells: expected numbers of nodes (elements, nodes of each)",
        ),
        (replace(COLUMN, cells=COLUMN.cells + 1), f"cells: names node {NODES} of {NODES}"),
        (replace(COLUMN, history=None), "history: expected a History, got None"),
        (with_history(settlement=NOTHING), "history.settlement: holds numbers that are not finite"),
        (
            with_history(settlement=COLUMN.history.settlement[1:]),
            f"history.settlement: expected numbers of shape ({STEPS},), got shape ({STEPS - 1},)",
        ),
        (
            with_history(time=COLUMN.history.time[::-1].copy()),
            "history.time: expected times that grow from 0 to 100, got [100.0",
        ),
        (with_history(time=COLUMN.history.time / 2), "history.time: expected times that grow from 0 to 100"),
        (
            replace(COLUMN, probes={"a": np.zeros((STEPS, 3))}),
            f"probes/a: expected numbers of shape ({STEPS}, 4), got shape ({STEPS}, 3)",
        ),
        (
            replace(COLUMN, reactions={"y-": np.full((STEPS, 3), np.inf)}),
            "reactions/y-: holds numbers that are not finite",
        ),
        (replace(COLUMN, profiles=()), "profiles: expected one at the end at least, got none"),
        (replace(COLUMN, profiles=("a",)), "profiles: expected a Profile, got 'a'"),
        (
            with_profile(u=np.zeros((NODES, 2))),
            f"profiles[0].u: expected numbers of shape ({NODES}, 3), got shape ({NODES}, 2)",
        ),
        (
            with_profile(stress=np.full((ELEMENTS, 3, 3), np.nan)),
            "profiles[0].stress: holds numbers that are not finite",
        ),
        (
            with_profile(element_p=[0.0]),
            f"profiles[0].element_p: expected numbers of shape ({ELEMENTS},), got [0.0]",
        ),
        (
            with_profile(internal={"charge": np.zeros(ELEMENTS)}),
            "profiles[0].internal: expected [], which 'quantities' names, got ['charge']",
        ),
        (
            replace(with_profile(internal={"charge": np.zeros(ELEMENTS + 1)}), quantities={"charge": ""}),
            f"profiles[0].internal['charge']: expected numbers of shape ({ELEMENTS},), got shape ({ELEMENTS + 1},)",
        ),
    ],
)
def test_a_wrong_solution_of_a_body_is_refused(solution, words):
    assert words in refused(body_solution_of, Says(solution), None, None, PROBLEM)


def test_a_right_solution_of_a_body_comes_through():
    assert body_solution_of(Says(COLUMN), None, None, PROBLEM) is COLUMN


# ---- names ----------------------------------------------------------------------------------------


def test_a_class_that_nobody_installed_is_named_with_its_file():
    class Mine:
        pass

    assert origin_of(Mine()) == f"Mine ({__file__})"
    assert origin_of(type("Later", (Says,), {})(None)) == f"plugin 'says' of acme 1.0 ({__file__})"


def test_the_class_of_a_plugin_is_named_as_it_was_asked_for():
    from porocore.plugins.registry import get

    words = origin_of(get("sampler", "sobol")(INPUTS, count=8))
    assert words.startswith("sampler 'sobol' of porocore ")
    assert words.endswith("porocore/sampling/samplers/designs.py)")
