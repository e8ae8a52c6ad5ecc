"""Expectations of a check (near, same, refused), messages of violations, comparison of responses."""

from __future__ import annotations

import os
import random
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import wraps
from typing import Any, TypeVar

import numpy as np

from porocore.states import Array, CellResponse, MacroState

T = TypeVar("T")
#: Characters of a text that came, in a message.
LONGEST = 300


class Violation(AssertionError):
    """A check that does not hold; ``state`` is what was asked, or the circumstances."""

    def __init__(self, state: str, expected: str, got: object) -> None:
        text = " ".join(str(got).split())
        if len(text) > LONGEST:
            text = f"{text[:LONGEST]} …"
        super().__init__(f"check '{_running()}', {state}: expected {expected}; got {text or 'nothing'}")


class Undefined(NotImplementedError):
    """A suite lacks a function that its author has to write."""


def holds(condition: object, state: str, expected: str, got: object) -> None:
    """Raise a :class:`Violation` unless ``condition`` is true."""
    __tracebackhide__ = True
    if not condition:
        raise Violation(state, expected, got)


def near(what: str, found: Any, expected: Any, state: str, *, rel: float = 0.0, within: float = 0.0) -> None:
    """Raise a :class:`Violation` unless each entry is near the expected one, which is broadcast.

    The allowed difference is the sum of ``rel``, a share of the expected entry, and ``within``.
    """
    __tracebackhide__ = True
    a, b = _alike(what, found, expected, state)
    allowed = within + rel * np.abs(b)
    with np.errstate(invalid="ignore"):
        far = ~((np.abs(a - b) <= allowed) | (a == b))
    if far.any():
        excess = np.where(np.isfinite(a), np.abs(a - b) / np.maximum(allowed, 1e-300), np.inf)
        place = np.unravel_index(int(np.argmax(np.where(far, excess, -1.0))), a.shape)
        raise Violation(
            state,
            f"{what}{_place(place)} = {b[place]:.10g} within {allowed[place]:.1e}",
            f"{a[place]:.10g}"
            + (f" ({int(far.sum())} of {a.size} entries are too far)" if a.size > 1 else ""),
        )


def same(what: str, found: Any, expected: Any, state: str) -> None:
    """Raise a :class:`Violation` unless both are alike to the last bit; NaN equals NaN."""
    __tracebackhide__ = True
    a, b = _alike(what, found, expected, state)
    far = ~((a == b) | (np.isnan(a) & np.isnan(b)))
    if far.any():
        place = np.unravel_index(int(np.argmax(far)), a.shape)
        raise Violation(
            state,
            f"{what}{_place(place)} = {b[place]:.17g} to the last bit",
            f"{a[place]:.17g}" + (f" ({int(far.sum())} of {a.size} entries differ)" if a.size > 1 else ""),
        )


def require(what: str, value: T | None, state: str) -> T:
    """Return the value; raise a :class:`Violation` where it is None."""
    __tracebackhide__ = True
    if value is None:
        raise Violation(state, what, "None")
    return value


@contextmanager
def refused(*errors: type[Exception], state: str, naming: tuple[str, ...] = ()) -> Iterator[None]:
    """Expect that the block raises one of ``errors``, with a message that holds every text of ``naming``."""
    __tracebackhide__ = True
    kinds = " or ".join(error.__name__ for error in errors)
    expected = f"a {kinds}" + (f" that names {', '.join(map(repr, naming))}" if naming else "")
    try:
        yield
    except errors as error:
        if any(text not in str(error) for text in naming):
            raise Violation(state, expected, f"{type(error).__name__}: {error}") from error
    except Exception as error:
        raise Violation(state, expected, f"{type(error).__name__}: {error}") from error
    else:
        raise Violation(state, expected, "no error")


def as_violation(check: Callable[..., None]) -> Callable[..., None]:
    """Return the check with a :class:`Violation` in the place of an error that the implementation raises in it."""

    @wraps(check)
    def telling(*arguments: Any, **named: Any) -> None:
        __tracebackhide__ = True
        try:
            check(*arguments, **named)
        except (AssertionError, Undefined):
            raise
        except Exception as error:
            raise Violation(
                "while it was tested", "that nothing is raised", f"{type(error).__name__}: {error}"
            ) from error

    return telling


