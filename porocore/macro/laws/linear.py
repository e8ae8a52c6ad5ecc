"""Linear poroelasticity: coefficients, laws of one cell and of many, effective properties (EffectiveProperties)."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from porocore.cell.materials.hyperelastic import Composite, Solid
from porocore.core.fields import Batch, provided
from porocore.core.files.plain_data import json_ready
from porocore.core.units import MULTIPLES, ResultUnits
from porocore.errors import ConfigurationError
from porocore.interfaces.cell import ElementCells
from porocore.interfaces.law import (
    CellLaw,
    Interval,
    LawMemory,
    MacroLaw,
    MacroResponse,
    MacroTangent,
    MemoryChanges,
    PointChanges,
    ResponseChanges,
    fingerprint,
)
from porocore.macro.laws.composed import TurnedLaw
from porocore.states import Array, BodyPlace, CellResponse, CellTangent, MacroState, Status

#: 1/M_B [1/E] up to this is round-off of a cell without pores.
NO_STORAGE = 1e-12


@dataclass(frozen=True, eq=False)
class LinearCoefficients:
    """Coefficients of linear poroelasticity, P_E = P₀ + C_eff:E − α p, φ = φ₀ + α:E + p/M_B, q = −K ∇p.

    With C the elasticity of the solid and M, Q the tangents of <∇u¹>_s at rest (Dehghani & Zilian)::

        C_eff = φ_s C + C:M,   α = φ_f I − I:M,   1/M_B = −tr Q

    A solid of several materials has no single C; its C_eff is ∂P_E/∂H of the cell at rest, which is the same tensor.
    One that swells has a stress P₀ at rest, and all coefficients are derivatives of the cell's own responses there.

    Attributes
    ----------
    stiffness : (3, 3, 3, 3)
        C_eff [E], symmetric in its minor indices.
    biot : (3, 3)
        α from the storage, φ_f I − I:M [-], symmetric.
    biot_of_stress : (3, 3)
        α from the stress, φ_f I − C:Q; the same tensor, up to the error of the cell solver.
    storage : float
        1/M_B [1/E].
    conductivity : (3, 3)
        K.
    mean_grad_grad_u : (3, 3, 3, 3)
        M [-].
    mean_grad_p : (3, 3)
        Q [1/E].
    stress : (3, 3)
        P₀ [E], 0 unless the solid swells.
    mean_grad : (3, 3)
        <∇u¹>_s at rest [-], 0 unless the solid swells.
    fluid_volume : float
        φ₀ at rest [-], which matters only where a point's coefficients change.
    """

    stiffness: Array
    biot: Array
    biot_of_stress: Array
    storage: float
    conductivity: Array
    mean_grad_grad_u: Array
    mean_grad_p: Array
    stress: Array = field(default_factory=lambda: np.zeros((3, 3)))
    mean_grad: Array = field(default_factory=lambda: np.zeros((3, 3)))
    fluid_volume: float = 0.0

    @classmethod
    def from_reference(
        cls,
        reference: CellResponse,
        solid_fraction: float,
        material: Solid,
        conductivity: Array,
        *,
        pores: bool = True,
    ) -> LinearCoefficients:
        """From the response of the undeformed cell with its tangent (one row), φ_s and K (3, 3).

        Raises
        ------
        ConfigurationError
            1/M_B = −tr Q is not positive: its response has a wrong sign, or it has no pores although ``pores``.
        ValueError
            The response is not one solved row with its tangent.
        """
        M, Q = reference_tangents(reference)
        stiffness, biot_of_stress = _of_stress(reference, solid_fraction, material)
        stiffness = (stiffness + stiffness.swapaxes(0, 1)) / 2
        stiffness = (stiffness + stiffness.swapaxes(2, 3)) / 2
        biot, storage, stress = _of_fluid(reference, solid_fraction, material)
        fluid = 1 - solid_fraction if reference.fluid_volume is None else float(reference.fluid_volume[0])
        if storage <= NO_STORAGE and (pores or storage < -NO_STORAGE):
            raise ConfigurationError(
                f"linear poroelasticity: expected 1/M_B = −tr Q > 0, got {storage:.3g}: "
                + (
                    "the cell takes up no fluid under pressure; give it pores (cell.geometry)"
                    if storage >= -NO_STORAGE
                    else "the cell gives off fluid under pressure; its solver has the sign of ∂<∇u¹>/∂p wrong, "
                    "'porocore plugin check' shows it"
                )
            )
        return cls(
            stiffness,
            (biot + biot.T) / 2,
            biot_of_stress,
            storage,
            np.array(conductivity, dtype=float),
            M,
            Q,
            stress,
            reference.mean_grad[0] if material.swells else np.zeros((3, 3)),
            fluid,
        )

    @property
    def biot_modulus(self) -> float:
        """Biot's modulus M_B [E]."""
        return 1 / self.storage

    def consolidation_coefficient(self, axis: int = 1) -> float:
        """c_v = K/(1/M_B + α²/C_eff) of confined compression along ``axis`` (0, 1, 2); T = c_v t/h²."""
        i = axis
        stiffness, alpha = self.stiffness[i, i, i, i], self.biot[i, i]
        return float(self.conductivity[i, i] / (self.storage + alpha**2 / stiffness))


