"""The configurations that come with porocore, to start from."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import yaml

from porocore.core.echo import echo, suggestion
from porocore.errors import ConfigurationError
from porocore.study.benchmark import benchmark_path

SCHEMA_FILE = "porocore.schema.json"
MODELINE = f"# yaml-language-server: $schema=./{SCHEMA_FILE}"
_HEAD = f"""{MODELINE}
# An editor with a YAML language server completes and checks the keys by this schema; write it beside this file with
#     porocore schema --to {SCHEMA_FILE}
#
"""


@dataclass(frozen=True)
class Example:
    """One configuration to start from.

    Attributes
    ----------
    name
        Name of the kind and of the file.
    title
        What it computes.
    path
        The file.
    """

    name: str
    title: str
    path: Path

    def start(self, to: Path) -> str:
        """Return the text with which a new configuration ``to`` begins."""
        text = self.path.read_text(encoding="utf-8")
        return _HEAD + text.replace(f"examples/{self.path.name}", str(to))


def examples() -> dict[str, Example]:
    """Return the examples by name, the benchmark first."""
    benchmark = benchmark_path()
    found = {}
    for path in (benchmark, *sorted(set(benchmark.parent.glob("*.yaml")) - {benchmark})):
        title = str(yaml.safe_load(path.read_text(encoding="utf-8")).get("title", ""))
        found[path.stem] = Example(path.stem, title, path)
    return found


def example(name: str) -> Example:
    """Return the example of a name.

    Raises
    ------
    ConfigurationError
        There is none of this name.
    """
    known = examples()
    if name not in known:
        raise ConfigurationError(f"no example {echo(name)}; {suggestion(name, known, 'the examples are')}")
    return known[name]
