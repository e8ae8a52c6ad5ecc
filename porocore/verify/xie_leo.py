"""Large-strain consolidation of a clay layer (Xie & Leo 2004): closed form, the clay as a law, and the layer.

A saturated layer is drained on top and loaded by q at t = 0 beyond the load and the self-weight under which it rests.
In the Lagrangian coordinate a, the depth below the surface before q, the paper has

- a constant coefficient of volume compressibility, m = −de/dσ′/(1 + e), so that J = (1 + e)/(1 + e₀) = exp(−m Δσ′),
- a permeability k = k₀ J², and incompressible water and grains.

With u the excess over the pressure at rest, Δσ′ = q − u, for self-weight and buoyancy do not change. The flow of water
relative to the grains is (k₀ J²/γ_w) (1/J) ∂u/∂a through reference area, and ∂J/∂a = m J ∂u/∂a, so

    ∂J/∂t = c ∂²J/∂a²   with c = k₀/(m γ_w):

linear diffusion from J = 1 to J = exp(−m q). The void ratio e₀(a), which self-weight makes depend on depth, drops out
of J, settlement and pressure; it is needed only to tell e.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.special import roots_legendre

from porocore.cell.material import cofactor, cofactor_tangent, determinant
from porocore.interfaces.macro import MacroSolver
from porocore.laws import LawMemory, MacroLaw, MacroResponse, MacroTangent, fingerprint
from porocore.problem import MacroProblem
from porocore.solution import MacroSolution
from porocore.states import Array, MacroState
from porocore.terzaghi import Terzaghi
from porocore.verify.case import Case, Check, number, observed_order

#: Time [s] → degree of consolidation by settlement, by pressure, and settlement [m]; of the layer :data:`PAPERS`.
PUBLISHED = {6.3496e8: (0.449463, 0.414164, 1.481789), 1.4775e9: (0.674157, 0.634112, 2.222560)}
ALLOWED = 0.01


@dataclass(frozen=True)
class XieLeo:
    """The layer, drained on top, impermeable below (PTIB in the paper), in closed form.

    Attributes
    ----------
    load
        q, sudden [kPa].
    height
        H before the load [m].
    permeability
        k₀ [m/s].
    compressibility
        m [1/kPa].
    unit_weight
        γ_w [kN/m³].
    preload
        On the surface before q [kPa].
    void_ratio
        e₀ at the surface.
    specific_gravity
        Of the grains.
    """

    load: float = 100.0
    height: float = 10.0
    permeability: float = 1e-9
    compressibility: float = 4e-3
    unit_weight: float = 10.0
    preload: float = 10.0
    void_ratio: float = 3.0
    specific_gravity: float = 2.75

    @property
    def final_stretch(self) -> float:
        """J at last, exp(−m q)."""
        return float(np.exp(-self.compressibility * self.load))

    @property
    def final_settlement(self) -> float:
        """Of the surface [m]."""
        return self.height * (1 - self.final_stretch)

    @property
    def conductivity(self) -> float:
        """k₀/γ_w [m²/(kPa s)]."""
        return self.permeability / self.unit_weight

    @property
    def _diffusion(self) -> Terzaghi:
        """J falls from 1 to its last value as the pressure does in a linear layer of modulus 1/m and load 1."""
        return Terzaghi(self.height, 1.0, 1 / self.compressibility, 1.0, 0.0, self.conductivity)

    def stretch(self, depth: npt.ArrayLike, t: float) -> Array:
        """J = (1 + e)/(1 + e₀) at depths a and one time."""
        y = self.height - np.asarray(depth, dtype=float)
        last = self.final_stretch
        stretch: Array = last + (1 - last) * self._diffusion.pressure(y, t)
        return stretch

    def pressure(self, depth: npt.ArrayLike, t: float) -> Array:
        """u, the excess pore pressure at depths a and one time [kPa]."""
        pressure: Array = self.load + np.log(self.stretch(depth, t)) / self.compressibility
        return pressure

    def settlement(self, t: npt.ArrayLike) -> Array:
        """Of the surface, positive downwards; the shape of ``t`` [m]."""
        settlement: Array = self.final_settlement * self._diffusion.degree(t)
        return settlement

    def degree_by_pressure(self, t: float) -> float:
        """1 − mean of u over a, of the load; by Gauss's rule on 40 parts."""
        x, weights = roots_legendre(10)
        edges = np.linspace(0, self.height, 41)
        a = (edges[:-1, None] + (x + 1) / 2 * np.diff(edges)[:, None]).ravel()
        mean = float(np.tile(weights, 40) @ self.pressure(a, t)) / 80
        return 1 - mean / self.load

    def initial_void_ratio(self, depth: npt.ArrayLike) -> Array:
        """e₀(a) under preload and self-weight."""
        submerged = self.unit_weight * (self.specific_gravity - 1)
        ratio: Array = self.void_ratio - self.compressibility * submerged * np.asarray(depth, dtype=float)
        return ratio