def state_text(grad_u: Any, p: Any = 0.0) -> str:
    """Return a state (H, p) as text, without the components that are zero."""
    H = np.asarray(grad_u, float).reshape(3, 3)
    parts = [f"H{i + 1}{j + 1} = {H[i, j]:.4g}" for i in range(3) for j in range(3) if H[i, j]]
    parts += [f"p = {float(p):.4g}"] if p else []
    return ", ".join(parts) or "at rest"


def states_text(states: MacroState) -> str:
    """Return several states as text: the first, and how many more."""
    if not len(states):
        return "no states"
    more = f" and {len(states) - 1} more states" if len(states) > 1 else ""
    return state_text(states.grad_u[0], states.p[0]) + more


def options(given: Mapping[str, Any]) -> str:
    """Return options as text."""
    return "made with " + ", ".join(f"{name}={value!r}" for name, value in given.items())


def _running() -> str:
    """The check that pytest runs, in words."""
    test = os.environ.get("PYTEST_CURRENT_TEST", "").rpartition(" (")[0].rpartition("::")[2]
    return test.removeprefix("test_").replace("_", " ") or "unknown"


def _alike(what: str, found: Any, expected: Any, state: str) -> tuple[Any, Any]:
    """Both as arrays of floats of one shape."""
    if found is None:
        raise Violation(state, what, "None")
    a, b = np.asarray(found, float), np.asarray(expected, float)
    if a.shape != b.shape and b.shape not in ((), a.shape[-b.ndim :]):
        raise Violation(state, f"{what} of shape {b.shape}", f"shape {a.shape}")
    return a, np.broadcast_to(b, a.shape)


def _place(place: tuple[Any, ...]) -> str:
    return f"[{', '.join(map(str, place))}]" if place else ""


Compare = Callable[[str, Any, Any, str], None]
RESPONSES = ("mean_grad", "potential", "stress", "fluid_volume")
#: Responses with the names of their derivatives in :class:`~porocore.states.CellTangent`.
DERIVATIVES = {name: (f"{name}_grad_u", f"{name}_p") for name in ("mean_grad", "stress", "fluid_volume")}


def with_derivatives(response: CellResponse) -> Iterator[tuple[str, tuple[Array, Array]]]:
    """Responses that come with both derivatives, and those: with respect to H and to p."""
    for name, (by_H, by_p) in DERIVATIVES.items():
        slopes = getattr(response.tangent, by_H), getattr(response.tangent, by_p)
        if getattr(response, name) is not None and slopes[0] is not None and slopes[1] is not None:
            yield name, slopes


#: Steps of a central difference of fourth order, and its weights.
STEPS, WEIGHTS = (-2, -1, 1, 2), (1 / 12, -2 / 3, 2 / 3, -1 / 12)


def central_difference(values: Iterable[Any], h: Any) -> Any:
    """Return the derivative of what has these values at :data:`STEPS` times h, up to h⁴."""
    return sum(w * value for w, value in zip(WEIGHTS, values, strict=True)) / h


def perturbed(states: MacroState, column: int, step: float) -> MacroState:
    """The states with one of the ten components (H row by row, then p) moved."""
    flat, p = states.grad_u.reshape(-1, 9).copy(), states.p.copy()
    if column == 9:
        p += step
    else:
        flat[:, column] += step
    return replace(states, grad_u=flat.reshape(-1, 3, 3), p=p)


def assert_identical(found: CellResponse, expected: CellResponse, state: str) -> None:
    """Raise a violation unless both are alike to the last bit, derivatives and flags included."""
    assert_alike(found, expected, state, same, same)


def assert_alike(
    found: CellResponse, expected: CellResponse, state: str, value: Compare, slope: Compare
) -> None:
    """Check values and slopes, given name, found, expected and state; flags are alike to the last bit."""
    doubts = [require("doubt", each.doubt, state) for each in (found, expected)]
    same("doubt", doubts[0], doubts[1], state)
    for name in RESPONSES:
        if getattr(expected, name) is not None:
            value(name, getattr(found, name), getattr(expected, name), state)
    slopes, others = dict(with_derivatives(found)), dict(with_derivatives(expected))
    holds(slopes.keys() == others.keys(), state, f"derivatives of {sorted(others)}", sorted(slopes))
    for name in others:
        for what, a, b in zip(("H", "p"), slopes[name], others[name], strict=True):
            slope(f"d{name}/d{what}", a, b, state)


def global_random_state() -> tuple[Any, ...]:
    """Return the states of Python's and numpy's global random number generators."""
    name, keys, *place = np.random.get_state()  # noqa: NPY002
    return random.getstate(), name, np.asarray(keys).tobytes(), place
