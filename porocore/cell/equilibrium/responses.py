"""Load path to an equilibrium, responses with derivatives and status there; overlap of the deformed wall.

Each step: a predictor along the exact tangent, then Newton on Π with a line search that keeps J > 0 and
lowers the energy. Under strong compression the ridges where two channels meet crease and fold through their mirror
plane while J stays positive everywhere; without contact such a state has no meaning.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from porocore.cell.equilibrium.discrete import (
    DiscreteSolid,
    FactorisedTangent,
    Iterate,
    LoadStepFailed,
    Sensitivities,
)
from porocore.cell.equilibrium.slopes import ExplicitDependence, solid_slopes
from porocore.cell.meshing.mesh import CellMesh
from porocore.cell.meshing.tetrahedra import shape_functions
from porocore.cell.symmetry import UNIT_LOADS, axis_order, classes, images, visible
from porocore.core.tensors import cofactor, cofactor_tangent, determinant
from porocore.states import Array, CellExtrema, CellResponse, CellSlopes, CellTangent, IntArray, Status

ITERATIONS = 50
#: After so many iterations the contact pairs are kept: at an edge a point may alternate between two triangles for ever.
PAIRINGS = 12
#: Largest step in any component of H, and in p over Young's modulus of the solid; larger ones seldom converge.
LARGEST_STEP = 0.16
SMALLEST_STEP = 1 / 300
#: A path of more than a thousand of the largest steps is refused.
SHORTEST_SHARE = 1e-3
#: Failed steps that end a path; behind a bifurcation every further one would fail.
FAILURES = 6
ARMIJO = 1e-4
#: Relative accuracy of the linear system of the predictor.
PREDICTOR_ACCURACY = 1e-3
#: Iterations with the factor of another tangent; more of them cost more than a new factor.
PATIENCE = 18
#: Shifts of an indefinite tangent, relative to the mean of its diagonal.
SMALLEST_SHIFT, LARGEST_SHIFT = 1e-5, 10.0


@dataclass(frozen=True, eq=False)
class LoadPathResult:
    """Result of a load path: its status, and the equilibrium, None unless the wanted load was reached."""

    status: Status
    equilibrium: Iterate | None
    steps: int
    iterations: int


def follow(problem: DiscreteSolid, start: Iterate, H: Array, p: float, tolerance: float) -> LoadPathResult:
    """Follow the load from ``start`` to (H, p) in adaptive steps, to a residual of ``tolerance`` times the force scale.

    A state on the way whose walls overlap ends the path: without contact, the states behind it have no meaning.
    """
    problem.reset()
    iterate, share = start, 0.0
    pressure = abs(p - start.p) / problem.material.mean_moduli()[0]
    largest = LARGEST_STEP / max(float(np.abs(H - start.H).max()), pressure, 1e-12)
    if largest < SHORTEST_SHARE:
        return LoadPathResult(Status.not_converged, None, 0, 0)
    step = min(1.0, largest)
    steps = iterations = failures = 0
    while share < 1:
        goal = min(1.0, share + step)
        H_goal, p_goal = start.H + goal * (H - start.H), start.p + goal * (p - start.p)
        try:
            reached, taken = _newton(problem, _predict(problem, iterate, H_goal, p_goal), tolerance)
        except LoadStepFailed as failed:
            step, failures = (goal - share) / 4, failures + 1
            if step < SMALLEST_STEP or failures > FAILURES:
                return LoadPathResult(failed.status, None, steps, iterations)
            continue
        iterate, step, share = reached, min(2 * (goal - share), largest), goal
        steps, iterations = steps + 1, iterations + taken
        if _overlaps(problem, iterate):
            return LoadPathResult(Status.overlap, None, steps, iterations)
    return LoadPathResult(Status.converged, iterate, steps, iterations)


def least_shifted(solve: Callable[[float], Array | None], rhs: Array, last: float) -> tuple[Array, float]:
    """Return the solution for ``rhs`` with the least shift that makes the tangent definite, and that shift.

    ``solve`` returns the solution with a shift, None if the tangent is still indefinite; ``last`` is the shift of the
    iterate before.

    Raises
    ------
    LoadStepFailed
        No shift makes it definite.
    """
    # Neighbouring iterates need about the same shift, and less of it brings them on faster.
    shift = max(last / 4, SMALLEST_SHIFT)
    while shift < LARGEST_SHIFT:
        x = solve(shift)
        if x is not None and x @ rhs > 0:
            return x, shift
        shift *= 4
    raise LoadStepFailed(Status.not_converged)


def gap(problem: DiscreteSolid, iterate: Iterate) -> float:
    """Return the smallest relative gap between pore wall and mirror planes; NaN without planes or without a wall."""
    if problem.mesh.domain == "whole":
        return float("nan")
    found = mirror_gap(problem.mesh, iterate.H, iterate.displacement)
    return found if np.isfinite(found) else float("nan")


def _overlaps(problem: DiscreteSolid, iterate: Iterate) -> bool:
    """Return whether the wall penetrates a plane or another wall deeper than contact accepts."""
    touching = iterate.touching
    if touching is not None and problem.contact is not None and touching.depth > problem.contact.deepest:
        return True
    if problem.mesh.domain == "eighth":
        return problem.contact is None and gap(problem, iterate) < 0
    inside = nodes_inside(problem.mesh, iterate.H, iterate.displacement)
    held: IntArray = np.unique(touching.forces.nodes) if touching is not None else np.zeros(0, dtype=np.int64)
    # A node in contact lies slightly inside; any other node inside has passed a wall between two iterates.
    images = problem.mesh.periodic_class
    return len(np.setdiff1d(images[inside], images[held])) > 0


def _predict(problem: DiscreteSolid, iterate: Iterate, H: Array, p: float) -> Iterate:
    """Return the first-order continuation of the equilibrium to (H, p)."""
    change = -problem.load_change(iterate, H - iterate.H, p - iterate.p)
    if change.any():
        change = problem.solve(iterate, change, PREDICTOR_ACCURACY)
    there = problem.moved(iterate, change, H, p)
    if there.min_jacobian <= 0:
        raise LoadStepFailed(Status.inverted)
    return there


def _longest(problem: DiscreteSolid, change: Array) -> float:
    """Return the share of a change that moves no node beyond the range of the contact search."""
    if problem.contact is None or not problem.contact.pairs_move:  # the mirror planes are always known
        return 1.0
    moved = float(np.linalg.norm(problem.expanded(change, ""), axis=1).max())
    return min(1.0, problem.contact.deepest / max(moved, 1e-300))


def _newton(problem: DiscreteSolid, iterate: Iterate, tolerance: float) -> tuple[Iterate, int]:
    """Return the equilibrium near a first guess, and the number of linear systems solved."""
    scale = problem.force_scale(iterate)
    goal = tolerance * scale
    for iteration in range(ITERATIONS):
        norm = float(np.linalg.norm(iterate.residual))
        if norm <= goal:
            return iterate, iteration
        accuracy = min(1e-2, max(1e-7, 0.1 * goal / norm, norm / scale))
        change = problem.solve(iterate, -iterate.residual, accuracy)
        slope = float(iterate.residual @ change)
        length, inverted = _longest(problem, change), True
        while length > 1e-3:
            trial = problem.moved(iterate, length * change, iterate.H, iterate.p)
            # With fixed pairs the energy along the line is smooth.
            trial = trial.with_pairs(iterate.contact_pairs)
            if trial.min_jacobian > 0:
                inverted = False
                if trial.energy <= iterate.energy + ARMIJO * length * slope:
                    break
                # Near the solution Π stalls at round-off while the residual still decreases.
                stalled = abs(slope) < 1e-9 * abs(iterate.energy) + 1e-14
                if stalled and float(np.linalg.norm(trial.residual)) < norm:
                    break
            length /= 2
        else:
            if norm <= 100 * goal:  # round-off, not a failure of the step
                return iterate, iteration
            raise LoadStepFailed(Status.inverted if inverted else Status.not_converged)
        iterate = trial.with_pairs(None) if iteration < PAIRINGS else trial
    if float(np.linalg.norm(iterate.residual)) <= goal:
        return iterate, ITERATIONS
    raise LoadStepFailed(Status.not_converged)


def respond(problem: DiscreteSolid, iterate: Iterate, *, tangent: bool) -> CellResponse:
    """Return one row of responses; ``unstable`` where the tangent of any parity class is indefinite.

    Raises
    ------
    FactorError
        A tangent cannot be factorised.
    """
    return respond_with_slopes(problem, iterate, (), tangent=tangent)[0]


def respond_with_slopes(
    problem: DiscreteSolid, iterate: Iterate, dependences: Sequence[ExplicitDependence], *, tangent: bool
) -> tuple[CellResponse, Array | None]:
    """Return one row of responses with its slopes by m parameters, and those of u¹ at the moving nodes, (m, nodes, 3).

    There are no slopes without derivatives or parameters, and none of the conductivity.

    Parameters
    ----------
    problem
        Solid.
    iterate
        Equilibrium.
    dependences
        Explicit dependence of the solid on each parameter.
    tangent
        Whether derivatives are wanted.

    Raises
    ------
    FactorError
        A tangent cannot be factorised.
    """
    slopes = moved = None
    mean_grad, second = np.zeros((3, 3, 10)), np.zeros((10, 10))
    counts = []
    swaps = problem.exchanged_axes(iterate)
    of_images: dict[str, int] = {}
    for parity, columns in classes(problem.mesh).items():
        first = min(images(parity, swaps))
        derived = tangent and bool(columns)
        if first in of_images and (not derived or iterate.touching is None):
            if derived:
                _exchange_axes(mean_grad, second, axis_order(first, parity, swaps), columns)
            counts.append(of_images[first])
            continue
        factor = problem.factor(iterate, parity)
        answer = None
        if derived:
            answer = problem.sensitivities(factor, columns)
            grad = problem.copies * visible(problem.mesh, parity) * answer.grad
            mean_grad[:, :, columns] = np.moveaxis(grad, 0, -1)
            second[np.ix_(columns, columns)] = problem.copies * (
                answer.second + _direct(iterate, parity, columns)
            )
            if not parity and dependences:
                slopes, moved = solid_slopes(problem, factor, answer, dependences)
        of_images[first] = _unstable_modes(problem, factor, answer)
        counts.append(of_images[first])
    # Where one class is unknown, the number is so too unless another one has unstable modes.
    negative = sum(max(count, 0) for count in counts) or min(counts)
    derivatives = _tangent(iterate, mean_grad, second) if tangent else None
    return _row(problem, iterate, negative, derivatives, slopes), moved


def _exchange_axes(mean_grad: Array, second: Array, order: Sequence[int], columns: Sequence[int]) -> None:
    """Fill in the derivatives by the loads of a class from those of the class that an exchange of axes maps onto it."""
    sources = [3 * order[column // 3] + order[column % 3] for column in columns]
    mean_grad[:, :, columns] = mean_grad[np.ix_(order, order, sources)]
    second[np.ix_(columns, columns)] = second[np.ix_(sources, sources)]


def _unstable_modes(problem: DiscreteSolid, factor: FactorisedTangent, answer: Sensitivities | None) -> int:
    """Return the number of negative eigenvalues; -1 where neither the factor nor the answer shows it."""
    if factor.negative >= 0 or answer is None:
        return problem.negative_eigenvalues(factor)
    return answer.negative


def _direct(iterate: Iterate, parity: str, columns: Sequence[int]) -> Array:
    """Return ∂²E/∂θ∂θ' of the energy E of contact at fixed u¹."""
    if iterate.touching is None:
        return np.zeros((len(columns), len(columns)))
    blocks = iterate.touching.blocks(parity)
    return np.array([[blocks.second(UNIT_LOADS[i], UNIT_LOADS[j]) for j in columns] for i in columns])


