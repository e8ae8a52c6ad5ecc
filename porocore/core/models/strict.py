"""Base of configuration sections (StrictModel), and the choice of a section by its ``kind``."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Discriminator, ValidationError
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

        Sections of a file are not called, so that their faults are told with their lines.
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
