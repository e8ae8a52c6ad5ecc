"""Traces of runs: what each task told its forecast, and when, on the wall clock and on the processor's."""

from __future__ import annotations

import io
import os
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import astuple, replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

from porocore.core.console import Console, Task
from porocore.interfaces.sampler import Outlook
from porocore.interfaces.surrogate import TrainingProgress
from porocore.macro.integration.newton import StepForecast
from porocore.plugins.registry import registry
from porocore.sampling.forecast import Guess, StateForecast
from porocore.study.config.config import RunConfig
from porocore.study.run import pipeline
from porocore.study.run.folder import RunFolder
from porocore.study.run.training import TrainingCurveFile

#: Ticks of the processor's clock in a second.
TICKS = os.sysconf("SC_CLK_TCK")


def processor_seconds() -> float:
    """Return the processor time of this process and of all that it started, the living ones included."""
    ended = os.times()
    return time.process_time() + ended.children_user + ended.children_system + _descendants(os.getpid())


def _descendants(pid: int) -> float:
    seconds = 0.0
    for children in Path(f"/proc/{pid}/task").glob("*/children"):
        for child in children.read_text().split():
            try:
                used = Path(f"/proc/{child}/stat").read_text().rpartition(")")[2].split()[11:15]
            except OSError:
                continue
            seconds += sum(map(int, used)) / TICKS + _descendants(int(child))
    return seconds


class Recorder(Console):
    """Console that keeps the time of every report and what the forecasts were told since the one before."""

    def __init__(self) -> None:
        super().__init__(io.StringIO())
        self.tasks: list[dict[str, Any]] = []
        self._told: list[Any] = []
        self._begun = (0.0, 0.0)

    @contextmanager
    def task(self, title: str, unit: str, begins: str = "") -> Iterator[Task]:
        """Record each report of a task: seconds since it began, done, total, and what was told."""
        self._told, self._begun = [], (time.monotonic(), processor_seconds())
        record: dict[str, Any] = {"title": title, "reports": []}
        self.tasks.append(record)
        with super().task(title, unit, begins) as task:
            update = task.update

            def recorded(done: float, total: float, **named: Any) -> None:
                record["reports"].append([*self._now(), done, total, self._told])
                self._told = []
                update(done, total, **named)

            task.update = recorded  # type: ignore[method-assign]
            yield task
        record["seconds"] = self._now()

    def _now(self) -> tuple[float, float]:
        now = time.monotonic(), processor_seconds()
        return round(now[0] - self._begun[0], 4), round(now[1] - self._begun[1], 4)

    @contextmanager
    def listening(self) -> Iterator[None]:
        """Hear what the forecasts are told."""
        with ExitStack() as stack:
            for kind, method, of in (
                (StepForecast, "add", lambda time: time),
                (StateForecast, "__init__", lambda inputs, guess: ["guess", *astuple(guess)]),
                (StateForecast, "look", lambda outlook: ["look", *astuple(outlook)]),
                (StateForecast, "decided", lambda seconds: ["decided", seconds]),
                (StateForecast, "add", lambda x, expected, **more: ["add", x, expected, *more.values()]),
                (TrainingCurveFile, "add", lambda p: [p.epoch, p.epochs, p.ends]),
            ):
                stack.enter_context(patch.object(kind, method, self._heard(getattr(kind, method), of)))
            yield

    def _heard(self, method: Callable[..., None], of: Callable[..., Any]) -> Callable[..., None]:
        def heard(forecast: Any, *args: Any, **named: Any) -> None:
            self._told.append(of(*args, **named))
            method(forecast, *args, **named)

        return heard


def recorded(config: RunConfig, laws: Sequence[Any]) -> list[dict[str, Any]]:
    """Run a study and return what its tasks told their forecasts."""
    console = Recorder()
    registry().get("surrogate", config.surrogate.backend).load_libraries()
    with (
        console.listening(),
        tempfile.TemporaryDirectory() as folder,
        RunFolder.claim(Path(folder) / "run", config) as claimed,
    ):
        pipeline.solve_reference(claimed, console=console)
        pipeline.sample(claimed, console=console)
        pipeline.train(claimed, console=console)
        pipeline.solve(claimed, console=console, laws=laws)
    return console.tasks


def replayed(
    task: dict[str, Any], config: RunConfig, clock: str = "wall", slower: float = 1.0
) -> tuple[list[tuple[float, float | None]], float]:
    """Return time and estimate of each report as the present sources would have shown it, and the whole time."""
    column, now, shown = ("wall", "cpu").index(clock), 0.0, []
    title, work = task["title"], (0.0, 1.0)
    replay = Task(title, "", "", lambda share: None, lambda: now)
    steps, inputs = None, config.sampling.input_space()
    states = StateForecast(inputs)
    # What was told in seconds of the wall clock.
    scale = slower * task["seconds"][column] / task["seconds"][0]
    if "load " in title:
        steps = StepForecast(config.macro.problem(float(title.rpartition(" ")[2])))
    for *times, done, total, told in task["reports"]:
        now = slower * times[column]
        if steps is not None:
            for time_reached in told:
                steps.add(time_reached)
            work = steps.work if told else work
        elif title != "training":
            for kind, *values in told:
                if kind == "guess":
                    states = StateForecast(inputs, scaled(Guess(*values), scale))
                else:
                    _tell(states, kind, values, scale, now)
            replay.update(done, total, seconds=states.seconds())
            shown.append((now, replay.left))
            continue
        else:
            work = (done, TrainingProgress(int(done), int(total), 0.0, 0.0, *told[-1][2:]).left)
        replay.update(done, total, work=work)
        shown.append((now, replay.left))
    return shown, slower * task["seconds"][column]


def scaled(guess: Guess, scale: float) -> Guess:
    """Return a guess on a clock that goes so many times as fast."""
    seconds = {name: scale * getattr(guess, name) for name in ("start", "state", "decision")}
    return replace(guess, **seconds)


def _tell(states: StateForecast, kind: str, values: list[Any], scale: float, now: float) -> None:
    if kind == "look":
        states.look(Outlook(*values))
    elif kind == "decided":
        states.decided(scale * values[0])
    else:
        x, expected, outward, seconds, _ = values
        known = None if seconds is None else scale * seconds
        states.add(tuple(x), expected, outward=outward, seconds=known, now=now)
