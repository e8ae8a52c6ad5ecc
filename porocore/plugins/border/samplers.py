"""Check of the requests of a sampler as they come (CheckedSampler)."""

from __future__ import annotations

import math
from typing import Any

from porocore.core.inputs.input_space import InputSpace
from porocore.interfaces.sampler import Outlook, Request, Sampler
from porocore.plugins.border.origin import refuse
from porocore.plugins.hookspecs import short_repr
from porocore.states import CellResponse

#: Characters of a key at most.
LONGEST_KEY = 200
#: Share of an input's range by which round-off may leave the box.
SLACK = 1e-9


class CheckedSampler:
    """A sampler whose requests, for states of the box ``inputs``, are checked as they come."""

    def __init__(self, sampler: Sampler, inputs: InputSpace) -> None:
        self.sampler, self.inputs = sampler, inputs
        self._keys: set[str] = set()

    def ask(self) -> list[Request]:
        """Return the next requests.

        Raises
        ------
        PluginError
            They are no list of requests, a key is no new text, or an input is no number of the box.
        """
        requests = self.sampler.ask()
        if not isinstance(requests, list | tuple):
            raise refuse(self.sampler, f"ask: expected a list of Request, got {short_repr(requests)}")
        for request in requests:
            if fault := self._fault(request):
                raise refuse(self.sampler, f"ask: {fault}")
            self._keys.add(request.key)
        return list(requests)

    def tell(self, key: str, response: CellResponse) -> None:
        """Tell the response of a state."""
        self.sampler.tell(key, response)

    @property
    def choosing(self) -> str:
        """Work of a sampler that is asked after a round, in a few words."""
        return str(self.sampler.choosing)

    @property
    def done(self) -> bool:
        """True when every state has been asked for and told."""
        return bool(self.sampler.done)

    @property
    def expected(self) -> int:
        """Estimated number of all states.

        Raises
        ------
        PluginError
            It is no number.
        """
        expected: Any = self.sampler.expected
        try:
            return int(expected)
        except (TypeError, ValueError, OverflowError):
            raise refuse(self.sampler, f"expected: must be a number, got {short_repr(expected)}") from None

    @property
    def outlook(self) -> Outlook:
        """The states foreseen.

        Raises
        ------
        PluginError
            It is no :class:`Outlook`.
        """
        outlook: Any = self.sampler.outlook
        if not isinstance(outlook, Outlook):
            raise refuse(self.sampler, f"outlook: expected an Outlook, got {short_repr(outlook)}")
        return outlook

    def _fault(self, request: Any) -> str:
        if not isinstance(request, Request):
            return f"expected a list of Request, got {short_repr(request)} in it"
        key, x, start = request.key, request.x, request.start
        if not isinstance(key, str) or not key.isprintable() or not 0 < len(key) <= LONGEST_KEY:
            return f"key: expected a text of 1 to {LONGEST_KEY} letters, got {short_repr(key)}"
        if key in self._keys:
            return f"key: '{key}' is asked for twice"
        if start is not None and not isinstance(start, str):
            return f"start of '{key}': expected the key of another state or None, got {short_repr(start)}"
        if not isinstance(x, tuple) or len(x) != len(self.inputs):
            return f"x of '{key}': expected a tuple of {len(self.inputs)} numbers, got {short_repr(x)}"
        for name, value, low, high in zip(
            self.inputs.names, x, self.inputs.lower, self.inputs.upper, strict=True
        ):
            slack = SLACK * (high - low)
            if not isinstance(value, float | int) or not math.isfinite(value):
                return f"x of '{key}': expected a finite number for {name}, got {short_repr(value)}"
            if not low - slack <= value <= high + slack:
                return f"x of '{key}': {name} = {value:g} is outside its range [{low:g}, {high:g}]"
        return ""
