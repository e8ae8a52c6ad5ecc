"""Material axes of a body (AxesField), and the law that they turn from point to point (TurnedLaw)."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Annotated, Any, Literal, overload

import numpy as np
from pydantic import AfterValidator, Discriminator, Tag, field_validator, model_validator

from porocore.core.echo import echo
from porocore.core.models.strict import StrictModel
from porocore.core.units import InScales, Unit, spoken
from porocore.errors import ConfigurationError
from porocore.interfaces.law import (
    LawMemory,
    LawWrapper,
    MacroLaw,
    MacroResponse,
    MacroTangent,
    MemoryChanges,
    ResponseChanges,
    fingerprint,
)
from porocore.macro.composition.fields import (
    DataField,
    FormulaField,
    ImageField,
    ParameterField,
    Points,
    TableField,
    formula_values,
    require_formula,
)
from porocore.states import Array, MacroState

#: A direction shorter than this, or a sine of two directions below it, determines no axes.
SHORTEST = 1e-9
#: A number with a unit of angles.
_ANGLE = re.compile(
    r"([-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?)\s*(deg|degrees?|°|rad|radians?)", re.IGNORECASE
)


def _form(value: Any) -> Any:
    """Return the branch of a field: a number, a text, or the ``kind`` of a section."""
    if isinstance(value, StrictModel):
        return getattr(value, "kind", None)
    if isinstance(value, dict):
        return value.get("kind", "formula")
    return "text" if isinstance(value, str) else "number"


def _readable(text: str) -> str:
    require_formula(text)
    return text


#: Text of a formula of x, y, z and t.
Formula = Annotated[str, AfterValidator(_readable), InScales()]
#: A number, a formula, or a section with a ``kind``.
AnyField = Annotated[
    Annotated[float, Tag("number")]
    | Annotated[Formula, Tag("text")]
    | Annotated[FormulaField, Tag("formula")]
    | Annotated[TableField, Tag("table")]
    | Annotated[ImageField, Tag("image")]
    | Annotated[DataField, Tag("data")],
    Discriminator(_form),
]
Component = float | Formula
Direction = tuple[Component, Component, Component]


class AxesField(StrictModel):
    """Material axes, in which the cell stands in the body.

    Either turned by ``angle`` about the line ``about``, or with the first two axes along ``first`` and ``second``, of
    which the second is made perpendicular to the first.
    """

    kind: Literal["axes"] = "axes"
    """Material axes."""
    about: tuple[float, float, float] | None = None
    """Direction of the line about which the axes are turned, counter-clockwise where it points to the reader."""
    angle: Annotated[AnyField | None, Unit("degrees")] = None
    """Angle by which they are turned."""
    first: Direction | None = None
    """Direction of the cell's first axis: three numbers or formulas of x, y, z and t."""
    second: Direction | None = None
    """Direction of the cell's second axis."""

    @model_validator(mode="before")
    @classmethod
    def _turn_by_their_angle(cls, data: Any) -> Any:
        if isinstance(data, dict) and (given := [key for key in ("initial", "over") if key in data]):
            raise ValueError(
                f"expected initial and over under 'angle:', got {' and '.join(given)} beside it; write "
                "'angle: {formula: 12*y, initial: 0, over: {ramp: 1, until: 100}}'"
            )
        return data

    @field_validator("angle", mode="before")
    @classmethod
    def _in_degrees(cls, angle: Any) -> Any:
        given = _ANGLE.fullmatch(angle.strip()) if isinstance(angle, str) else None
        if given is not None:
            number, unit = float(given[1]), given[2].lower()
            degrees = number if unit.startswith(("d", "°")) else np.rad2deg(number)
            raise ValueError(f"an angle is in degrees, without a unit; write {degrees:g}, got {echo(angle)}")
        return angle

    @model_validator(mode="after")
    def _one_way(self) -> AxesField:
        turned, directed = (self.about, self.angle), (self.first, self.second)
        for pair, words in ((turned, "about and angle"), (directed, "first and second")):
            if (pair[0] is None) != (pair[1] is None):
                raise ValueError(f"{words} belong together")
        if (self.about is None) == (self.first is None):
            raise ValueError("expected either about and angle, or first and second")
        if self.about is not None and np.linalg.norm(self.about) < SHORTEST:
            raise ValueError("about is no direction, all of its components are zero")
        return self

    @property
    def varies(self) -> bool:
        """True for axes that change with time."""
        texts = (component for component in (*(self.first or ()), *(self.second or ())))
        moves = any(isinstance(text, str) and "t" in require_formula(text).names for text in texts)
        return moves or (self.angle is not None and as_field(self.angle).varies)

    @property
    def corners(self) -> tuple[float, ...]:
        """Times at which the axes have a kink."""
        return () if self.angle is None else as_field(self.angle).corners

    def rotations(self, points: Points, time: float, key: str) -> Array:
        """Return the rotations (n, 3, 3) whose columns are the axes.

        Raises
        ------
        ConfigurationError
            A direction has no length somewhere, or both are along one line; the message begins with ``key``.
        """
        if self.about is not None and self.angle is not None:
            angle = as_field(self.angle)
            degrees = angle.in_time(angle.reached(points, time, f"{key}.angle"), time)
            return _turns(np.array(self.about), np.deg2rad(degrees))
        assert self.first is not None
        assert self.second is not None
        first = _unit(_direction(self.first, points, time, f"{key}.first"), points, f"{key}.first")
        second = _direction(self.second, points, time, f"{key}.second")
        across = second - np.einsum("ni,ni->n", first, second)[:, None] * first
        across = _unit(across, points, f"{key}.second", "has no part perpendicular to the first axis")
        return np.stack([first, across, np.cross(first, across)], axis=-1)


