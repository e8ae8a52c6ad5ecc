"""Coarse forms of the studies in the documents: the same commands, files and keys, fewer and larger everything."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib.figure
import numpy as np
import pytest
from matplotlib.image import imsave

import porocore.commands.calibration.cells
import porocore.commands.calibration.loading
import porocore.commands.crosscheck.comparison
import porocore.study.api.solved
import porocore.study.config.config
import porocore.study.config.loading
import porocore.study.sweep.plan
from porocore.cell.stability.map import LineSettings, MapPlan
from porocore.commands.fields import pictures
from porocore.commands.fields import pictures as geometry
from porocore.commands.representative.plan import SubvolumePlan
from porocore.commands.sensitivity.plan import StudyPlan, Sweep
from porocore.commands.verify import cases as ladder
from porocore.core.files.yaml_document import YamlDocument
from porocore.surrogates.network.options import MlpOptions, PotentialOptions

#: Modules that hold the function by which every configuration is made.
HOLDERS = (
    porocore.study.config.loading,
    porocore.study.api.solved,
    porocore.study.sweep.plan,
    porocore.commands.calibration.loading,
)
#: Iterations of a training.
TRAINING = {MlpOptions: "epochs", PotentialOptions: "iterations"}
SHORT, LONG = {"epochs": 60, "iterations": 15}, {"epochs": 2500, "iterations": 60}
#: Options by which samplers are told how many states they may take, and a number that is enough to learn from.
COUNTS, STATES = ("count", "budget"), 16
#: Of H and p: the pore wall is far from creasing there, and a state is solved in few iterations.
LOWEST, HIGHEST = -0.1, 0.06
#: Elements of a body along each axis.
ELEMENTS = 4
#: That are held against each other where none is named.
SURROGATES = ("polynomial", "torch")
#: Of the ladder, where none is named.
CASES = ("terzaghi",)


class _Command:
    """What the command that runs needs of a coarse study, by its name."""

    name = ""

    @property
    def needs_all_loads(self) -> bool:
        """The published figures are about two loads."""
        return self.name == "reproduce"

    @property
    def compares_surrogates(self) -> bool:
        """They agree when they are trained, as closely as many held-out states show."""
        return self.name == "crosscheck"


_command = _Command()


def begin(command: str) -> None:
    """Tell which command of porocore runs next."""
    _command.name = command


def coarsened(data: Mapping[str, Any]) -> dict[str, Any]:
    """The settings of a study with a coarse cell, few states, elements and steps; doing it twice changes nothing."""
    if not isinstance(data.get("sampling"), dict) or not isinstance(data.get("macro"), dict):
        return dict(data)
    cell, sampling, macro = (dict(data.get(name) or {}) for name in ("cell", "sampling", "macro"))
    cell["mesh"] = dict(cell.get("mesh") or {}) | {"size": 0.5, "fluid_size": 0.5, "element": "linear"}
    body, time = dict(macro.get("body") or {}), dict(macro.get("time") or {})
    if isinstance(body.get("elements"), list | tuple):
        body["elements"] = [min(count, ELEMENTS) for count in body["elements"]]
    if time:
        end = time["end"]
        time |= {"step": _part(end, 4), "ramp_increments": 1, "ramp_step": _part(end, 100)}
        if time.get("tolerance") is not None:
            time["tolerance"] = 0.1
    macro |= {"body": body, "time": time}
    if not _command.needs_all_loads:
        macro["loads"] = [min(macro["loads"], key=abs)]
    return dict(data) | {"cell": cell, "sampling": _sampled(sampling), "macro": macro}


def _part(time: float | str, count: int) -> float | str:
    """One ``count``-th of a time, which may have a unit."""
    number, *unit = str(time).split(maxsplit=1)
    return f"{float(number) / count:.12g} {unit[0]}" if unit else float(number) / count


def _sampled(sampling: dict[str, Any]) -> dict[str, Any]:
    options, inputs = dict(sampling.get("options") or {}), {}
    for name, swept in sampling.get("inputs", {}).items():
        numbers = [value for value in swept["range"] if not isinstance(value, str)]
        low, high = (
            swept["range"] if len(numbers) < 2 else (max(numbers[0], LOWEST), min(numbers[1], HIGHEST))
        )
        inputs[name] = dict(swept) | {"range": [low, high]}
        if swept.get("step") is not None:
            inputs[name]["step"] = (high - low) / (2 if _command.compares_surrogates else 1)
    coarse = {
        "workers": 1,
        "test": dict(sampling.get("test") or {}) | {"count": 16 if _command.compares_surrogates else 2},
        "options": options | {name: STATES for name in COUNTS if name in options},
        "inputs": inputs,
    }
    if sampling.get("tolerance") is not None:
        coarse["tolerance"] = 1.0
    return sampling | coarse


def make_coarse(patch: pytest.MonkeyPatch) -> None:
    """From now on all studies of this process are coarse, and pictures are written without being drawn."""
    validated = porocore.study.config.loading.validated

    def coarse(document: YamlDocument, **how: Any) -> porocore.study.config.config.RunConfig:
        return validated(dataclasses.replace(document, data=coarsened(document.data)), **how)

    for module in HOLDERS:
        patch.setattr(module, "validated", coarse)
    for options, name in TRAINING.items():
        patch.setattr(options, "parse", _with_at_most(options.parse, name))
    _shrink(
        patch, StudyPlan, sweeps=lambda plan: {name: _short(sweep) for name, sweep in plan.sweeps.items()}
    )
    _shrink(
        patch,
        MapPlan,
        along=lambda plan: {name: max(min(goal, HIGHEST), LOWEST) for name, goal in plan.along.items()},
        values=lambda plan: plan.values[:1],
        line=lambda plan: LineSettings(1, 0.1, plan.line.eigenvalues),
    )
    _shrink(patch, SubvolumePlan, sizes=lambda plan: (6, 8), count=lambda plan: 1, element=lambda plan: 2.0)
    find = porocore.commands.crosscheck.comparison.select_backends
    patch.setattr(
        porocore.commands.crosscheck.comparison,
        "select_backends",
        lambda fem, names: find(fem, names or SURROGATES),
    )
    run_cases, select_cases = ladder.run_cases, ladder.select_cases
    patch.setattr(ladder, "select_cases", lambda names: select_cases(names or CASES))
    patch.setattr(ladder, "run_cases", lambda *words, long, **named: run_cases(*words, long=False, **named))
    # At a larger load a coarse body soon leaves the few states that its surrogate knows, in ever shorter steps.
    further = porocore.commands.calibration.cells
    patch.setattr(further, "LOADS", (min(further.LOADS),))
    # What is on them is tested with the reports and the local fields, and takes most of the time of a small study.
    patch.setattr(matplotlib.figure.Figure, "draw", lambda figure, renderer: None)
    for module in (pictures, geometry):
        patch.setattr(module, "draw_views", _blank)


def _blank(vtu: Path, views: Sequence[pictures.View], scratch: Path) -> None:
    for view in views:
        imsave(view.png, np.full((*view.size[::-1], 3), 0.5))


def _short(sweep: Sweep) -> Sweep:
    return Sweep(max(sweep.lower, LOWEST), min(sweep.upper, HIGHEST), 0.1)


def _with_at_most(parse: Callable[..., Any], name: str) -> Callable[..., Any]:
    def parsed(options: dict[str, Any], backend: str) -> Any:
        count = (LONG if _command.compares_surrogates else SHORT)[name]
        given = options.get(name, count)
        return parse(options | {name: min(given, count) if isinstance(given, int) else given}, backend)

    return parsed


def _shrink(patch: pytest.MonkeyPatch, plan: type, **fields: Callable[[Any], Any]) -> None:
    """Change fields of every new object of a frozen class after it has checked them."""
    check = plan.__post_init__

    def checked(made: Any) -> None:
        check(made)
        for name, field in fields.items():
            object.__setattr__(made, name, field(made))

    patch.setattr(plan, "__post_init__", checked)
