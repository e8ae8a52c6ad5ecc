"""Entry points of the group ``porocore``, each with its source; damaged metadata of one stop no other."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from importlib import metadata

from porocore.plugins.foreign_code import attempt, file_of, reason_of
from porocore.plugins.hookspecs import short_repr
from porocore.plugins.kinds import PROJECT


@dataclass(frozen=True)
class Source:
    """Distribution and module that an offer comes from.

    Attributes
    ----------
    distribution, version, entry_point
        Names, and what the metadata say; the version is empty where they do not.
    requirements
        What the distribution needs, as its metadata says, without those of extras.
    file
        The module that the entry point names; where there is none, the folder of the distribution.
    seconds
        Wall time of importing that module [s].
    printed
        What it wrote to standard output when it was imported.
    """

    distribution: str
    version: str
    entry_point: str
    requirements: tuple[str, ...] = ()
    file: str = ""
    seconds: float = 0.0
    printed: str = ""

    def __str__(self) -> str:
        return f"{self.distribution} {self.version}".rstrip()

    @property
    def in_full(self) -> str:
        """Text with the file."""
        return f"{self} ({self.file})" if self.file else str(self)


@dataclass(frozen=True)
class Unreadable:
    """An entry point that cannot be read, or all of a distribution, and why."""

    source: Source
    reason: str


def entry_points() -> Iterator[tuple[Source, metadata.EntryPoint] | Unreadable]:
    """Yield each entry point once with its source, in the order of ``sys.path``."""
    seen: set[object] = set()
    for distribution in metadata.distributions():
        # Hundreds of distributions have no such group: nothing else of theirs is read.
        text = attempt(distribution.read_text, "entry_points.txt").value
        if not text or f"[{PROJECT}]" not in text:
            continue
        name = attempt(getattr, distribution, "name").value or "a distribution without METADATA"
        if name in seen:  # hidden by another of its name
            continue
        seen.add(name)
        yield from _of(distribution, name, seen)


def _of(
    distribution: metadata.Distribution, name: str, seen: set[object]
) -> Iterator[tuple[Source, metadata.EntryPoint] | Unreadable]:
    where = str(distribution.locate_file(""))
    read = attempt(lambda: distribution.entry_points.select(group=PROJECT))
    if read.error is not None:
        yield Unreadable(
            Source(name, "", "entry_points.txt", file=where),
            f"its entry_points.txt cannot be read: {reason_of(read.error)} ({where}); reinstall it",
        )
        return
    version = attempt(getattr, distribution, "version").value or ""
    needs = attempt(getattr, distribution, "requires").value or ()
    requirements = tuple(text for text in needs if "extra ==" not in text.replace("'", '"'))
    for entry_point in read.value:
        if (name, entry_point.value) in seen:
            continue
        seen.add((name, entry_point.value))
        source = Source(name, version, entry_point.name, requirements, where)
        module = attempt(getattr, entry_point, "module")
        if module.error is None:
            yield replace(source, file=file_of(module.value) or where), entry_point
        else:
            wanted = f"entry point {entry_point.name}: expected a module, or module:attribute"
            yield Unreadable(source, f"{wanted}, got {short_repr(entry_point.value)} ({where})")
