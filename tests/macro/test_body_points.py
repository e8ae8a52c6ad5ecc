"""States at the quadrature points of a body, from the values at its nodes."""

import numpy as np
import pytest

from porocore.macro.body.kinds import Box, point_states
from porocore.macro.problem import MacroProblem
from porocore.plugins import registry
from porocore.testing.macro_checks.bodies import write_tetrahedra


@pytest.mark.parametrize("body", ["box", "wedge", "file"])
def test_states_at_the_points_are_those_of_the_law(body, tmp_path):
    """Of a field of random values at the nodes, as the macro solver sees it."""
    settings = {
        "box": {"size": (1.0, 2.0, 1.5), "elements": (1, 2, 1)},
        "wedge": {"radius": 1, "height": 0.7, "elements": (1, 1, 1), "angle": 60},
        "file": {"path": str(tmp_path / "body.msh")},
    }
    write_tetrahedra(tmp_path / "body.msh", Box(size=(1.0, 2.0, 1.5), elements=(1, 1, 1)), bend=0.03)
    problem = {"body": {"kind": body} | settings[body], "boundary": {"y-": {"displacement": (0, 0, 0)}}}
    d = registry.get("macro solver", "skfem")().prepare(MacroProblem.model_validate(problem))
    x, mesh = np.random.default_rng(1).random(d.mesh.size), d.mesh
    whole, u, p = d.states(x)[0], x[: mesh.n_u].reshape(-1, 3), mesh.pressure_everywhere(x[mesh.n_u :])
    for some in (None, np.array([1])):
        points = slice(None) if some is None else slice(*(len(mesh.element.weights) * np.array([1, 2])))
        states = point_states(mesh, u, p, some)
        np.testing.assert_allclose(states.grad_u, whole.grad_u[points], atol=1e-11)
        np.testing.assert_allclose(states.p, whole.p[points], atol=1e-12)
