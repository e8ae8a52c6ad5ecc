"""Configurations that come with porocore: their paths, and the text of a new one to start from."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import yaml

from porocore.core.echo import echo, suggestion
from porocore.errors import ConfigurationError

#: File of the benchmark of Dehghani & Zilian.
BENCHMARK = "dehghani2022.yaml"
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


def packaged(name: str) -> Path:
    """Return the path of a configuration in the installed package, or in the repository."""
    package = Path(__file__).parents[2]
    installed = package / "data" / name
    return installed if installed.is_file() else package.parent / "examples" / name


def benchmark_path() -> Path:
    """Return the path of the benchmark of Dehghani & Zilian."""
    return packaged(BENCHMARK)


def as_stated_path() -> Path:
    """Return the path of the benchmark with the channel radius of the paper's text."""
    return packaged("dehghani2022-as-stated.yaml")


def crosscheck_path() -> Path:
    """Return the path of the small case on which backends are compared."""
    return packaged("crosscheck.yaml")


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
