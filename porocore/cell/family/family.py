"""Family of cells by the values of parameters (Family), base of a cell: members, ranges in dumps."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from pydantic import ModelWrapValidatorHandler, PrivateAttr, ValidationError, model_validator

from porocore.cell.family.parameters import CellParameter, base_values, values_in_order
from porocore.cell.family.ranges import (
    parameters_of,
    rebuilt,
    refusals,
    replaced,
    require_ends,
    split_ranges,
)
from porocore.core.models.strict import StrictModel
from porocore.errors import ConfigurationError, MemberError
from porocore.states import Array

if TYPE_CHECKING:
    import numpy.typing as npt


class Family(StrictModel):
    """Settings of a cell whose numbers may be ranges: a family of cells, or one member of it.

    A family has the numbers of its base, the middles of the ranges. A member has numbers of its own and the same
    :attr:`parameters`. Settings without ranges are neither.
    """

    _parameters: tuple[CellParameter, ...] = PrivateAttr(default=())
    #: Values of the parameters of a member; None for a family, whose numbers are those of its base.
    _values: tuple[float, ...] | None = PrivateAttr(default=None)

    @model_validator(mode="wrap")
    @classmethod
    def _read_ranges(cls, data: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        if not isinstance(data, Mapping):
            return handler(data)
        numbers, ranges = split_ranges(cls, data)
        cell = handler(numbers)
        if ranges:
            cell._parameters = parameters_of(cell, ranges)
            require_ends(cell, cell._parameters)
        return cell

    def _with_ranges(self, data: dict[str, Any]) -> dict[str, Any]:
        """Return dumped settings with the ranges of a family in place of its numbers."""
        if self._values is not None:
            return data
        ranges = {p.path: {"range": [p.lower, p.upper]} for p in self._parameters}
        found: dict[str, Any] = replaced(data, ranges)
        return found

    @property
    def parameters(self) -> tuple[CellParameter, ...]:
        """Parameters of the family that the cell is or belongs to, in the order of its keys; empty without ranges."""
        return self._parameters

    @property
    def parameter_values(self) -> Array | None:
        """Values of the parameters of a member, (m,); None for a family, and for a cell without parameters."""
        return None if self._values is None else np.array(self._values)

    @property
    def is_family(self) -> bool:
        """True where the parameters have no values, so that :meth:`at` has to choose a member."""
        return bool(self._parameters) and self._values is None

    def at(self, values: Mapping[str, float] | npt.ArrayLike = (), /) -> Self:
        """Return the member of the family at some values of the parameters.

        Its mesh is that of the family, moved from the base values; it is never made anew.

        Parameters
        ----------
        values : mapping or (m,)
            Values by name, or in the order of :attr:`parameters`.

        Raises
        ------
        MemberError
            No cell has these values together.
        ConfigurationError
            A name is unknown, or a value is missing or outside its range.
        """
        numbers = values_in_order(self._parameters, values)
        if not self._parameters:
            return self
        return self._member(numbers)

    def with_parameters(self, parameters: tuple[CellParameter, ...]) -> Self:
        """Return the family of the cell with these parameters, whose base has the numbers of this one."""
        family = self.model_copy()
        family.__dict__.pop("_generic_member", None)
        family.__dict__.pop("point_group", None)
        family._parameters, family._values = parameters, None
        return family

    def fixed(self, names: Collection[str]) -> Self:
        """Return the family or the member without the named parameters, which keep the numbers that they have."""
        kept = [k for k, parameter in enumerate(self._parameters) if parameter.name not in names]
        found = self.with_parameters(tuple(self._parameters[k] for k in kept))
        if self._values is not None and kept:
            found._values = tuple(self._values[k] for k in kept)
        return found

    def _member(self, numbers: tuple[float, ...]) -> Self:
        paths = [parameter.path for parameter in self._parameters]
        try:
            found = rebuilt(self, dict(zip(paths, numbers, strict=True)))
        except ValidationError as error:
            at = ", ".join(f"{p.name} = {x:g}" for p, x in zip(self._parameters, numbers, strict=True))
            raise MemberError(f"no cell has {at}: {refusals(error)}") from None
        found._parameters, found._values = self._parameters, numbers
        return found

    @property
    def moved_from(self) -> dict[str, float]:
        """Base values by key from which the mesh of a member was moved; empty where it is that of its own numbers."""
        return {
            p.key: p.base
            for p, value in zip(self._parameters, self._values or (), strict=False)
            if p.shape and value != p.base
        }

    def base_section(self, key: str) -> Any:
        """Return a section with the base values in place of those of a member."""
        numbers = {p.path[1:]: p.base for p in self._parameters if p.path[0] == key}
        section = getattr(self, key)
        return type(section).model_validate(replaced(section.model_dump(), numbers)) if numbers else section

    @property
    def _generic(self) -> Self:
        """Member near the base of a family, without a symmetry by chance; a member is its own."""
        # What is kept must not be the cell itself, else two equal ones are compared without end.
        return self._generic_member if self.is_family else self

    @cached_property
    def _generic_member(self) -> Self:
        shares = 1e-3 * np.sqrt(np.arange(2, 2 + len(self._parameters)))
        widths = [parameter.upper - parameter.lower for parameter in self._parameters]
        return self._member(tuple((base_values(self._parameters) + shares * widths).tolist()))

    def require_member(self, advice: str = "give one number instead of the range") -> None:
        """Refuse a family where one cell is needed.

        Raises
        ------
        ConfigurationError
            A parameter has no value.
        """
        if self.is_family:
            first = self._parameters[0]
            raise ConfigurationError(
                f"{first.key}: expected one number, got the range from {first.lower:g} to {first.upper:g}; {advice}"
            )
