"""Closures: mean-gradient by Dehghani & Zilian, and potential, exact; their error against the cell.

Both closures have the same flux. Its conductivity is that of the undeformed pore, carried along with F̄, or that of
the deformed pore, which is a response of the cell.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Literal, get_args

import numpy as np

from porocore.cell.cell import Cell
from porocore.cell.materials.hyperelastic import Composite, Solid
from porocore.core.fields import Batch, provided
from porocore.core.tensors import cofactor, cofactor_tangent, cross_matrix, determinant, polar_rotation, spin
from porocore.errors import ConfigurationError
from porocore.interfaces.law import (
    CellLaw,
    InternalVariable,
    LawMemory,
    MacroResponse,
    MacroTangent,
    MemoryChanges,
    PointChanges,
    ResponseChanges,
    UndeformedCells,
    add_scaled,
    fingerprint,
)
from porocore.states import Array, CellResponse, CellSlopes, CellTangent, MacroState

#: ``piola``: K of the undeformed cell, turned with the solid and pulled back, R̄ K R̄ᵀ for K; ``piola-unrotated``: pulled
#: back only (Dehghani & Zilian); ``deformed``: that of the flow through every deformed pore.
ConductivityLaw = Literal["piola", "piola-unrotated", "deformed"]
CONDUCTIVITY_LAWS: tuple[str, ...] = get_args(ConductivityLaw)
#: A conductivity that differs between directions by no more than this share is the same in all: it has nothing to turn.
ISOTROPIC = 1e-12


@dataclass(frozen=True, eq=False)
class PulledBack:
    """Kinematics and conductivity of n points; NaN where det F̄ ≤ 0 or det(I + H) ≤ 0.

    Attributes
    ----------
    F : (n, 3, 3)
        F̄ = I + H + <∇u¹>_s/φ_s.
    J : (n,)
        det F̄; NaN where there is no state of the solid or of the body.
    cof : (n, 3, 3)
        cof F̄ = Ḡᵀ.
    conductivity : (n, 3, 3)
        K_ref, between ∇_X p and the flux through reference area: Ḡ K̂ F̄⁻ᵀ, or that of the deformed pore.
    transformed : (n, 3, 3)
        K_t = K_ref/det F̄ (Dehghani & Zilian's transformed conductivity), F̄⁻¹ K̂ F̄⁻ᵀ where K is carried along.
    grad_p, flux : (n, 3)
        ∇_X p, and q = −conductivity ∇_X p.
    undeformed : (3, 3) or (n, 3, 3)
        K; None where the conductivity is that of the deformed pore.
    rotation : (n, 3, 3)
        R̄ of F̄ = R̄ Ū, by which K is turned, K̂ = R̄ K R̄ᵀ; None where K̂ = K.
    """

    F: Array
    J: Array
    cof: Array
    conductivity: Array
    transformed: Array
    grad_p: Array
    flux: Array
    undeformed: Array | None
    rotation: Array | None = None

    @classmethod
    def from_states(
        cls,
        states: MacroState,
        mean_grad: Array,
        grad_p: Array,
        solid_fraction: float | Array,
        K: Array,
        law: ConductivityLaw = "piola",
        deformed: Array | None = None,
    ) -> PulledBack:
        """Return the kinematics of H, <∇u¹>_s, ∇_X p, φ_s and K of the undeformed cell, or of each point's own (n, …).

        With the law ``deformed`` K_ref (n, 3, 3) of the ``deformed`` pores is in the place of K.

        Raises
        ------
        ValueError
            The law is ``deformed`` and there is no such K_ref.
        """
        F = np.eye(3) + states.grad_u + mean_grad / at_points(solid_fraction, 2)
        J, J0 = determinant(F), determinant(np.eye(3) + states.grad_u)
        J = np.where((J > 0) & (J0 > 0), J, np.nan)
        cof = np.ascontiguousarray(cofactor(F))
        rotation = None
        if law == "deformed":
            if deformed is None:
                raise ValueError("expected the conductivity of the deformed pores")
            conductivity = np.where(np.isnan(J)[:, None, None], np.nan, deformed)
        else:
            carried = K
            if law == "piola" and not is_isotropic(K):
                rotation = polar_rotation(np.where(np.isnan(J)[:, None, None], np.eye(3), F))
                carried = rotation @ K @ rotation.swapaxes(1, 2)
            conductivity = cof.swapaxes(1, 2) @ carried @ cof / J[:, None, None]
        transformed = conductivity / J[:, None, None]
        flux = -(conductivity @ grad_p[:, :, None])[..., 0]
        undeformed = None if law == "deformed" else K
        return cls(F, J, cof, conductivity, transformed, grad_p, flux, undeformed, rotation)

    @property
    def missing(self) -> Array:
        """Points without a response, (n, 1, 1) bool."""
        return np.isnan(self.J)[:, None, None]

    def flux_tangent(
        self,
        cell: CellTangent,
        solid_fraction: float | Array,
        deformation: tuple[Array, Array] | None = None,
    ) -> tuple[Array, Array]:
        """Return ∂q/∂H (n, 3, 9) and ∂q/∂p (n, 3).

        A cell that does not tell how its own conductivity changes is taken as if it did not: a Newton iteration with
        that tangent converges to the same solution, linearly.

        Parameters
        ----------
        deformation
            :func:`deformation_tangent` where it is known already.
        """
        n = len(self.J)
        if self.undeformed is not None:
            by_F = self.flux_by_deformation
            dF_dH, dF_dp = deformation or deformation_tangent(cell, solid_fraction)
            return by_F @ dF_dH, (by_F @ dF_dp)[..., 0]
        if cell.conductivity_grad_u is None or cell.conductivity_p is None:
            return np.zeros((n, 3, 9)), np.zeros((n, 3))
        by_H = np.einsum("nijk,nj->nik", cell.conductivity_grad_u.reshape(n, 3, 3, 9), self.grad_p)
        return -by_H, -(cell.conductivity_p @ self.grad_p[:, :, None])[..., 0]

    def flux_changes(self, deformation: Array, K: Array, law: ConductivityLaw) -> Array:
        """Return the changes (n, 3, k) of q at fixed ∇p.

        Parameters
        ----------
        deformation : (n, 3, 3, k)
            Change of F̄.
        K : (n, 3, 3, k)
            Change of K of the undeformed pore, or of K_ref with the law ``deformed``.
        law
            By which the flux goes.
        """
        n, k = len(K), K.shape[-1]
        if self.undeformed is None:
            return -_along(K, self.grad_p)
        R = self.rotation
        if R is None and law == "piola" and not is_isotropic(np.moveaxis(K, -1, 1)):
            R = polar_rotation(np.where(self.missing, np.eye(3), self.F))
        pulled = (self.cof @ self.grad_p[:, :, None])[..., 0]
        turned = pulled if R is None else (pulled[:, None, :] @ R)[:, 0]
        flow = _along(K, turned)
        if R is not None:
            flow = R @ flow
        moved = self.flux_by_deformation @ deformation.reshape(n, 9, k)
        return np.asarray(moved - self.cof.swapaxes(1, 2) @ flow / self.J[:, None, None])

    @cached_property
    def flux_by_deformation(self) -> Array:
        """∂q/∂F̄ (n, 3, 9) of a K that is carried along.

        For R̄ held it is q_i F̄⁻¹_lk − F̄⁻¹_ik q_l + (K_ref)_il (F̄⁻ᵀ ∇_X p)_k.
        """
        n, R, q, K, grad_p = len(self.J), self.rotation, self.flux, provided(self.undeformed), self.grad_p
        inverse = np.ascontiguousarray(self.cof.swapaxes(1, 2)) / self.J[:, None, None]
        pulled = (grad_p[:, None, :] @ inverse)[:, 0]
        by_F = q[:, :, None, None] * inverse.swapaxes(1, 2)[:, None]
        by_F -= inverse[:, :, :, None] * q[:, None, None, :]
        by_F += self.conductivity[:, :, None, :] * pulled[:, None, :, None]
        found: Array = by_F.reshape(n, 3, 9)
        if R is not None:
            # dK̂ = R̄ (Ω K − K Ω) R̄ᵀ, and Ω v = ω × v.
            v = (pulled[:, None, :] @ R)[:, 0]
            turned = v @ K.T if K.ndim == 2 else (K @ v[:, :, None])[..., 0]
            by_spin = K @ cross_matrix(v) - cross_matrix(turned)
            found -= self.cof.swapaxes(1, 2) @ R @ by_spin @ spin(self._states_of(R), R)
        return found

    def _states_of(self, R: Array) -> Array:
        """Return F̄ (n, 3, 3), and R where there is none."""
        return np.where(self.missing, R, self.F)


def _along(K: Array, vectors: Array) -> Array:
    """Return K v (n, 3, k) of tensors (n, 3, 3, k) and vectors (n, 3)."""
    found = np.zeros((len(K), 3, K.shape[-1]))
    for j in np.flatnonzero(K.any(axis=(0, 1, 2))):
        found[..., j] = (K[..., j] @ vectors[:, :, None])[..., 0]
    return found


def is_isotropic(K: Array) -> bool:
    """Tell whether K (3, 3), or each of K (n, 3, 3), is the same in all directions, so that no rotation changes it."""
    mean = at_points(np.trace(K, axis1=-2, axis2=-1) / 3, 2)
    return bool((np.abs(K - mean * np.eye(3)) <= ISOTROPIC * np.abs(mean)).all())


def at_points(value: float | Array, axes: int) -> float | Array:
    """Return a number as it is, and numbers (n,) with so many further axes of length 1."""
    return value.reshape(*value.shape, *(1,) * axes) if isinstance(value, np.ndarray) else value


def deformation_tangent(tangent: CellTangent, solid_fraction: float | Array) -> tuple[Array, Array]:
    """Return ∂F̄/∂H (n, 9, 9) and ∂F̄/∂p (n, 9, 1)."""
    M, Q, share = (
        provided(tangent.mean_grad_grad_u),
        provided(tangent.mean_grad_p),
        at_points(solid_fraction, 2),
    )
    return np.eye(9) + M.reshape(-1, 9, 9) / share, Q.reshape(-1, 9, 1) / share


@dataclass(frozen=True, eq=False)
class CellChanges(Batch):
    """Derivatives of a cell's responses by k unknowns at fixed (H, p); those that a cell does not provide are None.

    Attributes
    ----------
    modulus : (n, k)
        Relative change of the modulus of the solid.
    mean_grad : (n, 3, 3, k)
        Of <∇u¹>_s.
    porosity : (n, k)
        Of φ_f of the undeformed cell.
    conductivity : (n, 3, 3, k)
        Of K_ref where the response has it, else of K of the undeformed cell.
    stress : (n, 3, 3, k)
        Of P_E.
    fluid_volume : (n, k)
        Of φ.
    potential : (n, k)
        Of W.
    """

    modulus: Array
    mean_grad: Array
    porosity: Array
    conductivity: Array
    stress: Array | None = None
    fluid_volume: Array | None = None
    potential: Array | None = None


def cell_changes(
    law: CellLaw,
    states: MacroState,
    cell: CellResponse,
    changes: PointChanges,
    undeformed: Array | None,
    needed: tuple[str, ...],
) -> CellChanges:
    """Return the changes of the cell's responses.

    W = E w(H, p/E), so that E ∂P_E/∂E = P_E − p ∂P_E/∂p and E ∂φ/∂E = −p ∂φ/∂p, and so on; K is in inverse proportion
    to the viscosity.

    Parameters
    ----------
    cell
        Responses with their tangent.
    undeformed
        K of the undeformed cells, (3, 3) or (n, 3, 3); None where the flux goes by K_ref of the deformed ones.
    needed
        Responses whose slopes by the parameters must be known.

    Raises
    ------
    ConfigurationError
        The cell law does not know a derivative.
    """
    tangent = provided(cell.tangent)
    if undeformed is None and tangent.conductivity_p is None:
        raise ConfigurationError(
            f"the cell law {type(law).__name__} gives no derivatives of the conductivity of the deformed pore, without "
            "which a run has no sensitivities; choose conductivity: piola, or a surrogate"
        )
    found = _without_parameters(cell, tangent, states.p, changes, undeformed)
    if changes.parameters is None or not changes.parameters.any():
        return found
    if undeformed is not None and cell.conductivity is not None:
        raise ConfigurationError(
            f"the cell law {type(law).__name__} gives derivatives of the conductivity of the deformed pore by its "
            "parameters, and not of the undeformed one; choose conductivity: deformed"
        )
    return _with_parameters(found, law, law.slopes(states), changes.parameters, needed)


def _without_parameters(
    cell: CellResponse, tangent: CellTangent, p: Array, changes: PointChanges, undeformed: Array | None
) -> CellChanges:
    """Return the changes by modulus and viscosity."""
    n, k = changes.modulus.shape
    scaled = changes.modulus

    def by_modulus(value: Array | None, by_p: Array | None, power: int, *shape: int) -> Array | None:
        if value is None or by_p is None:
            return None
        change = (power * value - p.reshape(n, *(1 for _ in shape)) * by_p).reshape(n, -1, 1)
        return np.asarray(change * scaled[:, None, :]).reshape(n, *shape, k)

    K = provided(cell.conductivity) if undeformed is None else np.broadcast_to(undeformed, (n, 3, 3))
    flow = -K[..., None] * changes.viscosity[:, None, None, :]
    moved = by_modulus(K, tangent.conductivity_p, 0, 3, 3) if undeformed is None else None
    fluid, W, volume = tangent.fluid_volume_p, cell.potential, cell.fluid_volume
    return CellChanges(
        modulus=scaled,
        mean_grad=provided(by_modulus(cell.mean_grad, tangent.mean_grad_p, 0, 3, 3)),
        porosity=np.zeros_like(scaled),
        conductivity=flow if moved is None else flow + moved,
        stress=by_modulus(cell.stress, tangent.stress_p, 1, 3, 3),
        fluid_volume=None if fluid is None else -(p * fluid)[:, None] * scaled,
        potential=None if W is None or volume is None else (W + p * volume)[:, None] * scaled,
    )


def _with_parameters(
    found: CellChanges, law: CellLaw, slopes: CellSlopes, changes: Array, needed: tuple[str, ...]
) -> CellChanges:
    """Return the changes with those by the parameters (n, m, k) added."""

    def by_parameters(name: str, slope: Array | None, change: Array | None) -> Array | None:
        if slope is None:
            if name in needed:
                raise ConfigurationError(
                    f"the cell law {type(law).__name__} gives no derivatives of {name} by the parameters of the cell, "
                    "without which a run has no sensitivities to them; choose a surrogate with the closure potential"
                )
            return change
        n, m, k = changes.shape
        moved = np.asarray(slope.reshape(n, -1, m) @ changes).reshape(*slope.shape[:-1], k)
        return moved if change is None else change + moved

    return CellChanges(
        found.modulus,
        provided(by_parameters("mean_grad", slopes.mean_grad, found.mean_grad)),
        provided(by_parameters("porosity", slopes.porosity, found.porosity)),
        provided(by_parameters("conductivity", slopes.conductivity, found.conductivity)),
        by_parameters("stress", slopes.stress, found.stress),
        by_parameters("fluid_volume", slopes.fluid_volume, found.fluid_volume),
        None if slopes.potential is None else by_parameters("potential", slopes.potential, found.potential),
    )


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
        Which conductivity the flux goes by, :data:`~porocore.macro.laws.closure.ConductivityLaw`: with ``deformed`` a
        response of the cell, otherwise K carried along.
    """

    #: What the user writes.
    name: ClassVar[str]
    #: Fields of :class:`CellResponse` that it reads.
    responses: ClassVar[tuple[str, ...]]
    #: Fields of :class:`CellTangent` that it reads.
    derivatives: ClassVar[tuple[str, ...]]
    #: What it remembers beside H, p and φ.
    internal: ClassVar[tuple[InternalVariable, ...]] = ()

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
        return MacroResponse(
            stress=stress,
            storage=storage,
            flux=pore.flux,
            memory=self.memory(at.states, at.cell, at.memory.fluid_volume + storage),
            deformation=pore.F,
            volume_ratio=pore.J,
            transformed_conductivity=pore.transformed,
            mean_grad=at.cell.mean_grad,
            cell_p=at.states.p,
            doubt=np.zeros(len(at.states), np.int64) if at.cell.doubt is None else at.cell.doubt,
            tangent=tangent,
        )

    def memory(self, states: MacroState, cell: CellResponse, summed: Array) -> LawMemory:
        """Return the memory that the next step begins from.

        Parameters
        ----------
        summed : (n,)
            φ_f of the undeformed cell and the storage of all steps, which is φ unless a closure has one of the state.
        """
        return LawMemory.forgetful(states, summed)

    def fluid_changes(self, by: CellChanges) -> Array:
        """Return the changes (n, k) of the fluid volume of a cell at rest."""
        return by.porosity

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


#: A component of the stress whose values span less than this share of the widest one is not judged.
FLAT = 1e-6


@dataclass(frozen=True)
class ClosureError:
    """Errors of a closure on solved states, in per cent of the range of the exact values over those states.

    The stress is the total first Piola–Kirchhoff stress P_E, its error that of all components that vary,
    referred to the one that varies most. The fluid is what was taken up since the undeformed state.
    """

    stress_rms: float
    stress_largest: float
    fluid_rms: float
    fluid_largest: float

    def for_json(self) -> dict[str, float]:
        """Return the errors by names that include their unit."""
        return {f"{name}_percent_of_range": value for name, value in vars(self).items()}


def closure_error(
    closure: Closure, states: MacroState, exact: CellResponse, cells: UndeformedCells | None = None
) -> ClosureError:
    """Compare the closure, given the cell's own responses, with the cell's own stress and fluid volume.

    The closure gives a storage *rate*; it is integrated in one step from the undeformed state by the trapezoidal
    rule, so that the error of backward Euler is left out. The mean-gradient closure is quadratic there, and the
    path matters little: along the sequence of the sampled states the drained fluid differs by 0.1 %.

    Parameters
    ----------
    states
        n states that were solved, two different ones at least.
    exact
        Their responses, with stress and fluid volume.
    cells
        Undeformed cell of each state; None: that of the closure.

    Raises
    ------
    ValueError
        The responses lack what they are compared with, or do not vary.
    """
    if exact.stress is None or exact.fluid_volume is None:
        raise ValueError("expected responses with stress and fluid volume")
    n, still = len(states), np.zeros((len(states), 3))
    at_rest, rest = MacroState.zeros(n), np.zeros((n, 3, 3))
    porosity = np.broadcast_to(1 - closure.solid_fraction_of(cells), n)
    at_start = CellResponse(mean_grad=rest, status=exact.status, stress=rest, fluid_volume=porosity)
    at_end = ClosurePoints(states, exact, still, closure.memory(at_rest, at_start, porosity), cells)
    returned = ClosurePoints(
        at_rest, at_start, still, closure.memory(states, exact, exact.fluid_volume), cells
    )
    there, back = (closure.respond(points, tangent=False) for points in (at_end, returned))

    components = exact.stress.reshape(n, 9)
    spans = np.ptp(components, axis=0)
    if not spans.max() > 0:
        raise ValueError("expected states under different stresses")
    varying = spans > FLAT * spans.max()
    stress_error = (there.stress.reshape(n, 9) - components)[:, varying]
    taken_up = exact.fluid_volume - porosity
    fluid_error = (there.storage - back.storage) / 2 - taken_up
    return ClosureError(
        *_rms_and_largest(stress_error, float(spans.max())),
        *_rms_and_largest(fluid_error, float(np.ptp(taken_up))),
    )


def _rms_and_largest(error: Array, span: float) -> tuple[float, float]:
    return 100 * float(np.sqrt(np.mean(error**2))) / span, 100 * float(np.abs(error).max()) / span


def _unfit(reason: str) -> str:
    return (
        "closure 'mean-gradient' takes the stress of the solid at its mean deformation, so the whole solid must have "
        f"one strain energy without a stress at rest, but {reason}; choose closure: potential"
    )


@dataclass(frozen=True, eq=False)
class _Deformed:
    """Kinematics and stress of n points; the change of φ_s (n,) with <∇u¹>_s/φ_s (n, 3, 3) is None without one."""

    phi_s: float | Array
    share: float | Array  #: φ_s, (n, 1, 1) or one number
    p: Array  #: (n, 1, 1)
    pore: PulledBack
    step: Array  #: (n, 3, 3)  φ_f ΔH − Δ<∇u¹>_s
    grown: tuple[Array, Array] | None
    solid: Array  #: (n, 3, 3)  F̄, and the identity where there is none
    solid_stress: Array  #: (n, 3, 3)  ∂Ψ/∂F(F̄)


@dataclass(frozen=True, eq=False)
class _Slopes:
    """Derivatives of the stress, and of the storage in the last row, by F̄ (n, 10, 9); −∂storage/∂<∇u¹>_s (n, 1, 9)."""

    by_deformation: Array
    by_mean_grad: Array


class MeanGradientClosure(Closure):
    """The mean-gradient closure (Dehghani & Zilian): the solid responds to its average deformation gradient.

    With m = <∇_Y u¹>_s(H, p), F̄ = I + H + m/φ_s and Ḡ = det F̄ F̄⁻¹ (so Ḡᵀ = cof F̄)::

        P_E       = φ_s ∂Ψ/∂F(F̄) − φ_f p Ḡᵀ
        Δstorage  = φ_f Ḡᵀ:ΔH − Ḡᵀ:Δm              (Ḡ at the new time: backward Euler)
        q         = −Ḡ K̂ F̄⁻ᵀ ∇_X p
        K_t       = (1/det F̄) Ḡ K̂ F̄⁻ᵀ

    K̂ = R̄ K R̄ᵀ with F̄ = R̄ Ū, or K itself with the conductivity law ``piola-unrotated``, which is the paper's. With the
    conductivity of the deformed pore q = −K_ref ∇_X p and K_t = K_ref/det F̄.

    The solid takes up the volume φ_s det F̄. Where φ_s changes with time by Δφ_s, as with a parameter that does, the
    fluid changes by −(det F̄ − Ḡᵀ:m/φ_s) Δφ_s besides.
    """

    name = "mean-gradient"
    responses = ("mean_grad",)
    derivatives = ("mean_grad_grad_u", "mean_grad_p")
    internal = (InternalVariable("mean_grad", (3, 3)),)

    def __init__(
        self, solid_fraction: float, material: Solid, conductivity: Array, *, law: ConductivityLaw = "piola"
    ) -> None:
        super().__init__(solid_fraction, material, conductivity, law=law)
        if isinstance(material, Composite):
            raise ConfigurationError(_unfit("cell.materials gives each region its own"))
        if material.swells:
            raise ConfigurationError(_unfit("cell.material.swelling gives the cell a stress at rest"))
        self.energy = material

    @classmethod
    def unfit(cls, cell: Cell) -> str:
        """Return why it does not suit the solid of a cell; empty if it does."""
        if cell.materials is not None:
            return _unfit("cell.materials gives each region its own")
        varied = [parameter.key for parameter in cell.parameters if parameter.solid_key is not None]
        if varied:
            return _unfit(f"{varied[0]} is a range, which gives each point its own")
        if cell.solid.swells:
            return _unfit("cell.material.swelling gives the cell a stress at rest")
        return ""

    def respond(self, at: ClosurePoints, *, tangent: bool) -> MacroResponse:
        """Return the response at n points; NaN where det F̄ ≤ 0 or det(I + H) ≤ 0."""
        now = self._deformed(at)
        return self._closed(at, now, self._slopes(now) if tangent else None)

    def respond_to_changes(
        self, at: ClosurePoints, by: CellChanges, before: MemoryChanges
    ) -> tuple[MacroResponse, ResponseChanges]:
        """Return the response and its derivatives; see :class:`Closure`.

        Raises
        ------
        ConfigurationError
            φ_s depends on an unknown, and changes with time.
        """
        tangent = provided(at.cell.tangent)
        if at.cells_before is not None and by.porosity.any():
            raise ConfigurationError(
                "closure 'mean-gradient' gives no derivatives by parameters that change the porosity where these "
                "change with time; choose closure: potential"
            )
        now, (n, k) = self._deformed(at), by.modulus.shape
        slopes, dF = self._slopes(now), self.deformation_changes(at.cell, by, at.cells)
        found: Array = np.matmul(slopes.by_deformation, dF.reshape(n, 9, k))
        stress, storage = found[:, :9], found[:, 9:]
        add_scaled(stress, (now.share * now.solid_stress).reshape(n, 9), by.modulus)
        add_scaled(stress, -(now.solid_stress + now.p * now.pore.cof).reshape(n, 9), by.porosity)
        moved = before.internal - (1 - now.share) * before.grad_u.reshape(n, 9, k)
        add_scaled(moved, (at.states.grad_u - at.memory.states.grad_u).reshape(n, 9), by.porosity)
        storage += now.pore.cof.reshape(n, 1, 9) @ moved - slopes.by_mean_grad @ by.mean_grad.reshape(n, 9, k)
        return self._closed(at, now, slopes), ResponseChanges(
            stress=stress.reshape(n, 3, 3, k),
            storage=storage[:, 0],
            flux=now.pore.flux_changes(dF, by.conductivity, self.law),
            internal=by.mean_grad.reshape(n, 9, k),
            internal_grad_u=provided(tangent.mean_grad_grad_u).reshape(n, 9, 3, 3),
            internal_p=provided(tangent.mean_grad_p).reshape(n, 9),
        )

    def memory(self, states: MacroState, cell: CellResponse, summed: Array) -> LawMemory:
        """Return the memory with <∇u¹>_s."""
        return LawMemory(states, summed, cell.mean_grad.reshape(len(states), 9))

    def _deformed(self, at: ClosurePoints) -> _Deformed:
        states, cell, cells, memory = at.states, at.cell, at.cells, at.memory
        phi_s = self.solid_fraction_of(cells)
        share = at_points(phi_s, 2)
        pore = self.pull_back(states, cell, at.grad_p, cells)
        last = memory.internal.reshape(-1, 3, 3)
        step = (1 - share) * (states.grad_u - memory.states.grad_u) - (cell.mean_grad - last)
        grown = None
        if at.cells_before is not None and cells is not None:
            grown = (at.cells_before.porosity - cells.porosity, cell.mean_grad / share)
        # Ψ is asked only where there is a state.
        solid = np.where(pore.missing, np.eye(3), pore.F)
        stress = np.where(pore.missing, np.nan, self.energy.stress(solid))
        return _Deformed(phi_s, share, states.p[:, None, None], pore, step, grown, solid, stress)

    def _closed(self, at: ClosurePoints, now: _Deformed, slopes: _Slopes | None) -> MacroResponse:
        pore = now.pore
        storage = np.einsum("nij,nij->n", pore.cof, now.step)
        if now.grown is not None:
            storage = storage - now.grown[0] * (pore.J - np.einsum("nij,nij->n", pore.cof, now.grown[1]))
        stress = now.share * now.solid_stress - (1 - now.share) * now.p * pore.cof
        tangent = None if slopes is None else self._tangent(now, provided(at.cell.tangent), slopes)
        return self._response(at, pore, stress, storage, tangent)

    def _slopes(self, at: _Deformed) -> _Slopes:
        """Return the derivatives by F̄ and by <∇u¹>; second-rank tensors are rows of 9, fourth-rank ones 9 × 9."""
        n, pore, share = len(at.pore.J), at.pore, at.share
        cof_F = cofactor_tangent(pore.F).reshape(n, 9, 9)
        cof_row = pore.cof.reshape(n, 1, 9)
        by_F = np.empty((n, 10, 9))
        by_F[:, 9:] = at.step.reshape(n, 1, 9) @ cof_F
        by_m = cof_row
        if at.grown is not None:
            change = at.grown[0][:, None, None]
            by_F[:, 9:] -= change * (cof_row - at.grown[1].reshape(n, 1, 9) @ cof_F)
            by_m = cof_row * (1 - change / share)
        cof_F *= (1 - share) * at.p
        np.multiply(self.energy.tangent(at.solid).reshape(n, 9, 9), share, out=by_F[:, :9])
        by_F[:, :9] -= cof_F
        return _Slopes(by_F, by_m)

    @staticmethod
    def _tangent(at: _Deformed, cell: CellTangent, slopes: _Slopes) -> MacroTangent:
        """Return the chain rule through F̄(H, p)."""
        n, pore, phi_f = len(at.pore.J), at.pore, 1 - at.share
        M, Q = provided(cell.mean_grad_grad_u).reshape(n, 9, 9), provided(cell.mean_grad_p).reshape(n, 9, 1)
        by_F, by_m = slopes.by_deformation, slopes.by_mean_grad
        dF_dH, dF_dp = deformation_tangent(cell, at.phi_s)
        by_H, by_p = by_F @ dF_dH, (by_F @ dF_dp)[..., 0]
        flux_H, flux_p = pore.flux_tangent(cell, at.phi_s, (dF_dH, dF_dp))
        return MacroTangent(
            stress_grad_u=by_H[:, :9].reshape(n, 3, 3, 3, 3),
            stress_p=by_p[:, :9].reshape(n, 3, 3) - phi_f * pore.cof,
            storage_grad_u=(by_H[:, 9:10] + phi_f * pore.cof.reshape(n, 1, 9) - by_m @ M).reshape(n, 3, 3),
            storage_p=by_p[:, 9] - (by_m @ Q)[:, 0, 0],
            flux_grad_u=flux_H.reshape(n, 3, 3, 3),
            flux_p=flux_p,
            flux_grad_p=-pore.conductivity,
        )


class PotentialClosure(Closure):
    """Stress and fluid volume of the cell itself, the derivatives of W(H, p) = <Ψ + pJ>_s − p J₀.

    With φ = −∂W/∂p the current fluid volume per reference volume, and F̄ = I + H + <∇u¹>_s/φ_s as in the
    mean-gradient closure::

        P_E       = ∂W/∂H
        Δstorage  = φ(new) − φ(old)
        q         = −Ḡ K̂ F̄⁻ᵀ ∇_X p
        K_t       = (1/det F̄) Ḡ K̂ F̄⁻ᵀ

    Nothing is approximated in stress and storage, so dW = P_E:dH − φ dp and no closed cycle of (H, p) does
    work; ∂P_E/∂H has major symmetry and ∂P_E/∂p = −∂φ/∂H. Only the conductivity is that of the undeformed pore,
    carried along (K̂ = R̄ K R̄ᵀ with F̄ = R̄ Ū, or K itself with the law ``piola-unrotated``); or that of the deformed pore,
    q = −K_ref ∇_X p and K_t = K_ref/det F̄.
    """

    name = "potential"
    responses = ("mean_grad", "stress", "fluid_volume")
    derivatives = (
        "mean_grad_grad_u",
        "mean_grad_p",
        "stress_grad_u",
        "stress_p",
        "fluid_volume_grad_u",
        "fluid_volume_p",
    )

    def respond(self, at: ClosurePoints, *, tangent: bool) -> MacroResponse:
        """Return the response at n points; NaN where det F̄ ≤ 0 or det(I + H) ≤ 0.

        A cell that changes with time takes up fluid by its φ; the cells before are not needed.
        """
        return self._closed(at, self.pull_back(at.states, at.cell, at.grad_p, at.cells), tangent)

    def respond_to_changes(
        self, at: ClosurePoints, by: CellChanges, before: MemoryChanges
    ) -> tuple[MacroResponse, ResponseChanges]:
        """Return the response and its derivatives; see :class:`Closure`."""
        pore, fluid = self.pull_back(at.states, at.cell, at.grad_p, at.cells), provided(by.fluid_volume)
        found = ResponseChanges.forgetful(
            stress=provided(by.stress),
            storage=fluid - before.fluid_volume,
            flux=pore.flux_changes(
                self.deformation_changes(at.cell, by, at.cells), by.conductivity, self.law
            ),
        )
        return self._closed(at, pore, True), replace(found, potential=by.potential)

    def _closed(self, at: ClosurePoints, pore: PulledBack, tangent: bool) -> MacroResponse:
        cell, before = at.cell, at.memory.fluid_volume
        stress = np.where(pore.missing, np.nan, provided(cell.stress))
        storage = np.where(np.isnan(pore.J), np.nan, provided(cell.fluid_volume) - before)
        slopes = (
            self._tangent(pore, provided(cell.tangent), self.solid_fraction_of(at.cells)) if tangent else None
        )
        return replace(self._response(at, pore, stress, storage, slopes), potential=cell.potential)

    def memory(self, states: MacroState, cell: CellResponse, summed: Array | None = None) -> LawMemory:
        """Return the memory with φ of the cell in this state."""
        return LawMemory.forgetful(states, provided(cell.fluid_volume))

    def fluid_changes(self, by: CellChanges) -> Array:
        """Return the changes of φ of the cell at rest."""
        return provided(by.fluid_volume)

    @staticmethod
    def _tangent(pore: PulledBack, cell: CellTangent, solid_fraction: float | Array) -> MacroTangent:
        flux_H, flux_p = pore.flux_tangent(cell, solid_fraction)
        return MacroTangent(
            stress_grad_u=provided(cell.stress_grad_u),
            stress_p=provided(cell.stress_p),
            storage_grad_u=provided(cell.fluid_volume_grad_u),
            storage_p=provided(cell.fluid_volume_p),
            flux_grad_u=flux_H.reshape(-1, 3, 3, 3),
            flux_p=flux_p,
            flux_grad_p=-pore.conductivity,
        )


#: The closures by the name that the user writes.
CLOSURES: dict[str, type[Closure]] = {
    closure.name: closure for closure in (MeanGradientClosure, PotentialClosure)
}


def make_closure(
    name: str, solid_fraction: float, material: Solid, conductivity: Array, *, law: ConductivityLaw = "piola"
) -> Closure:
    """Return the closure of that name; see :class:`Closure` for its constants."""
    return CLOSURES[name](solid_fraction, material, conductivity, law=law)
