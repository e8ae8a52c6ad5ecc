"""Macroscopic states (H, p; θ), responses of the cell (CellResponse, tangent, slopes, extrema), status codes.

Every array is float64 and is led by the batch axis of length n. Derivatives carry the indices of the
response first and those of the variable last. Everything is dimensionless: stresses,
pressures and energies are in units of the reference modulus E (Young's modulus of a neo-Hookean solid).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import IntEnum, IntFlag
from functools import partial
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from porocore.core.fields import Batch, declared_fields, documented, row, rows_of

Array: TypeAlias = npt.NDArray[np.float64]
IntArray: TypeAlias = npt.NDArray[np.int64]
BoolArray: TypeAlias = npt.NDArray[np.bool_]


class Status(IntEnum):
    """Outcome of a cell solve.

    ``unstable`` keeps its values (the residual is met, the tangent is indefinite), and so does ``contact``; the
    others hold NaN.

    Examples
    --------
    >>> from porocore import Status
    >>> [status.name for status in Status if status.has_values and not status.stable]
    ['unstable']
    """

    converged = 0
    #: Residual met, but the tangent has negative pivots: an equilibrium that the cell would leave.
    unstable = 1
    #: A pore wall has passed through its mirror plane or another wall, or no fluid volume is left (J > 0 all the same).
    overlap = 2
    #: No load step, however small, keeps J > 0.
    inverted = 3
    #: The iteration or step limit was reached.
    not_converged = 4
    #: In equilibrium and stable, with the pore wall pressed against itself somewhere.
    contact = 5
    #: Nothing came back: the worker died, or was ended when the time for a state was over, twice.
    lost = 6

    @property
    def has_values(self) -> bool:
        """True where the responses of such a state are numbers."""
        return self in (Status.converged, Status.unstable, Status.contact)

    @property
    def stable(self) -> bool:
        """True where the equilibrium is stable; a surrogate learns from these only."""
        return self in (Status.converged, Status.contact)


class Doubt(IntFlag):
    """Reasons not to rely on a state that was predicted; a state may have several, and 0 is none.

    Examples
    --------
    >>> from porocore import Doubt
    >>> found = Doubt(6)
    >>> Doubt.error in found, Doubt.outside in found
    (True, False)
    """

    #: Beyond the sampled states: far from all of them, or outside their hull where errors are not estimated.
    outside = 1
    #: The estimated error exceeds the tolerance.
    error = 2
    #: The cell is in an unstable equilibrium.
    unstable = 4
    #: Pore walls touch in sampled states nearby, and there is no conductivity.
    closed = 8
    #: A component moves that was not sampled.
    not_sampled = 16

    @classmethod
    def _missing_(cls, value: object) -> Any:
        # Numbers of an array are no int, which the enumeration asks for.
        return super()._missing_(int(value)) if isinstance(value, np.integer) else super()._missing_(value)

    @classmethod
    def where(cls, **reasons: npt.NDArray[np.bool_] | None) -> IntArray:
        """Return the doubts (n,) from which rows have which of them, (n,) bool each; None: no row."""
        found = [np.where(rows, int(cls[name]), 0) for name, rows in reasons.items() if rows is not None]
        total: IntArray = np.sum(found, axis=0, dtype=np.int64)
        return total


@dataclass(frozen=True, eq=False)
class BodyPlace(Batch):
    """Region, material axes and place of n points of a body.

    Attributes
    ----------
    region : (n,)
        Number of the region: 0 is the rest of the body, the others count from 1 in the order of the configuration.
    axes : (n, 3, 3)
        Rotation R whose columns are the axes of the cell in the body; None where they are those of the body.
    position : (n, 3)
        X, place in the undeformed body; None where it does not matter.
    """

    region: IntArray
    axes: Array | None = None
    position: Array | None = None


@dataclass(frozen=True, eq=False)
class MacroState(Batch):
    """A batch of macroscopic states.

    Attributes
    ----------
    grad_u : (n, 3, 3)
        H = ∇_X u⁰, H_ij = ∂u_i/∂X_j [-].
    p : (n,)
        Pore pressure, positive in compression [E].
    parameters : (n, m)
        Parameters θ of the cell, in the order of ``Cell.parameters``; None for a cell without parameters.
    place
        Region, material axes and place of the points of a body; None where they do not matter.

    Examples
    --------
    >>> from porocore import MacroState
    >>> pressed = MacroState.single(np.diag([0.0, -0.1, 0.0]), p=0.02)
    >>> states = MacroState.concatenate([MacroState.zeros(2), pressed])
    >>> len(states), states[2:].p
    (3, array([0.02]))
    >>> states.with_parameters([0.25, 0.3]).parameters.shape
    (3, 2)
    """

    grad_u: Array
    p: Array
    parameters: Array | None = None
    place: BodyPlace | None = None

    def __post_init__(self) -> None:
        if self.grad_u.ndim != 3:
            return
        n = len(self.grad_u)
        if self.grad_u.shape[1:] != (3, 3) or self.p.shape != (n,):
            raise ValueError(
                f"expected grad_u (n, 3, 3) and p (n,), got {self.grad_u.shape} and {self.p.shape}"
            )
        if self.parameters is not None and (self.parameters.ndim != 2 or len(self.parameters) != n):
            raise ValueError(f"expected parameters (n, m) with n = {n}, got {self.parameters.shape}")

    def __len__(self) -> int:
        return len(self.p)

    @classmethod
    def single(cls, grad_u: npt.ArrayLike, p: float = 0.0) -> MacroState:
        """Return one state as a batch of length 1."""
        return cls(np.asarray(grad_u, dtype=float).reshape(1, 3, 3), np.array([float(p)]))

    @classmethod
    def zeros(cls, n: int) -> MacroState:
        """Return the undeformed state, n times."""
        return cls(np.zeros((n, 3, 3)), np.zeros(n))

    @classmethod
    def concatenate(cls, parts: list[MacroState]) -> MacroState:
        """Join states end to end.

        Raises
        ------
        ValueError
            Some have parameters and others have none, or other numbers of them.
        """
        counts = sorted({state.parameter_count for state in parts})
        if len(counts) > 1:
            raise ValueError(f"expected states with the same number of parameters, got {counts}")
        return super().concatenate(parts)

    def arrays(self) -> list[Array]:
        """Return H, p and, where there are some, the parameters, to hash and to compare."""
        return [self.grad_u, self.p, *([] if self.parameters is None else [self.parameters])]

    @property
    def parameter_count(self) -> int:
        """Number m of parameters, 0 without."""
        return 0 if self.parameters is None else self.parameters.shape[-1]

    def at_rest(self) -> MacroState:
        """Return the undeformed states, with the parameters and places of these."""
        return replace(self, grad_u=np.zeros_like(self.grad_u), p=np.zeros_like(self.p))

    def in_own_axes(self) -> MacroState:
        """Return the states as their cells see them, Rᵀ H R and p, at places without axes."""
        if self.place is None or self.place.axes is None:
            return self
        R = self.place.axes
        turned = np.asarray(R.swapaxes(1, 2) @ self.grad_u @ R)
        return replace(self, grad_u=turned, place=replace(self.place, axes=None))

    def with_parameters(self, values: npt.ArrayLike | None) -> MacroState:
        """Return the states at the parameters (m,), the same for all, or (n, m); None takes them away."""
        if values is None:
            return replace(self, parameters=None)
        given = np.asarray(values, dtype=float)
        return replace(self, parameters=np.broadcast_to(given, (len(self), given.shape[-1])).copy())


_slope = partial(row, flag="tangent")
_by_parameter = partial(row, flag="slopes")


@documented
@dataclass(frozen=True, eq=False)
class CellTangent(Batch):
    """First derivatives of the responses with respect to (H, p); response indices first.

    A surrogate that does not provide a response leaves its derivatives None.
    """

    mean_grad_grad_u: Array | None = field(
        default=None, metadata=_slope("-", "M_ijkl = ∂<∂u¹_i/∂Y_j>_s / ∂H_kl", 3, 3, 3, 3)
    )
    mean_grad_p: Array | None = field(
        default=None, metadata=_slope("1/E", "Q_ij = ∂<∂u¹_i/∂Y_j>_s / ∂p", 3, 3)
    )
    stress_grad_u: Array | None = field(default=None, metadata=_slope("E", "∂P_E,ij / ∂H_kl", 3, 3, 3, 3))
    stress_p: Array | None = field(default=None, metadata=_slope("-", "∂P_E,ij / ∂p", 3, 3))
    fluid_volume_grad_u: Array | None = field(default=None, metadata=_slope("-", "∂φ / ∂H_kl", 3, 3))
    fluid_volume_p: Array | None = field(default=None, metadata=_slope("1/E", "∂φ / ∂p"))
    conductivity_grad_u: Array | None = field(
        default=None, metadata=row("d²/μ", "∂K_ref,ij / ∂H_kl", 3, 3, 3, 3, flag="surrogate")
    )
    conductivity_p: Array | None = field(
        default=None, metadata=row("d²/(μ E)", "∂K_ref,ij / ∂p", 3, 3, flag="surrogate")
    )

    @property
    def hessian(self) -> Array | None:
        """(n, 10, 10) second derivatives of W by H, row by row, and p [E]; None without those of P_E and φ."""
        C, b, storage = self.stress_grad_u, self.stress_p, self.fluid_volume_p
        if C is None or b is None or storage is None:
            return None
        n = len(storage)
        found = np.empty((n, 10, 10))
        found[:, :9, :9] = C.reshape(n, 9, 9)
        found[:, :9, 9] = found[:, 9, :9] = b.reshape(n, 9)
        found[:, 9, 9] = -storage
        return found


@documented
@dataclass(frozen=True, eq=False)
class CellSlopes(Batch):
    """First derivatives of the responses with respect to the m parameters θ of the cell, in the order of its own.

    They are taken at fixed (H, p). A solver or surrogate that does not provide one leaves it None.
    """

    potential: Array | None = field(default=None, metadata=_by_parameter("E", "∂W / ∂θ_k", "m"))
    stress: Array | None = field(default=None, metadata=_by_parameter("E", "∂P_E,ij / ∂θ_k", 3, 3, "m"))
    fluid_volume: Array | None = field(default=None, metadata=_by_parameter("-", "∂φ / ∂θ_k", "m"))
    porosity: Array | None = field(
        default=None,
        metadata=_by_parameter("-", "∂φ_f / ∂θ_k, φ_f the porosity of the undeformed cell.", "m"),
    )
    mean_grad: Array | None = field(
        default=None, metadata=_by_parameter("-", "∂<∂u¹_i/∂Y_j>_s / ∂θ_k", 3, 3, "m")
    )
    conductivity: Array | None = field(
        default=None,
        metadata=_by_parameter(
            "d²/μ",
            "∂K_ref,ij / ∂θ_k where the response has K_ref, else ∂K_ij / ∂θ_k of the undeformed cell. NaN where K_ref "
            "is.",
            3,
            3,
            "m",
            gaps=True,
        ),
    )
    hessian: Array | None = field(
        default=None,
        metadata=row(
            "E",
            "∂³W / ∂(H, p)_k ∂(H, p)_l ∂θ_m of the undeformed cell, with H row by row and p in k and l. NaN where it "
            "has a stress.",
            10,
            10,
            "m",
            flag="undeformed",
            gaps=True,
        ),
    )


@documented
@dataclass(frozen=True, eq=False)
class CellExtrema(Batch):
    """Extrema over the solid, and signs of instability and contact."""

    grad: Array = field(metadata=row("-", "Largest ``|∂u¹_i/∂Y_j|``.", 3, 3))
    energy: Array = field(metadata=row("E", "Largest Ψ."))
    energy_mean: Array = field(metadata=row("E", "<Ψ>_s."))
    min_jacobian: Array = field(metadata=row("-", "Smallest J."))
    min_gap: Array = field(
        metadata=row(
            "-",
            "Smallest relative distance of the wall to its mirror planes; NaN on the whole cell.",
            gaps=True,
        )
    )
    negative_pivots: Array = field(
        metadata=row("-", "Negative pivots of the tangent at the solution; -1 where the solver cannot tell.")
    )
    contact_share: Array = field(metadata=row("-", "Share of the undeformed pore wall that is in contact."))


@documented
@dataclass(frozen=True, eq=False)
class CellResponse(Batch):
    """Responses of n states, solved or predicted; a response that is not provided is None.

    Rows whose status has no values hold NaN in every response, derivative and extremum. ``conductivity`` and
    ``min_fluid_jacobian`` are there with the conductivity law ``deformed`` only.

    Examples
    --------
    >>> from porocore import CellResponse, Status, failed_response
    >>> solved = CellResponse(mean_grad=np.zeros((1, 3, 3)), status=np.array([Status.converged]))
    >>> failed = CellResponse(mean_grad=np.full((1, 3, 3), np.nan), status=np.array([Status.inverted]))
    >>> CellResponse.concatenate([solved, failed]).valid
    array([ True, False])
    """

    mean_grad: Array = field(
        metadata=row(
            "-",
            "<∇_Y u¹>_s, an integral over the solid divided by the volume of the whole cell.",
            3,
            3,
            models=("mlp", "potential"),
        )
    )
    status: IntArray = field(
        metadata=row("-", ":class:`Status` of each row.", models=("mlp", "potential"), dtype=np.int64)
    )
    potential: Array | None = field(
        default=None, metadata=row("E", "W(H, p) = <Ψ + pJ>_s − p J₀.", models=("potential",))
    )
    stress: Array | None = field(
        default=None,
        metadata=row(
            "E",
            "Total first Piola–Kirchhoff stress P_E = ∂W/∂H, tension positive.",
            3,
            3,
            models=("potential",),
        ),
    )
    fluid_volume: Array | None = field(
        default=None,
        metadata=row(
            "-", "φ = −∂W/∂p, current fluid volume per reference volume of the cell.", models=("potential",)
        ),
    )
    tangent: CellTangent | None = field(default=None, metadata=rows_of(CellTangent))
    extrema: CellExtrema | None = field(default=None, metadata=rows_of(CellExtrema, name="peaks"))
    doubt: IntArray | None = field(
        default=None,
        metadata=row(
            "-",
            "Reasons not to rely on the row, :class:`Doubt` as a number; 0: none.",
            flag="surrogate",
            dtype=np.int64,
        ),
    )
    conductivity: Array | None = field(
        default=None,
        metadata=row(
            "d²/μ",
            "K_ref of the deformed pore, symmetric: the flux through reference area is −K_ref ∇_X p. NaN where "
            "the fluid's mesh cannot follow the wall, as where walls touch, whatever the status.",
            3,
            3,
            flag="deformed",
            gaps=True,
        ),
    )
    min_fluid_jacobian: Array | None = field(
        default=None,
        metadata=row(
            "-",
            "Smallest J of the fluid's mesh; conductivity has values where it is positive.",
            flag="deformed",
            gaps=True,
        ),
    )
    slopes: CellSlopes | None = field(default=None, metadata=rows_of(CellSlopes))

    def __len__(self) -> int:
        return len(self.status)

    @property
    def flagged(self) -> npt.NDArray[np.bool_]:
        """Rows that are not to be relied on, for whatever reason, (n,) bool."""
        return np.zeros(len(self), bool) if self.doubt is None else self.doubt != 0

    @property
    def valid(self) -> npt.NDArray[np.bool_]:
        """Rows that hold values, (n,) bool."""
        return np.isin(self.status, [status for status in Status if status.has_values])

    @property
    def stable(self) -> npt.NDArray[np.bool_]:
        """Rows of stable equilibria, with or without contact, from which a surrogate learns, (n,) bool."""
        return np.isin(self.status, [status for status in Status if status.stable])


#: Every field of a response by its name; ``tangent/stress_p`` is a field of the batch of derivatives.
RESPONSE_FIELDS = declared_fields(CellResponse)
#: Those that cell solvers provide and files hold, without the status.
CELL_FIELDS = {
    name: declared
    for name, declared in RESPONSE_FIELDS.items()
    if name != "status" and declared.flag != "surrogate"
}
