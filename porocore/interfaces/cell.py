"""Interface of a cell solver: prepare, solve, conductivity; fields and solutions that it returns."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Literal

import numpy as np
from typing_extensions import TypeVar

from porocore.states import Array, CellResponse, MacroState

if TYPE_CHECKING:
    from porocore.cell.cell import Cell


#: Type of what a solver prepares for one cell or macro problem.
Prepared = TypeVar("Prepared", default=Any)


@dataclass(frozen=True, eq=False)
class CellField:
    """The micro displacement of one solved state, to look at or to start a neighbour from.

    Attributes
    ----------
    grad_u : (3, 3)
        H of the state that it solves.
    p : float
        Its pore pressure.
    domain : {"eighth", "whole"}
        The part of the cell on which it is known.
    u : (nodes, 3)
        u¹ at the nodes of that domain's solid mesh, in the order of ``CellMesh.points``.
    """

    grad_u: Array
    p: float
    domain: str
    u: Array

    def perturbed(self, mode: Array, amplitude: float) -> CellField:
        """Return a start displaced along a mode (nodes, 3), which is scaled to a largest component ``amplitude``.

        Where the energy falls along the mode, a solve from here under the same load ends in the buckled state.
        """
        return replace(self, u=self.u + amplitude / float(np.abs(mode).max()) * mode)


@dataclass(frozen=True, eq=False)
class CellSolution:
    """The responses of a batch and, where asked for, the field of each row (None where it failed)."""

    response: CellResponse
    fields: list[CellField | None] | None = None


class CellSolver(ABC, Generic[Prepared]):
    """Solves the fluid and the solid cell problem; set-up is apart from the repeated solves.

    The laws that an implementation obeys are tested by ``porocore.testing.CellSolverSuite``:
    the derivatives are the slopes of the responses, ∂P_E/∂p = −∂φ/∂H, W is objective, and a state that
    cannot be solved is a row with a status and NaN while the others are returned.

    What a solver offers beyond or short of the ordinary is declared by the attributes of its class; a study that needs
    more is refused before anything is solved, and the suite skips what is not offered.
    """

    #: Conductivities that it computes: ``piola`` is K of the undeformed cell by :meth:`conductivity`; ``deformed`` is
    #: K_ref of the deformed pore, for which :meth:`prepare` takes ``deformed=True``. Empty: none.
    conductivities: ClassVar[tuple[Literal["piola", "deformed"], ...]] = ("piola",)
    #: Whether it holds the pore wall against itself as ``cell.contact`` says. Without, a state whose wall passes
    #: through itself has the status ``overlap``.
    contact: ClassVar[bool] = False
    #: Whether :meth:`solve` returns the micro displacement where ``fields`` are asked for.
    returns_fields: ClassVar[bool] = False
    #: Whether responses of a cell with parameters hold :class:`~porocore.CellSlopes`, the derivatives by them, and
    #: :meth:`hessian_slopes_at_rest` gives those of the undeformed cell.
    slopes: ClassVar[bool] = False
    #: ``core``: it solves on ``cell.make_mesh``, so that it agrees with others on that mesh to round-off; ``own``: on
    #: another mesh, or without any.
    meshes: ClassVar[Literal["core", "own"]] = "own"
    #: Largest relative difference from the exact responses and conductivity of a cell, at the mesh that is asked for;
    #: None: an estimate, which is held to no exact value.
    accuracy: ClassVar[float | None] = 1e-2

    def __init__(self, **options: Any) -> None:
        if options:
            raise TypeError(f"{type(self).__name__} takes no options, got {sorted(options)}")

    @abstractmethod
    def prepare(self, cell: Cell) -> Prepared:
        """Return what the states of one cell share (meshes, operators, sparsity, factors).

        A solver whose :attr:`conductivities` hold ``deformed`` takes a further keyword ``deformed``; if that is true,
        every response holds ``conductivity`` and ``min_fluid_jacobian``.
        """

    @abstractmethod
    def solve(
        self,
        prepared: Prepared,
        states: MacroState,
        *,
        start: Sequence[CellField | None] | None = None,
        tangent: bool = True,
        fields: bool = False,
    ) -> CellSolution:
        """Solve the solid cell problem for each state.

        Parameters
        ----------
        prepared
            What :meth:`prepare` returned.
        states
            n states.
        start
            For each state the field of a known neighbour; None starts from the undeformed cell. A start
            changes the cost and, where the cell has several equilibria, which of them is found.
        tangent
            Whether the ten derivatives are wanted.
        fields
            Whether the micro displacement is wanted.
        """

    def conductivity(self, prepared: Prepared) -> Array:
        """Return the hydraulic conductivity K (3, 3) of the undeformed cell, <w^j_i>_f with the cell's viscosity.

        A solver whose :attr:`conductivities` are empty leaves it out.
        """
        raise NotImplementedError(f"{type(self).__name__} computes no conductivity")

    def hessian_slopes_at_rest(self, prepared: Prepared) -> Array:
        """Return the slopes (10, 10, m) of the Hessian of W of the undeformed cell by its m parameters.

        They are those of :attr:`~porocore.CellTangent.hessian`, or NaN for a cell that has a stress at rest by any of
        its parameters. A solver whose :attr:`slopes` are false leaves it out.
        """
        raise NotImplementedError(f"{type(self).__name__} computes no slopes by parameters")

    def remark(self, prepared: Prepared) -> str:
        """Return a line for the log on how the linear systems were solved so far; empty where there is none."""
        return ""

    def solve_one(self, prepared: Prepared, grad_u: Any, p: float = 0.0, **how: Any) -> CellResponse:
        """Solve one state; a convenience around :meth:`solve`."""
        state = MacroState(np.asarray(grad_u, float).reshape(1, 3, 3), np.array([float(p)]))
        return self.solve(prepared, state, **how).response