def _row(
    problem: DiscreteSolid,
    iterate: Iterate,
    negative: int,
    tangent: CellTangent | None,
    slopes: CellSlopes | None,
) -> CellResponse:
    integrals, copies = problem.integrals(iterate), problem.copies
    seen = visible(problem.mesh)
    F0 = np.eye(3) + iterate.H
    J0 = float(determinant(F0))
    contact = iterate.touching.forces if iterate.touching is not None else None
    energy = integrals.energy + (contact.energy if contact else 0.0)
    stress = integrals.stress + (contact.by_load if contact else 0.0)
    stable = Status.converged if contact is None else Status.contact
    return CellResponse(
        mean_grad=(copies * seen * integrals.grad)[None],
        status=np.array([Status.unstable if negative > 0 else stable], dtype=np.int64),
        potential=np.array([copies * (energy + iterate.p * integrals.volume) - iterate.p * J0]),
        stress=(copies * seen * stress - iterate.p * cofactor(F0))[None],
        fluid_volume=np.array([J0 - copies * integrals.volume]),
        tangent=tangent,
        slopes=slopes,
        extrema=CellExtrema(
            grad=integrals.largest_grad[None],
            energy=np.array([integrals.largest_energy]),
            energy_mean=np.array([copies * integrals.energy]),
            min_jacobian=np.array([iterate.min_jacobian]),
            min_gap=np.array([gap(problem, iterate)]),
            negative_pivots=np.array([float(negative)]),
            contact_share=np.array([contact.share if contact else 0.0]),
        ),
    )


