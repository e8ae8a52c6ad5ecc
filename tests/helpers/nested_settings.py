"""Settings that are nested as in a file, validated."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from porocore import RunConfig
from porocore.core.files.yaml_document import YamlDocument
from porocore.study.config.loading import validated


def config_from(settings: Mapping[str, Any], folder: Path | str = ".") -> RunConfig:
    """Validate a configuration; relative paths in it start at ``folder``."""
    return validated(YamlDocument.of(settings, Path(folder)))
