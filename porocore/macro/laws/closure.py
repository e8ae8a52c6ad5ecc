"""Base of closures: stress, storage and flux from the cell's responses; check of what a closure requires."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from porocore.cell.cell import Cell
from porocore.cell.materials.composite import Solid
from porocore.core.fields.batch import Batch
from porocore.errors import ConfigurationError
from porocore.interfaces.law import LawMemory, MacroResponse, MacroTangent, UndeformedCells, fingerprint
from porocore.interfaces.law_changes import MemoryChanges, ResponseChanges, add_scaled
from porocore.macro.laws.cell_changes import CellChanges
from porocore.macro.laws.pull_back import CONDUCTIVITY_LAWS, ConductivityLaw, PulledBack, at_points
from porocore.states import Array, CellResponse, MacroState


@dataclass(frozen=True, eq=False)
class ClosurePoints(Batch):
    """Data of n points, of which a closure makes their response.

    Attributes
    ----------
    states
        (H, p; θ).
    cell
        Responses of the cell in these states.
    grad_p : (n, 3)
        ∇_X p.
    memory
        State of the law at the last accepted time.
    cells
        Undeformed cell of each point; None: that of the closure's constants.
    cells_before
        The same at the time of the memory, where it was another one.
    """

    states: MacroState
    cell: CellResponse
    grad_p: Array
    memory: LawMemory
    cells: UndeformedCells | None = None
    cells_before: UndeformedCells | None = None


class Closure(ABC):
    """Closure, which gives stress, storage and flux from the responses of the cell.

    A cell with parameters has φ_s and K of its own at each point; the constants here are those of a cell without.

    Parameters
    ----------
    solid_fraction
        φ_s = 1 − φ_f of the undeformed cell.
    material
        What the solid is made of.
    conductivity : (3, 3)
        K of the undeformed cell.
    law
        Which conductivity the flux goes by, :data:`~porocore.macro.laws.pull_back.ConductivityLaw`: with ``deformed`` a
        response of the cell, otherwise K carried along.
    """

    #: What the user writes.
    name: ClassVar[str]
    #: Fields of :class:`CellResponse` that it reads.
    responses: ClassVar[tuple[str, ...]]
    #: Fields of :class:`CellTangent` that it reads.
    derivatives: ClassVar[tuple[str, ...]]

    def __init__(
        self, solid_fraction: float, material: Solid, conductivity: Array, *, law: ConductivityLaw = "piola"
    ) -> None:
        if law not in CONDUCTIVITY_LAWS:
            raise ValueError(f"expected a conductivity law of {', '.join(CONDUCTIVITY_LAWS)}, got {law!r}")
        if not 0 < solid_fraction < 1:
            raise ValueError(f"expected a solid fraction between 0 and 1, got {solid_fraction:g}")
        self.solid_fraction = solid_fraction
        self.material, self.law = material, law
        self.conductivity = np.array(conductivity, dtype=float)
        if self.conductivity.shape != (3, 3):
            raise ValueError(f"expected a conductivity (3, 3), got {self.conductivity.shape}")

    @classmethod
    def unfit(cls, cell: Cell) -> str:
        """Return why the closure does not suit the solid of a cell; empty if it does."""
        return ""

    @property
    def identity(self) -> str:
        """Hash of the closure and of its constants."""
        return fingerprint(
            self.name, self.solid_fraction, self.material.identity, self.conductivity, self.law
        )

    def solid_fraction_of(self, cells: UndeformedCells | None) -> float | Array:
        """Return φ_s of each point's cell (n,), or the constant."""
        return self.solid_fraction if cells is None else 1 - cells.porosity

    def pull_back(
        self, states: MacroState, cell: CellResponse, grad_p: Array, cells: UndeformedCells | None = None
    ) -> PulledBack:
        """Return kinematics and flux at n points."""
        return PulledBack.from_states(
            states,
            cell.mean_grad,
            grad_p,
            self.solid_fraction_of(cells),
            self.conductivity if cells is None else cells.conductivity,
            self.law,
            cell.conductivity,
        )

    @abstractmethod
    def respond(self, at: ClosurePoints, *, tangent: bool) -> MacroResponse:
        """Return the response at n points; see :class:`MacroLaw`."""

    def deformation_changes(
        self, cell: CellResponse, by: CellChanges, cells: UndeformedCells | None = None
    ) -> Array:
        """Return the changes (n, 3, 3, k) of F̄ = I + H + <∇u¹>_s/φ_s at fixed H."""
        share, n = at_points(self.solid_fraction_of(cells), 2), len(cell)
        found: Array = by.mean_grad / at_points(self.solid_fraction_of(cells), 3)
        add_scaled(found.reshape(n, 9, -1), (cell.mean_grad / share**2).reshape(n, 9), by.porosity)
        return found

    @abstractmethod
    def respond_to_changes(
        self, at: ClosurePoints, by: CellChanges, before: MemoryChanges
    ) -> tuple[MacroResponse, ResponseChanges]:
        """Return the response with its tangent, and its derivatives at fixed (H, p, ∇p) by k unknowns.

        Parameters
        ----------
        at
            The points, whose responses of the cell have a tangent.
        by
            Changes of the cell's responses.
        before
            Derivatives of the memory.
        """

    def _response(
        self, at: ClosurePoints, pore: PulledBack, stress: Array, storage: Array, tangent: MacroTangent | None
    ) -> MacroResponse:
        """Return stress and storage with all that a closure takes from the pulled-back pore and the cell."""
        outside = at.cell.outside_training_range
        return MacroResponse(
            stress=stress,
            storage=storage,
            flux=pore.flux,
            memory=self.memory(at.states, at.cell, at.memory.fluid_volume + storage),
            deformation=pore.F,
            volume_ratio=pore.J,
            transformed_conductivity=pore.transformed,
            outside_training_range=np.zeros(len(at.states), bool) if outside is None else outside,
            tangent=tangent,
        )

    def memory(self, states: MacroState, cell: CellResponse, summed: Array) -> LawMemory:
        """Return the memory that the next step begins from.

        Parameters
        ----------
        summed : (n,)
            φ_f of the undeformed cell and the storage of all steps, which is φ unless a closure has one of the state.
        """
        return LawMemory(states, cell.mean_grad, summed)

    def check(self, cell: CellResponse, law: str) -> None:
        """Refuse a cell law whose prediction lacks what this closure reads.

        Raises
        ------
        ConfigurationError
            A response or a derivative is missing.
        """
        if self.law == "deformed" and cell.conductivity is None:
            raise ConfigurationError(
                f"conductivity: 'deformed' needs the conductivity of the deformed pore, but {law} does not provide it; "
                "choose conductivity: piola, or another surrogate"
            )
        missing = [name for name in self.responses if getattr(cell, name) is None]
        missing += [
            f"tangent.{name}" for name in self.derivatives if getattr(cell.tangent, name, None) is None
        ]
        if missing:
            raise ConfigurationError(
                f"closure '{self.name}' needs {', '.join(self.responses + self.derivatives)} of the cell, "
                f"but {law} does not provide {', '.join(missing)}; choose another closure or surrogate"
            )
