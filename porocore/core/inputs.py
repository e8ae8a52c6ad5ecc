"""Inputs that are sampled and their hull (InputSpace, SampledRange); states as users give them, checked."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull, QhullError, cKDTree

from porocore.core.echo import cut, did_you_mean, joined
from porocore.core.models.bounds import LARGEST_GRADIENT, LARGEST_PRESSURE
from porocore.core.units import units_now
from porocore.errors import ConfigurationError
from porocore.states import Array, Doubt, IntArray, MacroState

#: Values that are distinguished at most; of more, the farthest.
MOST = 200
#: Parameters are as good as used within this distance of used ones, all of them as shares of their ranges.
NEAR = 0.05


@dataclass(frozen=True, eq=False)
class UsedValues:
    """Values of m parameters that a body uses, in the unit box of their ranges.

    Attributes
    ----------
    unit : (k, m)
        The values.
    """

    unit: Array

    def away(self, unit: Array) -> npt.NDArray[np.bool_]:
        """Return which values (n, m) of the parameters are not near to used ones, (n,)."""
        distance, _ = self._tree.query(unit, distance_upper_bound=self.reach)
        away: npt.NDArray[np.bool_] = ~(distance <= self.reach)
        return away

    @cached_property
    def reach(self) -> float:
        """Distance within which values count as used."""
        if len(self.unit) < MOST:
            return NEAR
        # Farthest points leave nothing farther from them than they are from one another.
        return NEAR + float(self._tree.query(self.unit, k=2)[0][:, 1].min())

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.unit)


def farthest(points: Array, count: int) -> IntArray:
    """Return at most ``count`` of the points (k, m) as indices: the one farthest from the middle, then the farthest.

    Points that are alike count once.
    """
    chosen: list[int] = []
    distance = np.linalg.norm(points - points.mean(axis=0), axis=1)
    away = np.full(len(points), np.inf)
    while len(chosen) < count and away.max() > 0:
        best = int(np.round(np.where(np.isinf(away), distance, away), 12).argmax())
        chosen.append(best)
        away = np.minimum(away, np.linalg.norm(points - points[best], axis=1))
    return np.array(chosen, dtype=np.int64)


NAMES = (*(f"H{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)), "p")

#: Other measures of deformation, by pattern of a name, and the components of H that are meant.
_MEASURES = {
    r"[Ff]_?([123])\1": r"H\1\1 = F\1\1 − 1",
    r"[Ff]_?([123])([123])": r"H\1\2 = F\1\2",
    r"(?:[Ee]|[Ee]ps|epsilon|strain)_?([123])\1": r"for a small strain along an axis H\1\1 is that strain",
    r"(?:[Jj]|det_?F)": "J = det(I + H) follows from the components of H",
}


def input_meant(name: str) -> str:
    """Return the advice on the name of an input that is none: the component that is meant; empty where none is near."""
    numbered = name[:-2] + name[-2:].translate(str.maketrans("xyz", "123"))
    for pattern, meant in _MEASURES.items():
        if found := re.fullmatch(pattern, numbered):
            return f"the inputs are of H = grad u = F − I: {found.expand(meant)}"
    return did_you_mean(name, NAMES, most=3, cutoff=0.5)


#: Share of the largest sampled component of H that others may move by unnoticed.
NEGLIGIBLE = 2e-3
#: Components of H below the diagonal.
BELOW = ("H21", "H31", "H32")


@dataclass(frozen=True)
class InputSpace:
    """An ordered choice of d inputs with a closed range for each; the others stay zero.

    They are some of the ten components H11 … H33 and p of a state, then all parameters of the cell.

    Attributes
    ----------
    names
        From ``H11`` … ``H33`` and ``p``, then the ``parameters``.
    lower, upper
        Bounds, one for each name.
    parameters
        Names of the cell's parameters in their order, the last of ``names``; empty for a cell without.
    used
        Values of all parameters, k rows of them, that a body uses: states are sampled at such values alone. Empty: over
        the whole ranges.

    Examples
    --------
    >>> from porocore import InputSpace
    >>> inputs = InputSpace.from_ranges({"H22": (-0.4, 0.04), "p": (-0.1, 0.1)})
    >>> states = inputs.scatter([[-0.2, 0.05]])
    >>> states.grad_u[:, 1, 1], states.p
    (array([-0.2]), array([0.05]))
    >>> inputs.gather(states)
    array([[-0.2 ,  0.05]])
    >>> family = InputSpace.from_ranges({"H22": (-0.4, 0.04)}, {"radius": (0.15, 0.3)})
    >>> family.scatter([[-0.2, 0.25]]).parameters
    array([[0.25]])
    """

    names: tuple[str, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    parameters: tuple[str, ...] = ()
    used: tuple[tuple[float, ...], ...] = ()

    def __post_init__(self) -> None:
        own = len(self.names) - len(self.parameters)
        if any(len(row) != len(self.parameters) for row in self.used):
            raise ConfigurationError(
                f"expected {len(self.parameters)} values in each row of used, one for each parameter"
            )
        if own < 0 or self.names[own:] != self.parameters:
            raise ConfigurationError(
                f"expected the parameters {', '.join(self.parameters)} as the last inputs, got {joined(self.names)}"
            )
        for name in self.names[:own]:
            if name not in NAMES:
                meant = input_meant(name)
                raise ConfigurationError(
                    f"unknown input '{name}'; the inputs are {', '.join(NAMES)}{meant and f'; {meant}'}"
                )
        for name in self.parameters:
            if name in NAMES:
                raise ConfigurationError(f"'{name}' is a component of the state and cannot name a parameter")
        if twice := next((name for name in self.names if self.names.count(name) > 1), ""):
            raise ConfigurationError(f"input '{twice}' is given twice; give each one range")
        for name, low, high in zip(self.names, self.lower, self.upper, strict=True):
            if not low < high:
                raise ConfigurationError(
                    f"the range of input '{name}' is empty: [{low:g}, {high:g}]; give [lower, upper] with lower < upper"
                )

    def __repr__(self) -> str:
        # Hashes hang on this text: that of a space without parameters has to stay as it was.
        more = f", parameters={self.parameters!r}" if self.parameters else ""
        more += f", used={self.used!r}" if self.used else ""
        return f"InputSpace(names={self.names!r}, lower={self.lower!r}, upper={self.upper!r}{more})"

    def __len__(self) -> int:
        return len(self.names)

    def range_text(self, name: str, digits: int = 6) -> str:
        """Return the range of an input, with the study's unit of p."""
        k = self.names.index(name)
        return f"[{value_text(name, self.lower[k], digits)}, {value_text(name, self.upper[k], digits)}]"

    @classmethod
    def from_ranges(
        cls,
        ranges: Mapping[str, tuple[float, float]],
        parameters: Mapping[str, tuple[float, float]] | None = None,
        used: tuple[tuple[float, ...], ...] = (),
    ) -> InputSpace:
        """Return the space of ``{"H22": (-0.4, 0.04), ...}`` and of parameters ``{"radius": (0.15, 0.3), ...}``."""
        more = dict(parameters or {})
        low, high = zip(*ranges.values(), *more.values(), strict=True)
        return cls((*ranges, *more), tuple(low), tuple(high), tuple(more), used)

    @cached_property
    def columns(self) -> tuple[int, ...]:
        """Position of each input among the ten components (H row by row, then p) and the parameters behind them."""
        own = len(self.names) - len(self.parameters)
        return (*(NAMES.index(name) for name in self.names[:own]), *range(10, 10 + len(self.parameters)))

    @cached_property
    def parameter_ranges(self) -> Array:
        """Ranges of the parameters, (m, 2)."""
        ends: Array = np.array([self.lower, self.upper]).T[len(self) - len(self.parameters) :]
        return ends

    @cached_property
    def used_values(self) -> UsedValues | None:
        """Values of the parameters that are used, scaled by their ranges; None where the whole ranges are sampled."""
        return UsedValues(self._unit_parameters(np.array(self.used))) if self.used else None

    def not_used(self, parameters: Array) -> npt.NDArray[np.bool_]:
        """Return which values (n, m) of the parameters are away from those that are used."""
        if self.used_values is None:
            return np.zeros(len(parameters), dtype=bool)
        return self.used_values.away(self._unit_parameters(parameters))

    def _unit_parameters(self, parameters: Array) -> Array:
        low, high = self.parameter_ranges.T
        unit: Array = (parameters - low) / (high - low)
        return unit

    def require_parameters(self, states: MacroState) -> None:
        """Refuse states that have not the parameters of this space.

        Raises
        ------
        ConfigurationError
            They lack some, or have more.
        """
        if states.parameter_count == len(self.parameters):
            return
        if not self.parameters:
            raise ConfigurationError(
                f"the states have {states.parameter_count} parameters of a cell, but none were sampled: leave them "
                "out, or sample a cell with parameters (a number of 'cell' as a range)"
            )
        raise ConfigurationError(
            f"expected a value of each parameter ({', '.join(self.parameters)}) with every state, got "
            f"{states.parameter_count or 'none'}; give {{{self.parameters[0]}: …}} with the state"
        )

    def gather(self, states: MacroState) -> Array:
        """Return the inputs of n states, (n, d).

        Raises
        ------
        ConfigurationError
            The states have not the parameters of this space.
        """
        self.require_parameters(states)
        return components(states)[list(self.columns)].T

    def without_rotation(self, states: MacroState) -> MacroState:
        """Return the states rotated so that F = I + H is upper triangular, with the same stretch.

        For an objective law they are the same, and inputs from the upper triangle of H reach all of them. Where a
        component below the diagonal is an input, and where det F is not positive, states stay as they are.
        """
        H = states.grad_u
        if any(name in self.names for name in BELOW) or not H[:, (1, 2, 2), (0, 0, 1)].any():
            return states
        F = np.eye(3) + H
        turned = np.linalg.det(F) > 0
        F = F[turned]
        # F = Q R has the stretch of R, and C = RᵀR is its Cholesky factorisation.
        back = H.copy()
        back[turned] = np.linalg.cholesky(F.swapaxes(1, 2) @ F).swapaxes(1, 2) - np.eye(3)
        return replace(states, grad_u=back)

    def to_unit(self, x: Array) -> Array:
        """Return inputs (n, d) scaled by their ranges: the box becomes the unit box."""
        low, high = np.array(self.lower), np.array(self.upper)
        unit: Array = (x - low) / (high - low)
        return unit

    def scatter(self, x: npt.ArrayLike) -> MacroState:
        """Return n states from inputs (n, d), all other components zero."""
        rows: Array = np.atleast_2d(np.asarray(x, dtype=float))
        flat = np.zeros((len(rows), 10 + len(self.parameters)))
        flat[:, list(self.columns)] = rows
        theta = flat[:, 10:].copy() if self.parameters else None
        return MacroState(flat[:, :9].reshape(-1, 3, 3), flat[:, 9].copy(), theta)

    @property
    def negligible(self) -> float:
        """Largest value of a component that is no input, small against the inputs, that is neglected.

        The symmetry of a body and its cell is broken as much by a mesh that does not have it.
        """
        bounds = [
            abs(b)
            for c, *both in zip(self.columns, self.lower, self.upper, strict=True)
            if c < 9
            for b in both
        ]
        return max(1e-6, NEGLIGIBLE * max(bounds, default=0.0))

    def moves_other(self, states: MacroState) -> npt.NDArray[np.bool_]:
        """Return the rows (n,) in which a component that is no input is not negligible."""
        return self.others_move(components(states))

    def others_move(self, rows: Array) -> npt.NDArray[np.bool_]:
        """Return the same for the ``components`` (10, n), or more rows with those of parameters."""
        rest = rows[[column for column in range(10) if column not in self.columns]]
        moves: npt.NDArray[np.bool_] = np.abs(rest, out=rest).max(axis=0, initial=0.0) > self.negligible
        return moves


