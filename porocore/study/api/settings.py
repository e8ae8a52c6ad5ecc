"""Settings of a study as Python users give them: a file, an example by name, nested settings, a configuration."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from porocore.core.echo import did_you_mean, echo
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
