"""Settings as Python users give them: source of a study, name of a cell, values of a sweep."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from porocore.core.echo import did_you_mean, echo, suggestion
from porocore.core.files.plain_data import merged
from porocore.core.files.yaml_document import YamlDocument
from porocore.errors import ConfigurationError
from porocore.study.config.config import RunConfig
from porocore.study.config.examples import examples
from porocore.study.config.loading import validated


def configured(
    source: str | Path | Mapping[str, Any] | RunConfig | None, settings: dict[str, Any]
) -> tuple[str, RunConfig, YamlDocument]:
    """Return a name for the folder, the configuration, and the document that it was read from."""
    if not isinstance(source, str | Path | Mapping | RunConfig | None):
        raise ConfigurationError(
            "source: expected the path of a configuration, the name of an example or nested settings, got "
            + echo(source)
        )
    if not isinstance(source, str | Path):
        base = source.model_dump() if isinstance(source, RunConfig) else source or {}
        document = YamlDocument.of(merged(base, settings), Path.cwd())
        return (
            "study",
            source if isinstance(source, RunConfig) and not settings else validated(document),
            document,
        )
    path = Path(source)
    known = examples()
    if not path.exists() and path.name.removesuffix(".yaml") in known and path.parent == Path("."):
        path = known[path.name.removesuffix(".yaml")].path
    elif not path.suffix and not path.exists() and (question := did_you_mean(path.name, known)):
        raise ConfigurationError(f"{path}: no such file, and no example of this name; {question}")
    document = YamlDocument.read(path)
    if settings:
        document = YamlDocument.of(merged(document.data, settings), document.folder)
    return path.stem, validated(document), document


def of_named_cell(config: RunConfig, name: str | None) -> RunConfig:
    """Return the study of one cell alone; see :meth:`RunConfig.of_cell`.

    Raises
    ------
    ConfigurationError
        The study has no cell of this name.
    """
    if name is not None and name not in config.cells:
        known = suggestion(str(name), config.cells, "the cells are", "it has one cell, without a name")
        raise ConfigurationError(f"cell: the study has no cell {echo(name)}; {known}")
    return config.of_cell(name)


def values_over(
    parameter: str | Mapping[str, Sequence[float]], values: Sequence[float] | None
) -> Mapping[str, Sequence[float]]:
    """Return the values of a sweep by the name of the parameter.

    Raises
    ------
    ConfigurationError
        A name has no values, or what is given are no names.
    """
    over = {parameter: values} if isinstance(parameter, str) else parameter
    if not isinstance(over, Mapping) or any(given is None for given in over.values()):
        raise ConfigurationError(
            "expected the name of a parameter and its values, such as sweep('radius', [0.16, 0.22, 0.28])"
        )
    return {name: given for name, given in over.items() if given is not None}
