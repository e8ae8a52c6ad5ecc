"""Samplers ``sobol`` and ``latin-hypercube``: designs that fill the box evenly; corners of the box; members."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, ClassVar

import numpy as np

from porocore.core.inputs.input_space import InputSpace
from porocore.core.inputs.used_values import farthest
from porocore.core.models.bounds import LARGEST_SEED
from porocore.errors import ConfigurationError
from porocore.sampling.samplers.options import refuse_unknown, whole, yes_or_no
from porocore.sampling.samplers.rounds import RoundSampler
from porocore.states import Array

#: Boxes of more inputs have too many corners to solve them all.
MOST_CORNER_INPUTS = 8
#: Up to so many numbers a Latin hypercube is improved by exchanges: about two seconds.
MOST_OPTIMISED = 4000


class Design(RoundSampler):
    """``count`` states in one round, the corners of the box first if they are wanted.

    Parameters
    ----------
    inputs
        The box.
    count : int, at least 1
        Number of states, corners included.
    seed : int, at least 0
        Seed of the randomisation.
    corners : bool
        Solve the 2^d corners of the box of up to eight inputs first, so that a surrogate never extrapolates within it.
    states_per_member : int, at least 1
        Number of states in a row that have the same parameters of the cell, which then are a design of their own; 1:
        the design is one of all inputs together. Without parameters it does nothing.

    Raises
    ------
    ConfigurationError
        An option is unknown or of no use; the message begins with its key in a configuration.
    """

    name: ClassVar[str]

    seeded = True

    def __init__(
        self,
        inputs: InputSpace,
        count: int = 100,
        seed: int = 0,
        corners: bool = False,
        states_per_member: int = 4,
        **unknown: Any,
    ) -> None:
        refuse_unknown(self.name, ("count", "seed", "corners", "states_per_member"), unknown)
        super().__init__(inputs, whole("sampling.options.count", count, 1))
        self.seed = whole("sampling.options.seed", seed, 0, LARGEST_SEED)
        self.corners = yes_or_no("sampling.options.corners", corners)
        self.states_per_member = whole("sampling.options.states_per_member", states_per_member, 1)
        if corners:
            d = len(inputs)
            if d > MOST_CORNER_INPUTS:
                raise ConfigurationError(
                    f"sampling.options.corners: {d} inputs have {2**d} corners; leave them out beyond "
                    f"{MOST_CORNER_INPUTS} inputs"
                )
            if count < (most := len(self._box_corners())):
                raise ConfigurationError(
                    f"sampling.options.count: {count} states are fewer than the {most} corners of {d} inputs; "
                    "raise it, or set corners: false"
                )

    def next_round(self, room: int) -> Array:
        """Return the whole design, once."""
        if len(self.points):
            return np.empty((0, len(self.inputs)))
        first = self._box_corners() if self.corners else np.empty((0, len(self.inputs)))
        filling = self._members(room - len(first)) if room > len(first) else first[:0]
        return np.concatenate([first, filling])

    def _members(self, count: int) -> Array:
        """Return points (count, d): a design over the components, and each point of one over m parameters for some.

        Where a body uses some values of the parameters alone, those are the farthest of these, in turns.
        """
        m, used = len(self.inputs.parameters), self.inputs.used_values
        if not m or (used is None and self.states_per_member == 1):
            return self.filling(count, len(self.inputs))
        states, members = self.filling(count, len(self.inputs) - m), -(-count // self.states_per_member)
        values = (
            self.parameter_filling(members, m) if used is None else used.unit[farthest(used.unit, members)]
        )
        which = np.arange(count) // self.states_per_member % len(values)
        return np.concatenate([states, values[which]], axis=1)

    def _box_corners(self) -> Array:
        """Return the corners of the box; those of one member follow each other."""
        m, used = len(self.inputs.parameters), self.inputs.used_values
        if used is None:
            return np.roll(box_corners(len(self.inputs)), -m, axis=1)
        corners, values = box_corners(len(self.inputs) - m), used.unit[farthest(used.unit, 2**m)]
        return np.concatenate(
            [np.tile(corners, (len(values), 1)), np.repeat(values, len(corners), axis=0)], axis=1
        )

    @property
    def members(self) -> int:
        """Number of members of a family of cells that are prepared for the states; 1 for a cell without parameters."""
        m = len(self.inputs.parameters)
        if not m:
            return 1
        corners = len(self._box_corners()) if self.corners else 0
        at_corners: int = corners // 2 ** (len(self.inputs) - m)
        return at_corners + -(-(self.count - corners) // self.states_per_member)

    @abstractmethod
    def filling(self, count: int, d: int) -> Array:
        """Return ``count`` points (n, d) of the unit box."""

    @abstractmethod
    def parameter_filling(self, count: int, m: int) -> Array:
        """Return points (count, m) of the unit box for the parameters of ``count`` members."""


class SobolDesign(Design):
    """The first ``count`` points of a scrambled Sobol sequence (Sobol' 1967, Owen 1998).

    A larger ``count`` with the same seed begins with the same states. A power of two fills the box most evenly. The
    parameters of a family of cells are points of a scrambled Halton sequence, since two Sobol sequences would be alike.
    """

    name = "sobol"

    def filling(self, count: int, d: int) -> Array:
        """Return points of the sequence."""
        return sobol_points(d, count, self.seed)

    def parameter_filling(self, count: int, m: int) -> Array:
        """Return points of the Halton sequence."""
        return halton_points(m, count, self.seed)


class LatinHypercube(Design):
    """A Latin hypercube (McKay, Beckman & Conover 1979): each input takes one value in each of ``count`` slices.

    Small ones are improved by random exchanges that lower the centred discrepancy.
    """

    name = "latin-hypercube"

    def filling(self, count: int, d: int) -> Array:
        """Return points of the hypercube."""
        return _hypercube(count, d, self.seed)

    def parameter_filling(self, count: int, m: int) -> Array:
        """Return points of a hypercube of their own."""
        return _hypercube(count, m, self.seed + 1)


def _hypercube(count: int, d: int, seed: int) -> Array:
    optimisation = "random-cd" if d > 1 and 1 < count * d <= MOST_OPTIMISED else None
    from scipy.stats import qmc  # slow to import

    points: Array = qmc.LatinHypercube(d, seed=seed, optimization=optimisation).random(count)
    return points


def sobol_points(d: int, count: int, seed: int) -> Array:
    """Return the first points (count, d) of a scrambled Sobol sequence."""
    power = max(0, int(np.ceil(np.log2(count))))
    from scipy.stats import qmc  # slow to import

    points: Array = qmc.Sobol(d, seed=seed).random_base2(power)[:count]
    return points


def halton_points(d: int, count: int, seed: int) -> Array:
    """Return the first points (count, d) of a scrambled Halton sequence (Halton 1960)."""
    from scipy.stats import qmc  # slow to import

    points: Array = qmc.Halton(d, seed=seed).random(count)
    return points


def box_corners(d: int) -> Array:
    """Return the corners (2^d, d) of the unit box."""
    return np.array(np.meshgrid(*[(0.0, 1.0)] * d, indexing="ij")).reshape(d, -1).T
