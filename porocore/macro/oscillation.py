"""Early pressures after loading that a mesh does not resolve: diffusion time of the elements, a warning.

In a time t the fluid of a layer of about √(c_v t) leaves. As long as that is thinner than an element, the linear
pressure overshoots beside it: for a sudden load and one step of backward Euler where Δt < h²/(6 c_v) [Vermeer and
Verruijt 1981, Int. J. Numer. Anal. Methods Geomech. 5, 1–14]. Shorter steps make it worse; a ramp that lasts longer
avoids it.

Of a step without any diffusion, ∫ N_i p dX = ∫ N_i p₀ dX remains at the nodes i without a prescribed pressure. Beside a
drained plane of hexahedra p/p₀ is 1 + (2 − √3) = 1.27, beside an edge and a corner of drained planes its square and
cube, beside a plane of tetrahedra 1.5 to 1.7.
"""

from __future__ import annotations

import numpy as np

from porocore.core.formulas.time_function import TimeFunction
from porocore.core.units.results import spoken
from porocore.interfaces.solution import MacroSolution
from porocore.macro.body.mesh import BodyMesh
from porocore.macro.body.surfaces import Facets
from porocore.macro.composition.linearised_law import RestCoefficients
from porocore.macro.laws.linear import LinearCoefficients
from porocore.macro.problem import MacroProblem, MacroSetup, body_mesh
from porocore.states import Array

#: Two times or pressures that differ by less than this share are one.
SAME = 1e-9


def diffusion_time(macro: MacroSetup, coefficients: LinearCoefficients | RestCoefficients) -> float:
    """Return the largest h²/(6 c_v) of the elements at surfaces with a prescribed pressure; 0 where there are none.

    h is the height of an element above its facet and c_v that of confined compression along the normal, at rest. The
    coefficients are those of one cell, or of the elements of the body.
    """
    mesh, largest = body_mesh(macro), 0.0
    by_element = RestCoefficients.of_elements(coefficients, len(mesh.cells))
    share = 1.0 if mesh.element.shape == "hexahedron" else 3.0
    for name, boundary in macro.boundary.items():
        if boundary.pressure is None:
            continue
        facets = Facets(mesh, mesh.surface(name, f"macro.boundary.{name}"))
        if not len(facets.nodes):
            continue
        normals = (facets.normals * mesh.element.facet.weights[:, None]).sum(axis=1)
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
    from scipy.sparse import coo_array, diags_array
    from scipy.sparse.linalg import cg

    mesh = body_mesh(problem)
    shapes = mesh.element.corner_values(mesh.element.points)
    local = np.einsum("eq,qa,qb->eab", mesh.weights, shapes, shapes, optimize=True)
    corners, size = mesh.element.corners, len(mesh.p_nodes)
    rows, columns = np.repeat(mesh.p_cells, corners, axis=1), np.tile(mesh.p_cells, (1, corners))
    mass = coo_array((local.ravel(), (rows.ravel(), columns.ravel())), shape=(size, size)).tocsr()
    free = np.flatnonzero(~_drained(mesh, problem))
    if not len(free):
        return 0.0
    inner = mass[free][:, free]
    # Scaled by its diagonal its condition is that of an element, so that a few iterations serve.
    pressure, _ = cg(
        inner, mass.sum(axis=1)[free], rtol=1e-6, maxiter=200, M=diags_array(1 / inner.diagonal())
    )
    return float(pressure.max() - 1)


def _drained(mesh: BodyMesh, problem: MacroProblem) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """(p_nodes,) True where a pressure is prescribed."""
    found = np.zeros(len(mesh.p_nodes), dtype=bool)
    for name, boundary in problem.boundary.items():
        if boundary.pressure is not None:
            facets = mesh.surface(name, f"macro.boundary.{name}")[:, : mesh.element.facet_corners]
            found[np.searchsorted(mesh.p_nodes, np.unique(facets))] = True
    return found


def unresolved(problem: MacroProblem, limit: float, solution: MacroSolution) -> str | None:
    """Return a warning where the largest pressure comes sooner after loading began than ``limit``, else None.

    ``limit`` is that of :func:`diffusion_time`.
    """
    history = solution.history
    at = int(history.pressure_max.argmax())
    time, largest = float(history.time[at]), float(history.pressure_max[at])
    elapsed = time - _begin(problem, time)
    if at == 0 or elapsed >= limit * (1 - SAME) or largest <= _prescribed(problem, time) * (1 + SAME):
        return None
    load = f"{solution.load:g}".replace("-", "−")

    def said(duration: float) -> str:
        return spoken().text(duration, "time", 2)

    return (
        f"Load {load}, law {solution.law}: the largest pressure comes {said(elapsed)} after the start of the loading "
        f"and may be too large, by up to {100 * overshoot(problem):.0f} % on this mesh. The elements at the drained "
        f"surfaces do not resolve the pressure before h²/(6 c_v) = {said(limit)}. Take thinner elements there "
        "(grading), a longer ramp, or a longer first step."
    )


def _begin(problem: MacroProblem, time: float) -> float:
    """Return when the loading at ``time`` began: the last kink before it ahead of which all loads were constant."""
    functions = [function for boundary in problem.boundary.values() for function in boundary.time_functions]

    def loads(t: float) -> list[float]:
        return [problem.ramp(t), *(function.at(t) for function in functions)]

    plan = problem.time
    ramp = () if plan.load_curve else (plan.ramp_increments * plan.ramp_step,)
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