def _of_stress(reference: CellResponse, solid_fraction: float, material: Solid) -> tuple[Array, Array]:
    """Return C_eff and the Biot tensor of the stress; with several materials from the cell's own tangent at rest."""
    if isinstance(material, Composite) or material.swells:
        tangent = reference.tangent
        if tangent is None or tangent.stress_grad_u is None or tangent.stress_p is None:
            raise ValueError(
                "expected the derivatives of the cell's stress, without which a solid of several materials, or one "
                "that swells, has no known stiffness; the cell solver does not provide them"
            )
        return tangent.stress_grad_u[0].copy(), -tangent.stress_p[0]
    M, Q = reference_tangents(reference)
    C = material.elasticity
    stiffness = solid_fraction * C + np.einsum("ijmn,mnkl->ijkl", C, M)
    return stiffness, (1 - solid_fraction) * np.eye(3) - np.einsum("ijmn,mn->ij", C, Q)


def _of_fluid(reference: CellResponse, solid_fraction: float, material: Solid) -> tuple[Array, float, Array]:
    """Return α and 1/M_B of the storage, and P₀; of a solid that swells from the cell's own responses at rest."""
    if not material.swells:
        M, Q = reference_tangents(reference)
        biot = (1 - solid_fraction) * np.eye(3) - np.einsum("iikl->kl", M)
        return biot, 0.0 - float(np.trace(Q)), np.zeros((3, 3))
    tangent, stress = reference.tangent, reference.stress
    if (
        stress is None
        or tangent is None
        or tangent.fluid_volume_grad_u is None
        or tangent.fluid_volume_p is None
    ):
        raise ValueError(
            "expected the stress of the cell and the derivatives of its fluid volume, without which a solid that "
            "swells has no known storage; the cell solver does not provide them"
        )
    return (
        tangent.fluid_volume_grad_u[0].copy(),
        float(tangent.fluid_volume_p[0]),
        (stress[0] + stress[0].T) / 2,
    )


class LinearLaw(MacroLaw):
    """Law with C_eff, α, M_B and K that do not depend on (H, p)."""

    constant_tangent = True

    @abstractmethod
    def biot_and_storage(self, states: MacroState) -> tuple[Array, Array]:
        """Return α, (3, 3) or (n, 3, 3), and 1/M_B, one number or (n,), of n points."""

    def respond_to_changes(
        self,
        states: MacroState,
        grad_p: Array,
        memory: LawMemory,
        changes: PointChanges,
        before: MemoryChanges,
        *,
        step: Interval | None = None,
    ) -> tuple[MacroResponse, ResponseChanges]:
        """Return the response and its derivatives; C_eff and M_B are in proportion to the modulus, and so is P₀.

        Raises
        ------
        ConfigurationError
            A parameter changes: the slopes of the coefficients are not known.
        """
        if changes.parameters is not None and changes.parameters.any():
            raise ConfigurationError(
                f"the law '{self.name}' gives no derivatives by parameters of the cell; choose a law of a closure"
            )
        found, (biot, storage) = self.respond(states, grad_p, memory), self.biot_and_storage(states)
        by = changes.modulus
        borne = (found.stress + states.p[:, None, None] * biot)[..., None]
        return found, ResponseChanges.forgetful(
            stress=borne * by[:, None, None, :],
            storage=-(storage * states.p)[:, None] * by - before.fluid_volume,
            flux=-found.flux[..., None] * changes.viscosity[:, None, :],
        )