class ClayLaw(MacroLaw):
    """The clay at finite strain: isotropic and hyperelastic, in uniaxial motion as the paper has it.

    With J = det F, and G a shear modulus that uniaxial motion does not feel::

        Ψ = G/2 (tr FᵀF − 3) − G ln J + h(J),   h′ = (ln J)/m − G (J − 1/J)
        P_E = ∂Ψ/∂F − p cof F,   Δstorage = ΔJ,   q = −(k₀/γ_w) J³ F⁻¹F⁻ᵀ ∇_X p

    so that P_E,22 = (ln J)/m − p in uniaxial motion. H and p are counted from rest.

    Parameters
    ----------
    layer
        m and k₀/γ_w are taken from it.
    shear
        G in units of 1/m; below 1/2 the law is stable at rest.
    """

    name = "xie-leo"

    def __init__(self, layer: XieLeo, shear: float = 0.3) -> None:
        self.m, self.k = layer.compressibility, layer.conductivity
        self.G = shear / self.m
        self.identity = fingerprint(self.name, self.m, self.k, self.G)

    def initial(self, n: int) -> LawMemory:
        """At rest; the fluid volume is counted as J."""
        return LawMemory(MacroState.zeros(n), np.zeros((n, 3, 3)), np.ones(n))

    def respond(
        self, states: MacroState, grad_p: Array, memory: LawMemory, *, tangent: bool = True
    ) -> MacroResponse:
        """See :class:`~porocore.laws.MacroLaw`; NaN where det F ≤ 0."""
        assert memory.fluid_volume is not None
        n = len(states)
        F = np.eye(3) + states.grad_u
        J = determinant(F)
        J = np.where(J > 0, J, np.nan)
        cof = np.ascontiguousarray(cofactor(F))
        # ∂Ψ/∂F = G F + s cof F
        s = np.log(J) / self.m - self.G * J
        # cofᵀcof = J² F⁻¹F⁻ᵀ
        pulled = self.k * J[:, None, None] * (cof.swapaxes(1, 2) @ cof)
        flux = -(pulled @ grad_p[:, :, None])[..., 0]
        return MacroResponse(
            stress=self.G * F + (s - states.p)[:, None, None] * cof,
            storage=J - memory.fluid_volume,
            flux=flux,
            memory=LawMemory(states, np.zeros((n, 3, 3)), J),
            deformation=F,
            volume_ratio=J,
            transformed_conductivity=pulled / J[:, None, None],
            outside=np.zeros(n, bool),
            tangent=self._tangent(states, grad_p, F, J, cof, s, pulled, flux) if tangent else None,
        )

    def _tangent(
        self,
        states: MacroState,
        grad_p: Array,
        F: Array,
        J: Array,
        cof: Array,
        s: Array,
        pulled: Array,
        flux: Array,
    ) -> MacroTangent:
        n = len(J)
        cof_F, row = cofactor_tangent(F).reshape(n, 9, 9), cof.reshape(n, 1, 9)
        by_J = 1 / (self.m * J) - self.G
        stress = self.G * np.eye(9) + (s - states.p)[:, None, None] * cof_F
        stress = stress + by_J[:, None, None] * (row.swapaxes(1, 2) @ row)
        # q = −k J cofᵀ cof ∇p: first by cof, then by J.
        turned = (cof @ grad_p[:, :, None])[..., 0]
        direct = np.einsum("ib,na->niab", np.eye(3), turned) + np.einsum("nai,nb->niab", cof, grad_p)
        flux_F = -self.k * J[:, None, None] * (direct.reshape(n, 3, 9) @ cof_F)
        flux_F = flux_F + (flux / J[:, None])[:, :, None] * row
        return MacroTangent(
            stress_grad_u=stress.reshape(n, 3, 3, 3, 3),
            stress_p=-cof,
            storage_grad_u=cof,
            storage_p=np.zeros(n),
            flux_grad_u=flux_F.reshape(n, 3, 3, 3),
            flux_p=np.zeros((n, 3)),
            flux_grad_p=-pulled,
        )


