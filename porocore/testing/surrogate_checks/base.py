"""Suites of surrogates (SurrogateSuite, PotentialSuite): learned map, derivatives, flags, rest, files, symmetry.

.. code-block:: python

    class TestMySurrogate(SurrogateSuite):
        kit_version = "5"

        @classmethod
        def make_surrogate(cls):
            return MySurrogate(epochs=500)

The cell that is learned is :mod:`porocore.testing.synthetic.cell`, known in closed form. A surrogate that derives
stress and fluid volume from a potential subclasses :class:`PotentialSuite`.
"""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from porocore.errors import ConfigurationError, DataError
from porocore.interfaces.surrogate import Surrogate, TrainingSet
from porocore.states import Array, CellResponse, Doubt, MacroState
from porocore.testing import other_process
from porocore.testing.expect import (
    RESPONSES,
    STEPS,
    assert_alike,
    assert_identical,
    central_difference,
    holds,
    near,
    options,
    perturbed,
    refused,
    require,
    same,
    state_text,
    states_text,
    with_derivatives,
)
from porocore.testing.surrogate_checks.parameters import Parameters
from porocore.testing.surrogate_checks.training import Fitting, Trainings
from porocore.testing.synthetic.cell import INPUTS

#: Of the largest value of a response.
ROUND_OFF = 1e-13
#: Names of the functions and methods that read a pickle.
READ = ("load", "loads")


def arrays(response: CellResponse) -> dict[str, Array]:
    """Return what a surrogate predicts, with the derivatives, by names."""
    found = {name: getattr(response, name) for name in RESPONSES if getattr(response, name) is not None}
    found["doubt"] = np.asarray(response.doubt, float)
    for name, (by_H, by_p) in with_derivatives(response):
        found |= {f"d{name} by H": by_H, f"d{name} by p": by_p}
    return found


def predict(suite: Any, file: str, states: str, answer: str) -> list[str]:
    """Load ``file`` with the suite's surrogate, predict the states of one npz file and write them into another.

    What of pickle was called while the file was read is returned.
    """
    kind = type(suite.make_surrogate())
    with _unpickling() as calls:
        surrogate = kind.load(Path(file))
    with np.load(states) as known:
        response = surrogate.predict(MacroState(known["grad_u"], known["p"]))
    np.savez(answer, **arrays(response))
    return sorted(set(calls))


@contextmanager
def _unpickling() -> Iterator[list[str]]:
    """Note every call that reads a pickle, however it was imported."""
    calls: list[str] = []

    def look(frame: Any, event: str, function: Any) -> None:
        if event == "c_call" and function.__name__ in READ:
            owner = getattr(function, "__self__", None)
            if "_pickle" in (getattr(function, "__module__", None), type(owner).__module__):
                calls.append(f"pickle's {function.__name__}")
        elif event == "call" and frame.f_globals.get("__name__") == "pickle" and frame.f_code.co_name in READ:
            calls.append(f"pickle's {frame.f_code.co_name}")

    sys.setprofile(look)
    try:
        yield calls
    finally:
        sys.setprofile(None)