class LinearPoroelasticity(LinearLaw):
    """Small-strain poroelasticity as a macroscopic law, to compare the nonlinear ones with."""

    name = "linear"

    def __init__(self, coefficients: LinearCoefficients) -> None:
        self.coefficients = c = coefficients
        held = (c.stress,) if c.stress.any() else ()
        self.identity = fingerprint(
            self.name,
            c.stiffness,
            c.biot,
            c.storage,
            c.conductivity,
            c.mean_grad_grad_u,
            c.mean_grad_p,
            *held,
        )

    def initial(self, n: int) -> LawMemory:
        """Return the memory at rest."""
        return LawMemory.forgetful(MacroState.zeros(n), np.full(n, self.coefficients.fluid_volume))

    def respond(
        self,
        states: MacroState,
        grad_p: Array,
        memory: LawMemory,
        *,
        step: Interval | None = None,
        tangent: bool = True,
    ) -> MacroResponse:
        """See :class:`MacroLaw`; the mean gradient at rest and M:H + Q p are carried for the profiles."""
        c, n = self.coefficients, len(states)
        H, p = states.grad_u.reshape(n, 9), states.p[:, None]
        fluid = c.fluid_volume + H @ c.biot.reshape(9) + c.storage * states.p
        mean_grad = np.add(H @ c.mean_grad_grad_u.reshape(9, 9).T, p * c.mean_grad_p.reshape(9), dtype=float)
        return MacroResponse(
            stress=(H @ c.stiffness.reshape(9, 9).T - p * c.biot.reshape(9) + c.stress.ravel()).reshape(
                n, 3, 3
            ),
            storage=fluid - memory.fluid_volume,
            flux=-grad_p @ c.conductivity.T,
            memory=LawMemory.forgetful(states, fluid),
            deformation=np.eye(3) + states.grad_u,
            volume_ratio=np.ones(n),
            transformed_conductivity=np.broadcast_to(c.conductivity, (n, 3, 3)),
            mean_grad=c.mean_grad + mean_grad.reshape(n, 3, 3),
            cell_p=states.p,
            doubt=np.zeros(n, np.int64),
            tangent=self._tangent(n) if tangent else None,
        )

    def biot_and_storage(self, states: MacroState) -> tuple[Array, Array]:
        """Return α and 1/M_B of the cell."""
        return self.coefficients.biot, np.array(self.coefficients.storage)

    def _tangent(self, n: int) -> MacroTangent:
        c = self.coefficients
        return MacroTangent(
            stress_grad_u=np.broadcast_to(c.stiffness, (n, 3, 3, 3, 3)),
            stress_p=np.broadcast_to(-c.biot, (n, 3, 3)),
            storage_grad_u=np.broadcast_to(c.biot, (n, 3, 3)),
            storage_p=np.full(n, c.storage),
            flux_grad_u=np.zeros((n, 3, 3, 3)),
            flux_p=np.zeros((n, 3)),
            flux_grad_p=np.broadcast_to(-c.conductivity, (n, 3, 3)),
        )