def value_text(name: str, value: float, digits: int = 6) -> str:
    """Return the value of an input, with the study's unit if it is p."""
    return units_now().text(value, "pressure" if name == "p" else "", digits)


def components(states: MacroState) -> Array:
    """Return (10 + m, n): H row by row, then p and m parameters, each contiguous in memory."""
    rows, H = np.empty((10 + states.parameter_count, len(states))), states.grad_u.reshape(-1, 9)
    for i in range(9):
        rows[i] = H[:, i]
    rows[9] = states.p
    if states.parameters is not None:
        rows[10:] = states.parameters.T
    return rows


def flatten(states: MacroState) -> Array:
    """Return (n, 10 + m): H row by row, then p and m parameters."""
    more = [] if states.parameters is None else [states.parameters]
    return np.concatenate([states.grad_u.reshape(-1, 9), states.p[:, None], *more], axis=1)


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
        outside: npt.NDArray[np.bool_] = self.doubt(states) != 0
        return outside

    def doubt(self, states: MacroState) -> IntArray:
        """Return the :class:`~porocore.Doubt` of states (n,) that lie outside, or vary a component not sampled."""
        return self._beyond(states, self._planes, 1e-9)

    def far(self, states: MacroState) -> IntArray:
        """Return the :class:`~porocore.Doubt` of states (n,) that lie ``FAR`` outside, or vary a component not sampled.

        In more than ``CORNERED`` inputs the faces of the box count only: the corners that an even design leaves
        empty lie outside its hull, and a surrogate may know them well.
        """
        few = len(self.inputs) <= CORNERED
        faces = np.count_nonzero(self.normals, axis=1) == 1
        return self._beyond(states, self._planes if few else self._planes[faces], FAR)

    def _beyond(self, states: MacroState, planes: Array, by: float) -> IntArray:
        self.inputs.require_parameters(states)
        rows = components(states)
        outside = np.logical_not(_within(planes, rows[list(self.inputs.columns)].T, by))
        if self.inputs.used and states.parameters is not None:
            outside |= self._not_used(states.parameters)
        return Doubt.where(outside=outside, not_sampled=self.inputs.others_move(rows))

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