class Files(Fitting):
    """Part of :class:`porocore.testing.surrogate_checks.base.SurrogateSuite`."""

    def test_saved_and_loaded_it_is_the_same(
        self, fitted: Surrogate, saved: Path, data: TrainingSet, unseen: TrainingSet
    ) -> None:
        loaded = type(fitted).load(saved)
        assert_identical(loaded.predict(unseen.states), fitted.predict(unseen.states), "read back")
        for surrogate, state in ((fitted, "trained"), (loaded, "read back")):
            for name in ("identity", "inputs", "provenance"):
                found, expected = getattr(surrogate, name), getattr(data, name)
                holds(found == expected, state, f"{name} of the training set, {expected!r}", repr(found))
        names = [path.name for path in saved.parent.iterdir()]
        holds(names == [saved.name], "saved", "one file", names)

    def test_a_file_that_was_moved_is_enough(
        self, fitted: Surrogate, unseen: TrainingSet, tmp_path: Path
    ) -> None:
        """Another process reads a moved file to round-off, and nothing is unpickled."""
        original, moved = tmp_path / "original", tmp_path / "elsewhere" / "moved.h5"
        original.mkdir()
        moved.parent.mkdir()
        fitted.save(original / "surrogate.h5")
        (original / "surrogate.h5").rename(moved)
        shutil.rmtree(original)
        states, answer = tmp_path / "states.npz", tmp_path / "answer.npz"
        np.savez(states, grad_u=unseen.states.grad_u, p=unseen.states.p)
        state = "its one file, moved to another folder, read by another process"
        question = "porocore.testing.surrogate_checks.base:predict"
        facts = {"file": str(moved), "states": str(states), "answer": str(answer)}
        calls = other_process.ask(type(self), question, state, moved.parent, **facts)
        with np.load(answer) as found:
            for name, values in arrays(fitted.predict(unseen.states)).items():
                # Another process may sum in another order.
                within = (
                    ROUND_OFF * float(np.nanmax(np.abs(values), initial=0.0))
                    if values.dtype == float
                    else 0.0
                )
                near(name, found.get(name), values, state, within=within)
        holds(not calls, state, "that reading it unpickles nothing", ", ".join(calls))

    @pytest.mark.parametrize("share", [0.0, 0.01, 0.3, 0.7, 0.999])
    def test_a_truncated_file_is_refused(self, fitted: Surrogate, saved: Path, share: float) -> None:
        whole = saved.read_bytes()
        saved.write_bytes(whole[: int(share * len(whole))])
        state = f"the first {100 * share:g} % of the file"
        with refused(DataError, state=state, naming=(saved.name,)):
            type(fitted).load(saved)

    def test_a_damaged_file_is_refused_or_harmless(
        self, fitted: Surrogate, saved: Path, unseen: TrainingSet
    ) -> None:
        """A byte may lie in a part of the file that means nothing; it must never change a number."""
        whole, count = bytearray(saved.read_bytes()), 0
        places = np.random.default_rng(0).integers(len(whole), size=60)
        for place in places:
            damaged = whole.copy()
            damaged[place] ^= 0x55
            saved.write_bytes(damaged)
            try:
                loaded = type(fitted).load(saved)
            except DataError:
                count += 1
            else:
                state = f"byte {place} of {len(whole)} changed"
                assert_identical(loaded.predict(unseen.states), fitted.predict(unseen.states), state)
        state = f"one byte changed, at {len(places)} places"
        holds(count > len(places) / 3, state, "a DataError at a third of them", f"{count}")

    def test_a_foreign_file_is_refused(self, fitted: Surrogate, tmp_path: Path) -> None:
        text, other, missing = tmp_path / "notes.txt", tmp_path / "other.h5", tmp_path / "missing.h5"
        text.write_text("not a surrogate")
        with h5py.File(other, "w") as file:
            file["numbers"] = np.arange(3.0)
        for path in (text, other, missing):
            with refused(DataError, state=f"a foreign file, {path.name}", naming=(path.name,)):
                type(fitted).load(path)

    def test_reading_executes_nothing(self, fitted: Surrogate, tmp_path: Path) -> None:
        """A file whose unpickling would make a folder; written by hand, as pickle would."""
        made, path = tmp_path / "made", tmp_path / "surrogate.h5"
        path.write_bytes(b"cos\nmkdir\n(V" + str(made).encode() + b"\ntR.")
        state = "a pickle that makes a folder"
        with suppress(Exception):
            type(fitted).load(path)
        holds(not made.exists(), state, "that nothing is executed", "the folder")
        with refused(DataError, state=state):
            type(fitted).load(path)


