"""Suites that an offer names, or the default ones of its kind."""

from __future__ import annotations

from typing import Any

from porocore import testing
from porocore.errors import PluginError
from porocore.plugins.hookspecs import CommandOffer, Offer
from porocore.plugins.kinds import KINDS, Kind
from porocore.plugins.table import KIT_VERSION
from porocore.testing.suite import Suite


def find_suites(kind: Kind, offer: Offer, implementation: type[Any]) -> list[type[Suite]]:
    """The suites that an offer names; where it names none, that of its kind with default options.

    Raises
    ------
    PluginError
        They cannot be loaded, are no suites, or are suites of another kind only.
    """
    if offer.suites is None:
        return [_default(kind, offer, implementation)]
    try:
        found = list(offer.suites())
    except Exception as error:  # foreign code; its reason goes into the message
        raise PluginError(
            f"the suites of {kind} '{offer.name}' cannot be loaded: {type(error).__name__}: {error}; "
            "report this to its authors"
        ) from error
    for suite in found:
        if not (isinstance(suite, type) and issubclass(suite, Suite)):
            raise PluginError(
                f"the suites of {kind} '{offer.name}': expected suites of porocore.testing, got {suite!r}; "
                "report this to its authors"
            )
    if not any(issubclass(suite, _suite(kind)) for suite in found):
        raise PluginError(
            f"the suites of {kind} '{offer.name}': expected a subclass of porocore.testing.{KINDS[kind].suite}, "
            f"got {', '.join(suite.__name__ for suite in found) or 'none'}; report this to its authors"
        )
    return found


def _default(kind: Kind, offer: Offer, implementation: type[Any]) -> type[Suite]:
    """Return the suite of a plugin without suites of its own: with default options, of the present version."""

    def make(cls: Any, *inputs: Any, **options: Any) -> Any:
        return implementation(*inputs, **options)

    members: dict[str, Any] = {KINDS[kind].factory: classmethod(make), "kit_version": KIT_VERSION}
    if kind == "surrogate":
        members["resumable"] = members["random"] = None
    if isinstance(offer, CommandOffer):
        members["name"] = f"{offer.group} {offer.name}".strip()
    words = "".join(word.capitalize() for word in offer.name.replace("-", "_").split("_"))
    return type(f"Test{words}", (_suite(kind),), members)


def _suite(kind: Kind) -> type[Suite]:
    found: type[Suite] = getattr(testing, KINDS[kind].suite)
    return found
