"""A geometry that is read from a file: where the file is, and that it is still the one that was meant."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, Field, field_validator
from pydantic_core.core_schema import ValidationInfo

from porocore.errors import ConfigurationError


class FromFile(BaseModel):
    """The keys of a file.

    A relative path starts at the folder of the configuration, which the validation context names ``folder``; without
    one, at the current folder.
    """

    path: Annotated[str, Field(min_length=1)]
    sha256: Annotated[str | None, Field(validate_default=True)] = None
    """Of the content, which is what counts; filled in where it is left out."""

    @field_validator("path")
    @classmethod
    def _absolute(cls, path: str, info: ValidationInfo) -> str:
        folder = (info.context or {}).get("folder", ".")
        return str((Path(folder) / path).absolute())

    @field_validator("sha256")
    @classmethod
    def _same(cls, sha256: str | None, info: ValidationInfo) -> str | None:
        if "path" not in info.data:
            return sha256
        path = Path(info.data["path"])
        if not path.is_file():
            if sha256 is None:
                raise ValueError(f"no such file: {path}")
            return sha256  # what was computed of it can still be looked at
        found = content_hash(path)
        if sha256 not in (None, found):
            raise ValueError(_changed(path, sha256, found))
        return found

    def checked(self) -> Path:
        """The file, after another look at its content.

        Raises
        ------
        ConfigurationError
            It is not there any more, or has changed.
        """
        path = Path(self.path)
        if not path.is_file():
            raise ConfigurationError(f"cell.geometry.path: no such file: {path}")
        found = content_hash(path)
        if found != self.sha256:
            raise ConfigurationError(f"cell.geometry.sha256: {_changed(path, self.sha256, found)}")
        return path


def content_hash(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal digits.

    Raises
    ------
    ValueError
        It cannot be read.
    """
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise ValueError(f"{path} cannot be read: {error.strerror or error}") from error


def _changed(path: Path, expected: str | None, found: str) -> str:
    return (
        f"expected {path} with the content {expected}, got {found}; the file has changed since the configuration was "
        "written: bring it back, or leave sha256 out to take it as it is now"
    )
