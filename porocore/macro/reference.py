"""Undeformed cell (CellReference) and its file."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from porocore.cell.cell import Cell
from porocore.cell.materials.hyperelastic import Solid
from porocore.cell.meshing.mesh import Domain
from porocore.core.fields import provided
from porocore.core.files.plain_data import write_json
from porocore.core.files.reading import complete, read_json
from porocore.errors import ConfigurationError, DataError, SolveError
from porocore.interfaces.cell import CellSolver
from porocore.macro.laws.closure import Closure, ConductivityLaw, PulledBack, make_closure
from porocore.macro.laws.linear import EffectiveProperties, LinearCoefficients
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
        return float(provided(self.response.fluid_volume)[0])

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
        # Of a cell that has an eighth the line says whether the states are solved there or not.
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
        document = {
            "format": FORMAT,
            "version": VERSION,
            "identity": self.identity,
            "conductivity": self.conductivity.tolist(),
            "mesh": self.mesh,
            **{name: _listed(getattr(response, name)) for name in AVERAGES},
            **self._swollen(),
            "tangent": {
                name: value.tolist()
                for name, value in vars(provided(response.tangent)).items()
                if value is not None
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
    return float(provided(response.fluid_volume)[0])


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
