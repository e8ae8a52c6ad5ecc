"""Hull of the sampled inputs (SampledRange): which states lie outside it, and how far."""

from __future__ import annotations

import itertools
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull, QhullError, cKDTree

from porocore.core.inputs.input_space import InputSpace, components
from porocore.states import Array, MacroState

#: Farther beyond the samples than this share of the ranges nothing is known, whatever an estimate says.
FAR = 0.25
#: Up to this number of inputs a design begins with the corners of the box; where its hull lacks one, the cell has no
#: stable state there.
CORNERED = 3
#: Above this number of inputs the hull has too many facets to be of use and the bounding box stands in.
MOST_HULL_INPUTS = 5


@dataclass(frozen=True, eq=False)
class SampledRange:
    """A convex polytope {x : A x ≤ b} around the sampled inputs and the undeformed cell, which is always known.

    With parameters it is known at all of their values, but where the samples are at values that a body uses
    (``InputSpace.used``) all others are outside.

    Its faces lie beyond the samples by half of what neighbours usually differ by along an axis, as far from a sample as
    states between two of them, but not beyond the box of the inputs.

    Attributes
    ----------
    inputs : InputSpace
        The inputs, d of them.
    normals : (m, d)
        A, in inputs scaled to the ranges of ``inputs``.
    offsets : (m,)
        b.

    Examples
    --------
    >>> from porocore import InputSpace, SampledRange
    >>> inputs = InputSpace.from_ranges({"H22": (-0.4, 0.04), "p": (-0.1, 0.1)})
    >>> sampled = SampledRange.around(inputs, [[-0.4, 0.0], [0.0, 0.1], [0.0, -0.1]])
    >>> sampled.contains([[-0.1, 0.0], [-0.4, 0.1]])
    array([ True, False])
    """

    inputs: InputSpace
    normals: Array
    offsets: Array

    @classmethod
    def around(cls, inputs: InputSpace, points: npt.ArrayLike) -> SampledRange:
        """Return the range of ``points`` (n, d): their hull; their bounding box if they span no volume or d is big."""
        d = len(inputs)
        given: Array = np.concatenate([np.asarray(points, dtype=float).reshape(-1, d), _at_rest(inputs)])
        known = np.unique(inputs.to_unit(given), axis=0)
        low, high = known.min(axis=0), known.max(axis=0)
        unit = np.eye(d)
        normals, offsets = np.concatenate([unit, -unit]), np.concatenate([high, -low])
        box = np.concatenate([np.maximum(high, 1.0), -np.minimum(low, 0.0)])
        beyond = _spacing(known) / 2 / np.sqrt(d)
        if 2 <= d <= MOST_HULL_INPUTS and len(known) > d:
            with suppress(QhullError):
                hull = ConvexHull(known).equations
                return cls(
                    inputs,
                    np.concatenate([hull[:, :-1], normals]),
                    np.concatenate([beyond - hull[:, -1], box]),
                )
        return cls(inputs, normals, np.minimum(offsets + beyond, box))

    def contains(self, x: npt.ArrayLike, tolerance: float = 1e-9) -> npt.NDArray[np.bool_]:
        """Return which of the input rows (n, d) lie inside, up to ``tolerance`` of the range of an input."""
        rows = np.atleast_2d(np.asarray(x, dtype=float))
        inside = _within(self._planes, rows, tolerance)
        if self.inputs.used:
            inside &= ~self.inputs.not_used(rows[:, len(self.inputs) - len(self.inputs.parameters) :])
        return inside

    @cached_property
    def _planes(self) -> Array:
        """(A, −b) (m, d + 1), for inputs that are not scaled and a one below them."""
        low, high = np.array(self.inputs.lower), np.array(self.inputs.upper)
        normals = self.normals / (high - low)
        return np.column_stack([normals, -self.offsets - normals @ low])

    def outside(self, states: MacroState) -> npt.NDArray[np.bool_]:
        """Return which states (n,) lie outside, or vary a component that was not sampled."""
        return self._beyond(states, self._planes, 1e-9)

    def far(self, states: MacroState) -> npt.NDArray[np.bool_]:
        """Return which states (n,) lie ``FAR`` outside, or vary a component that was not sampled.

        In more than ``CORNERED`` inputs the faces of the box count only: the corners that an even design leaves
        empty lie outside its hull, and a surrogate may know them well.
        """
        few = len(self.inputs) <= CORNERED
        faces = np.count_nonzero(self.normals, axis=1) == 1
        return self._beyond(states, self._planes if few else self._planes[faces], FAR)

    def _beyond(self, states: MacroState, planes: Array, by: float) -> npt.NDArray[np.bool_]:
        self.inputs.require_parameters(states)
        rows = components(states)
        outside = np.logical_not(_within(planes, rows[list(self.inputs.columns)].T, by))
        outside |= self.inputs.others_move(rows)
        if self.inputs.used and states.parameters is not None:
            outside |= self._not_used(states.parameters)
        return outside

    def _not_used(self, parameters: Array) -> npt.NDArray[np.bool_]:
        """Return which parameters (n, m) are away from those that are used; the last answer is kept."""
        kept = self._last
        if not kept or not np.array_equal(kept[0], parameters):
            kept[:] = [parameters.copy(), self.inputs.not_used(parameters)]
        answer: npt.NDArray[np.bool_] = kept[1]
        return answer

    @cached_property
    def _last(self) -> list[Any]:
        return []


def _within(planes: Array, rows: Array, by: float) -> npt.NDArray[np.bool_]:
    """Return which rows (n, d) lie beyond none of the planes (m, d + 1) by more than ``by``."""
    with_one = np.ones((planes.shape[1], len(rows)))
    with_one[:-1] = rows.T
    inside: npt.NDArray[np.bool_] = (planes @ with_one).max(axis=0) <= by
    return inside


def _at_rest(inputs: InputSpace) -> Array:
    """Return the inputs (2^m, d) of the undeformed cell at the corners of the ranges of the m parameters."""
    corners = np.array(list(itertools.product(*inputs.parameter_ranges)))
    return np.concatenate([np.zeros((len(corners), len(inputs) - len(inputs.parameters))), corners], axis=1)


def _spacing(points: Array) -> float:
    """Return the median distance of points (n, d) to their nearest neighbours."""
    if len(points) < 2:
        return 0.0
    return float(np.median(cKDTree(points).query(points, k=2)[0][:, 1]))
