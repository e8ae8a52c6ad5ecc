"""Configuration sections that name a file (FromFile): its absolute path, its hash, whether it changed."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Annotated, ClassVar, Self

from pydantic import BaseModel, Field, field_validator, model_validator
from pydantic_core.core_schema import ValidationInfo

from porocore.core.echo import echo_path
from porocore.core.files.metaimage import data_file
from porocore.core.files.reading import require_ordinary
from porocore.core.files.slices import Slices, has_signs
from porocore.errors import ConfigurationError

#: Size of a mesh, geometry or image that is read [bytes].
LARGEST = 2 << 30


class FromFile(BaseModel):
    """The keys of a file.

    A relative path starts at the folder of the configuration, which the validation context names ``folder``; without
    one, at the current folder. Subclasses that read a stack of slices name the suffixes of their files in
    ``slice_suffixes``; for these the path may be that of a folder, or a pattern of names.
    """

    slice_suffixes: ClassVar[tuple[str, ...]] = ()
    sha256: str | None = None
    """SHA-256 of the file's content, which is what counts; filled in where it is left out."""
    path: Annotated[str, Field(min_length=1)]
    """Where the file is; a relative path starts at the folder of the configuration."""

    @field_validator("path")
    @classmethod
    def _absolute(cls, given: str, info: ValidationInfo) -> str:
        return absolute_path(given, info, cls.slice_suffixes)

    @model_validator(mode="after")
    def _known(self) -> Self:
        if self.sha256 is None:
            object.__setattr__(self, "sha256", content_hash(Path(self.path), self.slice_suffixes))
        return self

    @property
    def slices(self) -> Slices | None:
        """The slices to which the path leads; None: it is that of one file.

        Raises
        ------
        ConfigurationError
            They are not one stack any more.
        """
        try:
            return Slices.at(Path(self.path), self.slice_suffixes) if self.slice_suffixes else None
        except ValueError as error:
            raise ConfigurationError(str(error)) from None

    @property
    def file_name(self) -> str:
        """The name of the file or folder; with its folder for a pattern of names."""
        path = Path(self.path)
        return "/".join(path.parts[-2:]) if has_signs(path) else path.name

    def checked(self, key: str) -> Path:
        """Return the path after checking the content again; ``key`` is that of this section.

        Raises
        ------
        ConfigurationError
            It is not there any more, or has changed.
        """
        path = Path(self.path)
        if (fault := _fault(path, self.slice_suffixes)) is not None:
            raise ConfigurationError(f"{key}.path: {fault}")
        found = content_hash(path, self.slice_suffixes)
        if found != self.sha256:
            raise ConfigurationError(f"{key}.sha256: {_changed(path, self.sha256, found)}")
        return path


def absolute_path(given: str, info: ValidationInfo, suffixes: tuple[str, ...] = ()) -> str:
    """Return the absolute path of a file, checked against the key ``sha256`` before it; see :class:`FromFile`.

    Or of slices with one of the suffixes.

    Raises
    ------
    ValueError
        There is no such file, or it has changed.
    """
    path = (Path((info.context or {}).get("folder", ".")) / given).absolute()
    expected = info.data.get("sha256")
    # Where the content is known, what was computed of it can be looked at without the file.
    fault = _fault(path, suffixes)
    if expected is None and fault is not None:
        raise ValueError(fault)
    if expected is not None and fault is None and (found := content_hash(path, suffixes)) != expected:
        raise ValueError(_changed(path, expected, found))
    return str(path)


def _fault(path: Path, suffixes: tuple[str, ...]) -> str | None:
    """Return why a path leads to no file, or to no slices with these suffixes; None if it does."""
    try:
        files = _files(path, suffixes)
    except ValueError as error:
        return str(error)
    left = LARGEST
    for file in files:
        try:
            require_ordinary(file, LARGEST)
            left -= file.stat().st_size
        except OSError as error:
            named = f"{echo_path(path)}: ElementDataFile: " if file != path == files[0] else ""
            return f"{named}{echo_path(file)}: {error.strerror or error}"
    if left < 0:
        return (
            f"{echo_path(path)}: expected slices of at most {LARGEST / 1e9:.3g} GB together; leave some out"
        )
    return None


def _files(path: Path, suffixes: tuple[str, ...]) -> tuple[Path, ...]:
    """Return the files whose content counts: slices, or the one of the path with that of the voxels that it names."""
    if not suffixes:
        return (path,)
    if (slices := Slices.at(path, suffixes)) is not None:
        return slices.files
    data = data_file(path)
    return (path,) if data is None else (path, data)


def content_hash(path: Path, suffixes: tuple[str, ...] = ()) -> str:
    """Return the SHA-256 of a file in hexadecimal digits; of several files that of all their names and contents.

    Raises
    ------
    ValueError
        It cannot be read.
    """
    files = _files(path, suffixes)
    if files != (path,):
        lines = (f"{content_hash(file)}  {file.name}\n" for file in files)
        return hashlib.sha256("".join(lines).encode("utf-8", "surrogateescape")).hexdigest()
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise ValueError(f"{echo_path(path)} cannot be read: {error.strerror or error}") from None


def _changed(path: Path, expected: str | None, found: str) -> str:
    then = (
        "; the file has changed since the configuration was written: restore the old file, or remove the key sha256 to "
        "use the present file"
        if path.is_file()
        else "; slices have changed, are missing or were added since the configuration was written: restore the old "
        "ones, or remove the key sha256 to use those that are there"
    )
    return f"expected {path} with the content {expected}, got {found}{then}"
