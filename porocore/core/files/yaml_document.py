"""Reading of a YAML file with the line of each key (YamlDocument); dotted names of keys."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from porocore.core.echo import MOST, cut, echo_path
from porocore.core.files import yaml_loader
from porocore.core.files.reading import read_text
from porocore.errors import ConfigurationError

#: Where something stands in a document: keys and list positions, as text.
Location = tuple[str, ...]


def dotted(location: Location) -> str:
    """Return a location as messages name it, ``cell.geometry.radius``; a long key is cut."""
    return ".".join(cut(part) for part in location)


@dataclass(frozen=True, eq=False)
class YamlDocument:
    """The mapping that a file holds, or settings from elsewhere.

    Attributes
    ----------
    path
        The file; None: the data does not come from one.
    data
        Its content, of plain types only.
    lines
        Line of every key and list entry, counted from 1; the document itself is the empty location.
    folder
        Where relative paths in it start.
    """

    path: Path | None
    data: dict[str, Any]
    lines: dict[Location, int]
    folder: Path

    @classmethod
    def of(cls, settings: Mapping[str, Any], folder: Path) -> YamlDocument:
        """Return the document of nested settings; all of them are on line 0."""
        data = {str(key): value for key, value in settings.items()}
        return cls(None, data, dict.fromkeys(_locations(data, ()), 0), folder)

    @classmethod
    def read(cls, path: Path) -> YamlDocument:
        """Read one YAML file.

        Raises
        ------
        ConfigurationError
            It cannot be read, is not YAML, does not hold a mapping, or gives a key twice.
        """
        text = _text(path)
        try:
            node, data = yaml_loader.load(text)
        except yaml.MarkedYAMLError as error:
            mark = error.problem_mark or error.context_mark
            where = f"{path}:{mark.line + 1}" if mark else f"{path}"
            if isinstance(error, yaml_loader.Refused):
                raise ConfigurationError(f"{where}: {error.problem}") from error
            context = f"{error.context}, " if error.context else ""
            raise ConfigurationError(
                f"{where}: not valid YAML: {cut(context + (error.problem or ''), 2 * MOST)}; "
                "check indentation, colons and quotes on this line and the one above"
            ) from error
        except (yaml.YAMLError, ValueError, RecursionError) as error:
            raise ConfigurationError(f"{path}: not valid YAML: {' '.join(str(error).split())}") from error
        if not isinstance(data, dict):
            found = "nothing" if data is None else f"a {type(data).__name__}"
            raise ConfigurationError(f"{path}: expected sections such as 'cell:' and 'macro:', got {found}")
        lines: dict[Location, int] = {}
        _record(node, (), lines, path)
        return cls(path, data, lines, path.parent)

    def __contains__(self, location: Location) -> bool:
        return location in self.lines

    def line(self, location: Location) -> int:
        """Return the line of a location, or of the nearest enclosing one in the file."""
        while location not in self.lines:
            location = location[:-1]
        return self.lines[location]

    def at_line(self, line: int) -> str:
        """Return how a message about a line begins."""
        return f"{self.path}:{line}" if self.path is not None else "settings"

    def value(self, location: Location) -> Any:
        """Return the value at a location."""
        value: Any = self.data
        for part in location:
            value = (
                value[int(part)]
                if isinstance(value, list | tuple)
                else {str(k): v for k, v in value.items()}[part]
            )
        return value


def _locations(value: Any, at: Location) -> Iterator[Location]:
    yield at
    if isinstance(value, Mapping):
        for key, below in value.items():
            yield from _locations(below, (*at, str(key)))
    elif isinstance(value, list | tuple):
        for i, below in enumerate(value):
            yield from _locations(below, (*at, str(i)))


def _text(path: Path) -> str:
    """Return what a configuration file holds; what cannot be read is a :class:`ConfigurationError`."""
    try:
        return read_text(path, yaml_loader.MOST_BYTES)
    except FileNotFoundError as error:
        raise ConfigurationError(
            f"{path}: no such file; give the path of a configuration, such as one from examples/"
        ) from error
    except IsADirectoryError as error:
        raise ConfigurationError(f"{path}: expected a configuration file, got a folder") from error
    except UnicodeDecodeError as error:
        raise ConfigurationError(f"{path}: expected YAML text in UTF-8, got other bytes") from error
    except OSError as error:
        raise ConfigurationError(f"{echo_path(path)}: cannot be read: {error.strerror or error}") from error


def _record(node: Any, location: Location, lines: dict[Location, int], path: Path) -> None:
    """Note the line of every key below ``node``, which contains no alias of itself."""
    lines.setdefault(location, node.start_mark.line + 1)
    if isinstance(node, yaml.MappingNode):
        own: dict[str, int] = {}
        for key, value in node.value:
            name, line = str(key.value), key.start_mark.line + 1
            # Keys merged in by '<<' stand before the node's own and may be overridden.
            if name in own and own[name] >= node.start_mark.line + 1:
                raise ConfigurationError(
                    f"{path}:{line}: {dotted((*location, name))}: "
                    f"given twice, first on line {own[name]}; keep one"
                )
            own[name] = line
            lines[(*location, name)] = line
            _record(value, (*location, name), lines, path)
    elif isinstance(node, yaml.SequenceNode):
        for i, value in enumerate(node.value):
            _record(value, (*location, str(i)), lines, path)
