"""(r) One step of the benchmark's column: law, integration of the tangent, sparse solve, and the rest.

A column of 106 elements with the paper's closure on a network of its size, with the potential closure on a polynomial,
and with the linear law; the first two are trained to a made-up cell, how well does not matter here. All are parts of
one and the same run; the best of several runs.
"""

from __future__ import annotations

from time import process_time
from typing import Any

from common import table
from surrogate_calls import SURROGATES, trained

from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.core.inputs import InputSpace
from porocore.macro.laws.closure import make_closure
from porocore.macro.laws.macro_law import ClosedLaw
from porocore.plugins.registry import registry
from porocore.testing.synthetic.response import CONDUCTIVITY, SOLID_FRACTION, confined_column, linear_law

RUNS = 7
PLAN = {"end": 15.0, "step": 0.75, "ramp_increments": 10, "ramp_step": 0.075, "profiles": ()}


class Parts:
    """Processor time of some calls, each without the others."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    def watch(self, of: Any, method: str, part: str) -> None:
        call = getattr(of, method)

        def watched(*words: Any, **named: Any) -> Any:
            began = process_time()
            try:
                return call(*words, **named)
            finally:
                self.seconds[part] = self.seconds.get(part, 0.0) + process_time() - began

        setattr(of, method, watched)


def run(law: Any) -> dict[str, float]:
    """A whole solve: seconds of its parts."""
    solver = registry().get("macro solver", "skfem")(checkpoint_seconds=1e9)
    d = solver.prepare(confined_column(106, load=-0.01, time=PLAN))
    parts = Parts()
    for of, method, part in ((law, "respond", "law"), (d, "system", "tangent"), (d, "solve", "solve")):
        parts.watch(of, method, part)
    began = process_time()
    steps = len(solver.solve(d, law).history.time) - 1
    whole = process_time() - began
    del law.respond
    return {name: 1e3 * value / steps for name, value in {**parts.seconds, "whole": whole}.items()}


def closed_law(closure: str, surrogate: str) -> ClosedLaw:
    """The law of a closure on a surrogate of ``surrogate_calls.py``."""
    backend, options, _ = SURROGATES[surrogate]
    inputs = InputSpace(("H22", "p"), (-0.2, 0.0), (0.0, 0.2))
    return ClosedLaw(
        trained(backend, options, inputs), make_closure(closure, SOLID_FRACTION, NeoHookean(), CONDUCTIVITY)
    )


def main() -> str:
    laws = {
        "mean-gradient, the paper's network": closed_law("mean-gradient", "the paper's network, torch"),
        "potential, polynomial": closed_law("potential", "polynomial"),
        "linear": linear_law(),
    }
    rows = []
    for title, each in laws.items():
        found = min((run(each) for _ in range(RUNS)), key=lambda parts: parts["whole"])
        rest = found["whole"] - found["law"] - found["tangent"] - found["solve"]
        rows.append(
            [title, *(f"{found[name]:.1f}" for name in ("law", "tangent", "solve")), f"{rest:.1f}",
             f"{found['whole']:.1f}", f"{found['whole'] / (found['law'] + found['solve']):.2f}"]
        )  # fmt: skip
    return table(
        "(r) A step of the benchmark's column, milliseconds of processor time",
        [
            "law",
            "its evaluation",
            "integration of the tangent",
            "sparse solve",
            "rest",
            "step",
            "of law and solve",
        ],
        rows,
    )


if __name__ == "__main__":
    print(main())
