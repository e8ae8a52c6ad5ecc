"""A whole study, stage by stage: cell → samples → surrogate → macro solutions → report.

Each stage reads the files of the one before from the run folder, continues where an earlier process
stopped, and adds its wall time to the folder's record.
"""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from porocore.core.console import Console
from porocore.core.files.atomic import atomic_path
from porocore.interfaces.sampler import Sampler
from porocore.interfaces.surrogate import Surrogate, TrainingProgress
from porocore.macro.drainage import undrained
from porocore.macro.laws import CLOSURES
from porocore.macro.reference import CellReference
from porocore.plugins.border import conductivity_of, solution_of
from porocore.plugins.registry import registry
from porocore.sampling.campaign import CampaignProgress, CampaignSummary, run_campaign
from porocore.sampling.datasets.dataset import Dataset
from porocore.sampling.execution import CellPool
from porocore.sampling.samplers.random_states import RandomStates
from porocore.states import MacroState, Status
from porocore.study.backends import make_backend, with_closure
from porocore.study.config.config import RunConfig
from porocore.study.preflight.symmetry_notes import broken_by_the_mesh, uncovered
from porocore.study.run_folder.files import LINEAR
from porocore.study.run_folder.folder import RunFolder
from porocore.study.run_folder.provenance import versions
from porocore.study.stages.exploration import inform
from porocore.study.stages.solving import USUAL_LAWS, LawKind, solve
from porocore.study.stages.stage_files import (
    finished,
    linear_coefficients,
    load_reference,
    load_solution,
    load_surrogate,
    prepare_cell,
    training_set,
)
from porocore.study.stages.stage_times import stage_runs, stage_times, timed
from porocore.study.stages.training_curve import TrainingCurveFile

__all__ = ["prepare_cell", "report", "run", "sample", "solve", "solve_cell", "train", "training_set"]


def run(
    folder: RunFolder, config: RunConfig, *, console: Console, laws: Sequence[LawKind] = USUAL_LAWS
) -> Path:
    """All stages; returns the path of the report."""
    if not folder.surrogate_of(config).exists():
        registry().get("surrogate", config.surrogate.backend).load_libraries()
    sample(folder, config, console=console)
    train(folder, config, console=console)
    solve(folder, config, console=console, laws=laws)
    return report(folder, config, console=console)


def sample(folder: RunFolder, config: RunConfig, *, console: Console, retry_lost: bool = False) -> None:
    """Solve the undeformed cell, the sampler's states, and the held-out random states.

    With ``retry_lost``, states over which workers died or hung in an earlier session are solved again.
    """
    solver, prepared = prepare_cell(config.fem.backend, config.fem.options, config.cell, config.conductivity)
    inputs = config.sampling.input_space()
    sampler: Sampler = make_backend("sampler", config)
    if not folder.reference.exists():
        with timed(folder.timings, "cell"):
            reference = CellReference.compute(solver, prepared, config.cell, config.stages.cell)
            reference.save(folder.reference)
    reference = load_reference(folder, config)
    # Another closure than the one that the run began with learns from the same states.
    inform(sampler, folder.written, reference)
    diagonal = ", ".join(f"{k:.4g}" for k in np.diag(reference.conductivity))
    console.note(f"cell: porosity {reference.porosity:.4f}, conductivity K_11, K_22, K_33 = {diagonal}")
    for warning in undrained(config.macro, reference.conductivity):
        console.warn(warning)
    group = config.cell.point_group
    for warning in (*uncovered(inputs, group), *broken_by_the_mesh(reference.response, group)):
        console.warn(warning)
    held_out = _held_out(config)
    provenance = {"config": config.resolved_yaml(), **versions(), **reference.mesh}
    stages = [
        ("sampling", sampler, folder.dataset, config.stages.sampling),
        ("held-out states", held_out, folder.test_dataset, config.stages.test),
    ]
    arguments = (config.fem.backend, config.fem.options, config.cell, config.conductivity)
    with CellPool(prepare_cell, arguments, **config.sampling.pool_options(), on_warning=console.warn) as pool:
        for title, states, path, identity in stages:
            dataset = Dataset.create_or_open(path, inputs=inputs, identity=identity, provenance=provenance)
            if retry_lost:
                dataset.drop(dataset.ended(Status.lost))
            with timed(folder.timings, title):
                summary = _campaign(title, states, pool, dataset, console)
            counts = ", ".join(f"{n} {status.name.replace('_', ' ')}" for status, n in summary.counts.items())
            console.note(f"{title}: {sum(summary.counts.values())} states: {counts}")
            if lost := summary.counts.get(Status.lost, 0):
                console.warn(
                    f"{title}: {lost} states were lost, each over two workers that died or whose time was over; "
                    f"they count as failed; to try them again: porocore sample {folder.path} --retry-lost"
                )


