"""The u–p solver: the conformance suite, and scikit-fem's own."""

import numpy as np
import pytest
from skfem import ElementHex1, ElementHex2, FacetBasis, MeshHex

from porocore.macro.boundary.conditions import boundary_data
from porocore.macro.problem import body_mesh
from porocore.testing.synthetic.response import confined_column
from porocore_fem_skfem.conformance import TestSkfemMacroSolver
from porocore_fem_skfem.macro import SkfemMacroSolver

__all__ = ["TestSkfemMacroSolver"]


def test_unknown_options_are_refused():
    with pytest.raises(TypeError, match="wavelets"):
        SkfemMacroSolver(wavelets=True)


def test_the_loads_on_nodes_are_those_that_scikit_fem_integrates():
    """Traction and flux on a face that is neither square nor evenly divided."""
    boundary = {
        "x-": {"displacement": (0, 0, 0)},
        "y+": {"traction": (0.3, -1, 0.2), "flux": 0.7},
    }
    problem = confined_column((2, 1, 3), size=(1, 2, 1.5), boundary=boundary)
    mesh = body_mesh(problem)
    found = boundary_data(mesh, problem).external[0]
    axes = [np.linspace(0, size, n + 1) for size, n in zip((1, 2, 1.5), (2, 1, 3), strict=True)]
    theirs = MeshHex.init_tensor(*axes)
    facets = theirs.facets_satisfying(lambda x: x[1] == 2, boundaries_only=True)
    for element, expected, places in (
        (ElementHex2(), -found[: mesh.n_u].reshape(-1, 3) @ [0, -1, 0], mesh.points),
        (ElementHex1(), found[mesh.n_u :] / 0.7, mesh.points[mesh.p_nodes]),
    ):
        basis = FacetBasis(theirs, element, facets=facets, intorder=5)
        areas = sum(
            np.bincount(
                basis.element_dofs[a], (np.asarray(basis.basis[a][0]) * basis.dx).sum(axis=1), basis.N
            )
            for a in range(basis.Nbfun)
        )
        nodes = mesh.node_at(basis.doflocs.T)
        mine = np.zeros(len(mesh.points))
        mine[mesh.node_at(places)] = expected
        np.testing.assert_allclose(mine[nodes], areas, atol=1e-15)
        assert areas.sum() == pytest.approx(1.5)
