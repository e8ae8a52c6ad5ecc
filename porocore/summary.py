"""From the files of a run to what the report shows and to the figures of merit."""

from __future__ import annotations

from typing import Any

import numpy as np

from porocore.closure_error import ClosureError, closure_error
from porocore.closures import CLOSURES
from porocore.config import RunConfig
from porocore.dataset import Dataset
from porocore.drainage import undrained
from porocore.interfaces.surrogate import Surrogate
from porocore.linear import LinearCoefficients
from porocore.reference import CellReference
from porocore.report.context import (
    DEHGHANI_ZILIAN,
    Case,
    CellSummary,
    OutputCheck,
    ReportContext,
    SamplingSummary,
    Stage,
    SurrogateSummary,
    TrainingCurve,
)
from porocore.report.metrics import report_metrics, rms_percent, worst_percent
from porocore.runfolder import RunFolder, versions
from porocore.sampled_range import SampledRange
from porocore.solution import MacroSolution
from porocore.states import Status
from porocore.training_curve import read_training_curve

#: An output whose values span less than this is zero up to the cell solver's tolerance and is not judged.
FLAT = 1e-9
_SUBSCRIPTS = "₁₂₃"


def gather(
    folder: RunFolder,
    config: RunConfig,
    reference: CellReference,
    coefficients: LinearCoefficients,
    surrogate: Surrogate,
    timings: dict[str, float],
) -> tuple[ReportContext, dict[str, Any]]:
    """The report's context, and the figures of merit ready for JSON."""
    dataset = Dataset.open(folder.dataset, identity=config.stages.sampling)
    held_out = Dataset.open(folder.test_dataset, identity=config.stages.test)
    cases = tuple(
        Case(
            MacroSolution.load_file(folder.solution(config.closure, load)),
            MacroSolution.load_file(folder.solution("linear", load)),
        )
        for load in config.macro.loads
    )
    responses = dataset.responses()
    training = responses.status == Status.converged
    outputs = output_checks(dataset, held_out, surrogate)
    closure = _closure_error(config, reference, dataset)
    context = ReportContext(
        title=config.title or folder.path.name,
        cell=_cell_summary(config, reference, coefficients),
        sampling=SamplingSummary(dataset.inputs, dataset.x(), responses.status, training),
        surrogate=SurrogateSummary(
            backend=config.surrogate.backend,
            description=f"{config.closure} closure; trained on converged states only",
            training_states=int(training.sum()),
            outputs=outputs,
            curve=_training_curve(folder),
            closure_error=closure,
        ),
        cases=cases,
        stages=tuple(Stage(name, seconds) for name, seconds in timings.items()),
        provenance={**versions(), **reference.mesh, "run identity": config.identity},
        config_text=config.resolved_yaml(),
        published=DEHGHANI_ZILIAN if _is_the_benchmark(config) else None,
        warnings=tuple(undrained(config.macro, reference.conductivity)),
    )
    metrics = {
        "cell": {
            "porosity": reference.porosity,
            "conductivity": reference.conductivity.tolist(),
            "M_2222": float(coefficients.mean_grad_grad_u[1, 1, 1, 1]),
            "M_2211": float(coefficients.mean_grad_grad_u[1, 1, 0, 0]),
            "Q_11": float(coefficients.mean_grad_p[0, 0]),
            "C_eff_2222": float(coefficients.stiffness[1, 1, 1, 1]),
            "biot_coefficient": float(coefficients.biot[1, 1]),
            "biot_modulus": coefficients.biot_modulus,
            "consolidation_coefficient": coefficients.consolidation_coefficient(),
        },
        "sampling": {
            "states": len(dataset),
            "statuses": _counts(responses.status),
            "solve_seconds_mean": float(np.mean(dataset.seconds())),
            "held_out_states": len(held_out),
            "held_out_statuses": _counts(held_out.responses().status),
        },
        "surrogate": {
            "training_states": int(training.sum()),
            "test_states": int((~outputs[0].outside).sum()) if outputs else 0,
            "rms_error_percent_of_range": {check.plain: rms_percent(check) for check in outputs},
            "largest_error_percent_of_range": {check.plain: worst_percent(check) for check in outputs},
        },
        "closure": None if closure is None else closure.for_json(),
        "macro": report_metrics(cases)["cases"],
    }
    return context, metrics


def _closure_error(config: RunConfig, reference: CellReference, dataset: Dataset) -> ClosureError | None:
    """Of the run's closure on the converged states; None from a cell solver that gives no stress."""
    solved = np.flatnonzero(dataset.responses().status == Status.converged)
    exact = dataset.responses()[solved]
    if exact.stress is None or exact.fluid_volume is None:
        return None
    closure = CLOSURES[config.closure](reference.solid_fraction, config.cell.material, reference.conductivity)
    return closure_error(closure, dataset.states()[solved], exact)


def output_checks(dataset: Dataset, held_out: Dataset, surrogate: Surrogate) -> tuple[OutputCheck, ...]:
    """The surrogate against the solved held-out states, for each component of <∇u¹>_s that varies."""
    trained, tested = dataset.responses(), held_out.responses()
    training = trained.status == Status.converged
    solved = np.flatnonzero(tested.status == Status.converged)
    states = held_out.states()[solved]
    predicted = surrogate.predict(states, tangent=False).mean_grad
    outside = SampledRange.around(dataset.inputs, dataset.x()[training]).outside(states)
    checks = []
    for i in range(3):
        for j in range(3):
            values = trained.mean_grad[training, i, j]
            span = float(np.ptp(values))
            if span < FLAT:
                continue
            checks.append(
                OutputCheck(
                    name=rf"$\langle\nabla_Y u^1\rangle_{{{i + 1}{j + 1}}}$",
                    plain=f"⟨∇u¹⟩{_SUBSCRIPTS[i]}{_SUBSCRIPTS[j]}",
                    solved=tested.mean_grad[solved, i, j],
                    predicted=predicted[:, i, j],
                    span=span,
                    outside=outside,
                )
            )
    return tuple(checks)


def _cell_summary(
    config: RunConfig, reference: CellReference, coefficients: LinearCoefficients
) -> CellSummary:
    geometry, material = config.cell.geometry, config.cell.material
    solid = config.cell.make_mesh("solid", "whole")
    benchmark_like = geometry.axes == "xyz" and abs(geometry.radius - 0.25) < 1e-12
    return CellSummary(
        description=f"orthogonal channels of radius {geometry.radius:g} along {', '.join(geometry.axes)}; "
        f"{material.kind} solid with Poisson's ratio {material.poisson_ratio:g}",
        porosity=reference.porosity,
        viscosity=config.cell.viscosity,
        linear=coefficients,
        mesh=reference.mesh,
        surface=(solid.points, solid.cells),
        crease=(-0.15, -0.33) if benchmark_like and abs(material.poisson_ratio - 0.35) < 1e-12 else None,
    )


def _is_the_benchmark(config: RunConfig) -> bool:
    """The paper's cell and column, whichever of the two radii."""
    macro = config.macro
    return (
        config.cell.geometry.axes == "xyz"
        and config.cell.geometry.radius in (0.2, 0.25)
        and macro.size == (0.1, 7.5, 0.1)
        and -0.2 in macro.loads
    )


def _training_curve(folder: RunFolder) -> TrainingCurve | None:
    table = read_training_curve(folder.training_curve)
    return None if table is None else TrainingCurve(table[:, 0], table[:, 1], table[:, 2])


def _counts(status: Any) -> dict[str, int]:
    return {s.name: int((status == s).sum()) for s in Status if (status == s).any()}
