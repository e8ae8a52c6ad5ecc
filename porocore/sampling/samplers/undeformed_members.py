"""Undeformed members of a family of cells, from which a surrogate is exact at rest (UndeformedMembers)."""

from __future__ import annotations

import numpy as np

from porocore.core.inputs.input_space import InputSpace
from porocore.interfaces.sampler import Request, Sampler
from porocore.sampling.samplers.designs import halton_points
from porocore.sampling.samplers.options import check_waiting
from porocore.sampling.samplers.rounds import from_unit
from porocore.states import CellResponse


class UndeformedMembers(Sampler):
    """Members of a family spread over the ranges of its parameters, denser towards their ends.

    They are points of a Halton sequence u in the unit box, moved to (1 − cos πu)/2, where the Chebyshev points of a
    polynomial lie densest. There is no choice in it: a family has one set of them. Keys are ``member-000`` and so on.

    Parameters
    ----------
    inputs
        The parameters and their ranges, and nothing else.
    count
        Number of members.
    """

    choosing = "choosing members"

    def __init__(self, inputs: InputSpace, count: int) -> None:
        self.inputs = inputs
        m = len(inputs.parameters)
        unit = (1 - np.cos(np.pi * halton_points(m, count, seed=0))) / 2
        self._requests = [
            Request(f"member-{i:03d}", tuple(map(float, x))) for i, x in enumerate(from_unit(inputs, unit))
        ]
        self._waiting = {request.key for request in self._requests}
        self._asked = False

    def ask(self) -> list[Request]:
        """Return all members, once."""
        requests = [] if self._asked else self._requests
        self._asked = True
        return requests

    def tell(self, key: str, response: CellResponse) -> None:
        """Record that a member was solved, or cannot be."""
        check_waiting(key, self._waiting)
        self._waiting.remove(key)

    @property
    def done(self) -> bool:
        """True when every member was told."""
        return not self._waiting

    @property
    def expected(self) -> int:
        """Number of members."""
        return len(self._requests)
