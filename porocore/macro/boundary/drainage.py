"""Drainage of a body: through which surfaces, and how long; early pressures that its mesh does not resolve.

In a time t the fluid of a layer of about √(c_v t) leaves. As long as that is thinner than an element, the linear
pressure overshoots beside it: for a sudden load and one step of backward Euler where Δt < h²/(6 c_v) [Vermeer and
Verruijt 1981, Int. J. Numer. Anal. Methods Geomech. 5, 1–14]. Shorter steps make it worse; a ramp that lasts longer
avoids it.

Of a step without any diffusion, ∫ N_i p dX = ∫ N_i p₀ dX remains at the nodes i without a prescribed pressure. Beside a
drained plane of hexahedra p/p₀ is 1 + (2 − √3) = 1.27, beside an edge and a corner of drained planes its square and
cube, beside a plane of tetrahedra 1.5 to 1.7.

After ramps of columns that last r h²/(6 c_v), what is left of that at the largest pressure stays below e^{−r} of it on
hexahedra and e^{−0.65 r} on tetrahedra, which lack the symmetry along the plane (see :data:`DECAY`).
Quadrilaterals are as hexahedra; on triangles it was at most e^{−0.78 r}.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.linalg import eigh_tridiagonal
from scipy.sparse import coo_array, csc_array, diags_array
from scipy.sparse.linalg import cg, splu

from porocore.core.formulas import TimeFunction
from porocore.core.units import units_now
from porocore.interfaces.solution import MacroSolution
from porocore.macro.analytic import relaxed
from porocore.macro.body.kinds import Box
from porocore.macro.body.mesh import BodyMesh, Facets
from porocore.macro.laws.linear import LinearCoefficients, RestCoefficients
from porocore.macro.problem import Boundary, MacroProblem, MacroSetup, body_mesh
from porocore.states import Array, IntArray

#: A conductivity below this share of the largest is none: what the cell solver leaves where no pore runs through.
CLOSED = 1e-6
#: Steps of Lanczos' iteration, of which the slow parts need few, and the length of a vector that is round-off.
LANCZOS, EXHAUSTED = 24, 1e-10
#: Times or pressures that differ by less than this share are one.
SAME = 1e-9


def undrained(macro: MacroSetup, conductivity: Array) -> list[str]:
    """Return why the body, or a surface with a prescribed pressure, cannot drain; empty where all can.

    Parameters
    ----------
    macro
        With the surfaces on which the pressure is prescribed; the direction is known of those across x, y or z.
    conductivity : (3, 3)
        K of the undeformed cell.
    """
    faces = macro.boundary.items()
    if not drained_surfaces(macro) and not any(boundary.flux != 0 for _, boundary in faces):
        return [
            "no surface has a prescribed pressure, so no fluid can leave and nothing consolidates; "
            "give one under macro.boundary"
        ]
    K, found = np.diag(conductivity), []
    if K.max() <= 0:
        return [
            "the cell conducts no fluid in any direction, so none leaves through the surfaces whose pressure or flux "
            "is prescribed and nothing consolidates; its pores must run through, see cell.geometry"
        ]
    for name, boundary in faces:
        face = macro.surfaces[name].of if name in macro.surfaces else name
        if face not in Box.surfaces:
            continue
        i = "xyz".index(face[0])
        if boundary.pressure is not None and K[i] <= CLOSED * K.max():
            kind = "face" if name == face else "surface"
            found.append(
                f"the cell conducts no fluid along {face[0]} (K_{i + 1}{i + 1} = {K[i]:.2g}), so none leaves "
                f"through the {kind} {name}, whose pressure is prescribed; see cell.geometry"
            )
    return found


def drained_surfaces(macro: MacroSetup) -> list[str]:
    """Return the names of the surfaces through which fluid leaves: with a prescribed pressure, or beside indenters."""
    names = [name for name, boundary in macro.boundary.items() if boundary.pressure is not None]
    beside = [name for each in macro.contact.values() if each.drains for name in each.surfaces]
    return list(dict.fromkeys([*names, *beside]))


def drained_axes(macro: MacroSetup) -> tuple[int, ...]:
    """Return the axes along which fluid leaves by flat faces across them; all three where one face is none of these."""
    faces = [macro.surfaces[name].of if name in macro.surfaces else name for name in drained_surfaces(macro)]
    if not all(face in Box.surfaces for face in faces):
        return (0, 1, 2)
    return tuple(i for i, axis in enumerate("xyz") if any(face[0] == axis for face in faces))


def moved(macro: MacroSetup) -> bool:
    """Return whether displacements move the body and nothing else does, so that its force relaxes."""
    faces = macro.boundary.values()
    pushed = any(f.plate is not None or f.follower != 0 or any(t != 0 for t in f.traction) for f in faces)
    pushed |= any(indenter.force is not None for indenter in macro.contact.values())
    goes = any(face.is_moved for face in faces) or bool(macro.contact)
    return goes and not pushed and not any(macro.body_force)


def held_sideways(macro: MacroSetup) -> int | None:
    """Return the axis along which alone a body can deform, since all of its other surfaces are held; None without.

    It is that of two whole flat faces. Along it the other surfaces slide.
    """
    mesh = body_mesh(macro)
    names = set(mesh.surfaces)
    dimension = mesh.element.dimension
    for axis, letter in enumerate("xyz"[:dimension]):
        ends, others = {f"{letter}-", f"{letter}+"}, [i for i in range(dimension) if i != axis]
        sides = [macro.boundary.get(name, Boundary()) for name in names - ends]
        if not ends <= names or macro.surfaces or not all(_slides(side, axis, others) for side in sides):
            continue
        return axis if mesh.unnamed == 0 else None
    return None


def _slides(side: Boundary, axis: int, others: list[int]) -> bool:
    return side.displacement[axis] is None and (
        side.normal == 0 or all(side.displacement[i] == 0 for i in others)
    )


def relaxation_time(macro: MacroSetup, coefficients: LinearCoefficients, left: float = 0.05) -> float | None:
    """Return the time after a sudden displacement at which the force is within a share of its final value.

    None where it is not known in closed form: it is for a body that is held sideways, and both of whose ends along the
    axis that is left are moved or held, through one or both of which it drains.
    """
    axis = held_sideways(macro) if moved(macro) else None
    if axis is None:
        return None
    names = [f"{'xyz'[axis]}{sign}" for sign in "-+"]
    sides = [face for name, face in macro.boundary.items() if name not in names]
    if any(face.pressure is not None or face.flux != 0 for face in sides):
        return None
    ends = [macro.boundary.get(name, Boundary()) for name in names]
    drained = sum(end.pressure is not None for end in ends)
    if drained == 0 or any(end.normal is None and end.displacement[axis] is None for end in ends):
        return None
    compliance = float(coefficients.biot[axis, axis] ** 2 / coefficients.stiffness[axis, axis, axis, axis])
    time = relaxed(compliance / (compliance + coefficients.storage), left)
    length = float(np.ptp(body_mesh(macro).points[:, axis])) / drained
    return None if time is None else time * length**2 / coefficients.consolidation_coefficient(axis)


def drainage_time(
    macro: MacroSetup, coefficients: LinearCoefficients | RestCoefficients, share: float = 0.95
) -> float | None:
    """Return the time in which so large a share of what a sudden load drives out has left; None: nothing can leave.

    It is that of a pore pressure S ∂p/∂t = ∇·(S c ∇p) which is 1 everywhere at first and zero at surfaces with a
    prescribed pressure, on the body as it is. c_ij is K_ij/√(S_i S_j), where K_ii/S_i is the consolidation coefficient
    of confined compression along an axis, and S the geometric mean of the S_i. So it is exact for a column (Terzaghi),
    and a scale for bodies that give way sideways. The coefficients are those of one cell, or of the elements.
    """
    mesh = body_mesh(macro)
    drained = [mesh.surface(name, name) for name in drained_surfaces(macro)]
    facets = [nodes.ravel() for nodes in drained if len(nodes)]
    c = RestCoefficients.of_elements(coefficients, len(mesh.cells))
    if not facets or np.einsum("eii->ei", c.conductivity).max() <= 0:
        return None
    places = [0, 4, 8]  # 11, 22 and 33 among the nine components
    moduli, alpha = np.diagonal(c.stiffness, axis1=1, axis2=2)[:, places], c.biot[:, places]
    root = np.sqrt(c.storage[:, None] + alpha**2 / moduli)
    diffusivity = c.conductivity / (root[:, :, None] * root[:, None, :])
    largest = float(np.einsum("eii->ei", diffusivity).max())
    # Where all elements are alike, the storage makes no difference.
    storage = np.prod(root, axis=1) ** (2 / 3)
    storage /= storage.max()
    flow, volume = _diffusion(mesh, diffusivity + CLOSED * largest * np.eye(3), storage)
    free = np.setdiff1d(np.arange(len(mesh.points)), np.concatenate(facets))
    rates, shares = _decay(flow[free][:, free], volume[free][:, free], volume.sum(axis=1)[free])
    shares /= storage @ mesh.weights.sum(axis=1)
    if rates[0] * np.ptp(mesh.points, axis=0).max() ** 2 <= 100 * CLOSED * largest:
        return None
    return _time_to(1 - share, rates, shares)


def _time_to(left: float, rates: Array, shares: Array) -> float | None:
    """Return the time at which so much of decaying parts is left, by bisection; None if there was no more at first."""
    begin, end = 0.0, float(np.log(max(shares.sum() / left, 1.0)) / rates[0])
    while end - begin > SAME * end:
        middle = (begin + end) / 2
        later = shares @ np.exp(-rates * middle) > left
        begin, end = (middle, end) if later else (begin, middle)
    return end or None


def _decay(flow: Any, volume: Any, ones: Array) -> tuple[Array, Array]:
    """Return rates, the slowest first, and integrals of the decaying parts of a pressure that is 1 at first.

    By the spectral measure that Lanczos' iteration sees from the solution of a constant source: alike modes, as of a
    body in layers that do not exchange fluid, count as one.
    """
    solve = splu(csc_array(flow)).solve
    vector = solve(ones)
    size = float(np.sqrt(vector @ (volume @ vector)))
    found, diagonal, beside = [vector / size], [], []
    for _ in range(min(LANCZOS, len(ones))):
        vector = solve(volume @ found[-1])
        diagonal.append(float(found[-1] @ (volume @ vector)))
        basis = np.array(found)
        for _ in range(2):  # once leaves a share of the round-off
            vector -= basis.T @ (basis @ (volume @ vector))
        length = float(np.sqrt(max(vector @ (volume @ vector), 0.0)))
        if length <= EXHAUSTED * diagonal[0]:
            break
        beside.append(length)
        found.append(vector / length)
    times, parts = eigh_tridiagonal(diagonal, beside[: len(diagonal) - 1])
    positive = times > EXHAUSTED * times.max()
    rates = 1 / times[positive][::-1]
    return rates, (size * parts[0][positive][::-1] * rates) ** 2


def _diffusion(mesh: BodyMesh, diffusivity: Array, storage: Array) -> tuple[Any, Any]:
    """Return the sparse matrices (nodes, nodes) of ∫S ∇q·c∇p and ∫S qp with quadratic functions."""
    values, gradients = mesh.element.values(mesh.element.points), mesh.gradients()
    if mesh.revolved:  # nothing flows around
        gradients[..., 2] = 0.0
    weights = storage[:, None] * mesh.weights
    flow = np.einsum("eq,eqai,eij,eqbj->eab", weights, gradients, diffusivity, gradients, optimize=True)
    volume = np.einsum("eq,qa,qb->eab", weights, values, values, optimize=True)
    one, other = (_assembled(local, mesh.cells, len(mesh.points)).tocsc() for local in (flow, volume))
    return one, other


def _assembled(local: Array, nodes: IntArray, size: int) -> Any:
    """Return the sparse matrix (size, size) of element matrices (elements, a, a) between their nodes (elements, a)."""
    a = nodes.shape[1]
    rows, columns = np.repeat(nodes, a, axis=1).ravel(), np.tile(nodes, a).ravel()
    return coo_array((local.ravel(), (rows, columns)), shape=(size, size))


def diffusion_time(macro: MacroSetup, coefficients: LinearCoefficients | RestCoefficients) -> float:
    """Return the largest h²/(6 c_v) of the elements at surfaces with a prescribed pressure; 0 where there are none.

    h is the height of an element above its facet and c_v that of confined compression along the normal, at rest. The
    coefficients are those of one cell, or of the elements of the body.
    """
    mesh, largest = body_mesh(macro), 0.0
    by_element = RestCoefficients.of_elements(coefficients, len(mesh.cells))
    share = 1.0 if mesh.element.is_product else float(mesh.element.dimension)
    for name, boundary in macro.boundary.items():
        if boundary.pressure is None:
            continue
        facets = Facets(mesh, mesh.surface(name, f"macro.boundary.{name}"))
        if not len(facets.nodes):
            continue
        normals = (facets.directions * facets.areas[..., None]).sum(axis=1)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        height = share * mesh.weights[facets.elements].sum(axis=1) / facets.areas.sum(axis=1)
        speed = _consolidation(by_element[facets.elements], normals)
        open_ones = speed > 0
        largest = max(largest, float((height[open_ones] ** 2 / (6 * speed[open_ones])).max(initial=0.0)))
    return largest


def _consolidation(c: RestCoefficients, normals: Array) -> Array:
    """c_v (n,) = n·Kn/(1/M_B + αn·A⁻¹αn) along normals (n, 3), with the acoustic tensor A_ik = C_ijkl n_j n_l."""
    acoustic = np.einsum("nijkl,nj,nl->nik", c.stiffness.reshape(-1, 3, 3, 3, 3), normals, normals)
    push = np.einsum("ni,nij->nj", normals, c.biot.reshape(-1, 3, 3))
    yielding = np.einsum("ni,ni->n", push, np.linalg.solve(acoustic, push[..., None])[..., 0])
    return np.asarray(np.einsum("ni,nij,nj->n", normals, c.conductivity, normals) / (c.storage + yielding))


def overshoot(problem: MacroProblem) -> float:
    """Return by which share the mesh overshoots an equal pressure that drains, after a step without diffusion."""
    mesh = body_mesh(problem)
    shapes = mesh.element.corner_values(mesh.element.points)
    local = np.einsum("eq,qa,qb->eab", mesh.weights, shapes, shapes, optimize=True)
    mass = _assembled(local, mesh.p_cells, len(mesh.p_nodes)).tocsr()
    free = np.flatnonzero(~_drained(mesh, problem))
    if not len(free):
        return 0.0
    inner = mass[free][:, free]
    # Scaled by its diagonal its condition is that of an element, so that a few iterations serve.
    pressure, _ = cg(
        inner, mass.sum(axis=1)[free], rtol=1e-6, maxiter=200, M=diags_array(1 / inner.diagonal())
    )
    return float(pressure.max() - 1)


def _drained(mesh: BodyMesh, problem: MacroProblem) -> npt.NDArray[np.bool_]:
    """(p_nodes,) True where a pressure is prescribed."""
    found = np.zeros(len(mesh.p_nodes), dtype=bool)
    for name, boundary in problem.boundary.items():
        if boundary.pressure is not None:
            facets = mesh.surface(name, f"macro.boundary.{name}")[:, : mesh.element.facet_corners]
            found[np.searchsorted(mesh.p_nodes, np.unique(facets))] = True
    return found


#: Least rate at which the overshoot decays, per h²/(6 c_v) since the loading began, measured for r of 0.5 to 8.
DECAY = {"hexahedron": 1.0, "quadrilateral": 1.0, "tetrahedron": 0.65, "triangle": 0.65}
#: An overshoot up to this share is not told.
TOLD = 0.01


def unresolved(problem: MacroProblem, limit: float, solution: MacroSolution) -> str | None:
    """Return a warning where the largest pressure may be more than 1 % too large on the mesh, else None.

    ``limit`` is that of :func:`diffusion_time`.
    """
    history = solution.history
    at = int(history.pressure_max.argmax())
    time, largest = float(history.time[at]), float(history.pressure_max[at])
    elapsed = time - _begin(problem, time)
    if at == 0 or limit == 0 or largest <= _prescribed(problem, time) * (1 + SAME):
        return None
    element = body_mesh(problem).element
    if at == 1 and element.is_product and elapsed >= limit * (1 - SAME):
        return None  # One step of backward Euler on cubes and squares does not overshoot from there on.
    faded = float(np.exp(-DECAY[element.shape] * elapsed / limit))
    # No mesh overshoots by more than the corner of three drained planes of tetrahedra, 1.7³ − 1 = 3.9.
    if 4 * faded <= TOLD:
        return None
    most = overshoot(problem) * faded
    if most <= TOLD:
        return None
    load = f"{solution.load:g}".replace("-", "−")

    def said(duration: float) -> str:
        return units_now().text(duration, "time", 2)

    return (
        f"Load {load}, law {solution.law}: the largest pressure comes {said(elapsed)} after the start of the loading "
        f"and may be too large, by up to {100 * most:.0f} % on this mesh, and so may the drained volume until then. "
        f"The elements at the drained surfaces resolve the pressure only some time after h²/(6 c_v) = {said(limit)}. "
        "Take thinner elements there "
        "(grading), a longer ramp, or a longer first step."
    )


def _begin(problem: MacroProblem, time: float) -> float:
    """Return when the loading at ``time`` began: the last kink before it ahead of which all loads were constant."""
    functions = [function for boundary in problem.boundary.values() for function in boundary.time_functions]

    def loads(t: float) -> list[float]:
        return [problem.ramp(t), *(function.at(t) for function in functions)]

    plan = problem.time
    ramp = () if plan.load_curve else (plan.end_of_ramp,)
    kinks: list[float] = [t for t in sorted({0.0, *ramp, *problem.corners}) if t < time * (1 - SAME)]
    for before, kink in zip(reversed(kinks[:-1]), reversed(kinks[1:]), strict=True):
        if loads(before) == loads(kink):
            return kink
    return 0.0


def _prescribed(problem: MacroProblem, time: float) -> float:
    """Return the largest pressure that is prescribed anywhere."""
    values = [b.pressure for b in problem.boundary.values() if b.pressure is not None]
    factors = [
        value.at(time) if isinstance(value, TimeFunction) else value * problem.ramp(time) for value in values
    ]
    return float(max((problem.load * factor for factor in factors), default=0.0))
