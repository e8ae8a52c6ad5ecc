"""Law of a body of a family of cells by a few members, at each point the nearest of them (NearestMemberLaw)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from porocore.errors import ConfigurationError
from porocore.interfaces.law import MacroLaw, fingerprint
from porocore.interfaces.law_changes import PointChanges
from porocore.macro.composition.region_law import RegionLaw
from porocore.states import Array, IntArray, MacroState


class NearestMemberLaw(RegionLaw):
    """A law that asks at each point the law of the member whose parameters lie nearest.

    Parameters
    ----------
    laws
        Laws of k members, which have no parameters themselves.
    values : (k, m)
        Parameters of the members.
    ranges
        Ranges of the m parameters by name, in which distances are measured.

    Raises
    ------
    ConfigurationError
        There is no law.
    """

    def __init__(
        self, laws: Sequence[MacroLaw], values: Array, ranges: dict[str, tuple[float, float]]
    ) -> None:
        super().__init__(laws)
        self.parameters = tuple(ranges)
        self._spans = np.array([high - low for low, high in ranges.values()])
        self._values = np.asarray(values, float)
        self.identity = fingerprint("members", self.identity, self._values)

    def parameters_of(self, region: int) -> tuple[str, ...]:
        """Return all names; see :class:`MacroLaw`."""
        return self.parameters

    def _regions(self, states: MacroState) -> list[tuple[int, MacroLaw, IntArray]]:
        """Return number, law and points of each member that is the nearest somewhere.

        Raises
        ------
        ValueError
            The states have no parameters.
        """
        if states.parameters is None:
            raise ValueError("expected states with parameters")
        away = (states.parameters[:, None, :] - self._values) / self._spans
        nearest = (away**2).sum(axis=2).argmin(axis=1)
        return [(int(k), self.laws[k], np.flatnonzero(nearest == k)) for k in np.unique(nearest)]

    def _seen(self, states: MacroState, k: int) -> MacroState:
        """Return the states without parameters, which a member has not."""
        return replace(states, parameters=None)

    def _changes_seen(self, changes: PointChanges, k: int) -> PointChanges:
        """Return the changes without parameters.

        Raises
        ------
        ConfigurationError
            A parameter changes, of which the nearest member does not know.
        """
        if changes.parameters is not None and changes.parameters.any():
            raise ConfigurationError(
                f"the law '{self.name}' of the nearest members of a family jumps with its parameters, so that a run "
                "has no sensitivities to them; choose a surrogate of the family"
            )
        return replace(changes, parameters=None)