def column(layer: XieLeo, elements: int, steps: int, times: Sequence[float]) -> MacroProblem:
    """The layer as a column of one element's width that is loaded at once; fields are kept at the times."""
    end = times[-1]
    side: dict[str, Any] = {"displacement": (0, None, 0)}
    return MacroProblem.model_validate(
        {
            "size": (1, layer.height, 1),
            "elements": (1, elements, 1),
            "boundary": {
                **dict.fromkeys(("x-", "x+", "z-", "z+"), side),
                "y-": {"displacement": (0, 0, 0)},
                "y+": {"traction": (0, 1, 0), "pressure": 0},
            },
            "load": -layer.load,
            "time": {
                "end": end,
                "step": end / steps,
                "ramp_increments": 1,
                "ramp_step": 1e-6 * end / steps,
                "smallest_step": 1e-9 * end / steps,
                "profiles": tuple(times[:-1]),
            },
        }
    )


def mean_pressure(solution: MacroSolution, profile: int) -> float:
    """Mean of p over a, by the trapezoidal rule: between the corners of the elements p is linear."""
    y, first = np.unique(np.round(solution.points[:, 1], 9), return_index=True)
    p = solution.profiles[profile].p[first]
    return float(((p[1:] + p[:-1]) / 2 @ np.diff(y)) / y[-1])


def closed_form(solver: MacroSolver, long: bool) -> Sequence[Check]:
    """The published numbers against the closed form, to the digits that are published; no solver is asked."""
    layer, checks = XieLeo(), []
    for t, (by_settlement, by_pressure, settlement) in PUBLISHED.items():
        ours = float(layer.settlement(t))
        degree = ours / layer.final_settlement
        # The times are published with five digits, so the numbers are good for some 1e-5.
        checks += [
            number(f"U_s, {t:.5g} s", by_settlement, degree, 1e-4),
            number(f"U_p, {t:.5g} s", by_pressure, layer.degree_by_pressure(t), 1e-4),
            number(f"settlement [m], {t:.5g} s", settlement, ours, 1e-4),
        ]
    return checks


def layer_of_clay(solver: MacroSolver, long: bool) -> Sequence[Check]:
    """The column against the published numbers, and against the closed form over its history."""
    layer, law, times = XieLeo(), ClayLaw(XieLeo()), tuple(PUBLISHED)
    runs = (100, 200, 400) if long else (50, 100)
    elements = 40 if long else 20
    solutions = [solver.solve(solver.prepare(column(layer, elements, n, times)), law) for n in runs]
    errors = [_history_error(layer, solution) for solution in solutions]
    order = observed_order([1 / n for n in runs], errors, exact=0.0)
    last, checks = solutions[-1], []
    for i, (t, (by_settlement, by_pressure, settlement)) in enumerate(PUBLISHED.items()):
        found = -float(last.profiles[i].u[:, 1].min())
        degree = 1 - mean_pressure(last, i) / layer.load
        checks += [
            number(f"U_s, {t:.5g} s", by_settlement, found / layer.final_settlement, ALLOWED),
            number(f"U_p, {t:.5g} s", by_pressure, degree, ALLOWED),
            number(f"settlement [m], {t:.5g} s", settlement, found, ALLOWED),
        ]
        depth = layer.height - last.points[:, 1]
        error = float(np.abs(last.profiles[i].p - layer.pressure(depth, t)).max() / layer.load)
        checks.append(Check(f"pressure anywhere, of the load, {t:.5g} s", error, ALLOWED))
    quantity = "settlement from a tenth of the time on, of the last"
    return [*checks, Check(quantity, errors[-1], ALLOWED, order=order)]


def _history_error(layer: XieLeo, solution: MacroSolution) -> float:
    """At first the settlement is as the root of time, which no time steps resolve."""
    history = solution.history
    later = history.time >= 0.1 * history.time[-1]
    exact = layer.settlement(history.time[later])
    return float(np.abs(history.settlement[later] - exact).max() / layer.final_settlement)


CASE = Case(
    "xie-leo",
    "Large-strain consolidation of clay",
    "Xie & Leo 2004, Comput. Geotech. 31, 301–314",
    "macro solver",
    {"closed form": closed_form, "layer": layer_of_clay},
)
