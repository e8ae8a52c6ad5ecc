"""Fields of a batch of rows (Batch), declared once beside the dataclass that holds them.

What a file holds, which shapes and numbers are right, a row without values and the documentation follow from the
declaration, so that a new field is one line.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, Self, TypeVar

import numpy as np

_KEY = "porocore"
#: Axis of the parameters of a cell in the shape of a field.
PARAMETER_AXIS = "m"
T = TypeVar("T", bound=type)
Value = TypeVar("Value")


@dataclass(frozen=True)
class RowField:
    """One field of a batch of n rows.

    Attributes
    ----------
    shape
        Shape of one row; the array has n of them. A text names an axis whose length others give: ``m``, the number of
        parameters.
    unit
        Unit in dimensionless results: ``-`` where there is none.
    meaning
        What it is, in one sentence.
    flag
        What must be asked for: ``tangent`` (derivatives), ``slopes`` (derivatives by the parameters of the cell),
        ``deformed`` (conductivity of the deformed pore), ``undeformed`` (responses of undeformed members alone);
        ``surrogate`` where cell solvers never provide it; empty: nothing.
    models
        Models of surrogates that predict it.
    gaps
        A row with values may hold NaN here.
    dtype
        Type of the numbers.
    """

    shape: tuple[int | str, ...]
    unit: str
    meaning: str
    flag: str = ""
    models: tuple[str, ...] = ()
    gaps: bool = False
    dtype: type = np.float64

    @property
    def heading(self) -> str:
        """Shape of the array and, where they are not float64, type of its numbers."""
        shape = ", ".join(map(str, ("n", *self.shape))) + ("" if self.shape else ",")
        return f"({shape})" + ("" if self.dtype is np.float64 else f" {np.dtype(self.dtype).name}")

    def row_shape(self, m: int | None = None) -> tuple[int, ...]:
        """Return the shape of one row for m parameters.

        Raises
        ------
        ValueError
            It hangs on their number, and none is given.
        """
        if m is None and PARAMETER_AXIS in self.shape:
            raise ValueError(f"'{self.meaning}' has a row for each parameter; their number is missing")
        return tuple(int(m or 0) if length == PARAMETER_AXIS else int(length) for length in self.shape)

    def count_parameters(self, shape: tuple[int, ...]) -> int | None:
        """Return the number m of parameters that an array (n, ...) of this field has; None: none at all."""
        if PARAMETER_AXIS not in self.shape or len(shape) != 1 + len(self.shape):
            return None
        return shape[1 + self.shape.index(PARAMETER_AXIS)]


def row(unit: str, meaning: str, *shape: int | str, **more: Any) -> dict[str, RowField]:
    """Return the metadata of a dataclass field that declares it; arguments as of :class:`RowField`."""
    return {_KEY: RowField(shape, unit, meaning, **more)}


@dataclass(frozen=True)
class NestedBatch:
    """A batch within another one, and its name in files."""

    batch: type
    name: str


def rows_of(batch: type, name: str = "") -> dict[str, NestedBatch]:
    """Return the metadata of a dataclass field that holds another batch; ``name`` is used in files in its place."""
    return {_KEY: NestedBatch(batch, name)}


def declared_fields(batch: type, prefix: str = "") -> dict[str, RowField]:
    """Return all declared fields of a batch; ``group/name`` is a field of a batch within it."""
    found: dict[str, RowField] = {}
    for f in fields(batch):
        declared = f.metadata.get(_KEY)
        if isinstance(declared, RowField):
            found[prefix + f.name] = declared
        elif declared is not None:
            found |= declared_fields(declared.batch, f"{prefix}{declared.name or f.name}/")
    return found


def provided_fields(batch: Any, prefix: str = "") -> dict[str, Any]:
    """Return the values of a batch that are not None, by their names in :func:`declared_fields`."""
    found: dict[str, Any] = {}
    for f in fields(batch):
        declared, value = f.metadata.get(_KEY), getattr(batch, f.name)
        if isinstance(declared, NestedBatch) and value is not None:
            found |= provided_fields(value, f"{prefix}{declared.name or f.name}/")
        elif isinstance(declared, RowField) and value is not None:
            found[prefix + f.name] = value
    return found


def parameter_count(declared: Mapping[str, RowField], arrays: Mapping[str, Any]) -> int | None:
    """Return the number of parameters by which fields are differentiated; None where none of them has such an axis."""
    counts = (declared[name].count_parameters(np.shape(array)) for name, array in arrays.items())
    return next((m for m in counts if m is not None), None)


def documented(batch: T) -> T:
    """Add the declared fields to the documentation of a batch, before its examples."""
    lines = ["", "    Attributes", "    ----------"]
    for f in fields(batch):
        declared = f.metadata[_KEY]
        if isinstance(declared, RowField):
            lines += [f"    {f.name} : {declared.heading}", f"        {declared.meaning} [{declared.unit}]"]
        else:
            lines += [f"    {f.name}", f"        See :class:`{declared.batch.__name__}`."]
    text, heading, examples = (batch.__doc__ or "").partition("\n    Examples\n")
    batch.__doc__ = "\n".join([text.rstrip(), *lines]) + (f"\n{heading}{examples}" if heading else "\n    ")
    return batch


def provided(value: Value | None) -> Value:
    """Return a value that is there, such as a response that a check has found to be provided."""
    assert value is not None
    return value


class Batch:
    """Dataclass of arrays whose rows can be selected, nested ones included."""

    def __getitem__(self, rows: Any) -> Self:
        picked = {}
        for f in fields(self):  # type: ignore[arg-type]
            value = getattr(self, f.name)
            picked[f.name] = None if value is None else value[rows]
        return type(self)(**picked)

    @classmethod
    def concatenate(cls, parts: list[Self]) -> Self:
        """Join batches end to end; a field that is None in the first part must be None in all."""
        joined: dict[str, Any] = {}
        for f in fields(cls):  # type: ignore[arg-type]
            values = [getattr(part, f.name) for part in parts]
            if values[0] is None:
                joined[f.name] = None
            elif isinstance(values[0], Batch):
                joined[f.name] = type(values[0]).concatenate(values)
            else:
                joined[f.name] = np.concatenate(values)
        return cls(**joined)
