"""Strain energy densities in UFL."""

from __future__ import annotations

import ufl

from porocore.cell.materials.neo_hookean import NeoHookean
from porocore_fem_dolfinx import compat
from porocore_fem_dolfinx.types import Expr, Mesh


def energy_density(material: NeoHookean, F: Expr, domain: Mesh) -> Expr:
    """Return Ψ(F); the material's constants can change without a new compilation."""
    mu, lam = (compat.constant(domain, value) for value in (material.mu, material.lam))
    log_J = ufl.ln(ufl.det(F))
    return mu / 2 * (ufl.tr(F.T * F) - 3) - mu * log_J + lam / 2 * log_J**2