def train(folder: RunFolder, config: RunConfig, *, console: Console) -> None:
    """Fit the surrogate that the closure needs to the stable states, unless it was done before."""
    path = folder.surrogate_of(config)
    if path.exists():
        load_surrogate(folder, config)
        console.note(f"training: {path.name} is there already")
        return
    data = training_set(folder, config)
    surrogate: Surrogate = make_backend("surrogate", config)
    own = config.surrogate_model == folder.written.surrogate_model
    stage = "training" if own else f"training, {config.surrogate_model}"
    checkpoint = folder.training_checkpoint_of(config)
    with timed(folder.timings, stage), console.task("training", "epochs") as task:
        curve = TrainingCurveFile(folder.training_curve_of(config))

        def show(progress: TrainingProgress) -> None:
            curve.add(progress)
            task.update(
                progress.epoch,
                progress.epochs,
                detail=f"loss {progress.loss:.2e}, validation {progress.validation_loss:.2e}",
            )

        surrogate.fit(data, seed=config.surrogate.seed, checkpoint=checkpoint, on_progress=show)
        surrogate.save(path)
    checkpoint.unlink(missing_ok=True)


def report(folder: RunFolder, config: RunConfig, *, console: Console) -> Path:
    """Write metrics.json, histories as tables, the files for ParaView and the page; returns the page's path.

    They are about the closure that the run began with; solutions of other laws are set beside it.
    """
    from porocore.macro.series import write_series
    from porocore.report.html import write_report
    from porocore.report.text import all_warnings
    from porocore.report.vtk import write_vtu_series
    from porocore.study.stages.summary import gather

    finished(folder, folder.test_dataset, config.stages.test, _held_out(config))
    shown = with_closure(folder.written, folder.shown_closure)
    config = shown.model_copy(
        update={name: getattr(config, name) for name in ("title", "scales", "output_units", "scenarios")}
    )
    with timed(folder.timings, "report"):
        for load in config.macro.loads:
            for law in (*folder.solved(load), LINEAR):
                stem = folder.solution(law, load).stem
                solution = load_solution(folder, law, load)
                write_vtu_series(folder.fields, stem, solution)
                write_series(folder.history(law, load), solution, config.result_units)
        reference = load_reference(folder, config)
        coefficients = linear_coefficients(reference, config)
        closures = dict.fromkeys(law for load in config.macro.loads for law in folder.solved(load))
        surrogates = {
            closure: load_surrogate(folder, with_closure(config, closure))
            for closure in (config.closure, *closures)
            if closure in CLOSURES
        }
        context, metrics = gather(
            folder,
            config,
            reference,
            coefficients,
            surrogates,
            stage_times(folder.timings),
            stage_runs(folder.timings),
        )
        write_report(folder.report, context)
    for warning in all_warnings(context):
        console.warn(warning)
    metrics["stages"] = stage_times(folder.timings)
    metrics["stage_runs"] = stage_runs(folder.timings)
    with atomic_path(folder.metrics) as part:
        part.write_text(json.dumps(metrics, indent=2, allow_nan=False) + "\n", encoding="utf-8")
    return folder.report


def solve_cell(config: RunConfig, grad_u: Any, p: float) -> dict[str, Any]:
    """One state of the cell with everything that a solve returns, as nested dictionaries of arrays.

    Where the solid does not hang together, porosity and conductivity of the cell at rest.
    """
    began = time.perf_counter()
    solver, prepared = prepare_cell(config.fem.backend, config.fem.options, config.cell, config.conductivity)
    conductivity = conductivity_of(solver, prepared)
    geometry = config.cell.geometry
    if (disconnected := config.cell.disconnected) and p == 0 and not np.any(grad_u):
        return {
            "porosity": geometry.porosity,
            "conductivity": conductivity,
            "solid": f"disconnected: {disconnected}",
            "seconds": {"set_up": time.perf_counter() - began},
        }
    rest = solution_of(solver, prepared, MacroState.zeros(1), tangent=False).response
    ready = time.perf_counter()
    response = solution_of(solver, prepared, MacroState.single(grad_u, p)).response
    return {
        "porosity": geometry.porosity if rest.fluid_volume is None else float(rest.fluid_volume[0]),
        "conductivity": conductivity,
        "status": Status(int(response.status[0])).name,
        "mean_grad": response.mean_grad[0],
        "stress": None if response.stress is None else response.stress[0],
        "fluid_volume": None if response.fluid_volume is None else response.fluid_volume[0],
        "potential": None if response.potential is None else response.potential[0],
        **(
            {}
            if response.conductivity is None or response.min_fluid_jacobian is None
            else {
                "deformed_conductivity": response.conductivity[0],
                "min_fluid_jacobian": response.min_fluid_jacobian[0],
            }
        ),
        # A solver need not provide them.
        **{
            part: {name: value[0] for name, value in vars(holder).items() if value is not None}
            for part, holder in (("tangent", response.tangent), ("peaks", response.extrema))
            if holder is not None
        },
        "seconds": {"set_up": ready - began, "solve": time.perf_counter() - ready},
    }


def _held_out(config: RunConfig) -> RandomStates:
    test = config.sampling.test
    return RandomStates(config.sampling.input_space(), count=test.count, seed=test.seed)


def _campaign(
    title: str, sampler: Sampler, pool: CellPool, dataset: Dataset, console: Console
) -> CampaignSummary:
    with console.task(title, "states") as task:

        def show(progress: CampaignProgress) -> None:
            detail = "stopping after the running solves" if progress.stopping else ""
            task.update(progress.done, progress.expected, failed=progress.failed, detail=detail)

        return run_campaign(sampler, pool, dataset, on_progress=show)
