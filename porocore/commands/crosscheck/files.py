"""Files crosscheck.json and crosscheck.html: every compared number as plain data."""

from __future__ import annotations

from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from porocore.commands.crosscheck.bodies import DERIVATIVES, RESPONSES, BodyRun, CellRun
from porocore.commands.crosscheck.check import CrossCheck
from porocore.commands.crosscheck.comparison import Comparison
from porocore.commands.crosscheck.page import render
from porocore.core.files.atomic import atomic_path
from porocore.core.files.plain_data import json_ready, write_json
from porocore.states import CellResponse, Status
from porocore.study.run.folder import versions

FORMAT, VERSION = "porocore-crosscheck", 1


def write(folder: Path, result: CrossCheck) -> tuple[Path, Path]:
    """Paths of crosscheck.json and crosscheck.html, which take the place of older ones.

    Raises
    ------
    RunFolderError
        The folder cannot be written.
    """
    data, page = folder / "crosscheck.json", folder / "crosscheck.html"
    write_json(data, document(result), allow_nan=False)
    with atomic_path(page) as part:
        part.write_text(render(result), encoding="utf-8")
    return data, page


def document(result: CrossCheck) -> dict[str, Any]:
    """Everything, ready for JSON; what is not finite is null."""
    samples = result.samples
    found = {
        "format": FORMAT,
        "version": VERSION,
        "passed": result.passed,
        "failed": len(result.failed),
        "worst": _line(result.worst) if result.comparisons else None,
        "comparisons": [_line(line) for line in result.comparisons],
        "cells": {run.backend: _cell(run) for run in result.cells},
        "samples": None
        if samples is None
        else {
            "backend": samples.backend,
            "learned_from": len(samples.training.states),
            "held_out": len(samples.states),
            "span": {name: samples.span(name) for name in RESPONSES if samples.has(name)},
            "porosity": samples.reference.porosity,
            "mesh": samples.reference.mesh,
            "seconds": samples.seconds,
        },
        "surrogates": {
            run.name: {
                "held_out_error": run.errors,
                "failure": run.failure or None,
                "seconds": run.seconds,
            }
            for run in result.surrogates
        },
        "bodies": [_body(run) for run in result.bodies],
        "versions": versions(),
        "configuration": result.config.model_dump(mode="json"),
    }
    ready: dict[str, Any] = json_ready(found)
    return ready


def _line(line: Comparison) -> dict[str, Any]:
    return asdict(line) | {"passed": line.passed}


def _cell(run: CellRun) -> dict[str, Any]:
    return {
        "states": {name: _response(response) for name, response in run.responses.items()},
        "conductivity": run.conductivity,
        "failures": run.failures,
        "seconds": run.seconds,
    }


def _response(response: CellResponse) -> dict[str, Any]:
    values = {name: getattr(response, name) for name in RESPONSES}
    values |= {name: getattr(response.tangent, name, None) for name in DERIVATIVES}
    return {"status": Status(int(response.status[0])).name} | {
        name: None if value is None else value[0] for name, value in values.items()
    }


def _body(run: BodyRun) -> dict[str, Any]:
    history = None if run.solution is None else run.solution.history
    return {
        "backend": run.backend,
        "law": run.law,
        "failure": run.failure or None,
        "seconds": run.seconds,
        "history": None if history is None else {f.name: getattr(history, f.name) for f in fields(history)},
        "profiles": None
        if run.solution is None
        else [
            {"time": profile.time, "points": run.solution.points, "u": profile.u, "p": profile.p}
            for profile in run.solution.profiles
        ],
    }