def _entry_form(value: Any) -> Any:
    """Return the branch of an entry of ``fields``, where a section without a ``kind`` may be of axes."""
    if (
        isinstance(value, dict)
        and "kind" not in value
        and {"about", "angle", "first", "second"} & value.keys()
    ):
        return "axes"
    return _form(value)


#: A field of a parameter, or the material axes.
AnyEntry = Annotated[
    Annotated[float, Tag("number")]
    | Annotated[Formula, Tag("text")]
    | Annotated[FormulaField, Tag("formula")]
    | Annotated[TableField, Tag("table")]
    | Annotated[ImageField, Tag("image")]
    | Annotated[DataField, Tag("data")]
    | Annotated[AxesField, Tag("axes")],
    Discriminator(_entry_form),
]
#: Name of the entry that holds the material axes.
AXES = "axes"


def _well_named(entries: dict[str, Any]) -> dict[str, Any]:
    """Refuse axes under another name, and parameters called ``axes``."""
    for name, entry in entries.items():
        if (name == AXES) != isinstance(entry, AxesField):
            raise ValueError(
                f"'{AXES}' are the material axes: expected about and angle, or first and second"
                if name == AXES
                else f"material axes are given under the name '{AXES}', not '{name}'"
            )
    return entries


#: Fields by the name of their parameter, and the axes.
Fields = Annotated[dict[str, AnyEntry], AfterValidator(_well_named)]


def as_field(value: Any) -> ParameterField:
    """Return the field of a number or a text, and any other as it is."""
    if isinstance(value, ParameterField):
        return value
    return FormulaField(formula=value if isinstance(value, str) else repr(float(value)))


def _direction(components: Direction, points: Points, time: float, key: str) -> Array:
    columns = [
        formula_values(component, points.places, time, key)
        if isinstance(component, str)
        else np.full(len(points), component)
        for component in components
    ]
    return np.stack(columns, axis=1)


def _unit(vectors: Array, points: Points, key: str, fault: str = "has no length") -> Array:
    length = np.linalg.norm(vectors, axis=1)
    if len(length) and length.min() < SHORTEST:
        at = spoken().texts(points.places[length.argmin()], "displacement")
        raise ConfigurationError(f"{key}: the direction {fault} at {at}, so that it gives no axis there")
    return np.asarray(vectors / length[:, None])


def _turns(about: Array, angle: Array) -> Array:
    """Return the rotations (n, 3, 3) about one line by the angles (n,) [Rodrigues]."""
    a = about / np.linalg.norm(about)
    cross = np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])
    sine, cosine = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.asarray(np.eye(3) + sine * cross + (1 - cosine) * (cross @ cross))