#: As many sets of coordinates are evaluated one after the other, if each has so many points.
MOST_SETS, LEAST_POINTS = 32, 16


@dataclass(frozen=True, eq=False)
class PointSets:
    """Sets of n points.

    Attributes
    ----------
    number : (n,)
        Set of each point.
    count
        Number of sets, of which some may have no point.
    """

    number: IntArray
    count: int

    @cached_property
    def in_order(self) -> bool:
        """True where the points come one set after the other."""
        return bool((self.number[1:] >= self.number[:-1]).all())

    @cached_property
    def order(self) -> IntArray:
        """Points one set after the other, (n,)."""
        return np.argsort(self.number, kind="stable")

    @cached_property
    def back(self) -> IntArray:
        """Place of each point in that order, (n,)."""
        found = np.empty_like(self.order)
        found[self.order] = np.arange(len(found))
        return found

    @cached_property
    def first(self) -> IntArray:
        """A point of each set, (sets,)."""
        found = np.zeros(self.count, dtype=np.int64)
        found[self.number[::-1]] = np.arange(len(self.number))[::-1]
        return found

    @cached_property
    def _ends(self) -> list[int]:
        """Numbers of points up to each set, from 0."""
        ends: list[int] = np.cumsum([0, *np.bincount(self.number, minlength=self.count)]).tolist()
        return ends

    def parts(self, start: int, stop: int) -> Iterator[tuple[int, slice]]:
        """Yield the sets that have points from ``start`` to ``stop`` in their order, each with these."""
        for i in range(self.count):
            first, last = max(self._ends[i], start), min(self._ends[i + 1], stop)
            if first < last:
                yield i, slice(first, last)

    def take(self, points: IntArray) -> PointSets:
        """Return the sets of some of the points."""
        return PointSets(self.number[points], self.count)


