"""Fields of a batch of rows (Batch) and their declaration; derivatives of the responses of a cell.

What a file holds, which shapes and numbers are right, a row without values and the documentation follow from the
declaration, so that a new field is one line.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import partial
from typing import TYPE_CHECKING, Any, Self, TypeVar

import numpy as np

if TYPE_CHECKING:
    from porocore.states import Array


_KEY = "porocore"
#: Axis of the parameters of a cell in the shape of a field.
PARAMETER_AXIS = "m"
T = TypeVar("T", bound=type)


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
        """Return the number m of parameters that an array (n, ...) of this field has; None: it tells nothing of it."""
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


_slope = partial(row, flag="tangent")
_by_parameter = partial(row, flag="slopes")


@documented
@dataclass(frozen=True, eq=False)
class CellTangent(Batch):
    """First derivatives of the responses with respect to (H, p); response indices first.

    A surrogate that does not provide a response leaves its derivatives None.
    """

    mean_grad_grad_u: Array | None = field(
        default=None, metadata=_slope("-", "M_ijkl = ∂<∂u¹_i/∂Y_j>_s / ∂H_kl", 3, 3, 3, 3)
    )
    mean_grad_p: Array | None = field(
        default=None, metadata=_slope("1/E", "Q_ij = ∂<∂u¹_i/∂Y_j>_s / ∂p", 3, 3)
    )
    stress_grad_u: Array | None = field(default=None, metadata=_slope("E", "∂P_E,ij / ∂H_kl", 3, 3, 3, 3))
    stress_p: Array | None = field(default=None, metadata=_slope("-", "∂P_E,ij / ∂p", 3, 3))
    fluid_volume_grad_u: Array | None = field(default=None, metadata=_slope("-", "∂φ / ∂H_kl", 3, 3))
    fluid_volume_p: Array | None = field(default=None, metadata=_slope("1/E", "∂φ / ∂p"))
    conductivity_grad_u: Array | None = field(
        default=None, metadata=row("d²/μ", "∂K_ref,ij / ∂H_kl", 3, 3, 3, 3, flag="surrogate")
    )
    conductivity_p: Array | None = field(
        default=None, metadata=row("d²/(μ E)", "∂K_ref,ij / ∂p", 3, 3, flag="surrogate")
    )

    @property
    def hessian(self) -> Array | None:
        """(n, 10, 10) second derivatives of W by H, row by row, and p [E]; None without those of P_E and φ."""
        C, b, storage = self.stress_grad_u, self.stress_p, self.fluid_volume_p
        if C is None or b is None or storage is None:
            return None
        n = len(storage)
        found = np.empty((n, 10, 10))
        found[:, :9, :9] = C.reshape(n, 9, 9)
        found[:, :9, 9] = found[:, 9, :9] = b.reshape(n, 9)
        found[:, 9, 9] = -storage
        return found


@documented
@dataclass(frozen=True, eq=False)
class CellSlopes(Batch):
    """First derivatives of the responses with respect to the m parameters θ of the cell, in the order of its own.

    They are taken at fixed (H, p). A solver or surrogate that does not provide one leaves it None.
    """

    potential: Array | None = field(default=None, metadata=_by_parameter("E", "∂W / ∂θ_k", "m"))
    stress: Array | None = field(default=None, metadata=_by_parameter("E", "∂P_E,ij / ∂θ_k", 3, 3, "m"))
    fluid_volume: Array | None = field(default=None, metadata=_by_parameter("-", "∂φ / ∂θ_k", "m"))
    porosity: Array | None = field(
        default=None,
        metadata=_by_parameter("-", "∂φ_f / ∂θ_k, φ_f the porosity of the undeformed cell.", "m"),
    )
    mean_grad: Array | None = field(
        default=None, metadata=_by_parameter("-", "∂<∂u¹_i/∂Y_j>_s / ∂θ_k", 3, 3, "m")
    )
    conductivity: Array | None = field(
        default=None,
        metadata=_by_parameter(
            "d²/μ",
            "∂K_ref,ij / ∂θ_k where the response has K_ref, else ∂K_ij / ∂θ_k of the undeformed cell. NaN where K_ref "
            "is.",
            3,
            3,
            "m",
            gaps=True,
        ),
    )
    hessian: Array | None = field(
        default=None,
        metadata=row(
            "E",
            "∂³W / ∂(H, p)_k ∂(H, p)_l ∂θ_m of the undeformed cell, with H row by row and p in k and l. NaN where it "
            "has a stress.",
            10,
            10,
            "m",
            flag="undeformed",
            gaps=True,
        ),
    )
