"""Parts of every HTML page: templates, filters, embedded pictures, references to cite."""

from __future__ import annotations

import base64
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path

import jinja2
import markupsafe
from matplotlib.figure import Figure

from porocore.core.files.atomic import atomic_path, file_stem
from porocore.core.files.plain_data import stable_hash
from porocore.core.parallel.calls import CallProcesses, Tell
from porocore.report.figures.style import png_bytes, svg_bytes
from porocore.report.format import difference, duration, in_unit, measured, number, percent, plain, unit
from porocore.report.words.results import is_flagged, largest_rows

#: As CITATION.cff has it.
PAPER = (
    "H. Dehghani and A. Zilian: Finite strain poro-hyperelasticity: An asymptotic multi-scale ALE-FSI approach "
    "supported by ANNs. Computational Mechanics 71, 695–719 (2023), doi:10.1007/s00466-022-02262-y"
)


def citations() -> tuple[str, str]:
    """Return software and paper, each as an entry of a list of references."""
    return f"The porocore developers: porocore, version {metadata.version('porocore')}", PAPER


#: Forms of a figure by the ending of their files.
FORMS = {"svg": svg_bytes, "png": png_bytes}
#: Kinds of data addresses by the same.
_KINDS = {"svg": "svg+xml", "png": "png"}


@dataclass(frozen=True)
class Picture:
    """Figure as a data address, with an alternative text.

    Attributes
    ----------
    form
        ``svg``, or ``png``, which is smaller where there are very many parts.
    drawn
        Returns the file; another process may still be drawing it.
    text
        The alternative text.
    """

    form: str
    drawn: Callable[[], bytes]
    text: str

    @property
    def source(self) -> str:
        """The data address."""
        return f"data:image/{_KINDS[self.form]};base64,{base64.b64encode(self.drawn()).decode('ascii')}"


@dataclass(frozen=True)
class Pictures:
    """Maker of the pictures of a page, which keeps each figure as PNG and SVG too.

    Attributes
    ----------
    folder
        Where the files are written; None: nowhere.
    tell
        Called with the name of each figure before it is drawn, or before a process is waited for that draws it.
    processes
        Processes that draw; None: this one does.
    suffix
        End of the name of each figure.
    stems
        Names of the figures by those of their files, which differ even where they are alike in small ASCII letters.
    """

    folder: Path | None = None
    tell: Callable[[str], None] = lambda name: None
    processes: CallProcesses | None = None
    suffix: str = ""
    stems: dict[str, str] = field(default_factory=dict)

    def svg(self, name: str, figure: Figure, text: str) -> Picture:
        """Return a figure of lines and markers; its files are called ``name``."""
        return self._picture(name, figure, "svg", text)

    def png(self, name: str, figure: Figure, text: str) -> Picture:
        """Return a figure with very many parts; its files are called ``name``."""
        return self._picture(name, figure, "png", text)

    def _picture(self, name: str, figure: Figure, form: str, text: str) -> Picture:
        name += self.suffix
        path = None if self.folder is None else self.folder / self._stem(name)
        if self.processes is None:
            self.tell(name)
            drawn = draw(figure, form, path)
            return Picture(form, lambda: drawn, text)
        call = self.processes.submit(f"while it drew figure {name}", draw_elsewhere, figure, form, path)

        def wait() -> bytes:
            self.tell(name)
            found: bytes = call.result()
            return found

        return Picture(form, wait, text)

    def _stem(self, name: str) -> str:
        """Return the name of the files of a figure, with a hash where another figure has the same."""
        stem = file_stem(name)
        taken = self.stems.setdefault(stem.lower(), name) != name
        return f"{stem}-{stable_hash(name, length=8)}" if taken else stem


def draw(figure: Figure, form: str, path: Path | None) -> bytes:
    """Return the figure in one of the forms; keep it in all of them in files with this path and their endings."""
    drawn = FORMS[form](figure)
    if path is not None:
        for ending in (form, *(other for other in FORMS if other != form)):
            with atomic_path(path.with_name(f"{path.name}.{ending}")) as part:
                part.write_bytes(drawn if ending == form else FORMS[ending](figure))
    return drawn


def load_elsewhere(tell: Tell) -> None:
    """Do nothing in another process, which imports this module for that, and what draws figures with it."""


def draw_elsewhere(tell: Tell, figure: Figure, form: str, path: Path | None) -> bytes:
    """Draw a figure of another process; see :func:`draw`."""
    return draw(figure, form, path)


def environment(*packages: str) -> jinja2.Environment:
    """Return the templates of this package and of others before it, with the filters of ``format``.

    Parameters
    ----------
    packages
        Names of packages that hold further templates.
    """
    loaders = [jinja2.PackageLoader(name, "") for name in (*packages, "porocore.report")]
    made = jinja2.Environment(
        loader=jinja2.ChoiceLoader(loaders),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    filters = (number, plain, percent, duration, difference, in_unit, measured, is_flagged, largest_rows)
    made.filters |= {each.__name__: each for each in filters}
    made.globals |= {"unit": unit, "citations": citations}
    return made


def retitled(page: str, heading: tuple[str, str], configuration: tuple[str, str]) -> str | None:
    """Return the page of a run with another heading and configuration, each before and after; None if it has others."""
    title = ("<title>{} – porocore report</title>", heading)
    for form, (before, after) in (title, ("<h1>{}</h1>", heading), ("<pre>{}</pre>", configuration)):
        old, new = (form.format(markupsafe.escape(text)) for text in (before, after))
        if page.count(old) != 1:
            return None
        page = page.replace(old, new)
    return page
