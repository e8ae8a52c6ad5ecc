"""Base of configuration sections (StrictModel), choice of a section by its ``kind``, walk over values."""

from __future__ import annotations

import re
import types
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any, TypeGuard, TypeVar, Union, get_args, get_origin

from pydantic import BaseModel, BeforeValidator, ConfigDict, Discriminator, Tag, ValidationError
from pydantic_core import ErrorDetails

from porocore.core.echo import comma_advice, did_you_mean, echo
from porocore.core.files.yaml_document import Location, dotted
from porocore.errors import ConfigurationError

#: Pydantic's words, and plain ones.
_PLAIN = {
    "a valid ": "a ",
    "integer": "whole number",
    "greater than or equal to": "at least",
    "less than or equal to": "at most",
}


class StrictModel(BaseModel):
    """Immutable model that refuses unknown keys and numbers that are not finite."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    def quantity_of(self, below: Location, declared: str) -> str:
        """Return the quantity of a number below the section, by default as it is declared; '' is a plain number."""
        return declared


def _as_text(value: Any) -> Any:
    return str(value) if isinstance(value, int) and not isinstance(value, bool) else value


#: A name that may be the number of a group of a mesh, quoted or not.
Name = Annotated[str, BeforeValidator(_as_text)]

if TYPE_CHECKING:
    # The constructors of models are known of pydantic's own metaclass only.
    from pydantic._internal._model_construction import ModelMetaclass

    CalledByUsers = ModelMetaclass
else:

    class CalledByUsers(type(BaseModel)):
        """Metaclass of models that users call themselves: a fault is one message and no error of pydantic.

        Sections of a file are not called, so that their faults have their lines.
        """

        def __call__(cls, *args: Any, **settings: Any) -> Any:
            """Return the model.

            Raises
            ------
            ConfigurationError
                A setting is unknown or faulty.
            """
            try:
                return super().__call__(*args, **settings)
            except ValidationError as error:
                found: dict[str, str] = {}
                for fault in error.errors():
                    found.setdefault(_place(settings, fault["loc"]) or cls.__name__, fault_text(fault))
                raise ConfigurationError("\n".join(f"{at}: {text}" for at, text in found.items())) from None


def _place(settings: Any, location: tuple[int | str, ...]) -> str:
    """Return the dotted key of a fault, without the branches of unions that pydantic names behind a key."""
    kept = []
    for i, part in enumerate(location):
        here = part in settings if isinstance(settings, Mapping) else isinstance(part, int)
        if here or i == len(location) - 1:
            kept.append(str(part))
            settings = settings[part] if here and isinstance(settings, Mapping) else None
    return dotted(tuple(kept))


def fault_text(error: ErrorDetails) -> str:
    """Return what was expected and what came, in the words of messages and without the place."""
    kind, message, value = error["type"], error["msg"], error["input"]
    if kind == "extra_forbidden":
        return "unknown key; remove it"
    if kind == "missing":
        return f"missing; got {echo(value)}"
    if kind == "value_error":
        text = message.removeprefix("Value error, ")
        choice = re.fullmatch(r"'.*' is not one of (.*?)\.?", text, re.DOTALL)  # in the words of typer
        return f"expected one of {choice[1]}, got {echo(value)}" if choice else text
    if kind == "union_tag_invalid":
        kinds = [name.strip("' ") for name in error["ctx"]["expected_tags"].split(",")]
        question = did_you_mean(str(error["ctx"]["tag"]), kinds)
        return f"expected a kind of {', '.join(kinds)}, got {echo(value)}" + (
            f"; {question}" if question else ""
        )
    expected = message.removeprefix("Input should be ").partition(", unable to parse")[0]
    for words, plain in _PLAIN.items():
        expected = expected.replace(words, plain)
    return f"expected {expected}, got {echo(value)}{comma_advice(value)}"


def bounds(name: str, metadata: Iterable[Any], kind: str = "a number") -> str:
    """Return a text such as ``a number with 0 < radius < 0.5`` for the constraints of a field; empty without any."""
    lower = upper = ""
    for constraint in metadata:
        if (bound := getattr(constraint, "gt", None)) is not None:
            lower = f"{_said(bound)} < "
        elif (bound := getattr(constraint, "ge", None)) is not None:
            lower = f"{_said(bound)} <= "
        elif (bound := getattr(constraint, "lt", None)) is not None:
            upper = f" < {_said(bound)}"
        elif (bound := getattr(constraint, "le", None)) is not None:
            upper = f" <= {_said(bound)}"
    return f"{kind} with {lower}{name}{upper}" if lower or upper else ""


def _said(bound: float) -> str:
    """Return a bound as a message names it: all digits of a whole number."""
    return str(bound) if isinstance(bound, int) else f"{bound:g}"


def by_kind(base: type[BaseModel], default: str) -> Discriminator:
    """Return the discriminator of a union by the ``kind`` of a mapping or of an instance of ``base``.

    Parameters
    ----------
    base
        What all classes derive from.
    default
        The kind of a mapping that names none.
    """

    def kind(value: Any) -> Any:
        if isinstance(value, base):
            return getattr(value, "kind", None)
        return value.get("kind", default) if isinstance(value, dict) else default

    return Discriminator(kind)


#: Key of the ends of a range in place of a number.
RANGE = "range"


@dataclass(frozen=True)
class Place:
    """One value of a configuration.

    Attributes
    ----------
    path
        Keys and indices that lead to the value.
    value
        Read data or a validated value.
    annotation
        Declared type without its metadata; of a union the section, mapping or list that holds the value.
    metadata
        Declared metadata, followed by those of that member.
    above
        Place of the section, mapping or list that holds the value; None for the root.
    """

    path: Location
    value: Any
    annotation: Any
    metadata: tuple[Any, ...]
    above: Place | None = None


def walk(model: type[BaseModel], value: Any) -> Iterator[Place]:
    """Yield every declared value in a section, depth first, each after the one that holds it.

    Parameters
    ----------
    model
        Declares the section.
    value
        An instance of the model, or a mapping that is still to be validated as one; undeclared keys are passed over.
    """
    yield from _walk(Place((), value, model, ()))


def _walk(place: Place) -> Iterator[Place]:
    annotation, metadata, value = place.annotation, place.metadata, place.value
    while is_union(annotation) and (member := _member(annotation, metadata, value)) is not None:
        annotation, more = bare(member)
        metadata += more
    place = replace(place, annotation=annotation, metadata=metadata)
    yield place
    for key, part, given, child in _parts(annotation, value):
        declared, more = bare(part)
        yield from _walk(Place((*place.path, key), child, declared, (*given, *more), place))


def _parts(annotation: Any, value: Any) -> Iterator[tuple[str, Any, tuple[Any, ...], Any]]:
    """Yield key, annotation, metadata and value of everything that a value holds directly."""
    arguments = get_args(annotation)
    if is_section(annotation):
        given = value if isinstance(value, Mapping) else dict(value) if isinstance(value, annotation) else {}
        for key, child in given.items():
            field = annotation.model_fields.get(key) if isinstance(key, str) else None
            if field is not None:
                yield str(key), field.annotation, tuple(field.metadata), child
    elif get_origin(annotation) is dict and isinstance(value, Mapping):
        for key, child in value.items():
            yield str(key), arguments[1], (), child
    elif is_number(annotation) and isinstance(value, Mapping) and isinstance(value.get(RANGE), list | tuple):
        # The ends of a range in place of a number are declared like the number.
        yield RANGE, types.GenericAlias(tuple, (annotation, ...)), (), value[RANGE]
    elif get_origin(annotation) is tuple and isinstance(value, list | tuple):
        same = arguments[-1] is Ellipsis
        for i, child in enumerate(value):
            yield str(i), arguments[0 if same else min(i, len(arguments) - 1)], (), child


M = TypeVar("M", bound=BaseModel)


def copied(model: M, **changed: Any) -> M:
    """Return a copy of a model with other values, which are not validated, without what it has computed of its own."""
    found = model.model_copy(update=changed)
    for name in found.__dict__.keys() - type(model).model_fields.keys():
        del found.__dict__[name]
    return found


def with_number(value: Any, path: Location, change: Callable[[float], Any]) -> Any:
    """Return a copy of a section, mapping or list with a changed number at a path; nothing is validated.

    What a section has computed of its numbers is not kept.
    """
    if not path:
        return change(value)
    key, below = path[0], path[1:]
    if isinstance(value, BaseModel):
        return copied(value, **{key: with_number(getattr(value, key), below, change)})
    if isinstance(value, Mapping):
        return {name: with_number(v, below, change) if str(name) == key else v for name, v in value.items()}
    return type(value)(with_number(v, below, change) if str(i) == key else v for i, v in enumerate(value))


def bare(annotation: Any) -> tuple[Any, tuple[Any, ...]]:
    """Return an annotation without its metadata, and these."""
    metadata: tuple[Any, ...] = ()
    while get_origin(annotation) is Annotated:
        annotation, *more = get_args(annotation)
        metadata += tuple(more)
    return annotation, metadata


def is_number(annotation: Any) -> bool:
    """Return True for a real number, and for one that may be left out."""
    annotation, _ = bare(annotation)
    if is_union(annotation):
        return any(is_number(member) for member in get_args(annotation))
    return annotation is float


def is_section(annotation: Any) -> TypeGuard[type[BaseModel]]:
    """Return True for a model of a section."""
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)


def is_union(annotation: Any) -> bool:
    """Return True for a union of types."""
    return get_origin(annotation) in (Union, types.UnionType)


def _member(union: Any, metadata: tuple[Any, ...], value: Any) -> Any:
    """Return the member of a union that holds a value; None without a section, mapping, list or text for it."""
    chooser = next((extra for extra in metadata if isinstance(extra, Discriminator)), None)
    for member in get_args(union):
        tag = next((extra.tag for extra in bare(member)[1] if isinstance(extra, Tag)), None)
        if chooser is None:
            if _may_hold(member, value):
                return member
        elif callable(chooser.discriminator) and tag == chooser.discriminator(value):
            return member
    return None


def _may_hold(annotation: Any, value: Any) -> bool:
    """Return True if an annotation is a container for values of this type, or a text and the value is one."""
    annotation, _ = bare(annotation)
    if is_union(annotation):
        return any(_may_hold(part, value) for part in get_args(annotation))
    if isinstance(value, str):
        return annotation is str
    if isinstance(value, BaseModel):
        return is_section(annotation) and isinstance(value, annotation)
    if isinstance(value, Mapping):
        return get_origin(annotation) is dict or is_section(annotation)
    return get_origin(annotation) is tuple and isinstance(value, list | tuple)
