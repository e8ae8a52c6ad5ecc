"""Case of large-strain consolidation by Xie & Leo, and the clay's law that it needs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from porocore.commands.verify.case import Check, VerificationCase, observed_order, relative_check
from porocore.core.tensors import cofactor, cofactor_tangent, determinant
from porocore.interfaces.law import Interval, LawMemory, MacroLaw, MacroResponse, MacroTangent, fingerprint
from porocore.interfaces.macro import MacroSolver
from porocore.interfaces.solution import MacroSolution
from porocore.macro.analytic import XieLeo
from porocore.macro.problem import MacroProblem
from porocore.states import Array, MacroState
from porocore.testing.synthetic.response import confined_column


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
        """Return the state at rest; the fluid volume is counted as J."""
        return LawMemory.forgetful(MacroState.zeros(n), np.ones(n))

    def respond(
        self,
        states: MacroState,
        grad_p: Array,
        memory: LawMemory,
        *,
        step: Interval | None = None,
        tangent: bool = True,
    ) -> MacroResponse:
        """See :class:`~porocore.interfaces.law.MacroLaw`; NaN where det F ≤ 0."""
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
        slopes = None
        if tangent:
            cof_F, row = cofactor_tangent(F).reshape(n, 9, 9), cof.reshape(n, 1, 9)
            by_J = 1 / (self.m * J) - self.G
            stress = self.G * np.eye(9) + (s - states.p)[:, None, None] * cof_F
            stress = stress + by_J[:, None, None] * (row.swapaxes(1, 2) @ row)
            # q = −k J cofᵀ cof ∇p: first by cof, then by J.
            turned = (cof @ grad_p[:, :, None])[..., 0]
            direct = np.einsum("ib,na->niab", np.eye(3), turned) + np.einsum("nai,nb->niab", cof, grad_p)
            flux_F = -self.k * J[:, None, None] * (direct.reshape(n, 3, 9) @ cof_F)
            flux_F = flux_F + (flux / J[:, None])[:, :, None] * row
            slopes = MacroTangent(
                stress_grad_u=stress.reshape(n, 3, 3, 3, 3),
                stress_p=-cof,
                storage_grad_u=cof,
                storage_p=np.zeros(n),
                flux_grad_u=flux_F.reshape(n, 3, 3, 3),
                flux_p=np.zeros((n, 3)),
                flux_grad_p=-pulled,
            )
        return MacroResponse(
            stress=self.G * F + (s - states.p)[:, None, None] * cof,
            storage=J - memory.fluid_volume,
            flux=flux,
            memory=LawMemory.forgetful(states, J),
            deformation=F,
            volume_ratio=J,
            transformed_conductivity=pulled / J[:, None, None],
            mean_grad=np.zeros((n, 3, 3)),
            cell_p=states.p,
            doubt=np.zeros(n, np.int64),
            tangent=slopes,
        )


#: Time [s] → degree of consolidation by settlement, by pressure, and settlement [m] of the paper's layer.
PUBLISHED = {6.3496e8: (0.449463, 0.414164, 1.481789), 1.4775e9: (0.674157, 0.634112, 2.222560)}
ALLOWED = 0.01


def column(layer: XieLeo, elements: int, steps: int, times: Sequence[float]) -> MacroProblem:
    """The layer as a column of one element's width that is loaded at once; fields are kept at the times."""
    end = times[-1]
    plan = {
        "end": end,
        "step": end / steps,
        "ramp_increments": 1,
        "ramp_step": 1e-6 * end / steps,
        "smallest_step": 1e-9 * end / steps,
        "profiles": tuple(times[:-1]),
    }
    return confined_column(elements, load=-layer.load, size=(1, layer.height, 1), time=plan)


def mean_pressure(solution: MacroSolution, profile: int) -> float:
    """Mean of p over a, by the trapezoidal rule: between the corners of the elements p is linear."""
    y, first = np.unique(np.round(solution.points[:, 1], 9), return_index=True)
    p = solution.after_rest[profile].p[first]
    return float(((p[1:] + p[:-1]) / 2 @ np.diff(y)) / y[-1])


def closed_form(solver: MacroSolver, long: bool) -> Sequence[Check]:
    """The published numbers against the closed form, to the digits that are published; no solver is asked."""
    layer, checks = XieLeo(), []
    for t, (by_settlement, by_pressure, settlement) in PUBLISHED.items():
        ours = float(layer.settlement(t))
        degree = ours / layer.final_settlement
        # The times are published with five digits, so the numbers are good for some 1e-5.
        checks += [
            relative_check(f"U_s, {t:.5g} s", by_settlement, degree, 1e-4),
            relative_check(f"U_p, {t:.5g} s", by_pressure, layer.degree_by_pressure(t), 1e-4),
            relative_check(f"settlement [m], {t:.5g} s", settlement, ours, 1e-4),
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
        found = -float(last.after_rest[i].u[:, 1].min())
        degree = 1 - mean_pressure(last, i) / layer.load
        checks += [
            relative_check(f"U_s, {t:.5g} s", by_settlement, found / layer.final_settlement, ALLOWED),
            relative_check(f"U_p, {t:.5g} s", by_pressure, degree, ALLOWED),
            relative_check(f"settlement [m], {t:.5g} s", settlement, found, ALLOWED),
        ]
        depth = layer.height - last.points[:, 1]
        error = float(np.abs(last.after_rest[i].p - layer.pressure(depth, t)).max() / layer.load)
        checks.append(Check(f"pressure anywhere, of the load, {t:.5g} s", error, ALLOWED))
    quantity = "settlement from a tenth of the time on, of the last"
    return [*checks, Check(quantity, errors[-1], ALLOWED, order=order)]


def _history_error(layer: XieLeo, solution: MacroSolution) -> float:
    """Return the error after a tenth of the time; no time step resolves the initial root of time."""
    history = solution.history
    later = history.time >= 0.1 * history.time[-1]
    exact = layer.settlement(history.time[later])
    return float(np.abs(history.settlement[later] - exact).max() / layer.final_settlement)


CASE = VerificationCase(
    "xie-leo",
    "Xie & Leo 2004, Comput. Geotech. 31, 301–314",
    "macro solver",
    {"closed form": closed_form, "layer": layer_of_clay},
)