class Coordinates:
    """Coordinates of n points.

    Parameters
    ----------
    x : (l, n)
        The coordinates; (l, 1) where all points have the same.
    """

    def __init__(self, x: Array) -> None:
        self.x = x

    @property
    def same(self) -> bool:
        """True where they are given once for all points."""
        return self.x.shape[1] == 1

    @cached_property
    def sets(self) -> PointSets | None:
        """Points that share their coordinates where these are few; None where they are many."""
        n = self.x.shape[1]
        if n == 0 or (self.x == self.x[:, :1]).all():
            return PointSets(np.zeros(n, dtype=np.int16), 1)
        # The first points tell most fields without a sort of all.
        if len(np.unique(self.x[:, : 4 * MOST_SETS], axis=1).T) > MOST_SETS:
            return None
        _, first, number = np.unique(self.x, axis=1, return_index=True, return_inverse=True)
        if len(first) > min(MOST_SETS, n // LEAST_POINTS):
            return None
        # Numbered as they come, so that points of one set after the other are in order; small integers, which are
        # sorted in linear time.
        rank = np.empty(len(first), dtype=np.int16)
        rank[np.argsort(first)] = np.arange(len(first))
        return PointSets(rank[number.reshape(-1)], len(first))

    def take(self, points: IntArray) -> Coordinates:
        """Return those of some of the points."""
        if self.same:
            return self
        found = Coordinates(self.x[:, points])
        found.__dict__["sets"] = None if self.sets is None else self.sets.take(points)
        return found


def given_states(grad_u: npt.ArrayLike, p: npt.ArrayLike = 0.0) -> MacroState:
    """Return one state or n of them.

    Parameters
    ----------
    grad_u : (3, 3) or (n, 3, 3)
        H_ij = ∂u_i/∂X_j.
    p : number or (n,)
        Pore pressure, positive in compression [E].

    Raises
    ------
    ConfigurationError
        These are no finite numbers of such shapes.
    """
    H, pressures = _numbers("grad_u", grad_u), _numbers("p", p)
    if H.shape[-2:] != (3, 3) or H.ndim not in (2, 3):
        raise ConfigurationError(f"grad_u: expected shape (3, 3), or (n, 3, 3) for n states, got {H.shape}")
    H = H.reshape(-1, 3, 3)
    if pressures.shape not in ((), (1,), (len(H),)):
        raise ConfigurationError(
            f"p: expected one number, or one for each of the n = {len(H)} states of grad_u, got shape {pressures.shape}"
        )
    return MacroState(H, np.broadcast_to(pressures, len(H)).copy())


def named_state(components: Mapping[str, float]) -> Array:
    """Return a state (10,), H row by row, then p, from the components that are not zero.

    Raises
    ------
    ConfigurationError
        A name is unknown, or a value no finite number.
    """
    row = np.zeros(10)
    for name, value in components.items():
        if name not in NAMES or not isinstance(value, int | float | np.number) or not np.isfinite(value):
            question = "" if name in NAMES else input_meant(str(name))
            raise ConfigurationError(
                f"expected finite values of some of {', '.join(NAMES)}, got {cut(str(name))} = {cut(str(value))}"
                + (f"; {question}" if question else "")
            )
        row[NAMES.index(name)] = value
    return row


def _numbers(name: str, value: Any) -> Array:
    try:
        found: Array = np.array(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise ConfigurationError(
            f"{name}: expected numbers in rows of equal length, got {cut(repr(value))}"
        ) from error
    if not np.isfinite(found).all():
        raise ConfigurationError(f"{name}: expected finite numbers, got {found[~np.isfinite(found)][0]:g}")
    return found


def require_possible(grad_u: npt.ArrayLike, p: float, modulus: float, what: str) -> None:
    """Refuse a state that no cell can be in; see :func:`why_impossible`.

    Raises
    ------
    ConfigurationError
        It is one; the message begins with ``what``.
    """
    if why := why_impossible(grad_u, p, modulus):
        raise ConfigurationError(f"{what}: {why}")


def why_impossible(grad_u: npt.ArrayLike, p: float, modulus: float = 1.0) -> str:
    """Return why no cell can be in a state; empty if one may.

    Parameters
    ----------
    grad_u : (3, 3)
        H_ij = ∂u_i/∂X_j.
    p
        Pore pressure [E].
    modulus
        Young's modulus of the stiffest solid [E].
    """
    H = np.asarray(grad_u, dtype=float).reshape(3, 3)
    if not (np.abs(H) <= LARGEST_GRADIENT).all():
        return f"expected components of H of at most {LARGEST_GRADIENT:g}, got {np.abs(H).max():g}"
    if not abs(p) <= LARGEST_PRESSURE * modulus:
        return (
            f"expected a pressure p of at most {LARGEST_PRESSURE:g} times the solid's "
            f"{value_text('p', modulus)}, got {value_text('p', p)}"
        )
    J = float(np.linalg.det(np.eye(3) + H))
    if J <= 0:
        return (
            f"det F = {J:.4g} with F = I + H, but a solid has det F > 0: it would be pressed to nothing or turned "
            "inside out; give a smaller H"
        )
    return ""


def least_volume(inputs: InputSpace) -> tuple[float, dict[str, float]]:
    """Return the smallest det F in a box of inputs, and the components of H by name at the corner where it is.

    det F is linear in every single component of H, so that no point of the box has less than its least corner.
    """
    moving = [i for i, column in enumerate(inputs.columns) if column < 9]
    corners = np.array(list(itertools.product(*((inputs.lower[i], inputs.upper[i]) for i in moving))))
    H: Array = np.zeros((len(corners), 9))
    H[:, [inputs.columns[i] for i in moving]] = corners
    with np.errstate(all="ignore"):  # ends may be too large for a product
        J = np.linalg.det(np.eye(3) + H.reshape(-1, 3, 3))
    least = int(J.argmin())
    return float(J[least]), {
        NAMES[inputs.columns[i]]: float(x) for i, x in zip(moving, corners[least], strict=True)
    }