class SurrogateSuite(Files, Trainings, Parameters):
    """Subclass it, name the class ``Test…`` and give it ``make_surrogate``."""

    def test_shapes(self, fitted: Surrogate, unseen: TrainingSet) -> None:
        """The batch axis leads, an empty batch included; each response comes with its slopes."""
        response = fitted.predict(unseen.states)
        n, state = len(unseen.states), states_text(unseen.states)
        same("status", response.status, np.zeros(n), state)
        shapes = {"doubt": (n,), "mean_grad": (n, 3, 3)}
        for name, slopes in with_derivatives(response):
            value = getattr(response, name)
            for what, slope, shape in (("H", slopes[0], (*value.shape, 3, 3)), ("p", slopes[1], value.shape)):
                holds(
                    slope.shape == shape, state, f"d{name}/d{what} of shape {shape}", f"shape {slope.shape}"
                )
        for name, shape in shapes.items():
            found = np.shape(require(name, getattr(response, name), state))
            holds(found == shape, state, f"{name} of shape {shape}", f"shape {found}")
        none = len(fitted.predict(MacroState.zeros(0)).mean_grad)
        holds(none == 0, "an empty batch", "no rows", f"{none} rows")

    def test_learns_the_map(self, fitted: Surrogate, unseen: TrainingSet) -> None:
        """Unseen states of a cell in closed form are predicted within the declared accuracy."""
        predicted = fitted.predict(unseen.states, tangent=False)
        for name in RESPONSES:
            values, truth = getattr(predicted, name), getattr(unseen.responses, name)
            if values is not None:
                if name == "stress":  # a potential over the inputs knows the stress that works on them
                    values, truth = values[:, 1, 1], truth[:, 1, 1]
                self._compare(name, values, truth, self.accuracy(fitted))

    def test_learns_the_derivatives(self, fitted: Surrogate, unseen: TrainingSet) -> None:
        """Derivatives at unseen states are predicted within ten times the declared accuracy."""
        predicted = fitted.predict(unseen.states)
        known = dict(with_derivatives(unseen.responses))
        for name, (by_H, by_p) in with_derivatives(predicted):
            H22 = (..., 1, 1)
            pairs = ((f"d{name}/dH22", by_H[H22], known[name][0][H22]), (f"d{name}/dp", by_p, known[name][1]))
            for what, slopes, truth in pairs:
                if name == "stress":
                    slopes, truth = slopes[:, 1, 1], truth[:, 1, 1]
                self._compare(what, slopes, truth, self.derivative_accuracy(fitted))

    @staticmethod
    def _compare(what: str, values: Array, truth: Array, accuracy: float) -> None:
        """A component that does not vary must be right to a thousandth of what the largest may be wrong by.

        Where none varies, their size takes the place of the range.
        """
        values, truth = values.reshape(len(values), -1), truth.reshape(len(truth), -1)
        error = np.sqrt(((values - truth) ** 2).mean(axis=0))
        extent = np.ptp(truth, axis=0)
        if extent.max() < 1e-9 * np.abs(truth).max():
            extent = np.abs(truth).max(axis=0)
        allowed = accuracy * np.maximum(extent, 1e-3 * extent.max())
        worst = int(np.argmax(error / allowed))
        holds(
            (error <= allowed).all(),
            f"{len(values)} unseen states",
            f"a root mean square error of {what}, component {worst}, of at most {allowed[worst]:.2e}",
            f"{error[worst]:.2e}",
        )

    def test_derivatives_match_differences(self, fitted: Surrogate, unseen: TrainingSet) -> None:
        """Derivatives match differences in all ten directions, also those not sampled.

        At states that the differences do not carry across the end of the range, where a surrogate may change its
        ways as long as its derivatives go on.
        """
        x = INPUTS.gather(unseen.states)
        inside = ((x > np.array(INPUTS.lower) + 0.01) & (x < np.array(INPUTS.upper) - 0.01)).all(axis=1)
        states = unseen.states[np.flatnonzero(inside)[:40]]
        response = fitted.predict(states)
        slopes = dict(with_derivatives(response))
        holds(slopes, states_text(states), "a response with its derivatives", "none")
        if (
            response.potential is not None
            and response.stress is not None
            and response.fluid_volume is not None
        ):
            slopes["potential"] = response.stress, -response.fluid_volume
        h = 1e-3
        for column in range(10):
            values = [fitted.predict(perturbed(states, column, k * h), tangent=False) for k in STEPS]
            for name, (by_H, by_p) in slopes.items():
                difference = central_difference((getattr(value, name) for value in values), h)
                slope = by_p if column == 9 else by_H[..., column // 3, column % 3]
                variable = "p" if column == 9 else f"H{column // 3 + 1}{column % 3 + 1}"
                within = 1e-6 * max(np.abs(slope).max(), 1e-3)
                near(
                    f"d{name}/d{variable} by differences,",
                    slope,
                    difference,
                    states_text(states),
                    within=within,
                )

    def test_rows_do_not_depend_on_the_batch_or_its_order(
        self, fitted: Surrogate, unseen: TrainingSet
    ) -> None:
        states = unseen.states[:20]
        together = fitted.predict(states)
        backwards = fitted.predict(states[::-1])[::-1]
        _same_rows(backwards, together, f"{states_text(states)}, backwards")
        for row in range(20):
            alone = states[row : row + 1]
            _same_rows(fitted.predict(alone), together[row : row + 1], f"{states_text(alone)}, alone")

    def test_two_calls_give_the_same_to_the_last_bit(self, fitted: Surrogate, unseen: TrainingSet) -> None:
        one, two = fitted.predict(unseen.states), fitted.predict(unseen.states)
        assert_identical(two, one, f"{states_text(unseen.states)}, predicted twice")

    def test_derivatives_only_where_they_are_wanted(self, fitted: Surrogate, unseen: TrainingSet) -> None:
        states = unseen.states[:20]
        plain, whole = fitted.predict(states, tangent=False), fitted.predict(states)
        state = f"{states_text(states)}, tangent=False"
        holds(plain.tangent is None, state, "no derivatives", "derivatives")
        for name in RESPONSES:
            if getattr(whole, name) is not None:
                near(name, getattr(plain, name), getattr(whole, name), state, within=1e-12)

    def test_inputs_are_not_changed(self, fitted: Surrogate, data: TrainingSet, unseen: TrainingSet) -> None:
        """Neither the states that it predicts nor those that it was trained on."""
        states = unseen.states[:20]
        H, p = states.grad_u.copy(), states.p.copy()
        fitted.predict(states)
        same("H", states.grad_u, H, "after the prediction")
        same("p", states.p, p, "after the prediction")
        original = self.training_data()
        for name in ("grad_u", "p"):
            same(name, getattr(data.states, name), getattr(original.states, name), "after the training")
        for name in RESPONSES:
            before = getattr(original.responses, name)
            same(name, getattr(data.responses, name), before, "after the training")

    def test_it_provides_what_it_says(self, fitted: Surrogate, unseen: TrainingSet) -> None:
        """``provides``, unless it is None, lists the responses that are there, each with its derivatives."""
        response = fitted.predict(unseen.states[:3])
        found = {name for name in RESPONSES if getattr(response, name) is not None}
        says, state = fitted.provides, states_text(unseen.states[:3])
        if says is not None:
            declared = set(says) & set(RESPONSES)
            holds(declared == found, state, f"the responses of provides, {sorted(declared)}", sorted(found))
        with_slopes = dict(with_derivatives(response))
        for name in found & {"mean_grad", "stress", "fluid_volume"}:
            empty = np.isnan(getattr(response, name)).all()
            holds(name in with_slopes or empty, state, f"derivatives of {name}", "None")

    def test_reference_state_is_exact(self, fitted: Surrogate, data: TrainingSet) -> None:
        """Responses and derivatives at rest are exact; without ``exact_at_rest`` the responses within the accuracy."""
        at_rest = fitted.predict(MacroState.zeros(1))
        known = dict(with_derivatives(data.reference))
        exact = type(fitted).exact_at_rest
        for name, slopes in with_derivatives(at_rest):
            span = float(np.ptp(getattr(data.responses, name), axis=0).max())
            within = 1e-12 if exact else type(fitted).expected_error * span
            near(name, getattr(at_rest, name), getattr(data.reference, name), "at rest", within=within)
            if exact:
                for what, slope, expected in zip(("H", "p"), slopes, known[name], strict=True):
                    near(f"d{name}/d{what}", slope, expected, "at rest", within=1e-11)

    def test_outside_is_flagged(self, fitted: Surrogate, data: TrainingSet) -> None:
        x = np.array([[-0.1, 0.1], [-0.2001, 0.1], [-0.1, 0.2401], [0.0, 0.0], [0.1, 0.3]])
        states = INPUTS.scatter(x)
        states.grad_u[3, 0, 1] = 0.01
        doubt = require("doubt", fitted.predict(states, tangent=False).doubt, states_text(states))
        for row, flagged in enumerate([False, True, True, True, True]):
            state = state_text(states.grad_u[row], states.p[row])
            holds(
                (doubt[row] != 0) == flagged,
                state,
                "a doubt" if flagged else "no doubt",
                f"doubt = {doubt[row]}",
            )
        holds(
            bool(doubt[3] & Doubt.not_sampled),
            state_text(states.grad_u[3], states.p[3]),
            "Doubt.not_sampled",
            f"doubt = {doubt[3]}",
        )
        trained = fitted.predict(data.states, tangent=False).doubt
        count = np.count_nonzero(require("doubt", trained, "the states of the training"))
        holds(not count, "the states of the training", "none flagged", f"{count} flagged")

    def test_invalid_options_are_refused(self) -> None:
        for given in self.invalid_options:
            with refused(ConfigurationError, state=options(given), naming=(next(iter(given)),)):
                self.make_invalid(given)


def _same_rows(found: CellResponse, expected: CellResponse, state: str) -> None:
    """Alike but for round-off, derivatives and flags included."""
    same("status", found.status, expected.status, state)
    assert_alike(found, expected, state, partial(near, within=1e-12), partial(near, within=1e-10))


class PotentialSuite(SurrogateSuite):
    """Further checks of a surrogate whose stress and fluid volume derive from one potential.

    They hold for every state, whether or not the training came near it.
    """

    @pytest.fixture(scope="class")
    @classmethod
    def states(cls) -> MacroState:
        """Stretched, sheared and rotated, and the undeformed state."""
        random = np.random.default_rng(11)
        grad_u = random.uniform(-0.08, 0.08, (40, 3, 3))
        grad_u[0] = 0.0
        return MacroState(grad_u, random.uniform(-0.02, 0.2, 40) * (np.arange(40) > 0))

    def test_it_provides_a_potential(self, fitted: Surrogate, states: MacroState) -> None:
        response = fitted.predict(states)
        for name in RESPONSES:
            require(name, getattr(response, name), states_text(states))
        found, wanted = sorted(dict(with_derivatives(response))), ["fluid_volume", "mean_grad", "stress"]
        holds(found == wanted, states_text(states), f"derivatives of {wanted}", found)

    def test_rest_is_free_of_energy_and_stress(self, fitted: Surrogate, data: TrainingSet) -> None:
        at_rest = fitted.predict(MacroState.zeros(1))
        near("potential", at_rest.potential, 0.0, "at rest", within=1e-12)
        near("stress", at_rest.stress, 0.0, "at rest", within=1e-12)
        near("fluid_volume", at_rest.fluid_volume, data.reference.fluid_volume, "at rest", within=1e-12)

    def test_the_tangent_is_symmetric(self, fitted: Surrogate, states: MacroState) -> None:
        tangent = require("derivatives", fitted.predict(states).tangent, states_text(states))
        A = require("∂P_E/∂H", tangent.stress_grad_u, states_text(states))
        near(
            "∂P_E/∂H, with major symmetry,", A, A.transpose(0, 3, 4, 1, 2), states_text(states), within=1e-12
        )

    def test_reciprocity(self, fitted: Surrogate, states: MacroState) -> None:
        """∂P_E/∂p = −∂φ/∂H."""
        tangent = require("derivatives", fitted.predict(states).tangent, states_text(states))
        by_H = require("∂φ/∂H", tangent.fluid_volume_grad_u, states_text(states))
        near("∂P_E/∂p = −∂φ/∂H", tangent.stress_p, -by_H, states_text(states), within=1e-12)

    def test_objectivity(self, fitted: Surrogate, states: MacroState) -> None:
        """W and φ do not feel a rotation; P_E and <∇u¹> turn with it."""
        R = _rotations(len(states), seed=3)
        turned = MacroState(R @ (np.eye(3) + states.grad_u) - np.eye(3), states.p)
        before, after = fitted.predict(states, tangent=False), fitted.predict(turned, tangent=False)
        for name in ("potential", "fluid_volume"):
            near(
                name,
                getattr(after, name),
                getattr(before, name),
                f"{states_text(states)}, turned",
                within=1e-12,
            )
        for name in ("stress", "mean_grad"):
            expected = R @ getattr(before, name)
            near(name, getattr(after, name), expected, f"{states_text(states)}, turned", within=1e-12)

    @pytest.mark.parametrize("seed", [0, 1, 2])
    def test_a_closed_cycle_does_no_work(self, fitted: Surrogate, seed: int) -> None:
        """∮ P_E:dH − φ dp over a smooth loop; the trapezoidal rule converges exponentially there."""
        random = np.random.default_rng(seed)
        (H0, H1, H2), (p0, p1, p2) = random.uniform(-0.04, 0.04, (3, 3, 3)), random.uniform(-0.03, 0.03, 3)
        angle = 2 * np.pi * np.arange(400) / 400
        cos, sin = np.cos(angle), np.sin(angle)
        loop = MacroState(
            H0 + cos[:, None, None] * H1 + sin[:, None, None] * H2, 0.08 + p0 + cos * p1 + sin * p2
        )
        response = fitted.predict(loop, tangent=False)
        dH, dp = cos[:, None, None] * H2 - sin[:, None, None] * H1, cos * p2 - sin * p1
        stress = require("stress", response.stress, states_text(loop))
        volume = require("fluid_volume", response.fluid_volume, states_text(loop))
        power = np.einsum("nij,nij->n", stress, dH) - volume * dp
        state = f"a closed loop of {len(angle)} states"
        mean = np.abs(power).mean()
        holds(mean > 1e-6, state, "a power on the way above 1e-6", mean)
        near("work", power.sum() * 2 * np.pi / len(angle), 0.0, state, within=1e-10)


def _rotations(n: int, seed: int) -> Array:
    """Random rotations (n, 3, 3), by any angle."""
    Q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(n, 3, 3)))
    rotations: Array = Q * np.linalg.det(Q)[:, None, None]
    return rotations
