"""Cases of the cell: identities of its responses, derivatives, a cell without pores."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import porocore.testing.cell_laws.identities as identities
from porocore.cell.cell import Cell
from porocore.cell.geometry.kinds import NoPores
from porocore.cell.materials.neo_hookean import NeoHookean
from porocore.cell.meshing.mesh import MeshSettings
from porocore.interfaces.cell import CellSolver
from porocore.macro.laws.linear import LinearCoefficients
from porocore.states import Array, CellResponse, MacroState
from porocore.verification.crosscheck.cells import AVERAGES
from porocore.verification.ladder.case import Check, VerificationCase, relative_check

#: What is checked holds on every mesh.
MESH, FINE = MeshSettings(size=0.2, fluid_size=0.14), MeshSettings(size=0.1, fluid_size=0.1)
LINEAR = MeshSettings(size=0.2, fluid_size=0.14, element="linear")
#: On the eighth, and without any symmetry on the whole cell.
DIAGONAL = np.diag([0.02, -0.08, 0.03]), 0.05
GENERAL = np.array([[0.03, 0.08, -0.02], [0.01, -0.06, 0.04], [0.0, 0.05, 0.02]]), 0.08
STEP = 1e-3
#: Of exact identities, which only round-off and the solver's tolerance disturb; and of differences.
EXACT, DIFFERENCE = 1e-8, 1e-6


def at_rest(solver: CellSolver, long: bool) -> Sequence[Check]:
    """Linear coefficients and conductivity of the paper's cell."""
    material = NeoHookean()
    cell, nu = Cell(mesh=FINE if long else MESH, material=material), material.poisson_ratio
    prepared = solver.prepare(cell)
    rest = solver.solve(prepared, MacroState.zeros(1)).response
    K = solver.conductivity(solver.prepare(Cell(mesh=MESH, symmetry="none")))
    assert rest.tangent is not None
    assert rest.tangent.mean_grad_grad_u is not None
    assert rest.fluid_volume is not None
    porosity = float(rest.fluid_volume[0])
    linear = LinearCoefficients.from_reference(rest, 1 - porosity, material, K)
    values = np.linalg.eigvalsh((K + K.T) / 2)
    return [
        Check("Q_ii = (1 − 2ν)(M_2222 + 2 M_2211)", identities.uniform_pressure(rest.tangent, nu), EXACT),
        Check("φ_f I − I:M = φ_f I − C:Q", identities.biot_forms(linear), EXACT),
        relative_check(
            "Biot modulus −1/tr Q > 0",
            identities.biot_modulus(linear, porosity, nu),
            linear.biot_modulus,
            EXACT,
            note="reference: K_s/(α − φ_f)",
        ),
        Check("cubic symmetry of M", identities.cubic_symmetry(rest.tangent.mean_grad_grad_u[0]), EXACT),
        Check("K = Kᵀ", identities.misfit(K.T, K), EXACT),
        relative_check("smallest over largest eigenvalue of K", 1.0, float(values[0] / values[-1]), EXACT),
    ]


def derivatives(state: tuple[Array, float], solver: CellSolver, prepared: Any) -> list[Check]:
    """Tangents against differences, and the potential behind them."""
    H, p = state
    rng = np.random.default_rng(1)
    dH, dp = rng.normal(size=(3, 3)), float(rng.normal())
    if np.abs(H - np.diag(np.diag(H))).max() == 0:
        dH = np.diag(np.diag(dH))
    at = solver.solve(prepared, MacroState.single(H, p)).response
    around = [solver.solve(prepared, s).response for s in identities.stencil_states(H, p, dH, dp, STEP)]
    differences = identities.difference_quotients(around, STEP)
    assert at.tangent is not None
    checks = [
        Check(
            "dW = P_E:dH − φ dp (Hill–Mandel)"
            if name == "potential"
            else f"tangent of {AVERAGES[name]} = slope",
            identities.misfit(differences[name], slope),
            DIFFERENCE,
        )
        for name, slope in identities.linear_changes(at, dH, dp).items()
    ]
    return [
        *checks,
        Check("∂P_E/∂H has major symmetry", identities.major_symmetry(at.tangent), EXACT),
        Check("∂P_E/∂p = −∂φ/∂H", identities.reciprocity(at.tangent), EXACT),
    ]


def diagonal(solver: CellSolver, long: bool) -> Sequence[Check]:
    """Check a diagonal state on the eighth, in the long form on the whole cell."""
    return derivatives(DIAGONAL, solver, solver.prepare(Cell(mesh=MESH, symmetry="none" if long else "auto")))


def general(solver: CellSolver, long: bool) -> Sequence[Check]:
    """Check a general state on the whole cell, with a rotation."""
    prepared = solver.prepare(Cell(mesh=MESH if long else LINEAR))
    H, p = GENERAL
    R = Rotation.from_rotvec([0.3, -0.5, 0.7]).as_matrix()

    def solve(H: Array) -> CellResponse:
        return solver.solve(prepared, MacroState.single(H, p), tangent=False).response

    turned = identities.objectivity(solve(H), solve(R @ (np.eye(3) + H) - np.eye(3)), R)
    objective = [Check(f"objectivity of {AVERAGES[name]}", error, EXACT) for name, error in turned.items()]
    return [*objective, *derivatives(GENERAL, solver, prepared)]


def homogeneous(state: tuple[Array, float], solver: CellSolver, long: bool) -> Sequence[Check]:
    """⟨∇u¹⟩ = 0, P_E = P(I + H) whatever p is, no fluid, and K = 0."""
    cell = Cell(
        geometry=NoPores(kind="no-pores"),
        material=NeoHookean(),
        mesh=MeshSettings(size=0.15 if long else 0.3),
    )
    prepared = solver.prepare(cell)
    H, p = state
    found = solver.solve(prepared, MacroState.single(H, p)).response
    assert found.stress is not None
    assert found.fluid_volume is not None
    stress = NeoHookean().stress((np.eye(3) + H)[None])[0]
    return [
        Check("⟨∇u¹⟩ = 0, of H", float(np.abs(found.mean_grad).max() / np.abs(H).max()), EXACT),
        Check("P_E = P(I + H)", identities.misfit(found.stress[0], stress), EXACT),
        Check("φ = 0", float(abs(found.fluid_volume[0])), EXACT),
        Check("K = 0", float(np.abs(solver.conductivity(prepared)).max()), EXACT),
    ]


HOMOGENEOUS = VerificationCase(
    "homogeneous",
    "Cell without pores",
    "the material's own law",
    "cell solver",
    {
        "diagonal H": partial(homogeneous, (np.diag([0.1, -0.2, 0.05]), 0.3)),
        "general H": partial(homogeneous, (np.array([[0.1, 0.2, 0], [0, -0.15, 0.05], [0, 0, 0.1]]), 0.3)),
    },
)
IDENTITIES = VerificationCase(
    "identities",
    "Identities of the cell",
    "Dehghani & Zilian 2022; reciprocity, objectivity, Hill–Mandel",
    "cell solver",
    {"at rest": at_rest, "diagonal H": diagonal, "general H": general},
)
