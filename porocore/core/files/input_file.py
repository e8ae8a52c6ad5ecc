"""Configuration sections that name a file (FromFile): its absolute path, its hash, whether it changed."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Annotated, Self

from pydantic import BaseModel, Field, field_validator, model_validator
from pydantic_core.core_schema import ValidationInfo

from porocore.core.echo import echo_path
from porocore.core.files.reading import require_ordinary
from porocore.errors import ConfigurationError

#: Size of a mesh, geometry or image that is read [bytes].
LARGEST = 2 << 30


class FromFile(BaseModel):
    """The keys of a file.

    A relative path starts at the folder of the configuration, which the validation context names ``folder``; without
    one, at the current folder.
    """

    sha256: str | None = None
    """SHA-256 of the file's content, which is what counts; filled in where it is left out."""
    path: Annotated[str, Field(min_length=1)]
    """Where the file is; a relative path starts at the folder of the configuration."""

    @field_validator("path")
    @classmethod
    def _absolute(cls, given: str, info: ValidationInfo) -> str:
        return absolute_path(given, info)

    @model_validator(mode="after")
    def _known(self) -> Self:
        if self.sha256 is None:
            object.__setattr__(self, "sha256", content_hash(Path(self.path)))
        return self

    def checked(self, key: str) -> Path:
        """Return the path after checking the content again; ``key`` is that of this section.

        Raises
        ------
        ConfigurationError
            It is not there any more, or has changed.
        """
        path = Path(self.path)
        if (fault := _fault(path)) is not None:
            raise ConfigurationError(f"{key}.path: {fault}")
        found = content_hash(path)
        if found != self.sha256:
            raise ConfigurationError(f"{key}.sha256: {_changed(path, self.sha256, found)}")
        return path


def absolute_path(given: str, info: ValidationInfo) -> str:
    """Return the absolute path of a file, checked against the key ``sha256`` before it; see :class:`FromFile`.

    Raises
    ------
    ValueError
        There is no such file, or it has changed.
    """
    path = (Path((info.context or {}).get("folder", ".")) / given).absolute()
    expected = info.data.get("sha256")
    # Where the content is known, what was computed of it can be looked at without the file.
    fault = _fault(path)
    if expected is None and fault is not None:
        raise ValueError(fault)
    if expected is not None and fault is None and (found := content_hash(path)) != expected:
        raise ValueError(_changed(path, expected, found))
    return str(path)


def _fault(path: Path) -> str | None:
    """Return why a path leads to no file; None if it does."""
    try:
        require_ordinary(path, LARGEST)
    except OSError as error:
        return f"{echo_path(path)}: {error.strerror or error}"
    return None


def content_hash(path: Path) -> str:
    """Return the SHA-256 of a file in hexadecimal digits.

    Raises
    ------
    ValueError
        It cannot be read.
    """
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise ValueError(f"{echo_path(path)} cannot be read: {error.strerror or error}") from None


def _changed(path: Path, expected: str | None, found: str) -> str:
    return (
        f"expected {path} with the content {expected}, got {found}; the file has changed since the configuration was "
        "written: restore the old file, or remove the key sha256 to use the present file"
    )