@dataclass(frozen=True, eq=False)
class RestCoefficients(Batch):
    """Coefficients of linear poroelasticity at n points; see :class:`LinearCoefficients`.

    Attributes
    ----------
    points
        States at rest, with parameters and places.
    stress : (n, 3, 3)
        P₀ at rest, other than zero where a swelling is held.
    fluid_volume : (n,)
        φ₀ at rest.
    stiffness : (n, 9, 9)
        C_eff.
    biot : (n, 9)
        α from the storage.
    storage : (n,)
        1/M_B.
    conductivity : (n, 3, 3)
        K.
    """

    points: MacroState
    stress: Array
    fluid_volume: Array
    stiffness: Array
    biot: Array
    storage: Array
    conductivity: Array

    @classmethod
    def of_elements(cls, coefficients: LinearCoefficients | RestCoefficients, n: int) -> RestCoefficients:
        """Return the coefficients of the n elements of a body; those of one cell are the same in all."""
        if isinstance(coefficients, RestCoefficients):
            return coefficients
        c, ones = coefficients, np.ones(n)
        return cls(
            MacroState.zeros(n),
            np.zeros((n, 3, 3)),
            c.fluid_volume * ones,
            np.multiply.outer(ones, c.stiffness.reshape(9, 9)),
            np.multiply.outer(ones, c.biot.reshape(9)),
            c.storage * ones,
            np.multiply.outer(ones, c.conductivity),
        )

    def at(self, i: int) -> LinearCoefficients:
        """Return the coefficients at one point, without M and Q, which are not known (NaN)."""
        return LinearCoefficients(
            self.stiffness[i].reshape(3, 3, 3, 3),
            self.biot[i].reshape(3, 3),
            self.biot[i].reshape(3, 3),
            float(self.storage[i]),
            self.conductivity[i],
            np.full((3, 3, 3, 3), np.nan),
            np.full((3, 3), np.nan),
            self.stress[i],
        )


class LinearisedLaw(LinearLaw):
    """A law linearised at H = 0 and p = 0, at each point with its own parameters and place.

    P = P₀ + C_eff:H − α p, φ = φ₀ + α:H + p/M_B and q = −K ∇p. Where the parameters or the axes change with time, so do
    the coefficients, P₀ and φ₀. The mean gradient <∇u¹>_s is not carried.

    Parameters
    ----------
    law
        Any law; it is asked at rest only.
    name
        For reports.
    """

    def __init__(self, law: MacroLaw, name: str = "linear") -> None:
        self.law, self.name, self.parameters = law, name, law.parameters
        self.identity = fingerprint("linearised", law.identity)
        self._known: list[RestCoefficients] = []

    def parameters_of(self, region: int) -> tuple[str, ...]:
        """Return those of the law; see :class:`MacroLaw`."""
        return self.law.parameters_of(region)

    def initial(self, n: int) -> LawMemory:
        """Return the memory at rest."""
        return self.initial_at(MacroState.zeros(n))

    def initial_at(self, points: MacroState) -> LawMemory:
        """Return the memory at rest, with the parameters and places of the points."""
        rest = points.at_rest()
        return LawMemory.forgetful(rest, self.coefficients(rest).fluid_volume)

    def respond(
        self,
        states: MacroState,
        grad_p: Array,
        memory: LawMemory,
        *,
        step: Interval | None = None,
        tangent: bool = True,
    ) -> MacroResponse:
        """Return the linear response; see :class:`MacroLaw`."""
        n, c = len(states), self.coefficients(states)
        H, p = states.grad_u.reshape(n, 9), states.p
        fluid = c.fluid_volume + np.einsum("ni,ni->n", c.biot, H) + c.storage * p
        stress = (c.stiffness @ H[:, :, None])[..., 0] - p[:, None] * c.biot
        return MacroResponse(
            stress=c.stress + stress.reshape(n, 3, 3),
            storage=fluid - memory.fluid_volume,
            flux=-(c.conductivity @ grad_p[:, :, None])[..., 0],
            memory=LawMemory.forgetful(states, fluid),
            deformation=np.eye(3) + states.grad_u,
            volume_ratio=np.ones(n),
            transformed_conductivity=c.conductivity,
            mean_grad=np.zeros((n, 3, 3)),
            cell_p=states.p,
            doubt=np.zeros(n, np.int64),
            tangent=MacroTangent(
                stress_grad_u=c.stiffness.reshape(n, 3, 3, 3, 3),
                stress_p=-c.biot.reshape(n, 3, 3),
                storage_grad_u=c.biot.reshape(n, 3, 3),
                storage_p=c.storage,
                flux_grad_u=np.zeros((n, 3, 3, 3)),
                flux_p=np.zeros((n, 3)),
                flux_grad_p=-c.conductivity,
            )
            if tangent
            else None,
        )

    def biot_and_storage(self, states: MacroState) -> tuple[Array, Array]:
        """Return α (n, 3, 3) and 1/M_B (n,) of the points."""
        c = self.coefficients(states)
        return c.biot.reshape(-1, 3, 3), c.storage

    def coefficients(self, states: MacroState) -> RestCoefficients:
        """Return the coefficients at n points, by their parameters and places."""
        for known in self._known:
            if _same_points(known.points, states):
                return known
        rest = states.at_rest()
        n = len(rest)
        before = self.law.initial_at(rest)
        found = self.law.respond(rest, np.zeros((n, 3)), before)
        tangent = provided(found.tangent)
        C = tangent.stress_grad_u
        C = (C + C.swapaxes(1, 2)) / 2
        C = (C + C.swapaxes(3, 4)) / 2
        alpha = (tangent.storage_grad_u + tangent.storage_grad_u.swapaxes(1, 2)) / 2
        coefficients = RestCoefficients(
            rest,
            found.stress,
            before.fluid_volume,
            C.reshape(n, 9, 9),
            alpha.reshape(n, 9),
            np.array(tangent.storage_p),
            -tangent.flux_grad_p,
        )
        self._known = [coefficients, *self._known[:1]]
        return coefficients


