"""Reading of a calibration: the section of a study or a file of its own, its studies and curves, one error."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import yaml

from porocore.commands.calibration.expectations import body_height, require_free, sign_note, size_note
from porocore.commands.calibration.films import read_film
from porocore.commands.calibration.observations import MeasuredSeries
from porocore.commands.calibration.plan import (
    OF_LOAD,
    CalibrationPlan,
    Experiment,
    PlannedUnknown,
    occurrences,
)
from porocore.commands.calibration.posterior import require_emcee
from porocore.commands.calibration.problem import MANY_VALUES
from porocore.commands.calibration.reading import read_curve
from porocore.commands.calibration.settings import CalibrationSettings, ExperimentSettings
from porocore.commands.calibration.unknowns import (
    bounds_notes,
    camera_unknowns,
    keyed,
    planned_unknowns,
    reach_notes,
)
from porocore.core.files.reading import read_text
from porocore.core.files.yaml_document import Location, YamlDocument, dotted
from porocore.core.models.strict import StrictModel
from porocore.core.units import using_units
from porocore.errors import ConfigurationError
from porocore.study.config.config import RunConfig
from porocore.study.config.errors import located
from porocore.study.config.loading import read_settings, validated
from porocore.study.sweep.plan import family_over

#: Key of the section in a study.
SECTION = "calibration"


class _Section(StrictModel):
    calibration: CalibrationSettings


def read_document(source: Path | str | Mapping[str, Any] | YamlDocument) -> YamlDocument:
    """Return the document of a calibration from a file, or from settings nested as in one."""
    if isinstance(source, YamlDocument):
        return source
    return (
        YamlDocument.of(source, Path.cwd())
        if isinstance(source, Mapping)
        else YamlDocument.read(Path(source))
    )


@contextmanager
def at_points(document: YamlDocument, experiment: str, film: str) -> Iterator[None]:
    """Put file, line and key of a measured field before a complaint that the block raises."""
    within = (SECTION,) if SECTION in document.data else ()
    of = ("experiments", experiment) if experiment else ()
    with located(document), keyed(_key(within, *of, "points", film)):
        yield


def read_plan(
    source: Path | str | Mapping[str, Any] | YamlDocument, *, synthetic: bool = False, planned: bool = False
) -> CalibrationPlan:
    """Return the plan of a calibration from a file, or from settings nested as in one.

    Parameters
    ----------
    source
        A study with a section ``calibration:``, or unknowns and experiments alone; also as a document that was read.
    synthetic
        Values of the curves will be made up.
    planned
        Values of curves without a file may be made up later.

    Raises
    ------
    ConfigurationError
        Each fault on a line of its own: file, line, key, what was expected and what came.
    """
    document = read_document(source)
    settings, at = _settings(document)
    with located(document):
        experiments = _experiments(settings, document)
        studies = {name: _study(document, name, each, at) for name, each in experiments.items()}
        plan = _plan(document, settings, studies, at, synthetic, planned)
        return replace(plan, documents=_documents(document, experiments))


def _documents(
    document: YamlDocument, experiments: Mapping[str, ExperimentSettings]
) -> tuple[tuple[str, str], ...]:
    """Return names and texts of the configuration and of the studies that it names, each once."""
    own = (
        yaml.safe_dump(document.data, sort_keys=False, allow_unicode=True)
        if document.path is None
        else read_text(document.path)
    )
    found = {"settings" if document.path is None else document.path.name: own}
    for each in experiments.values():
        if each.study is not None:
            found[each.study] = read_text(document.folder / each.study)
    return tuple(found.items())


def _settings(document: YamlDocument) -> tuple[CalibrationSettings, Location]:
    """Return the settings, and the location of their section in the document."""
    inside = SECTION in document.data
    if not inside and not document.data.keys() & {"unknowns", "experiments"}:
        where = "the settings" if document.path is None else str(document.path)
        raise ConfigurationError(
            f"{where}: expected a section 'calibration:' with unknowns and observations, or a file with 'unknowns:' "
            "and 'experiments:', got neither"
        )
    if not inside:
        return read_settings(document, CalibrationSettings), ()
    alone = replace(document, data={SECTION: document.data[SECTION]})
    return read_settings(alone, _Section).calibration, (SECTION,)


def _experiments(settings: CalibrationSettings, document: YamlDocument) -> dict[str, ExperimentSettings]:
    """Return the experiments by name; the only one of a study has none."""
    if settings.experiments:
        return settings.experiments
    if SECTION not in document.data:
        raise ConfigurationError(
            "observations: a file of its own has 'experiments:' with the study of each, and observations below them"
        )
    return {"": ExperimentSettings(observations=settings.observations, points=settings.points)}


def _key(at: Location, *keys: str) -> str:
    return dotted((*at, *keys))


def _study(
    document: YamlDocument, name: str, experiment: ExperimentSettings, at: Location
) -> tuple[RunConfig, float, ExperimentSettings]:
    """Return the study of an experiment and its load."""
    key = (*at, "experiments", name) if name else at
    if experiment.study is None:
        if SECTION not in document.data:
            raise ConfigurationError(
                f"{_key(key, 'study')}: missing; add the configuration of the study of this experiment"
            )
        config = validated(replace(document, data={k: v for k, v in document.data.items() if k != SECTION}))
    else:
        with keyed(_key(key, "study")):
            of_study = YamlDocument.read(document.folder / experiment.study)
        config = validated(of_study)
    loads = config.macro.loads
    if experiment.load is None and len(loads) > 1:
        listed = ", ".join(f"{load:g}" for load in loads)
        where = _key(key, "load") if name else "macro.loads"
        raise ConfigurationError(
            f"{where}: expected one load for the experiment, got those of the study, {listed}; "
            + ("add 'load:'" if name else "keep one, or list experiments with a load each")
        )
    load = loads[0] if experiment.load is None else experiment.load
    if load == 0:
        raise ConfigurationError(f"{_key(key, 'load')}: a load of 0 moves nothing; give another")
    macro = config.macro.model_copy(update={"loads": (load,)})
    return config.model_copy(update={"macro": macro}), load, experiment


def _plan(
    document: YamlDocument,
    settings: CalibrationSettings,
    studies: Mapping[str, tuple[RunConfig, float, ExperimentSettings]],
    at: Location,
    synthetic: bool,
    planned: bool,
) -> CalibrationPlan:
    plain = {name: Experiment(name, config, load, ()) for name, (config, load, _) in studies.items()}
    unknowns = planned_unknowns(settings, plain, at)
    experiments, notes = [], dict[str, None]()
    for each in unknowns:
        notes |= dict.fromkeys(bounds_notes(each, plain))
    notes |= dict.fromkeys(reach_notes(unknowns, plain))
    refused: list[str] = []
    for name, (config, load, experiment) in studies.items():
        family, said = _family(config, plain[name], unknowns, at)
        notes |= dict.fromkeys((*said, *(f"{name}: {note}" if name else note for note in config.unit_notes)))
        curves, kinds = [], {each.number.kind for each in occurrences(unknowns, plain[name])}
        for observed, observation in experiment.observations.items():
            keys = ("experiments", name, "observations") if name else ("observations",)
            try:
                with keyed(_key(at, *keys, observed)), using_units(config.result_units):
                    series = MeasuredSeries.chosen(observation)
                    series.require_in(config.macro)
                    if not kinds & {*OF_LOAD, "time_shift"}:
                        require_free(series, config.macro, load)
                    curve = read_curve(
                        observed, observation, document.folder, config.scales, config.macro.time.end,
                        height=_height(config, series), experiment=name,
                        synthetic=synthetic or (planned and observation.file is None),
                    )  # fmt: skip
                    large = None if synthetic else size_note(curve, config.macro)
            except ConfigurationError as error:
                refused.append(str(error))
            else:
                curves.append(curve)
                notes |= dict.fromkeys(f"{curve.name}: {note}" for note in (*curve.notes, large) if note)
        for filmed, film in experiment.points.items():
            keys = ("experiments", name, "points") if name else ("points",)
            try:
                with keyed(_key(at, *keys, filmed)), using_units(config.result_units):
                    found, unit = read_film(
                        filmed, film, document.folder, config.macro, config.scales, experiment=name,
                        synthetic=synthetic or (planned and film.file is None),
                    )  # fmt: skip
                    sizes = [None if synthetic else size_note(curve, config.macro) for curve in found]
            except ConfigurationError as error:
                refused.append(str(error))
            else:
                curves += found
                with keyed(_key(at, *keys, filmed)):
                    unknowns += camera_unknowns(filmed, film, found[0], unit, config, name)
                for curve, size in zip(found, sizes, strict=True):
                    notes |= dict.fromkeys(f"{curve.name}: {note}" for note in (*curve.notes, size) if note)
        for curve in curves:
            of_indenter = isinstance(curve.series, MeasuredSeries) and curve.series.indenter
            if (of_indenter or not kinds & set(OF_LOAD)) and (sign := sign_note(curve, config.macro, load)):
                notes[f"{curve.name}: {sign}"] = None
        experiments.append(Experiment(name, family, load, tuple(curves)))
    if refused:
        raise ConfigurationError("\n".join(refused))
    own = experiments[0].config.title
    title = f"Calibration: {own}".removesuffix(": ") if settings.title in ("", own) else settings.title
    _check_posterior(settings, len(unknowns), sum(len(c) for one in experiments for c in one.curves), at)
    _check_shifts(experiments, unknowns, at)
    plan = CalibrationPlan(
        title, tuple(experiments), tuple(unknowns), settings.fit, tuple(notes), settings.posterior
    )
    points, free = sum(map(len, plan.curves)), sum(not each.unknown.has_prior for each in unknowns)
    if points < free:
        raise ConfigurationError(
            f"{_key(at, 'unknowns')}: expected at least as many measured values as unknowns without a prior, got "
            f"{points} for {free}; measure more, or give priors"
        )
    return plan


def _height(config: RunConfig, series: MeasuredSeries) -> float | None:
    """Return the height of the body where it turns a strain into what is measured."""
    return body_height(config.macro) if series.quantity == "displacement" else None


def _check_shifts(experiments: Sequence[Experiment], unknowns: list[PlannedUnknown], at: Location) -> None:
    """Refuse a time shift by which data come to lie behind the end of their study, where nothing is computed."""
    for one in experiments:
        for each in occurrences(unknowns, one):
            unknown, end = unknowns[each.index].unknown, one.config.macro.time.end
            last = max(float(curve.times[-1]) for curve in one.curves)
            if each.number.kind == "time_shift" and last + unknown.upper * each.factor > end * (1 + 1e-9):
                unit = f" {unknown.unit}" if unknown.unit else ""
                of = f" of the experiment '{one.name}'" if one.name else ""
                raise ConfigurationError(
                    f"{_key(at, 'unknowns', unknown.name, 'upper')}: expected at most {(end - last) / each.factor:.4g}"
                    f"{unit}, got {unknown.upper:g}{unit}, by which the last data{of} lie behind the end of the "
                    "study; raise its macro.time.end, or give 'until:'"
                )


def _check_posterior(settings: CalibrationSettings, unknowns: int, values: int, at: Location) -> None:
    """Refuse too many data, too few walkers, and a posterior without the package that draws from it."""
    if settings.posterior is None:
        return
    if values > MANY_VALUES:
        raise ConfigurationError(
            f"{_key(at, 'posterior')}: expected at most {MANY_VALUES} measured values, between whose runs a posterior "
            f"distribution is interpolated, got {values}; remove the section, or keep fewer points or times"
        )
    if (walkers := settings.posterior.walkers_of(unknowns)) < 2 * unknowns:
        raise ConfigurationError(
            f"{_key(at, 'posterior', 'walkers')}: expected at least {2 * unknowns}, twice the number of unknowns, got "
            f"{walkers}"
        )
    with keyed(_key(at, "posterior")):
        require_emcee()


def _family(
    config: RunConfig, experiment: Experiment, unknowns: list[PlannedUnknown], at: Location
) -> tuple[RunConfig, tuple[str, ...]]:
    """Return the study of the family of cells that the bounds of the unknowns span."""
    ranges = {}
    for each in occurrences(unknowns, experiment):
        if each.number.kind == "cell":
            one = unknowns[each.index].unknown
            ranges[each.number.name] = (one.lower * each.factor, one.upper * each.factor)
    if not ranges:
        return config, ()
    try:
        return family_over(config, ranges)
    except ConfigurationError as error:
        raise ConfigurationError(
            f"{_key(at, 'unknowns')}: the bounds span no family of cells: {error}"
        ) from None
