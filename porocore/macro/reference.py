"""Undeformed cell (CellReference) and its file; early pressures that a mesh does not resolve.

In a time t the fluid of a layer of about √(c_v t) leaves. As long as that is thinner than an element, the linear
pressure overshoots beside it: for a sudden load and one step of backward Euler where Δt < h²/(6 c_v) [Vermeer and
Verruijt 1981, Int. J. Numer. Anal. Methods Geomech. 5, 1–14]. Shorter steps make it worse; a ramp that lasts longer
avoids it.

Of a step without any diffusion, ∫ N_i p dX = ∫ N_i p₀ dX remains at the nodes i without a prescribed pressure. Beside a
drained plane of hexahedra p/p₀ is 1 + (2 − √3) = 1.27, beside an edge and a corner of drained planes its square and
cube, beside a plane of tetrahedra 1.5 to 1.7.

After ramps of columns that last r h²/(6 c_v), what is left of that at the largest pressure stays below e^{−r} of it on
hexahedra and e^{−0.65 r} on tetrahedra, which lack the symmetry along the plane (see :data:`DECAY`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from porocore.cell.cell import Cell
from porocore.cell.materials.hyperelastic import Solid
from porocore.cell.meshing.mesh import Domain
from porocore.core.files.plain_data import write_json
from porocore.core.files.reading import complete, read_json
from porocore.core.formulas import TimeFunction
from porocore.core.units import spoken
from porocore.errors import ConfigurationError, DataError, SolveError
from porocore.interfaces.cell import CellSolver
from porocore.interfaces.solution import MacroSolution
from porocore.macro.body.mesh import BodyMesh, Facets
from porocore.macro.laws.closure import Closure, ConductivityLaw, PulledBack, make_closure
from porocore.macro.laws.linear import EffectiveProperties, LinearCoefficients, RestCoefficients
from porocore.macro.problem import MacroProblem, MacroSetup, body_mesh
from porocore.plugins.border import conductivity_of, solution_of
from porocore.states import Array, CellResponse, CellTangent, MacroState, Status

FORMAT, VERSION = "porocore-reference", 1
#: Averages of the response in the file.
AVERAGES = ("mean_grad", "potential", "stress", "fluid_volume")
#: Responses besides, of a cell whose pores the swelling of its solid has deformed.
OF_SWOLLEN_PORES = ("conductivity", "min_fluid_jacobian")


@dataclass(frozen=True, eq=False)
class CellReference:
    """Response at H = 0, p = 0 with its tangent (one row), conductivity and phase fractions.

    A solid that swells is held there, and has a stress.

    Attributes
    ----------
    identity
        Hash of the cell and of the backend's settings.
    response
        One row; its tangent holds M and Q of the linear limit.
    conductivity : (3, 3)
        K with the cell's viscosity.
    mesh
        Facts on the meshes, name to text.
    before_swelling
        φ_f of the cell before its solid swells; None: it does not, and φ_f is the fluid volume of the response.
    """

    identity: str
    response: CellResponse
    conductivity: Array
    mesh: dict[str, str]
    before_swelling: float | None = None

    @property
    def porosity(self) -> float:
        """φ_f of the mesh that the responses belong to."""
        if self.before_swelling is not None:
            return self.before_swelling
        assert self.response.fluid_volume is not None
        return float(self.response.fluid_volume[0])

    @property
    def solid_fraction(self) -> float:
        """φ_s = 1 − φ_f."""
        return 1 - self.porosity

    def resting(self, law: ConductivityLaw) -> CellResponse:
        """Return the response, with its conductivity where the law is that of the deformed pore."""
        if law != "deformed" or self.before_swelling is not None:  # which holds that of its own pores
            return self.response
        return replace(self.response, conductivity=self.conductivity[None], min_fluid_jacobian=np.ones(1))

    def conductivity_at_rest(self, law: ConductivityLaw) -> Array:
        """Return the conductivity (3, 3) of the flux at H = 0: K, or K_ref of pores that a swelling has deformed."""
        if self.before_swelling is None:
            return self.conductivity
        rest = self.resting(law)
        deformed = rest.conductivity if law == "deformed" else None
        still, K = np.zeros((1, 3)), self.conductivity
        found = PulledBack.from_states(
            MacroState.zeros(1), rest.mean_grad, still, self.solid_fraction, K, law, deformed
        )
        return np.asarray(found.conductivity[0])

    def coefficients(self, cell: Cell, law: ConductivityLaw, *, pores: bool = True) -> LinearCoefficients:
        """Return linear poroelasticity of ``cell``, whose reference it is; without ``pores`` it need have none.

        Raises
        ------
        ConfigurationError
            The cell takes up no fluid under pressure.
        ValueError
            The cell solver provides no derivatives.
        """
        solid = (cell.unstressed if cell.is_family else cell).solid
        K = self.conductivity_at_rest(law)
        return LinearCoefficients.from_reference(self.response, self.solid_fraction, solid, K, pores=pores)

    def properties(self, cell: Cell, law: ConductivityLaw) -> EffectiveProperties:
        """Return the effective properties of ``cell``, whose reference it is; see :meth:`coefficients`."""
        found = self.coefficients(cell, law, pores=cell.geometry.porosity > 0)
        return EffectiveProperties.of(found, self.porosity, cell.viscosity)

    def closure(self, name: str, material: Solid, law: ConductivityLaw) -> Closure:
        """Return the closure of that name with the constants of this cell."""
        return make_closure(name, self.solid_fraction, material, self.conductivity, law=law)

    @classmethod
    def compute(cls, solver: CellSolver, prepared: Any, cell: Cell, identity: str) -> CellReference:
        """Solve both cell problems at rest.

        Raises
        ------
        ConfigurationError
            The cell has no pores, its solid is not connected across the periodic cell, or it swells so much that it
            cannot be held.
        SolveError
            The undeformed cell has no solution, which a mesh or backend fault must cause.
        """
        cell.require_pores()
        response = solution_of(solver, prepared, MacroState.zeros(1)).response
        require_solved(response, cell)
        # Of a cell that has an eighth it is told whether the states are solved there or not.
        part: Domain = "whole" if cell.geometry.unfolding == "whole" else "eighth"
        solid, fluid = cell.make_mesh("solid", part), cell.make_mesh("fluid", part)
        mesh = {
            "element": cell.mesh.element,
            f"solid tetrahedra in the {part}": f"{len(solid.cells):,}",
            f"solid nodes in the {part}": f"{len(solid.points):,}",
            f"fluid tetrahedra in the {part}": f"{len(fluid.cells):,}",
            "solid mesh hash": solid.hash,
            "fluid mesh hash": fluid.hash,
        }
        before = porosity_before_swelling(solver, cell) if cell.solid.swells else None
        return cls(identity, response, conductivity_of(solver, prepared), mesh, before)

    def save(self, path: Path) -> None:
        """Write one JSON file, atomically."""
        response = self.response
        assert response.tangent is not None
        document = {
            "format": FORMAT,
            "version": VERSION,
            "identity": self.identity,
            "conductivity": self.conductivity.tolist(),
            "mesh": self.mesh,
            **{name: _listed(getattr(response, name)) for name in AVERAGES},
            **self._swollen(),
            "tangent": {
                name: value.tolist() for name, value in vars(response.tangent).items() if value is not None
            },
        }
        write_json(path, document, indent=1)

    def _swollen(self) -> dict[str, Any]:
        """Return what only the file of a cell whose solid swells holds."""
        if self.before_swelling is None:
            return {}
        names = [name for name in OF_SWOLLEN_PORES if getattr(self.response, name) is not None]
        pores = {name: _listed(getattr(self.response, name)) for name in names}
        return {"before_swelling": self.before_swelling, "pores": pores}

    @classmethod
    def load(cls, path: Path, identity: str) -> CellReference:
        """Read what :meth:`save` wrote.

        Raises
        ------
        DataError
            The file is damaged or belongs to another cell.
        """
        again = "run porocore sample on the folder again"
        with complete(path, "cell reference", again):
            document = read_json(path)
            if (document["format"], document["version"]) != (FORMAT, VERSION):
                raise DataError(f"{path}: expected {FORMAT} version {VERSION}; move it elsewhere and {again}")
            if document["identity"] != identity:
                raise DataError(
                    f"{path}: belongs to another cell ({document['identity']}); move it elsewhere and {again}"
                )
            arrays = {name: _array(document[name]) for name in AVERAGES}
            arrays |= {name: _array(document.get("pores", {}).get(name)) for name in OF_SWOLLEN_PORES}
            before = document.get("before_swelling")
            response = CellResponse(
                status=np.array([Status.converged], dtype=np.int64),
                tangent=CellTangent(**{name: _array(value) for name, value in document["tangent"].items()}),
                **arrays,
            )
            K = np.array(document["conductivity"])
            return cls(identity, response, K, document["mesh"], None if before is None else float(before))


def porosity_before_swelling(solver: CellSolver, cell: Cell) -> float:
    """Return φ_f of a cell before its solid swells, as the solver's own mesh has it."""
    dry = cell.before_swelling
    response = solution_of(solver, solver.prepare(dry), MacroState.zeros(1), tangent=False).response
    require_solved(response, dry)
    assert response.fluid_volume is not None
    return float(response.fluid_volume[0])


