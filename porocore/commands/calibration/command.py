"""``porocore calibrate``: unknowns of one or more studies from measured curves, and their identifiability."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from porocore.cli.common import chosen_store, note_nothing_to_resume, page, plain_table
from porocore.cli.options import JsonOption, NoStoreOption, ResumeOption, StoreOption
from porocore.interfaces.command import Command, FileCheck

if TYPE_CHECKING:
    from porocore.commands.calibration.results import Calibration
    from porocore.commands.calibration.settings import CalibrationSettings
    from porocore.core.files.yaml_document import YamlDocument


def calibrate(
    config: Annotated[
        Path,
        typer.Argument(
            metavar="CONFIG",
            help="Study with a section calibration, or file with unknowns and experiments (YAML).",
            show_default=False,
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="DIR",
            help="Folder of the results.",
            show_default="runs/<name of the configuration>-calibration",
        ),
    ] = None,
    synthetic: Annotated[
        bool,
        typer.Option(
            "--synthetic",
            help="Generate synthetic data, from the start values of the unknowns and noise, to plan a test.",
        ),
    ] = False,
    json_: JsonOption = False,
    resume: ResumeOption = False,
    store: StoreOption = None,
    no_store: NoStoreOption = False,
) -> None:
    """Find numbers of a study, such as the radius of its pores, from measured curves.

    The cells between the bounds of the unknowns are sampled and learned once. The unknowns are fitted with exact
    derivatives. Then their 95 % intervals and the non-identifiable combinations are computed. Writes calibration.json,
    report.html, curves.csv and samples.csv, and points.csv of measured fields. --resume continues to the same result.
    """
    from porocore.commands.calibration.calibrate import calibrate as run
    from porocore.commands.calibration.plan import RECORD

    kept = chosen_store(store, no_store)
    folder = Path("runs") / f"{config.stem}-calibration" if out is None else out
    note_nothing_to_resume(folder, RECORD, "calibration", resume=resume)
    done = run(config, folder, synthetic=synthetic, resume=resume, store=kept or False)
    if json_:
        typer.echo((done.path / "calibration.json").read_text(encoding="utf-8"), nl=False)
        return
    print_unknowns(done)
    names = ["calibration.json", "report.html", "curves.csv", "samples.csv"]
    names += ["points.csv"] * done.has_films + ["posterior.csv"] * (done.posterior is not None)
    for name in names:
        typer.echo(done.path / name)


class CalibrateCommand(Command):
    """The command ``calibrate`` with its section ``calibration:``, and a file of its own."""

    run = staticmethod(calibrate)

    def section(self) -> type[CalibrationSettings]:
        """Return the model of the section."""
        from porocore.commands.calibration.settings import CalibrationSettings

        return CalibrationSettings

    def check(self, document: YamlDocument, config: Any, settings: Any) -> FileCheck:
        """Read the data, of which some may be made up later."""
        from porocore.commands.calibration.expectations import linear_notes
        from porocore.commands.calibration.loading import read_plan
        from porocore.study.notes.checks import check_backends

        plan = read_plan(document, planned=True)
        if config is None:
            for experiment in plan.experiments:
                check_backends(experiment.config)
        # Those on the units of the study itself stand in its outline.
        known = () if config is None else config.unit_notes
        notes = [note for note in plan.notes if not note.endswith(known)]
        plan = replace(plan, notes=(*notes, *linear_notes(plan)))
        return FileCheck(plan.outline if config is None else plan.section, {"synthetic": plan.is_planned})


def print_unknowns(done: Calibration) -> None:
    """Print value, interval and identifiability of each unknown, and the non-identifiable combinations."""
    from porocore.commands.calibration.profiles import interval_words
    from porocore.core.units import pretty

    table = plain_table(("unknown", "value", "95 % interval", "unit", "identifiable"), (1,))
    for one in done.inference.unknowns:
        interval, yes = interval_words(done.intervals[one.name]), done.identifiable[one.name]
        unit = pretty(one.unit) or "–"
        table.add_row(one.name, f"{done.values[one.name]:.4g}", interval, unit, "yes" if yes else "no")
    page().print(table)
    if not done.quality.explains:
        typer.echo(
            f"intervals presume a right model, but the reduced chi-square is {done.quality.reduced:.3g}"
        )
    if (posterior := done.posterior) is not None:
        table = plain_table(("posterior", "median", "95 % credible interval"), (1,))
        for one, median, ends in zip(posterior.unknowns, posterior.medians, posterior.intervals, strict=True):
            table.add_row(one.name, f"{median:.4g}", interval_words(ends))
        page().print(table)
    for words in done.inference.words:
        typer.echo(f"non-identifiable: {words}")
    for product in done.inference.products:
        typer.echo(f"identifiable: {product.words}")