def _tangent(iterate: Iterate, mean_grad: Any, second: Any) -> CellTangent:
    """Return the derivatives by name from the columns of θ, with the fluid's share −p J₀ of W."""
    F0 = np.eye(3) + iterate.H
    second[:9, :9] -= iterate.p * cofactor_tangent(F0).reshape(9, 9)
    second[:9, 9] -= cofactor(F0).ravel()
    second[9, :9] -= cofactor(F0).ravel()
    return CellTangent(
        mean_grad_grad_u=mean_grad[:, :, :9].reshape(1, 3, 3, 3, 3),
        mean_grad_p=mean_grad[None, :, :, 9],
        stress_grad_u=second[:9, :9].reshape(1, 3, 3, 3, 3),
        stress_p=second[:9, 9].reshape(1, 3, 3),
        fluid_volume_grad_u=-second[9, :9].reshape(1, 3, 3),
        fluid_volume_p=-second[9:, 9],
    )


#: Subdivision of a quadratic tetrahedron (VTK order) into eight linear ones.
SUBDIVISION = np.array([
    [0, 4, 6, 7], [4, 1, 5, 8], [6, 5, 2, 9], [7, 8, 9, 3],
    [4, 5, 6, 8], [4, 6, 7, 8], [6, 5, 9, 8], [6, 9, 7, 8],
])  # fmt: skip
#: Intervals along the edge of a facet in the grid of points on the wall.
FACET_GRID = 8
#: A node lies inside a tetrahedron if all its barycentric coordinates exceed this.
DEPTH = 0.02


