"""Calibration of one or more studies (calibrate): cells, fit, intervals, report."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from porocore.commands.calibration.cells import families, further_data
from porocore.commands.calibration.derived import derived_cells
from porocore.commands.calibration.expectations import start_notes
from porocore.commands.calibration.fit import (
    CalibrationFit,
    FitQuality,
    FitRounds,
    at_bounds,
    far_from_start,
    place_of,
    studies_identity,
)
from porocore.commands.calibration.infer import Inference, infer
from porocore.commands.calibration.loading import read_plan
from porocore.commands.calibration.observations import ObservedCurve, by_curve, curve_data
from porocore.commands.calibration.plan import CalibrationFolder, CalibrationPlan
from porocore.commands.calibration.posterior import Posterior, sample_posterior
from porocore.commands.calibration.problem import CurveModel, Misfit, first_coordinates, values_at
from porocore.commands.calibration.results import Calibration, results_of, write_tables
from porocore.commands.calibration.settings import PosteriorSettings
from porocore.commands.calibration.suggestions import shift_words
from porocore.core.console import Console
from porocore.core.echo import joined
from porocore.core.files.plain_data import json_hash, json_ready, write_json
from porocore.core.files.store import ResultStore
from porocore.core.parallel.calls import CallProcesses
from porocore.core.parallel.memory import one_blas_thread
from porocore.errors import SolveError
from porocore.states import Array
from porocore.study.notes.checks import check_backends
from porocore.study.store import chosen_store


def calibrate(
    source: Path | str | Mapping[str, Any],
    out: Path | str,
    *,
    synthetic: bool = False,
    resume: bool = False,
    progress: bool = True,
    store: ResultStore | str | Path | bool = True,
) -> Calibration:
    """Find the unknowns of one or more studies from measured curves, and their identifiability.

    The cells between the bounds are sampled and learned once. Every evaluation is kept in the folder, so that a call
    that was interrupted goes on with ``resume`` to the same answer.

    Parameters
    ----------
    source
        A study with a section ``calibration:``, a file with ``unknowns:`` and ``experiments:``, or settings nested as
        in one.
    out
        Folder of the results.
    synthetic
        Generate synthetic data: curves at the start values of the unknowns, with noise of their standard deviations.
    resume
        Continue what the folder holds.
    progress
        Show progress on standard error.
    store
        As for :class:`porocore.Study`.

    Raises
    ------
    ConfigurationError
        Configuration or data are faulty; each fault on a line of its own.
    RunFolderError
        The folder holds something else, or this calibration while ``resume`` is not set.
    SolveError
        The experiments can be computed at none of the starts.
    """
    began = time.monotonic()
    console = Console.shown(progress)
    plan = read_plan(source, synthetic=synthetic)
    for experiment in plan.experiments:
        check_backends(experiment.config)
    folder = CalibrationFolder(Path(out), _identity(plan, synthetic), resume=resume)
    for note in plan.notes:
        console.note(note)
    with one_blas_thread(), folder, ExitStack() as stack:
        cells = families(plan, folder.path, stack, console, chosen_store(store))
        for family in cells:
            family.learn()
        count = min(len(plan.experiments), plan.experiments[0].config.sampling.worker_count())
        processes = stack.enter_context(CallProcesses(count)) if count > 1 else None
        rounds = FitRounds(plan, folder, cells, console, processes)
        return _calibrated(rounds, synthetic, began)


def _calibrated(rounds: FitRounds, synthetic: bool, began: float) -> Calibration:
    from porocore.commands.calibration.page import write_report  # matplotlib is slow to import

    plan, folder, console = rounds.plan, rounds.folder, rounds.console
    if synthetic:
        plan = rounds.plan = _with_made_up_data(plan, rounds.model)
    else:
        for note in start_notes(plan, rounds.model):
            console.warn(note)
    misfit, found = rounds.fitted(curve_data(plan.curves))
    inference = _with_error_of_steps(
        _inferred(plan, misfit, found, rounds, console), misfit, rounds, synthetic
    )
    posterior = _posterior(plan.posterior, misfit, inference, console)
    quality = FitQuality.of_fit(misfit, inference.best)
    done = Calibration(
        folder.path,
        plan,
        misfit.data,
        inference,
        quality,
        posterior,
        derived_cells(inference, plan, rounds.cells),
        sum(family.solves for family in rounds.cells),
        len(rounds.model),
        time.monotonic() - began,
        tuple(_warnings(rounds, misfit, found, inference, quality, posterior)),
        np.array([each.unknown.start for each in plan.unknowns]) if synthetic else None,
    )
    write_tables(done, rounds.model)
    write_report(done)
    # Last, so that a folder with results has all of them.
    write_json(folder.path / "calibration.json", json_ready(results_of(done)), indent=2, ensure_ascii=False)
    for warning in done.warnings:
        console.warn(warning)
    return done


def _identity(plan: CalibrationPlan, synthetic: bool) -> dict[str, str]:
    """Return the hashes of all that the answer depends on, by what they are of; the data of each curve by its file."""
    return {
        "studies": studies_identity(plan),
        **{f"data of {_source(curve)}": json_hash([_contents(curve), synthetic]) for curve in plan.curves},
        "unknowns": json_hash([repr(each.unknown) for each in plan.unknowns]),
        "settings of the fit": json_hash(plan.fit.model_dump()),
    }


def _source(curve: ObservedCurve) -> str:
    return f"'{curve.name}'" if curve.file is None else f"'{curve.name}' ({curve.file.name})"


def _contents(curve: ObservedCurve) -> list[Any]:
    """Return all that a fit takes from a curve."""
    measured = None if curve.measured is None else curve.measured.tolist()
    return [place_of(curve), measured, _listed(curve.spread), curve.share, curve.weights.tolist()]


def _listed(spread: float | Array | None) -> float | list[float] | None:
    # The text of a long array leaves out its middle.
    return spread.tolist() if isinstance(spread, np.ndarray) else spread


def _with_made_up_data(plan: CalibrationPlan, model: CurveModel) -> CalibrationPlan:
    """Return the plan with curves at the start values of the unknowns, and noise."""
    # At the coordinates where the search begins, to the last bit, so that this run is not made twice.
    starts = values_at(model.unknowns, first_coordinates(model.unknowns))
    try:
        exact = model.curves(starts).values
    except SolveError as error:
        at = ", ".join(f"{one.name} {value:g}" for one, value in zip(model.unknowns, starts, strict=True))
        raise SolveError(
            f"no synthetic data can be computed at the start values of the unknowns, {at}; give "
            f"other bounds, or a 'start:' for each: {error}"
        ) from error
    pairs = enumerate(zip(plan.curves, by_curve(exact, plan.curves), strict=True))
    curves = iter([curve.made_up(part, [plan.fit.seed, number]) for number, (curve, part) in pairs])
    experiments = [replace(one, curves=tuple(islice(curves, len(one.curves)))) for one in plan.experiments]
    return replace(plan, experiments=tuple(experiments))


def _inferred(
    plan: CalibrationPlan, misfit: Misfit, found: CalibrationFit, rounds: FitRounds, console: Console
) -> Inference:
    """Return what the data say, with progress."""
    asked, total = 0, 2 * len(plan.unknowns) + 3
    with console.task("intervals", "ends") as task:

        def tell(words: str) -> None:
            nonlocal asked
            task.update(min(asked, total), total, detail=words)
            asked += 1

        values = misfit.values(found.best.coordinates)
        further = further_data(rounds.studies.experiments, plan, values, rounds.processes, tell)
        return infer(
            misfit,
            found.best,
            dependence=partial(rounds.dependence, misfit),
            rule=plan.rule,
            further=further,
            rays=plan.fit.rays,
            tell=tell,
        )


def _with_error_of_steps(
    inference: Inference, misfit: Misfit, rounds: FitRounds, synthetic: bool
) -> Inference:
    """Return the statements with the error of the steps in time, which the intervals hold unless it is small.

    Synthetic data have the same error, which then shifts nothing; it is reported for the planned test.
    """
    try:
        once = inference.with_error(rounds.error_of_steps(misfit, inference.best, 1), not synthetic)
        assert once.systematic is not None
        if synthetic or once.systematic.is_small:
            return once
        # How fast the error falls says how large it is; it is asked only where that counts.
        return inference.with_error(rounds.error_of_steps(misfit, inference.best, 2))
    except SolveError as error:
        rounds.console.warn(f"the error of the steps in time is not known: {error}")
        return inference


def _posterior(
    settings: PosteriorSettings | None, misfit: Misfit, inference: Inference, console: Console
) -> Posterior | None:
    """Return draws from the posterior distribution where the plan wants them, with progress."""
    if settings is None:
        return None
    with console.task("posterior", "per cent") as task:

        def tell(words: str, share: float) -> None:
            task.update(int(100 * share), 100, detail=words)

        found = sample_posterior(misfit, inference.points, inference.best, settings, tell)
        task.update(100, 100, detail="")
    return found


def _warnings(
    rounds: FitRounds,
    misfit: Misfit,
    found: CalibrationFit,
    inference: Inference,
    quality: FitQuality,
    posterior: Posterior | None,
) -> Iterator[str]:
    """Yield sentences on what is to be doubted."""
    if quality.complaint:
        yield quality.complaint
    if not found.converged:
        most = rounds.plan.fit.evaluations
        yield f"the fit has not converged after {most} evaluations a start; raise fit.evaluations"
    if inference.best.prediction.flagged:
        yield "the fitted body leaves the states that the surrogate is trusted in; " + (
            "no further cells were solved there, since they would not explain the data"
            if rounds.given_up
            else "sample wider ranges, or raise fit.rounds"
        )
    if unmoved := misfit.unmoved(inference.best):
        yield (
            f"no unknown changes {joined(unmoved)}, which may be prescribed by the study; leave it out, or fit another "
            "quantity"
        )
    error = inference.systematic
    if error is not None and error.counted:
        yield (
            "the steps in time are long for these data: in the limit of short steps "
            f"{shift_words(inference.unknowns, inference.best.coordinates, error)}. The intervals include them. "
            "A quarter of macro.time.tolerance, or half of macro.time.step where there is none, halves the error"
        )
    yield from at_bounds(misfit, inference.best.coordinates, explained=quality.explains)
    yield from far_from_start(misfit, inference.best.coordinates)
    yield from () if posterior is None else posterior.complaints
