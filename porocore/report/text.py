"""Results in sentences, and in tables beside a publication."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from porocore.macro.laws.pull_back import is_isotropic
from porocore.report.context import CellSummary, Published, ReportContext, SurrogateSummary
from porocore.report.format import NONE, difference, number, percent, plain
from porocore.report.metrics import LoadCase, case_metrics, case_warnings, leaving
from porocore.states import Status

#: What each status means, in plain words.
MEANINGS: dict[Status, str] = {
    Status.converged: "in equilibrium, and stable as far as the solved part of the cell can tell",
    Status.contact: "in equilibrium and stable, with the pore wall pressed against itself or its mirror image",
    Status.unstable: "in equilibrium, but the cell would leave it at the least disturbance (indefinite "
    "tangent); the values are kept",
    Status.overlap: "the pore wall has passed through itself or its mirror image, or no fluid volume is "
    "left, although every point still has J > 0; no valid data",
    Status.inverted: "no load step, however small, keeps J > 0; no data",
    Status.not_converged: "the limit of iterations or steps was reached; no data",
    Status.lost: "twice the worker died over it or its time was over, which may not be the cell's fault; no data",
}


@dataclass(frozen=True)
class ComparisonRow:
    """Quantity with its published value and that of this run."""

    name: str
    published: str
    found: str


def case_sentences(metrics: dict[str, Any]) -> list[str]:
    """Return a load case, given its :func:`porocore.report.metrics.case_metrics`, in a few sentences."""
    nonlinear, linear = metrics["nonlinear"], metrics["linear"]
    settled, expected = nonlinear["final_settlement"], linear["final_settlement"]
    sentences = [
        f"Under the load {plain(metrics['load'])} the settlement ends at {number(settled)} with the "
        f"cell's own law and at {number(expected)} with linear poroelasticity of the same cell: "
        f"{difference(metrics['settlement_ratio'])}."
    ]
    if nonlinear["time_to_99_percent"] is not None and linear["time_to_99_percent"] is not None:
        sentences.append(
            f"95 % of the final settlement is reached at t = {number(nonlinear['time_to_95_percent'], 3)} "
            f"against {number(linear['time_to_95_percent'], 3)}, 99 % at "
            f"t = {number(nonlinear['time_to_99_percent'], 3)} against "
            f"{number(linear['time_to_99_percent'], 3)} "
            f"({difference(metrics['time_to_99_percent_ratio'], 'sooner', 'later')})."
        )
    if nonlinear["flagged_largest"] > 0:
        sentences.append(
            f"At the end {percent(nonlinear['flagged_end'], 0)} of the body lies beyond the states that the "
            f"surrogate was trained on ({leaving(nonlinear)})."
        )
    else:
        sentences.append("Every state of the body lies within the range that the surrogate was trained on.")
    return sentences


def benchmark_rows(published: Published, metrics: dict[str, Any]) -> list[ComparisonRow]:
    """Return the statements of the publication on one load beside the figures of that load."""
    nonlinear, linear = metrics["nonlinear"], metrics["linear"]
    return [
        ComparisonRow(
            "final settlement, nonlinear against linear",
            published.settlement,
            difference(metrics["settlement_ratio"]),
        ),
        ComparisonRow(
            "steady state, nonlinear",
            f"at t = {plain(published.steady_time)} (no criterion stated)",
            f"95 % at t = {number(nonlinear['time_to_95_percent'], 3)}, "
            f"99 % at t = {number(nonlinear['time_to_99_percent'], 3)}",
        ),
        ComparisonRow(
            "steady state, nonlinear against linear",
            published.duration,
            f"to 95 %: {difference(metrics['time_to_95_percent_ratio'], 'sooner', 'later')} (linear: t = "
            f"{number(linear['time_to_95_percent'], 3)}); to 99 %: "
            f"{difference(metrics['time_to_99_percent_ratio'], 'sooner', 'later')} (linear: t = "
            f"{number(linear['time_to_99_percent'], 3)})",
        ),
    ]


def cell_rows(cell: CellSummary, published: Published | None) -> list[ComparisonRow]:
    """Return porosity, conductivity and micro–macro tangents of the undeformed cell."""
    linear = cell.linear
    M, Q = linear.mean_grad_grad_u, linear.mean_grad_p
    said = [NONE] * 5
    if published is not None:
        said = [
            number(published.porosity, 2),
            number(published.conductivity_viscosity / cell.viscosity, 4),
            number(published.mean_grad_2222, 2),
            number(published.mean_grad_2211, 2),
            number(published.mean_grad_p_11, 3),
        ]
    names = ("porosity φ_f", f"K₁₁ at μ_f = {plain(cell.viscosity)}", "M₂₂₂₂", "M₂₂₁₁", "Q₁₁")
    found = (cell.porosity, linear.conductivity[0, 0], M[1, 1, 1, 1], M[1, 1, 0, 0], Q[0, 0])
    return [
        ComparisonRow(name, text, number(float(value)))
        for name, text, value in zip(names, said, found, strict=True)
    ]


def linear_rows(cell: CellSummary) -> list[tuple[str, str]]:
    """Return the coefficients of linear poroelasticity."""
    linear = cell.linear
    return [
        ("drained stiffness C_eff,2222 / E", number(float(linear.stiffness[1, 1, 1, 1]))),
        ("Biot coefficient α₂₂", number(float(linear.biot[1, 1]))),
        ("inverse Biot modulus E / M_B", number(linear.storage)),
        ("consolidation coefficient c_v", number(linear.consolidation_coefficient())),
    ]


#: How K is carried along, by whether it turns with the solid.
_CARRIED = {
    False: "carried along with F̄ as in the paper: the figures show K_t = F̄⁻¹ K F̄⁻ᵀ",
    True: "turned with the solid and carried along with F̄ = R̄ Ū: the figures show K_t = Ū⁻¹ K Ū⁻¹",
}


def conductivity_sentence(case: LoadCase, cell: CellSummary) -> str:
    """Return which conductivity the flux goes by, and its component 22 at the last profile."""
    if cell.law == "deformed":
        found = (
            "K_ref, between ∇p and the flux through reference area, is that of the deformed pore, learned from the "
            "flow through the deformed pore of every sampled state; the figures show K_t = K_ref/det F̄."
        )
    else:
        turned = cell.law == "piola" and not is_isotropic(cell.linear.conductivity)
        found = (
            f"K of the undeformed pore is {_CARRIED[turned]}, and "
            "the flux through reference area has K_ref = det F̄ K_t. Compression along an axis raises both along it, "
            "although the pores close, and the times to 95 % and 99 % depend on it."
        )
    if not case.nonlinear.profiles:
        return found
    last, rest = case.nonlinear.profiles[-1], number(float(cell.linear.conductivity[1, 1]), 3)
    K_t, K_ref = (
        " to ".join(number(float(end(K[:, 1, 1])), 3) for end in (np.min, np.max))
        for K in (last.conductivity, last.reference_conductivity)
    )
    return f"{found} At t = {number(last.time, 3)} K_ref,22 is {K_ref} and K_t,22 {K_t}; both are {rest} at rest."


def _unjudged(surrogate: SurrogateSummary) -> list[str]:
    """Return a warning where no held-out state lies within the sampled range."""
    outputs = surrogate.outputs
    if not outputs or not all(check.all_outside for check in outputs):
        return []
    return [
        f"None of the {len(outputs[0].solved)} held-out states lies within the range that the surrogate was trained "
        "on, so its errors are those beyond that range and say nothing of those within. Sample more states, so that "
        "they fill the ranges, or hold out more (sampling.test.count)."
    ]


def all_warnings(context: ReportContext) -> list[str]:
    """Return the given warnings, then those of the results."""
    found = [*context.warnings, *_unjudged(context.surrogate)]
    for case in context.cases:
        found += case_warnings(case_metrics(case), case.flagged)
    return found
