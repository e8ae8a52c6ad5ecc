"""What a small shear does to a cell with mirrors; the note of ``check`` on a shear that is not sampled rests on it."""

import numpy as np

import porocore

SMALL = 0.01


def test_a_shear_acts_on_all_but_its_own_stress_with_its_square():
    channels = {"kind": "orthogonal-channels", "radius": 0.25}
    mesh = {"size": 0.34, "fluid_size": 0.4, "element": "linear"}
    H = np.zeros((3, 3, 3))
    H[:, 1, 1] = -0.05
    H[:, 0, 1] = 0, SMALL, 2 * SMALL
    found = porocore.CellProblem(porocore.Cell(geometry=channels, mesh=mesh), fem="skfem").response(H, p=0.01)
    assert found.status.tolist() == [porocore.Status.converged] * 3
    for values in (
        np.diagonal(found.stress, axis1=1, axis2=2),
        found.fluid_volume,
        found.tangent.stress_grad_u[:, 0, 1, 0, 1],
    ):
        once, twice = values[1] - values[0], values[2] - values[0]
        np.testing.assert_allclose(twice, 4 * once, rtol=5e-3)
        # By less than the square of the shear's share of the strain.
        assert (np.abs(once) < np.abs(values[0]) * (SMALL / 0.05) ** 2).all()
    np.testing.assert_allclose(found.stress[2, 0, 1], 2 * found.stress[1, 0, 1], rtol=5e-3)