def mirror_gap(mesh: CellMesh, grad_u: Array, u: Array) -> float:
    """Return the smallest distance of the deformed wall to a mirror plane of the eighth over the undeformed one.

    It is 1 in the undeformed state, and negative where the wall has passed the plane. It is evaluated on a grid of
    points on every facet, since a crease begins as a fold within the facets next to the plane. The mesh is that of the
    solid on the eighth, ``grad_u`` (3, 3) is a diagonal H and u (nodes, 3) is u¹.
    """
    X, weights = _wall_points(mesh)
    x = X * (1 + np.diag(grad_u)) + np.einsum("sa,kai->ksi", weights, u[mesh.wall]).reshape(-1, 3)
    edge = (1 + np.diag(grad_u)) * mesh.high
    gap = np.inf
    for axis in range(3):
        below, above = X[:, axis], mesh.high[axis] - X[:, axis]
        off = below > 1e-12
        gap = min(gap, (x[off, axis] / below[off]).min(initial=np.inf))
        off = above > 1e-12
        gap = min(gap, ((edge[axis] - x[off, axis]) / above[off]).min(initial=np.inf))
    return float(gap)


@lru_cache(maxsize=8)
def _wall_points(mesh: CellMesh) -> tuple[Array, Array]:
    """Return grid points on the wall's facets (points, 3), and their shape functions (samples, 3 or 6)."""
    n = FACET_GRID
    grid = np.array([(j, n - i - j) for i in range(n + 1) for j in range(n + 1 - i)]) / n
    weights, _ = shape_functions(grid, mesh.wall.shape[1])
    return np.einsum("sa,kai->ksi", weights, mesh.points[mesh.wall]).reshape(-1, 3), weights


