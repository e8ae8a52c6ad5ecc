"""Report page of a calibration (write_report): one self-contained HTML file; figures as SVG and PNG."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from porocore.calibration.report.contents import CalibrationContents
from porocore.calibration.report.correlation_figure import correlation_figure
from porocore.calibration.report.field_figure import field_figure
from porocore.calibration.report.fit_figure import fit_figure
from porocore.calibration.report.plane_figure import plane_figure
from porocore.calibration.report.posterior_figure import posterior_figure
from porocore.calibration.report.profile_figure import profile_figure
from porocore.calibration.report.words import (
    data_rows,
    derived_rows,
    gain_text,
    helpful,
    posterior_rows,
    provenance_rows,
    search_rows,
    seen_sentence,
    underived_sentence,
    unknown_rows,
)
from porocore.core.files.atomic import atomic_path
from porocore.report.page import Picture, Pictures, environment

#: Of the page, and of the folder of its figures, in the folder of a calibration.
PAGE, FIGURES = "report.html", "figures"


def write_report(
    folder: Path, contents: CalibrationContents, tell: Callable[[str], None] = lambda name: None
) -> Path:
    """Write ``report.html`` into a folder and its figures into ``figures``, and return the page's path.

    Parameters
    ----------
    folder
        Of the calibration; it exists.
    contents
        What is shown.
    tell
        Called with the name of each figure before it is drawn.

    Raises
    ------
    RunFolderError
        A file cannot be written.
    """
    (folder / FIGURES).mkdir(exist_ok=True)
    html = render(contents, Pictures(folder / FIGURES, tell))
    with atomic_path(folder / PAGE) as part:
        part.write_text(html, encoding="utf-8")
    return folder / PAGE


def render(contents: CalibrationContents, pictures: Pictures | None = None) -> str:
    """Return the page as text; ``pictures`` may keep the figures as files."""
    pictures = pictures or Pictures()
    inference, truth = contents.inference, contents.truth
    several = len(inference.unknowns) > 1
    profiles = pictures.svg(
        "profiles", profile_figure(inference, truth), "Profile likelihood of each unknown"
    )
    return (
        environment("porocore.calibration.report")
        .get_template("calibration.html.j2")
        .render(
            contents=contents,
            inference=inference,
            rows=list(unknown_rows(inference, None if truth is None else truth.tolist())),
            seen=seen_sentence(inference),
            suggestions=[(each.name, gain_text(each)) for each in helpful(inference)],
            separable=any(each.separates for each in inference.suggestions)
            or all(each.exact for each in inference.directions),
            derived=[(each.title, list(derived_rows(each))) for each in contents.derived],
            underived=underived_sentence(contents),
            searched=[] if contents.plan is None else list(search_rows(contents.plan)),
            data=[] if contents.plan is None else list(data_rows(contents.plan)),
            provenance=list(provenance_rows(contents)),
            fits=_fits(contents, pictures),
            fields=_fields(contents, pictures),
            posterior_rows=[] if contents.posterior is None else list(posterior_rows(contents.posterior)),
            posterior_picture=_posterior(contents, pictures),
            profiles=profiles,
            plane=None
            if inference.plane is None
            else pictures.svg("plane", plane_figure(inference, truth), "Plane of two unknowns"),
            correlations=pictures.svg("correlations", correlation_figure(inference), "Correlations")
            if several
            else None,
        )
    )


def _posterior(contents: CalibrationContents, pictures: Pictures) -> Picture | None:
    if contents.posterior is None:
        return None
    figure = posterior_figure(contents.posterior, contents.inference.values, contents.truth)
    return pictures.svg("posterior", figure, "Posterior distribution of the unknowns")


def _fields(contents: CalibrationContents, pictures: Pictures) -> list[Picture]:
    return [
        pictures.svg(f"field_{each.name}", field_figure(contents, each), f"Field of {each.name}")
        for each in contents.fields
    ]


def _fits(contents: CalibrationContents, pictures: Pictures) -> list[tuple[str, Picture]]:
    names = contents.data.names
    return [
        (name, pictures.svg(f"fit_{name}", fit_figure(contents, c), f"Fit of {name}"))
        for c, name in enumerate(names)
    ]
