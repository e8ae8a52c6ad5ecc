"""Parts of every HTML page: templates and filters, embedded SVG and PNG pictures, names of their files."""

from __future__ import annotations

import base64
import re
import unicodedata
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import jinja2
import markupsafe
from matplotlib.figure import Figure

from porocore.core.files.atomic import atomic_path
from porocore.report.figures.style import png_bytes, svg_bytes
from porocore.report.format import difference, duration, in_unit, measured, number, percent, plain, unit
from porocore.report.metrics import is_flagged


@dataclass(frozen=True)
class Picture:
    """Figure as a data address, with an alternative text."""

    source: str
    text: str


@dataclass(frozen=True)
class Pictures:
    """Maker of the pictures of a page, which keeps each figure as PNG and SVG too.

    Attributes
    ----------
    folder
        Where the files are written; None: nowhere.
    tell
        Called with the name of each figure before it is drawn.
    """

    folder: Path | None = None
    tell: Callable[[str], None] = lambda name: None

    def svg(self, name: str, figure: Figure, text: str) -> Picture:
        """Return a figure of lines and markers; its files are called ``name``."""
        return svg_picture(self._drawn(name, figure, {"svg": svg_bytes, "png": png_bytes}), text)

    def png(self, name: str, figure: Figure, text: str) -> Picture:
        """Return a figure with very many parts; its files are called ``name``."""
        return png_picture(self._drawn(name, figure, {"png": png_bytes, "svg": svg_bytes}), text)

    def _drawn(self, name: str, figure: Figure, forms: dict[str, Callable[[Figure], bytes]]) -> bytes:
        """Return the figure in the first of the forms; keep it in all of them."""
        self.tell(name)
        first, *others = forms
        drawn = forms[first](figure)
        if self.folder is not None:
            for ending in (first, *others):
                with atomic_path(self.folder / f"{file_stem(name)}.{ending}") as part:
                    part.write_bytes(drawn if ending == first else forms[ending](figure))
        return drawn


def file_stem(name: str) -> str:
    """Return a name as that of a file: ASCII letters, numbers and signs that no system minds."""
    plain = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode()
    return re.sub(r"[^A-Za-z0-9._=-]+", "-", plain).strip("-")


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
    filters = (number, plain, percent, duration, difference, in_unit, measured, is_flagged)
    made.filters |= {each.__name__: each for each in filters}
    made.globals["unit"] = unit
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


def svg_picture(drawn: bytes, text: str) -> Picture:
    """Return an SVG document to embed."""
    return Picture(f"data:image/svg+xml;base64,{base64.b64encode(drawn).decode('ascii')}", text)


def png_picture(drawn: bytes, text: str) -> Picture:
    """Return a PNG image to embed, which is smaller than SVG where there are very many parts."""
    return Picture(f"data:image/png;base64,{base64.b64encode(drawn).decode('ascii')}", text)