def nodes_inside(mesh: CellMesh, grad_u: Array, u: Array) -> IntArray:
    """Return the nodes of the deformed wall that, or a periodic image of which, lie inside the deformed solid.

    The domain is the whole cell under any load; arguments as of :func:`mirror_gap`.
    """
    F0 = np.eye(3) + grad_u
    x = mesh.points @ F0.T + u
    tetrahedra = mesh.cells if mesh.order == 1 else mesh.cells[:, SUBDIVISION].reshape(-1, 4)
    # Sums over short last axes are slow, so components come first.
    corners = x.T[:, tetrahedra.T]
    centres = corners.mean(axis=1)
    radii = np.sqrt(((corners - centres[:, None]) ** 2).sum(axis=0).max(axis=0))
    low, high = x.min(axis=0), x.max(axis=0)
    nodes = np.unique(mesh.wall)
    queries, names = [], []
    for shift in product((-1.0, 0.0, 1.0), repeat=3):
        moved = x[nodes] + F0 @ (np.array(shift) * mesh.spans)
        near = ((moved > low) & (moved < high)).all(axis=1)
        queries.append(moved[near])
        names.append(nodes[near])
    points, origin = np.concatenate(queries), np.concatenate(names)
    reach = float(radii.max(initial=0.0))
    near = cKDTree(points, balanced_tree=False).sparse_distance_matrix(
        cKDTree(centres.T, balanced_tree=False), reach, output_type="ndarray"
    )
    point, tetrahedron = near["i"], near["j"]
    within = near["v"] < radii[tetrahedron]
    point, tetrahedron = point[within], tetrahedron[within]
    same = mesh.periodic_class[tetrahedra[tetrahedron]] == mesh.periodic_class[origin[point]][:, None]
    apart = ~same.any(axis=1)
    point, tetrahedron = point[apart], tetrahedron[apart]
    inside = _depth(x[tetrahedra[tetrahedron]], points[point]) > DEPTH
    return np.asarray(np.unique(origin[point[inside]]))


def _depth(corners: Array, points: Array) -> Array:
    """Return the smallest barycentric coordinate of each point (n, 3) in its tetrahedron (n, 4, 3).

    It is −1 for a tetrahedron that is flat or turned inside out.
    """
    edges = (corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1)
    # A curved tetrahedron may be sound where one of the straight ones that divide it is turned inside out.
    flat = np.linalg.det(edges) < 1e-14
    edges[flat] = np.eye(3)
    inner = np.linalg.solve(edges, (points - corners[:, 0])[:, :, None])[:, :, 0]
    depth: Array = np.minimum(inner.min(axis=1), 1 - inner.sum(axis=1))
    depth[flat] = -1.0
    return depth