def coefficients_of_elements(law: MacroLaw, cells: ElementCells, profile: int = 0) -> RestCoefficients:
    """Return the coefficients of the elements of a body, in its axes, at the time of a profile.

    Parameters
    ----------
    law
        That of the body.
    cells
        Of its elements.
    profile
        Number of the profile.
    """
    n, values, axes = len(cells.region), cells.values_at(profile), cells.axes_at(profile)
    zero = MacroState.zeros(n)
    points = replace(zero, parameters=values, place=BodyPlace(cells.region, axes))
    return LinearisedLaw(law if axes is None else TurnedLaw(law)).coefficients(points)


def _same_points(one: MacroState, other: MacroState) -> bool:
    """Tell whether as many points have the same parameters, regions and axes."""
    parts = (
        [at.parameters, *([] if at.place is None else [at.place.region, at.place.axes])]
        for at in (one, other)
    )
    first, second = parts
    return (
        len(one) == len(other)
        and len(first) == len(second)
        and all(
            a is b or (a is not None and b is not None and np.array_equal(a, b))
            for a, b in zip(first, second, strict=True)
        )
    )


class LinearCellLaw(CellLaw):
    """<∇u¹>_s = M:H + Q p with the tangents of the undeformed cell; a cell law for small deformations.

    Parameters
    ----------
    reference
        Response at H = 0, p = 0 with its tangent (one row).
    """

    def __init__(self, reference: CellResponse) -> None:
        self.M, self.Q = reference_tangents(reference)
        self.identity = fingerprint("linear", self.M, self.Q)

    def predict(self, states: MacroState, *, tangent: bool = True) -> CellResponse:
        """Return ``mean_grad`` and its derivatives; no other response."""
        n = len(states)
        mean_grad = states.grad_u.reshape(n, 9) @ self.M.reshape(9, 9).T
        return CellResponse(
            mean_grad=mean_grad.reshape(n, 3, 3) + states.p[:, None, None] * self.Q,
            status=np.full(n, int(Status.converged)),
            doubt=np.zeros(n, np.int64),
            tangent=CellTangent(
                mean_grad_grad_u=np.broadcast_to(self.M, (n, 3, 3, 3, 3)),
                mean_grad_p=np.broadcast_to(self.Q, (n, 3, 3)),
            )
            if tangent
            else None,
        )


