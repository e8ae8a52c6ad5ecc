"""Sampler ``density-sweep``: sweeps of one input at a time, refined where the response bends."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from porocore.core.echo import echo, suggestion
from porocore.core.inputs.input_space import InputSpace, value_text
from porocore.core.models.bounds import MOST_STATES
from porocore.errors import ConfigurationError
from porocore.interfaces.sampler import Request, Sampler
from porocore.sampling.samplers.line import LinePoint, LineSweep, grid_size
from porocore.sampling.samplers.options import check_waiting, positive, refuse_unknown
from porocore.states import CellResponse, Status

#: Values closer than this would share a key.
SMALLEST_INTERVAL = 1e-9


class DensitySweep(Sampler):
    """One-factor-at-a-time sampling with a check of the output density (Dehghani & Zilian, eq. Res).

    The first input is swept from zero to both ends of its range with the others at zero. Every accepted value
    starts sweeps of each later input from there, and so on, all independent of one another: whatever can be
    solved is asked for at once. Each sweep is a :class:`~porocore.sampling.samplers.line.LineSweep`, which says how the
    step is halved, what happens near a zero of <∇u¹>, and how the edge of the computable region is resolved.
    The first step of a sweep has no two points behind it and is accepted unchecked.

    A state starts from the field of the last accepted state of its sweep. A state without values is data
    too, but starts no further sweeps. Keys are the inputs to ten decimals, such as
    ``p=+0.0800000000 H22=-0.1200000000``.

    Parameters
    ----------
    inputs
        Each range must include 0. Their order is that of the nesting: put first what is solvable alone.
    step
        Default step of each input, by name.
    tolerance
        Largest residual, a fraction of ‖<∇u¹>_s‖_F.
    smallest : float, above 0, at most 1
        Smallest interval as a fraction of the default step.

    Raises
    ------
    ConfigurationError
        An option is unknown, missing or of no use; the message begins with its key in a configuration.
    """

    samples_parameters = False

    def __init__(
        self,
        inputs: InputSpace,
        step: Mapping[str, float] | None = None,
        tolerance: float = 0.05,
        smallest: float = 0.125,
        **unknown: Any,
    ) -> None:
        refuse_unknown("density-sweep", ("smallest",), unknown)
        if inputs.parameters:
            raise ConfigurationError(
                "sampling.sampler: density-sweep sweeps from the undeformed cell, and varies no parameters of the cell "
                f"({', '.join(inputs.parameters)}); take another sampler such as sobol, or give each of them one value"
            )
        self.inputs = inputs
        self.tolerance = positive("sampling.tolerance", tolerance)
        self.smallest = positive("sampling.options.smallest", smallest)
        if self.smallest > 1:
            raise ConfigurationError(
                f"sampling.options.smallest: must be a fraction of the step in (0, 1], got {echo(smallest)}"
            )
        self.steps = _checked_steps(inputs, step or {}, self.smallest)
        for name, low, high in zip(inputs.names, inputs.lower, inputs.upper, strict=True):
            if not low <= 0 <= high:
                raise ConfigurationError(
                    f"sampling.inputs.{name}.range: must include 0, where every sweep of density-sweep starts, "
                    f"got {inputs.range_text(name)}; widen it"
                )
        sizes = [
            1 + sum(grid_size(end, step) for end in (low, high) if end != 0)
            for low, high, step in zip(inputs.lower, inputs.upper, self.steps, strict=True)
        ]
        if (states := math.prod(sizes)) > MOST_STATES:
            each = " × ".join(f"{size:.4g} of {name}" for name, size in zip(inputs.names, sizes, strict=True))
            raise ConfigurationError(
                f"sampling.inputs: the steps make a grid of {float(states):.3g} states ({each}); at most {MOST_STATES} "
                "are solved: enlarge the steps, or take another sampler such as sobol"
            )
        self._grid_sizes = sizes
        #: For each input, the number of grid states that one of its values begets, itself included.
        self._subtree = [math.prod(sizes[k + 1 :]) for k in range(len(inputs))]
        root = (0.0,) * len(inputs)
        key = state_key(inputs, root)
        self._waiting: dict[str, tuple[tuple[float, ...], LineSweep | None]] = {key: (root, None)}
        self._ready = [Request(key, root)]
        self._asked = 1

    def ask(self) -> list[Request]:
        """Return the next state of every sweep that waits for none."""
        ready, self._ready = self._ready, []
        return ready

    def tell(self, key: str, response: CellResponse) -> None:
        """Record the response of one state, move its sweep on and start those that branch off."""
        check_waiting(key, self._waiting)
        x, line = self._waiting.pop(key)
        has_values = Status(int(response.status[0])).has_values
        mean_grad = response.mean_grad[0].copy() if has_values else None
        if line is None:
            if mean_grad is not None:
                self._branch((), LinePoint(0.0, mean_grad))
            return
        for point in line.tell(LinePoint(x[line.position], mean_grad)):
            self._branch(line.prefix, point)
        self._move_on(line)

    @property
    def done(self) -> bool:
        """True when every sweep has reached its end."""
        return not self._waiting

    @property
    def expected(self) -> int:
        """Number of states asked for and still to come if no step is halved again."""
        foreseen = 0
        for _, line in self._waiting.values():
            if line is None:
                foreseen += self._subtree[0] * self._grid_sizes[0] - 1
            else:
                subtree = self._subtree[line.position]
                foreseen += len(line.grid) * subtree + (len(line.ahead) + 1) * (subtree - 1)
        return self._asked + foreseen

    def _branch(self, prefix: tuple[float, ...], point: LinePoint) -> None:
        """Start the sweeps of the inputs that follow ``prefix`` and the value of ``point``."""
        fixed = (*prefix, point.value) if prefix or point.value != 0 else ()
        for k in range(len(fixed), len(self.inputs)):
            resting = fixed + (0.0,) * (k - len(fixed))
            origin = LinePoint(0.0, point.mean_grad)
            for end in (self.inputs.upper[k], self.inputs.lower[k]):
                if end != 0:
                    self._move_on(
                        LineSweep(resting, origin, end, self.steps[k], self.tolerance, self.smallest)
                    )

    def _move_on(self, line: LineSweep) -> None:
        value = line.next_value()
        if value is None:
            return
        x = self._complete((*line.prefix, value))
        key = state_key(self.inputs, x)
        # A state belongs to the one sweep that moves its last non-zero input, so no two sweeps meet.
        assert key not in self._waiting
        self._waiting[key] = (x, line)
        start = state_key(self.inputs, self._complete((*line.prefix, line.last.value)))
        self._ready.append(Request(key, x, start))
        self._asked += 1

    def _complete(self, values: tuple[float, ...]) -> tuple[float, ...]:
        return values + (0.0,) * (len(self.inputs) - len(values))


def state_key(inputs: InputSpace, x: tuple[float, ...]) -> str:
    """Return the values of the inputs as text, such as ``p=+0.0800000000 H22=-0.1200000000``."""
    return " ".join(f"{name}={value:+.10f}" for name, value in zip(inputs.names, x, strict=True))


def _checked_steps(inputs: InputSpace, step: Mapping[str, float], smallest: float) -> tuple[float, ...]:
    for name in step:
        if name not in inputs.names:
            raise ConfigurationError(
                f"sampling.options.step.{name}: names no sampled input; "
                + suggestion(name, inputs.names, "these are")
            )
    steps = []
    for name in inputs.names:
        if name not in step:
            raise ConfigurationError(
                f"sampling.inputs.{name}.step: missing, and density-sweep needs it; give the default step of '{name}'"
            )
        size = positive(f"sampling.inputs.{name}.step", step[name])
        if size * smallest < SMALLEST_INTERVAL:
            raise ConfigurationError(
                f"sampling.inputs.{name}.step: {value_text(name, size)} with smallest = {smallest:g} allows intervals "
                f"below {value_text(name, SMALLEST_INTERVAL)}; enlarge one of them"
            )
        steps.append(size)
    return tuple(steps)
