"""Local frames of nodes on oblique surfaces, whose axes include the prescribed directions."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from porocore.errors import ConfigurationError
from porocore.macro.body.mesh import BodyMesh
from porocore.states import Array, IntArray

#: Sine of an angle between two directions below which they are one; also of the difference of their values, of these.
SAME = 1e-6


class Constraint(NamedTuple):
    """Displacement that is prescribed along one direction."""

    direction: Array  #: (3,) a unit vector
    function: int  #: number of its time function
    factor: float  #: on that
    source: str  #: what prescribes it, for messages


def in_frames(
    mesh: BodyMesh,
    oblique: Mapping[int, list[Constraint]],
    others: Callable[[int], list[Constraint]],
    functions: int,
    kept: Mapping[int, Sequence[int]] | None = None,
) -> tuple[Any, tuple[IntArray, Array]]:
    """Return the rotation into the frames, and the prescribed values there.

    Parameters
    ----------
    oblique
        Constraints of each node on an oblique surface.
    others
        The constraints on Cartesian components of a node.
    functions
        How many there are.
    kept
        Axes of nodes that stay an unknown of their own, those along which plates move; at right angles to what is
        prescribed there.

    Returns
    -------
    rotation, (unknowns, values)
        Orthogonal matrix (unknowns, unknowns), None without oblique surfaces; prescribed unknowns (k,) of these nodes
        and their values (k, functions) for a unit of each time function.

    Raises
    ------
    ConfigurationError
        Constraints of a node depend on each other, and contradict.
    """
    if not oblique:
        return None, (np.empty(0, dtype=np.int64), np.empty((0, functions)))
    rotation = sparse.identity(mesh.size, format="lil")
    unknowns, values = [], []
    for node, constraints in oblique.items():
        frame, rows, prescribed = _frame([*constraints, *others(node)], functions, (kept or {}).get(node, ()))
        own = slice(3 * node, 3 * node + 3)
        rotation[own, own] = frame
        unknowns += [3 * node + row for row in rows]
        values += prescribed
    order = np.argsort(unknowns)
    return rotation.tocsr(), (np.array(unknowns, dtype=np.int64)[order], np.array(values)[order])


def _frame(
    constraints: list[Constraint], functions: int, kept: Sequence[int]
) -> tuple[Array, list[int], list[Array]]:
    """Return an orthonormal frame (3, 3), its prescribed rows and their values (functions,).

    The kept axes keep their places; the directions that are prescribed take the first of the others.
    """
    basis = [(np.eye(3)[axis], np.zeros(functions)) for axis in kept]
    for direction, function, factor, source in constraints:
        # What the rows so far leave of it (Gram–Schmidt).
        rest, value = direction.copy(), factor * np.eye(functions)[function]
        for row, known in basis:
            share = row @ direction
            rest, value = rest - share * row, value - share * known
        length = np.linalg.norm(rest)
        if length > SAME:
            basis.append((rest / length, value / length))
        elif np.abs(value).max() > SAME * max(
            abs(factor), *(float(np.abs(known).max()) for _, known in basis)
        ):
            raise ConfigurationError(
                f"{source} contradicts what neighbouring surfaces prescribe where they meet; "
                "prescribe it on one of them only"
            )
    prescribed = basis[len(kept) :]
    for axis in np.eye(3):
        rest = axis - sum((row @ axis) * row for row, _ in basis)
        length = np.linalg.norm(rest)
        if len(basis) < 3 and length > 0.5:
            basis.append((rest / length, np.zeros(functions)))
    places = [*kept, *(i for i in range(3) if i not in kept)]
    frame = np.empty((3, 3))
    frame[places] = [row for row, _ in basis]
    first = len(kept)
    return frame, places[first : first + len(prescribed)], [value for _, value in prescribed]
