"""Notes on symmetry: shears that are no inputs, planes that the cell lacks, a mesh that breaks it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from porocore.core.inputs.input_space import InputSpace
from porocore.core.tensors.point_group import PointGroup
from porocore.states import Array, CellResponse
from porocore.surrogates.potential.data import STILL, variables
from porocore.surrogates.stretch.components import PLACES
from porocore.surrogates.stretch.log_stretch import LogStretch
from porocore.surrogates.symmetry import acting_across, on_places

#: Largest asymmetry of the stiffness at rest without a warning.
LARGEST_DEFECT = 0.02
#: Entries of a mirror closer than this to a whole number are one.
SAME = 1e-6
#: States in the box of the inputs that show which variables they move.
STATES = 16


def uncovered_shears(inputs: InputSpace, group: PointGroup) -> list[str]:
    """Return shears, such as ``H12``, that are no inputs but on which a cell with this group bears under the inputs.

    Their stress is learned; the stiffness against them is that at rest. A body that gives way leaves what was sampled.
    """
    low, high = np.array(inputs.lower), np.array(inputs.upper)
    states = inputs.scatter(low + (high - low) * np.random.default_rng(0).random((STATES, len(inputs))))
    y = variables(LogStretch.from_gradient(states.grad_u), states.p)
    moved = np.abs(np.nan_to_num(y)).max(axis=1) > STILL
    active = tuple(int(a) for a in np.flatnonzero(moved))
    found = [PLACES[a] for a in acting_across(group, active) if 3 <= a < 6]
    return sorted(f"H{i + 1}{j + 1}" for i, j in found)


def uncovered(inputs: InputSpace, group: PointGroup) -> list[str]:
    """Return a warning of :func:`uncovered_shears`, none without such shears."""
    shears = uncovered_shears(inputs, group)
    if not shears:
        return []
    names = " and ".join(shears)
    are = "is no input" if len(shears) == 1 else "are no inputs"
    return [
        f"in a cell of the point group {group.name} {', '.join(inputs.names)} may cause stresses along {names}, which "
        f"{are}. The surrogate learns these stresses, but it knows the stiffness against {names} only at rest. Where "
        f"the body shears by {names}, states are flagged, and Newton's iteration may fail. Add {names} to "
        f"sampling.inputs, unless the body is held against such shear. Add "
        f"{_transposed(shears)} instead where a boundary moves the body so; the cell is stretched the same"
    ]


def _transposed(shears: list[str]) -> str:
    """Return H21 for H12, and so on; the stretch of a cell is the same."""
    return " and ".join(f"H{name[2]}{name[1]}" for name in shears)


def unmirrored(planes: Mapping[str, Array], group: PointGroup) -> list[str]:
    """Return a note of symmetry planes of the body at which a cell of this group is not mirrored to itself.

    Parameters
    ----------
    planes
        Normals (3,) by name.
    group
        Point group of the cell.
    """
    mirrors = {name: np.eye(3) - 2 * np.outer(normal, normal) for name, normal in planes.items()}
    names = [
        f"'{name}'"
        for name, Q in mirrors.items()
        if np.abs(Q - np.rint(Q)).max() > SAME or np.rint(Q).astype(int) not in group
    ]
    if not names:
        return []
    return [
        f"the cell, of the point group {group.name}, is not its own mirror image at {' and '.join(names)}: behind "
        "such a plane the whole body is made of mirrored cells. If it is not, solve the whole body, without such "
        "planes; a small patch (macro.surfaces) holds it sideways where only smooth plates do, see docs/bodies.md"
    ]


def defect(stiffness: Array, group: PointGroup) -> float:
    """Return the asymmetry of ∂P_E/∂H (3, 3, 3, 3) under a group, as a share of its largest entry."""
    action, matrix = on_places(group), stiffness.reshape(9, 9)
    return float(np.abs(matrix - action.mean(action, matrix)).max() / np.abs(matrix).max())


def broken_by_the_mesh(reference: CellResponse, group: PointGroup) -> list[str]:
    """Return a warning of a free mesh that breaks the symmetry of its cell at rest, none within the tolerance.

    Parameters
    ----------
    reference
        Response of the undeformed cell with its tangent, one row.
    group
        Point group of the cell.
    """
    tangent = reference.tangent
    if tangent is None or tangent.stress_grad_u is None:
        return []
    share = defect(np.asarray(tangent.stress_grad_u[0]), group)
    if not share > LARGEST_DEFECT:
        return []
    return [
        f"the mesh of the cell breaks its symmetry, {group.name}: the stiffness at rest differs by {share:.1%} of its "
        "largest entry where it should not; the error of the mesh is at least as large, see cell.mesh.size"
    ]
