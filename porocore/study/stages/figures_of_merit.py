"""Contents of metrics.json but the stage times: cell, sampling, surrogate, loads, errors."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from porocore.macro.linear_systems.figures import work_figures
from porocore.macro.oscillation import diffusion_time
from porocore.report.context import ReportContext, SurrogateSummary
from porocore.report.dimensional import dimensional_metrics, figures_with_units
from porocore.report.law_differences import law_differences
from porocore.report.loading_mode import reactions
from porocore.report.metrics import case_metrics, without_settlement
from porocore.report.text import all_warnings
from porocore.report.words.held_out import (
    rms_percent,
    rms_percent_in_body,
    worst_percent,
    worst_percent_in_body,
)
from porocore.report.words.parameters import family_figures, group_errors
from porocore.report.words.statuses import solved_shares, visited_shares
from porocore.states import Status
from porocore.study.findings.body_cells import rest_of_body
from porocore.study.outline.at_rest import cell_length
from porocore.study.stages.results import RunResults

#: Sections of the body whose figures have units.
WITH_UNITS = ("macro", "reactions")


def figures_of_merit(results: RunResults, context: ReportContext) -> dict[str, Any]:
    """Return what ``metrics.json`` holds, apart from the times of the stages."""
    limit = diffusion_time(results.config.macro, rest_of_body(results))
    figures = dict if context.loading_mode.settles else without_settlement
    (first, *others), cells = context.of_each_cell, results.by_cell
    found: dict[str, Any] = {
        "warnings": all_warnings(context),
        **_of_cell(cells[None], first),
        "macro": [
            {
                **figures(case_metrics(case)),
                "mesh_diffusion_time": limit,
                "gaps": law_differences(case),
                "cell_states": visited_shares(part.nonlinear, first.sampling),
            }
            for case, part in zip(context.cases, first.cases, strict=True)
        ],
    }
    if context.loading_mode.displaced:
        found["reactions"] = [
            {"law": each.law, "load": each.load, "surfaces": reactions(each)}
            for each in results.all_solutions
        ]
    if context.units.given:
        found |= {
            name: figures_with_units(found[name], context.units) for name in WITH_UNITS if name in found
        }
        found["dimensional"] = dimensional_metrics(results.all_solutions, context.units)
    if worked := [each for each in results.all_solutions if each.work]:
        found["linear_systems"] = [work_figures(each) for each in worked]
    if others:
        found["cells"] = {
            each.name: _of_cell(cells[each.name], each)
            | {"cell_states": [visited_shares(case.nonlinear, each.sampling) for case in each.cases]}
            for each in others
        }
    if context.fallbacks:
        found["fallback"] = [asdict(done) for done in context.fallbacks]
    if context.direct:
        found["direct"] = [asdict(cost) | {"speed_up": cost.speed_up} for cost in context.direct]
    return found


def _of_cell(results: RunResults, context: ReportContext) -> dict[str, Any]:
    """Return the figures of one cell, its samples and its surrogates."""
    closure = context.surrogate.closure_error
    found = {
        "cell": figures_with_units(_cell(results), context.units)
        | {"properties": context.cell.properties.in_units(context.units, cell_length(results.config))},
        "sampling": _sampling(results, context),
        "surrogate": _surrogate(context),
        "closure": None if closure is None else closure.for_json(),
    }
    if context.family is not None:
        used = {} if context.body is None else context.body.used()
        errors = group_errors(context.surrogate.outputs)
        found["parameters"] = family_figures(context.family, errors, used)
    if context.other_surrogates:
        found["other_surrogates"] = {each.closure: _errors(each) for each in context.other_surrogates}
    return found


def _cell(results: RunResults) -> dict[str, Any]:
    reference, c = results.reference, results.coefficients
    return {
        "porosity": reference.porosity,
        "conductivity": reference.conductivity.tolist(),
        "permeability": (reference.conductivity * results.config.cell.viscosity).tolist(),
        "M_2222": float(c.mean_grad_grad_u[1, 1, 1, 1]),
        "M_2211": float(c.mean_grad_grad_u[1, 1, 0, 0]),
        "M": (c.mean_grad_grad_u + 0.0).tolist(),
        "Q_11": float(c.mean_grad_p[0, 0]),
        "Q": (c.mean_grad_p + 0.0).tolist(),
        "C_eff_2222": float(c.stiffness[1, 1, 1, 1]),
        "C_eff": c.stiffness.tolist(),
        "biot_coefficient": float(c.biot[1, 1]),
        "biot_tensor": c.biot.tolist(),
        "biot_modulus": c.biot_modulus,
        "consolidation_coefficients": [c.consolidation_coefficient(axis) for axis in range(3)],
    }


def _sampling(results: RunResults, context: ReportContext) -> dict[str, Any]:
    dataset, held_out = results.dataset, results.held_out
    return {
        "states": len(dataset),
        "statuses": _counts(dataset.responses().status),
        "shares": solved_shares(context.sampling),
        "solve_seconds_mean": float(np.mean(dataset.seconds())),
        "held_out_states": len(held_out),
        "held_out_statuses": _counts(held_out.responses().status),
    }


def _surrogate(context: ReportContext) -> dict[str, Any]:
    outputs = context.surrogate.outputs
    return {
        "training_states": context.surrogate.training_states,
        "test_states": int(outputs[0].counted.sum()) if outputs else 0,
        "test_states_beyond_range": bool(outputs) and outputs[0].all_outside,
        **_errors(context.surrogate),
    }


def _errors(summary: SurrogateSummary) -> dict[str, Any]:
    return {
        "rms_error_percent_of_range": {check.plain: rms_percent(check) for check in summary.outputs},
        "largest_error_percent_of_range": {check.plain: worst_percent(check) for check in summary.outputs},
        "rms_error_percent_of_range_in_body": {c.plain: rms_percent_in_body(c) for c in summary.outputs},
        "largest_error_percent_of_range_in_body": {
            c.plain: worst_percent_in_body(c) for c in summary.outputs
        },
    }


def _counts(status: Any) -> dict[str, int]:
    return {s.name: int((status == s).sum()) for s in Status if (status == s).any()}
