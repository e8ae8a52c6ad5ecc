"""Prediction from a surrogate's file in another process, and a watch over unpickling."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from porocore.states import Array, CellResponse, MacroState
from porocore.testing.expect import RESPONSES, with_derivatives

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