#: Poisson's ratio above which a solid that cannot be solved at rest fails most likely for it.
NEARLY_INCOMPRESSIBLE = 0.499


def porosity_at_rest(solver: CellSolver, prepared: Any, cell: Cell) -> float:
    """Return φ_f of the undeformed cell, before its solid swells: of the mesh that the responses belong to.

    A solid that is not connected cannot be solved; then, and where the solver gives no fluid volume, it is that of the
    core's mesh.
    """
    if cell.disconnected:
        return cell.mesh_porosity
    if cell.solid.swells:
        return porosity_before_swelling(solver, cell)
    found = solution_of(solver, prepared, MacroState.zeros(1), tangent=False).response.fluid_volume
    return cell.mesh_porosity if found is None else float(found[0])


def require_solved(response: CellResponse, cell: Cell) -> None:
    """Refuse an undeformed cell that could not be solved, with what to change.

    Raises
    ------
    ConfigurationError
        Its solid swells too much, or is nearly incompressible.
    SolveError
        Anything else.
    """
    if response.status[0] == Status.converged:
        return
    name = Status(response.status[0]).name
    if cell.solid.swells:
        raise ConfigurationError(
            f"cell: held at H = 0 while its solid swells, the cell ended with status '{name}'; let it swell less "
            "(swelling)"
        )
    ratio = getattr(cell.solid, "poisson_ratio", None)
    if ratio is not None and ratio > NEARLY_INCOMPRESSIBLE:
        raise ConfigurationError(
            f"cell.material.poisson_ratio: the undeformed cell ended with status '{name}'; {ratio:g} is that of a "
            f"nearly incompressible solid, which cannot be solved here; give one up to {NEARLY_INCOMPRESSIBLE:g}"
        )
    raise SolveError(
        f"the undeformed cell ended with status '{name}'; "
        "refine the mesh (cell.mesh.size) or try another backend (--fem)"
    )


def _listed(array: Array | None) -> Any:
    return None if array is None else array.tolist()


def _array(value: Any) -> Any:
    return None if value is None else np.array(value, dtype=float)


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


#: Least rate at which the overshoot decays, per h²/(6 c_v) since the loading began, measured for r of 0.5 to 8.
DECAY = {"hexahedron": 1.0, "tetrahedron": 0.65}
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
    shape = body_mesh(problem).element.shape
    if at == 1 and shape == "hexahedron" and elapsed >= limit * (1 - SAME):
        return None  # One step of backward Euler on hexahedra does not overshoot from there on.
    faded = float(np.exp(-DECAY[shape] * elapsed / limit))
    # No mesh overshoots by more than the corner of three drained planes of tetrahedra, 1.7³ − 1 = 3.9.
    if 4 * faded <= TOLD:
        return None
    most = overshoot(problem) * faded
    if most <= TOLD:
        return None
    load = f"{solution.load:g}".replace("-", "−")

    def said(duration: float) -> str:
        return spoken().text(duration, "time", 2)

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