def reference_tangents(reference: CellResponse) -> tuple[Array, Array]:
    """Return M (3, 3, 3, 3) and Q (3, 3) of the undeformed cell.

    Raises
    ------
    ValueError
        The response is not one solved row with its tangent.
    """
    tangent = reference.tangent
    if (
        len(reference) != 1
        or not reference.valid.all()
        or tangent is None
        or tangent.mean_grad_grad_u is None
        or tangent.mean_grad_p is None
    ):
        raise ValueError("expected the solved response of one undeformed cell, with its tangent")
    return tangent.mean_grad_grad_u[0].copy(), tangent.mean_grad_p[0].copy()


#: Quantities of the properties, each a key of :data:`porocore.core.units.QUANTITIES`; '' for a pure number.
PROPERTIES = {
    "porosity": "",
    "permeability": "permeability",
    "conductivity": "conductivity",
    "stiffness_voigt": "stress",
    "confined_moduli": "stress",
    "young_moduli": "stress",
    "poisson_ratios": "",
    "shear_moduli": "stress",
    "anisotropy_ratio": "",
    "biot_tensor": "",
    "biot_modulus": "stress",
    "storage": "compliance",
    "consolidation_coefficients": "diffusivity",
    "held_stress": "stress",
}
#: Axes of Voigt's components: 11, 22, 33, 23, 13, 12, with e_23 counted twice.
VOIGT = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
#: Values along several axes that differ by less than this share are one.
SAME = 1e-3

Isotropy = Literal["isotropic", "cubic", "anisotropic"]