class TurnedLaw(LawWrapper):
    """A law in the axes of its material: states are turned into them, and responses back into those of the body.

    With the rotation R of a point, whose columns are the material axes, the law is asked for Rᵀ H R, p and Rᵀ ∇p; it
    answers P, q and K, of which the body sees R P Rᵀ, R q and R K Rᵀ. Points without axes are left alone. Memories are
    in the axes of the body, so that a point may turn with time; the law sees them in the present axes, with the turn
    between these and those of their own time.
    """

    def __init__(self, law: MacroLaw) -> None:
        super().__init__(law)
        self.identity = fingerprint("turned", law.identity)

    def states_in(self, states: MacroState) -> MacroState:
        """Return the states in the axes of the material, at places that have no others."""
        return states.in_own_axes()

    def gradient_in(self, grad_p: Array, states: MacroState) -> Array:
        """Return Rᵀ ∇_X p."""
        R = _axes(states)
        return grad_p if R is None else (grad_p[:, None, :] @ R)[:, 0]

    def memory_in(self, memory: LawMemory, states: MacroState) -> LawMemory:
        """Return the memory in the axes that the material has in ``states``."""
        R = _axes(states)
        if R is None:
            return memory
        before, place = _axes(memory.states), memory.states.place
        turn = None if before is None or before is R else R.swapaxes(1, 2) @ before
        states = replace(
            memory.states,
            grad_u=_in(memory.states.grad_u, R),
            place=None if place is None else replace(place, axes=turn),
        )
        return replace(memory, states=states, mean_grad=_in(memory.mean_grad, R))

    def memory_changes_in(self, before: MemoryChanges, states: MacroState) -> MemoryChanges:
        """Return the derivatives of the memory in the axes of the material."""
        R = _axes(states)
        if R is None:
            return before
        return replace(before, grad_u=_each_in(before.grad_u, R), mean_grad=_each_in(before.mean_grad, R))

    def memory_out(self, memory: LawMemory, states: MacroState) -> LawMemory:
        """Return the memory in the axes of the body."""
        R = _axes(states)
        return memory if R is None else replace(memory, states=states, mean_grad=_back(memory.mean_grad, R))

    def response_out(self, response: MacroResponse, states: MacroState) -> MacroResponse:
        """Return the response in the axes of the body."""
        R = _axes(states)
        if R is None:
            return response
        return replace(
            response,
            stress=_back(response.stress, R),
            flux=(R @ response.flux[:, :, None])[..., 0],
            memory=self.memory_out(response.memory, states),
            deformation=_back(response.deformation, R),
            transformed_conductivity=_back(response.transformed_conductivity, R),
            tangent=None if response.tangent is None else _tangent_in_body(response.tangent, R),
        )

    def changes_out(self, changes: ResponseChanges, states: MacroState) -> ResponseChanges:
        """Return the derivatives of a response in the axes of the body."""
        R = _axes(states)
        return changes if R is None else _changes_in_body(changes, R)


def _axes(states: MacroState) -> Array | None:
    return None if states.place is None else states.place.axes


def _in(tensor: Array, R: Array) -> Array:
    """Return Rᵀ T R (n, 3, 3)."""
    return np.asarray(R.swapaxes(1, 2) @ tensor @ R)


def _back(tensor: Array, R: Array) -> Array:
    """Return R T Rᵀ (n, 3, 3)."""
    return np.asarray(R @ tensor @ R.swapaxes(1, 2))


@overload
def _each_in(tensors: Array, R: Array) -> Array: ...
@overload
def _each_in(tensors: None, R: Array) -> None: ...
def _each_in(tensors: Array | None, R: Array) -> Array | None:
    """Return Rᵀ T R of tensors (n, 3, 3, k)."""
    return None if tensors is None else np.einsum("nia,nijk,njb->nabk", R, tensors, R, optimize=True)


def _changes_in_body(changes: ResponseChanges, R: Array) -> ResponseChanges:
    back = R.swapaxes(1, 2)
    M, Q = changes.mean_grad_grad_u, changes.mean_grad_p
    return replace(
        changes,
        stress=_each_in(changes.stress, back),
        flux=R @ changes.flux,
        mean_grad=_each_in(changes.mean_grad, back),
        mean_grad_grad_u=None if M is None else _fourth_rank_back(M, R),
        mean_grad_p=None if Q is None else _back(Q, R),
    )


def _fourth_rank_back(tensor: Array, R: Array) -> Array:
    """Return a derivative of a tensor by a tensor (n, 3, 3, 3, 3) in the axes of the body."""
    n = len(R)
    # T ↦ R T Rᵀ of tensors as rows of 9.
    pairs = np.einsum("nia,njb->nijab", R, R).reshape(n, 9, 9)
    return np.asarray(pairs @ tensor.reshape(n, 9, 9) @ pairs.swapaxes(1, 2)).reshape(n, 3, 3, 3, 3)


def _tangent_in_body(tangent: MacroTangent, R: Array) -> MacroTangent:
    n = len(R)
    # T ↦ R T Rᵀ of tensors as rows of 9.
    pairs = np.einsum("nia,njb->nijab", R, R).reshape(n, 9, 9)
    back = pairs.swapaxes(1, 2)
    flux = R @ tangent.flux_grad_u.reshape(n, 3, 9) @ back
    return MacroTangent(
        stress_grad_u=_fourth_rank_back(tangent.stress_grad_u, R),
        stress_p=_back(tangent.stress_p, R),
        storage_grad_u=_back(tangent.storage_grad_u, R),
        storage_p=tangent.storage_p,
        flux_grad_u=flux.reshape(n, 3, 3, 3),
        flux_p=(R @ tangent.flux_p[:, :, None])[..., 0],
        flux_grad_p=_back(tangent.flux_grad_p, R),
    )
