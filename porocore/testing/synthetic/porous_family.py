"""Made-up family of porous cells in closed form, training sets of it, its law (PorousFamilyLaw).

With the radius r of three channels, φ_f = 3π r² − 8√2 r³, and moduli K_d, G_d close to the bounds of Hashin and
Shtrikman for the solid of K_s(ν), G_s(ν), Fₚ = F exp(p/(3 K_s)) and E = (FₚᵀFₚ − I)/2

    w = G_d/2 (tr FₚᵀFₚ − 3) − G_d ln Jₚ + (K_d − 2/3 G_d)/2 (ln Jₚ)² + ½ b Σ E_ii² + c p Σ_{i<j} E_ij²
        − p (J − φ_s) − φ_s p²/(2 K_s),
    <∇u¹> = F (k₁ E + k₂ tr E I + k₃ diag E + k₄ p I),   K_ref = r⁴ (1 + 8 r) Jᵃ F⁻¹F⁻ᵀ exp(2 p),

with k such that <∇u¹> at rest is that of an isotropic solid with this stiffness,
so that Biot's identities hold at rest; with the modulus and the swelling stretch of the whole solid as in
:mod:`porocore.surrogates.family.derivatives`, and a viscosity. All derivatives are complex steps, exact to round-off.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from porocore.core.inputs import InputSpace
from porocore.core.tensors import CUBIC
from porocore.interfaces.law import CellLaw, UndeformedCells
from porocore.interfaces.records import ParameterKind, RestData
from porocore.interfaces.surrogate import TrainingSet
from porocore.states import Array, CellResponse, CellSlopes, MacroState
from porocore.testing.expect import STEPS, central_difference
from porocore.testing.synthetic.response import by_state, complex_steps, respond_by

Numbers = npt.NDArray[np.complex128]
#: Parameters that there are, with their values where they are none.
DEFAULTS = {"radius": 0.22, "poisson_ratio": 0.3, "modulus": 1.0, "swelling": 1.0, "viscosity": 1.0}
KINDS: dict[str, ParameterKind] = {
    "radius": "length",
    "poisson_ratio": "poisson_ratio",
    "modulus": "modulus",
    "swelling": "swelling",
    "viscosity": "viscosity",
}
#: Radius and Poisson's ratio, and strains and pressures in confined compression.
PARAMETERS = {"radius": (0.15, 0.3), "poisson_ratio": (0.2, 0.45)}
INPUTS = InputSpace.from_ranges({"H22": (-0.12, 0.04), "p": (0.0, 0.1)}, PARAMETERS)
IDENTITY = "porous-family-1"


def porosity(radius: Any) -> Any:
    """Return φ_f of three channels."""
    return 3 * np.pi * radius**2 - 8 * np.sqrt(2) * radius**3


def respond(states: MacroState, names: tuple[str, ...] = tuple(PARAMETERS)) -> CellResponse:
    """Return all responses of n states with their parameters, derivatives and slopes.

    Parameters
    ----------
    states
        States whose parameters (n, m) have these ``names``.
    """
    return respond_by(partial(values_at, names=names), states, hidden=("porosity",))


def undeformed_conductivity(at: dict[str, Any], n: int) -> Any:
    """Return K (n,) of the undeformed cells."""
    r = at["radius"]
    return np.broadcast_to(np.asarray(r**4 * (1 + 8 * r) / at["viscosity"]), n)


def rest_data(k: int = 20, inputs: InputSpace = INPUTS, *, slopes: bool = True) -> RestData:
    """Return k undeformed members, spread over the ranges of the parameters."""
    names = inputs.parameters
    theta = _spread(k, inputs.parameter_ranges)
    stretch = theta[:, names.index("swelling")] if "swelling" in names else np.ones(k)
    states = MacroState((stretch - 1)[:, None, None] * np.eye(3), np.zeros(k), theta)
    found = respond(states, names)
    assert found.conductivity is not None
    assert found.slopes is not None
    assert found.slopes.conductivity is not None
    # The conductivity of the pores before they swell.
    by = stretch[:, None, None] ** 3
    reference = found.slopes.conductivity / by[..., None]
    if "swelling" in names:
        reference[..., names.index("swelling")] = 0.0
    slopes_of = replace(found.slopes, conductivity=reference)
    found = replace(found, conductivity=found.conductivity / by, slopes=slopes_of)
    radius = theta[:, names.index("radius")] if "radius" in names else np.full(k, DEFAULTS["radius"])
    return RestData(
        states,
        found,
        porosity(radius),
        tuple(KINDS[name] for name in names),
        "modulus" if "modulus" in names else 1.0,
        "poisson_ratio" if "poisson_ratio" in names else DEFAULTS["poisson_ratio"],
        hessian_slopes(partial(respond, names=names), states) if slopes else None,
    )


def porous_training_set(
    n: int = 40, seed: int = 0, inputs: InputSpace = INPUTS, *, tolerance: float | None = None
) -> TrainingSet:
    """Return ``n`` states, uniform at random in the box of ``inputs`` by ``seed``, and undeformed members."""
    low, high = np.array(inputs.lower), np.array(inputs.upper)
    states = inputs.scatter(low + (high - low) * np.random.default_rng(seed).random((n, len(inputs))))
    rests = rest_data(20, inputs)
    reference = respond(
        MacroState.zeros(1).with_parameters(inputs.parameter_ranges.mean(axis=1)), inputs.parameters
    )
    found = respond(states, inputs.parameters)
    return TrainingSet(states, found, inputs, reference, IDENTITY, {}, CUBIC, tolerance, rests)


def _spread(k: int, ranges: Array) -> Array:
    """Return points (k, m) of the ranges (m, 2), denser towards their ends."""
    from scipy.stats import qmc  # slow to import

    unit = (1 - np.cos(np.pi * qmc.Halton(len(ranges), seed=3).random(k))) / 2
    spread: Array = ranges[:, 0] + (ranges[:, 1] - ranges[:, 0]) * unit
    return spread


def with_defaults(z: Any, names: tuple[str, ...]) -> dict[str, Any]:
    """Return the parameters (n,) by name at z (n, 10 + m), and those that are not named."""
    return DEFAULTS | {name: z[:, 10 + k] for k, name in enumerate(names)}


def values_at(z: Any, names: tuple[str, ...]) -> dict[str, Any]:
    """Return W, P_E, φ, <∇u¹>, K_ref and φ_f at z (n, 10 + m): H row by row, p and the parameters."""
    at, n = with_defaults(z, names), len(z)
    r, nu, young, stretch, viscosity = (np.broadcast_to(at[name], n).astype(complex) for name in DEFAULTS)
    s2 = stretch[:, None, None]
    F, p = (np.eye(3) + z[:, :9].reshape(n, 3, 3)) / s2, z[:, 9] / young
    W, P, volume = _potential(F, p, porosity(r), nu)
    E = (F.swapaxes(1, 2) @ F - np.eye(3)) / 2
    k1, k2, k3, k4 = _mean_coefficients(porosity(r), nu)
    eye, trace = np.eye(3), np.trace(E, axis1=1, axis2=2)
    G = k1[:, None, None] * E + k3[:, None, None] * E * eye + (k2 * trace + k4 * p)[:, None, None] * eye
    G = F @ G
    inverse, J = np.linalg.inv(F), np.linalg.det(F)
    K = r**4 * (1 + 8 * r) * J ** (3 + 4 * r) * np.exp(2 * p) / viscosity * stretch**3
    return {
        "potential": young * stretch**3 * W,
        "stress": (young * stretch**2)[:, None, None] * P,
        "fluid_volume": stretch**3 * volume,
        "mean_grad": s2 * G,
        "conductivity": K[:, None, None] * inverse @ inverse.swapaxes(1, 2),
        "porosity": porosity(r),
    }


def _moduli(phi: Numbers, nu: Numbers) -> tuple[Numbers, ...]:
    """Return K_s, G_s, K_d, G_d and b."""
    K, G = 1 / (3 * (1 - 2 * nu)), 1 / (2 * (1 + nu))
    Kd = (1 - 0.4 * phi) / (1 / K + phi * (3 / (4 * G) + 1 / K) / (1 - phi))
    Gd = (1 - 0.6 * phi) * G * (1 - phi) / (1 + 6 * phi * (K + 2 * G) / (9 * K + 8 * G))
    return K, G, Kd, Gd, -0.1 * phi * G


def _mean_coefficients(phi: Numbers, nu: Numbers) -> tuple[Numbers, ...]:
    """Return k₁ … k₄: the mean strain of the solid by the mean stress less φ_s E, and its answer to p."""
    K, G, Kd, Gd, b = _moduli(phi, nu)
    volume = 1 / (9 * K) - 1 / (6 * G)
    k1, k3 = Gd / G - (1 - phi), b / (2 * G)
    k2 = (Kd - 2 / 3 * Gd) / (2 * G) + (3 * Kd + b) * volume
    return k1, k2, k3, (k1 + 3 * k2 + k3) / (3 * K)


def _potential(F: Numbers, p: Numbers, phi: Numbers, nu: Numbers) -> tuple[Numbers, Numbers, Numbers]:
    """Return w (n,), ∂w/∂F (n, 3, 3) and −∂w/∂p (n,)."""
    K, _, Kd, Gd, b = _moduli(phi, nu)
    c, lam, pb = 0.5 * phi, Kd - 2 / 3 * Gd, p[:, None, None]
    t2 = np.exp(p / (3 * K))[:, None, None]
    X = F * t2
    inverse, log_J = np.linalg.inv(X).swapaxes(1, 2), np.log(np.linalg.det(X))
    E = (X.swapaxes(1, 2) @ X - np.eye(3)) / 2
    d = np.einsum("nii->ni", E)
    shear = E * (1 - np.eye(3))
    J = np.linalg.det(F)
    W = Gd / 2 * (np.einsum("nij,nij->n", X, X) - 3) - Gd * log_J + lam / 2 * log_J**2
    W = W + b / 2 * (d**2).sum(axis=1) + c / 2 * p * np.einsum("nij,nij->n", shear, shear)
    W = W - p * (J - (1 - phi)) - (1 - phi) * p**2 / (2 * K)
    by_E = b[:, None, None] * E * np.eye(3) + (c * p)[:, None, None] * shear
    by_X = Gd[:, None, None] * (X - inverse) + (lam * log_J)[:, None, None] * inverse + X @ by_E
    cof = J[:, None, None] * np.linalg.inv(F).swapaxes(1, 2)
    volume = J - (1 - phi) + (1 - phi) * p / K - np.einsum("nij,nij->n", by_X, X) / (3 * K)
    volume = volume - c / 2 * np.einsum("nij,nij->n", shear, shear)
    return W, by_X * t2 - pb * cof, volume


def hessian_slopes(respond: Callable[[MacroState], CellResponse], states: MacroState) -> Array:
    """Return the slopes (n, 10, 10, m) of ∂²W/∂(H, p)² of a made-up family, by central differences of fourth order."""

    def hessian(k: int, step: Array) -> Any:
        theta: Any = np.array(states.parameters)
        theta[:, k] += step
        return vars(respond(states.with_parameters(theta)))["tangent"].hessian

    found = []
    for k in range(states.parameter_count):
        h = 1e-4 * np.array(states.parameters)[:, k]
        found.append(central_difference((hessian(k, step * h) for step in STEPS), h[:, None, None]))
    return np.stack(found, axis=-1)


class PorousFamilyLaw(CellLaw):
    """Law of the family in closed form, with the parameters that are named; the others have their usual values.

    Parameters
    ----------
    parameters
        Names.
    deformed
        Predict the conductivity of the deformed pore, too.
    """

    identity = IDENTITY

    def __init__(self, *parameters: str, deformed: bool = False) -> None:
        self.parameters, self.deformed = parameters, deformed

    def predict(self, states: MacroState, *, tangent: bool = True) -> CellResponse:
        """Return the responses with their derivatives."""
        hidden = ("porosity",) if self.deformed else ("porosity", "conductivity")
        states = self._named(states)
        found = replace(respond_by(self._values, states, hidden=hidden, tangent=tangent), slopes=None)
        if not self.deformed or found.tangent is None:
            return found
        by_H, by_p = by_state(complex_steps(self._values, states)["conductivity"])
        return replace(found, tangent=replace(found.tangent, conductivity_grad_u=by_H, conductivity_p=by_p))

    def slopes(self, states: MacroState) -> CellSlopes:
        """Return the derivatives by the parameters."""
        found = respond(self._named(states), self.parameters).slopes
        assert found is not None
        if self.deformed:
            return found

        def undeformed(z: Any) -> dict[str, Any]:
            return {"K": undeformed_conductivity(with_defaults(z, self.parameters), len(z))}

        K = complex_steps(undeformed, self._named(states))["K"]
        return replace(found, conductivity=K[:, None, None, 10:] * np.eye(3)[..., None])

    def _values(self, z: Any) -> dict[str, Any]:
        return values_at(z, self.parameters)

    @staticmethod
    def _named(states: MacroState) -> MacroState:
        """Return the states with parameters, none of which there may be."""
        return states if states.parameters is not None else states.with_parameters(np.zeros(0))

    def undeformed(self, parameters: Array) -> UndeformedCells:
        """Return φ_f, and K before the solid swells."""
        at: dict[str, Any] = {**DEFAULTS, **dict(zip(self.parameters, parameters.T, strict=True))}
        r, n = at["radius"], len(parameters)
        K = undeformed_conductivity(at, n)
        return UndeformedCells(np.broadcast_to(np.asarray(porosity(r)), n), K[:, None, None] * np.eye(3))
