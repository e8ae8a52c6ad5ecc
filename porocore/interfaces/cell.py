"""Interface of a cell solver: prepare, solve, conductivity; the cells of a body's elements (ElementCells)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Literal

import numpy as np
from typing_extensions import TypeVar

from porocore.core.fields import provided
from porocore.core.hdf5 import Contents
from porocore.states import Array, CellResponse, IntArray, MacroState

if TYPE_CHECKING:
    from porocore.cell.cell import Cell
    from porocore.cell.materials.prony import Relaxation


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

    The checks that an implementation obeys are tested by ``porocore.testing.CellSolverSuite``:
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
    #: Whether :meth:`relax` follows a cell whose solid relaxes.
    relaxes: ClassVar[bool] = False
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

    def relax(
        self,
        prepared: Prepared,
        path: MacroState,
        times: Array,
        relaxation: Relaxation,
        *,
        fields: bool = False,
    ) -> CellSolution:
        """Follow a path of the cell whose solid relaxes, with the history of each of its points.

        The solid has stood at the first state for long. Between two times its stress of equilibrium changes at a
        constant rate. A solver whose :attr:`relaxes` is false leaves it out.

        Parameters
        ----------
        prepared
            What :meth:`prepare` returned.
        path
            n states, one at each time.
        times : (n,)
            They never fall; two that are equal are a sudden change.
        relaxation
            Overstress of the solid, the same in all its regions; that of the cell itself is not looked at.
        fields
            Whether the micro displacement is wanted.

        Returns
        -------
        CellSolution
            Stress, <∇u¹>_s, fluid volume, status and extrema at each time; a status of instability is that of the
            step, whose energy the extrema have too. There is no potential, since the stress depends on the past, nor
            derivatives or a conductivity. All rows behind one without values have its status.

        Raises
        ------
        ConfigurationError
            There is no state, or not one time for each, or the times fall.
        """
        raise NotImplementedError(f"{type(self).__name__} solves no cell whose solid relaxes")

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


#: Group of a file that holds them.
GROUP = "element_cells"


@dataclass(frozen=True, eq=False)
class ElementCells:
    """Regions, parameters and material axes of a body's elements, means over each element.

    What does not change with time is there once, else once for each profile of the solution.

    Attributes
    ----------
    region : (elements,)
        Number of the region: 0 is the rest of the body, the others count from 1 in the order of ``regions``.
    regions
        Names of the regions.
    parameters
        Names of the cell's parameters.
    values : (1 or profiles, elements, m)
        Values of the m parameters; NaN where the cell of a region has not one.
    axes : (1 or profiles, elements, 3, 3)
        Rotations whose columns are the material axes; None where they are those of the body.

    Examples
    --------
    >>> import numpy as np
    >>> from porocore import ElementCells
    >>> cells = ElementCells(np.array([0, 1]), ("top",), ("radius",), np.array([[[0.2], [0.25]]]))
    >>> cells.field("radius", 3)
    array([0.2 , 0.25])
    """

    region: IntArray
    regions: tuple[str, ...] = ()
    parameters: tuple[str, ...] = ()
    values: Array | None = None
    axes: Array | None = None

    @property
    def varies(self) -> bool:
        """True if anything changes with time."""
        return any(array is not None and len(array) > 1 for array in (self.values, self.axes))

    def field(self, name: str, profile: int) -> Array:
        """Return the values (elements,) of a parameter at the time of a profile, by its place among them."""
        return np.asarray(provided(self.values_at(profile))[:, self.parameters.index(name)])

    def values_at(self, profile: int) -> Array | None:
        """Return the values (elements, parameters) at the time of a profile; None without parameters."""
        return None if self.values is None else _at(self.values, profile)

    def axes_at(self, profile: int) -> Array | None:
        """Return the material axes (elements, 3, 3) at the time of a profile."""
        return None if self.axes is None else _at(self.axes, profile)

    def given_to(self, states: MacroState, profile: int, elements: Any = slice(None)) -> MacroState:
        """Return n states of a profile as their cells see them: in the material axes, with their parameters.

        Parameters
        ----------
        states
            States in the axes of the body.
        profile
            Number of the profile.
        elements
            Element of each state (n,); by default there is one state for each element.
        """
        H, theta = states.grad_u, None
        if self.axes is not None:
            R = _at(self.axes, profile)[elements]
            H = R.swapaxes(1, 2) @ H @ R
        if self.values is not None:
            theta = _at(self.values, profile)[elements]
        return replace(states, grad_u=H, parameters=theta)

    def evolved(self, name: str, values: Array) -> ElementCells:
        """Return the cells with other values (profiles, elements) of a parameter, where the cells have it."""
        before = provided(self.values)
        found = np.broadcast_to(before, (len(values), *before.shape[1:])).copy()
        k = self.parameters.index(name)
        found[..., k] = np.where(np.isnan(found[..., k]), np.nan, values)
        return replace(self, values=found)

    def of_elements(self, elements: IntArray, parameters: Sequence[str]) -> ElementCells:
        """Return the cells of some elements, with these of the parameters, in this order."""
        columns = [self.parameters.index(name) for name in parameters]
        return replace(
            self,
            region=self.region[elements],
            parameters=tuple(parameters),
            values=None if self.values is None or not columns else self.values[:, elements][:, :, columns],
            axes=None if self.axes is None else self.axes[:, elements],
        )

    def save(self, file: Any) -> None:
        """Write them into an open HDF5 file."""
        file[f"{GROUP}/region"] = self.region
        for name in ("regions", "parameters"):
            if names := getattr(self, name):
                file[f"{GROUP}/{name}"] = list(names)
        for name in ("values", "axes"):
            if (array := getattr(self, name)) is not None:
                file[f"{GROUP}/{name}"] = array

    @classmethod
    def read(cls, file: Contents) -> ElementCells | None:
        """Read what :meth:`save` wrote; None where there is nothing.

        Raises
        ------
        ValueError
            The arrays do not fit together.
        """
        there = file.members(GROUP)
        if not there:
            return None
        region = file.array(f"{GROUP}/region", "elements", kind="int")
        names = {
            name: tuple(file.texts(f"{GROUP}/{name}", name)) if name in there else ()
            for name in ("regions", "parameters")
        }
        if len(region) and not 0 <= region.min() <= region.max() <= len(names["regions"]):
            raise ValueError(f"'{GROUP}/region' names a region that is not there")
        shapes = {"values": ("elements", "parameters"), "axes": ("elements", 3, 3)}
        arrays = {
            name: file.array(f"{GROUP}/{name}", f"times of {name}", *shape, finite=False)
            for name, shape in shapes.items()
            if name in there
        }
        return cls(region, names["regions"], names["parameters"], arrays.get("values"), arrays.get("axes"))


def _at(arrays: Array, profile: int) -> Array:
    return np.asarray(arrays[profile if len(arrays) > 1 else 0])