@dataclass(frozen=True, eq=False)
class EffectiveProperties:
    """Properties of a cell in linear poroelasticity, for tables, reports and figures derived from them.

    All numbers are dimensionless. In a study with :class:`~porocore.core.units.Scales` each times
    ``ResultUnits.factor`` of its quantity in ``PROPERTIES``, or ``Scales.factor`` for SI units, has its unit;
    :meth:`in_units` does it for all. Multiples of E are of the reference modulus, d is the edge of the cell, of a box
    the cube root of its volume, μ_c the viscosity of the scales.

    Attributes
    ----------
    porosity : float
        φ_f of the mesh [-].
    permeability : (3, 3)
        Intrinsic permeability k = K μ_f [d²; m² in SI units].
    conductivity : (3, 3)
        K = k/μ_f, the hydraulic permeability of biomechanics [d²/μ_c; m²/(Pa s), which is m⁴/(N s), in SI units].
    stiffness_voigt : (6, 6)
        Drained stiffness C_eff [E], axes 11, 22, 33, 23, 13, 12 of stress, and of strain with twice e_23, e_13, e_12.
    confined_moduli : (3,)
        C_iiii of compression along each axis with the sides held [E]: the aggregate modulus H_A, oedometer modulus.
    young_moduli : (3,)
        Drained Young's moduli E_i along the axes, of a sample that is free at its sides [E].
    poisson_ratios : (3, 3)
        ν_ij, the contraction along j by the extension along i under uniaxial stress along i [-]; NaN for i = j.
    shear_moduli : (3,)
        G_23, G_13, G_12 [E].
    anisotropy_ratio : float
        Zener's 2 G (1 + ν)/E [-], 1 if isotropic; NaN where the stiffness is not cubic.
    biot_tensor : (3, 3)
        Biot coefficients α [-].
    biot_modulus : float
        M_B [E], infinite without pores.
    storage : float
        1/M_B [1/E].
    consolidation_coefficients : (3,)
        c_v = K_ii/(1/M_B + α_ii²/C_iiii) of a layer that is compressed and drained along an axis
        [E d²/μ_c; m²/s in SI units].
    held_stress : (3, 3)
        Stress of a solid whose swelling is held [E], tension positive; 0 unless it swells.
    """

    porosity: float
    permeability: Array
    conductivity: Array
    stiffness_voigt: Array
    confined_moduli: Array
    young_moduli: Array
    poisson_ratios: Array
    shear_moduli: Array
    anisotropy_ratio: float
    biot_tensor: Array
    biot_modulus: float
    storage: float
    consolidation_coefficients: Array
    held_stress: Array

    @classmethod
    def of(cls, c: LinearCoefficients, porosity: float, viscosity: float) -> EffectiveProperties:
        """Return the properties that follow from the coefficients of a cell, its porosity and its viscosity [μ_c]."""
        C = np.array([[c.stiffness[*one, *other] for other in VOIGT] for one in VOIGT])
        S = np.linalg.inv((C + C.T) / 2)
        young = 1 / np.diag(S)[:3]
        poisson = -S[:3, :3] * young[:, None]
        np.fill_diagonal(poisson, np.nan)
        shear = 1 / np.diag(S)[3:]
        ratio = 2 * shear.mean() * (1 + np.nanmean(poisson)) / young.mean()
        storage = 0.0 if abs(c.storage) <= NO_STORAGE else c.storage
        confined = np.diag(C)[:3].copy()
        taken_up = storage + np.diag(c.biot) ** 2 / confined
        K = np.diag(c.conductivity)
        return cls(
            porosity,
            c.conductivity * viscosity,
            c.conductivity,
            C,
            confined,
            young,
            poisson,
            shear,
            float(ratio) if _is_cubic(C) else np.nan,
            c.biot,
            1 / storage if storage else np.inf,
            storage,
            np.divide(K, taken_up, out=np.zeros(3), where=taken_up > NO_STORAGE),
            c.stress,
        )

    @classmethod
    def of_flow(cls, porosity: float, conductivity: Array, viscosity: float) -> EffectiveProperties:
        """Return the properties of a cell of which the flow alone is known; the others are NaN."""
        none, of_axes, tensor = np.nan, np.full(3, np.nan), np.full((3, 3), np.nan)
        C = np.full((6, 6), np.nan)
        flow = (porosity, conductivity * viscosity, conductivity)
        return cls(
            *flow, C, of_axes, of_axes, tensor, of_axes, none, tensor, none, none, of_axes, np.zeros((3, 3))
        )

    @property
    def stiff(self) -> bool:
        """True where the stiffness is known."""
        return bool(np.isfinite(self.stiffness_voigt).all())

    @property
    def isotropy(self) -> Isotropy:
        """Class of the stiffness, equal numbers being those within :data:`SAME`."""
        if np.isnan(self.anisotropy_ratio):
            return "anisotropic"
        return "isotropic" if abs(self.anisotropy_ratio - 1) < SAME else "cubic"

    def in_units(self, units: ResultUnits | None = None, length: float | None = None) -> dict[str, Any]:
        """Return every property by its name, ready for JSON, as ``{"value", "unit", "dimensionless", "multiple_of"}``.

        Pure numbers have the unit ``1`` and no more. Without scales there is no ``value`` and no ``unit``, except for
        the permeability of a cell with a ``length`` [m]. Numbers that are not defined are None.
        """
        units = units or ResultUnits()
        found: dict[str, Any] = {}
        for name, quantity in PROPERTIES.items():
            given = np.asarray(getattr(self, name), dtype=float)
            if not quantity:
                found[name] = {"value": json_ready(given), "unit": "1"}
                continue
            found[name] = {"dimensionless": json_ready(given), "multiple_of": MULTIPLES[quantity]}
            if units.given:
                values = np.vectorize(lambda x, q=quantity: units.value(float(x), q), otypes=[float])(given)
                found[name] = {"value": json_ready(values), "unit": units.name(quantity)} | found[name]
            elif quantity == "permeability" and length is not None:
                found[name] = {"value": json_ready(given * length**2), "unit": "m²"} | found[name]
        return found


def _is_cubic(C: Array) -> bool:
    """Tell whether a stiffness (6, 6) is that of a cubic cell with its axes, to :data:`SAME`."""
    normal, mixed, shear = np.diag(C)[:3], C[np.triu_indices(3, 1)], np.diag(C)[3:]
    scale = float(np.abs(C).max())
    one = np.diag(np.r_[np.full(3, normal.mean()), np.full(3, shear.mean())])
    one[:3, :3][~np.eye(3, dtype=bool)] = mixed.mean()
    alike = all(np.ptp(each) <= SAME * np.abs(each).max() for each in (normal, shear))
    return bool(alike and np.abs(C - one).max() <= SAME * scale)
