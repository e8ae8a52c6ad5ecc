"""The largest pressure right after a sudden load, which a coarse mesh overshoots."""

import numpy as np
import pytest

from porocore.macro.body.kinds import Box
from porocore.macro.oscillation import diffusion_time, unresolved
from porocore.macro.problem import MacroProblem
from porocore.testing.macro_laws.meshes import write_tetrahedra
from porocore.testing.synthetic.response import confined_column, linear_law

Solver = pytest.importorskip("porocore_fem_skfem.macro").SkfemMacroSolver
LAW = linear_law()
C = LAW.coefficients
#: All of a load that nothing has drained is borne by the fluid but for what its storage takes.
UNDRAINED = 1 / (C.biot[1, 1] + C.storage * C.stiffness[1, 1, 1, 1] / C.biot[1, 1])


def column(ramp_step, **plan):
    time = {"end": 2.0, "step": 0.5, "ramp_increments": 1, "ramp_step": ramp_step, "profiles": (), **plan}
    return confined_column(4, -1e-3, size=(0.1, 2.0, 0.1), time=time)


def test_the_time_is_that_of_an_element_at_the_drained_surface(tmp_path):
    """h²/(6 c_v) of its height, of hexahedra and of tetrahedra; nothing where no pressure is prescribed."""
    limit = 0.5**2 / (6 * C.consolidation_coefficient())
    assert diffusion_time(column(0.1), C) == pytest.approx(limit, rel=1e-12)
    write_tetrahedra(tmp_path / "box.msh", Box(size=(1, 2, 1), elements=(1, 4, 1)))
    body = {"kind": "file", "path": str(tmp_path / "box.msh")}
    faces = {"y-": {"displacement": (0, 0, 0)}, "y+": {"pressure": 0}}
    drained = MacroProblem.model_validate({"body": body, "boundary": faces})
    assert diffusion_time(drained, C) == pytest.approx(limit, rel=1e-12)
    sealed = MacroProblem.model_validate({"body": body, "boundary": {"y-": {"displacement": (0, 0, 0)}}})
    assert diffusion_time(sealed, C) == 0


@pytest.mark.parametrize(("share", "warned"), [(1e-4, True), (1.01, False)])
def test_a_largest_pressure_that_the_mesh_overshoots_is_told(share, warned):
    """Against the undrained pressure, which no point can exceed."""
    limit = diffusion_time(column(0.1), C)
    problem = column(share * limit)
    solver = Solver()
    solution = solver.solve(solver.prepare(problem), LAW)
    over = solution.history.pressure_max.max() / (1e-3 * UNDRAINED) - 1
    assert (over > 0.1) == warned
    assert over < 0.3
    told = unresolved(problem, limit, solution)
    assert (told is not None) == warned
    if told:
        assert "do not resolve the pressure before h²/(6 c_v)" in told


def test_the_loading_begins_where_loads_stood_still_before():
    """A sudden second load after rest; a pressure that is prescribed is not overshot."""
    table = {"table": [[0, 0], [0.5, -1e-4], [3, -1e-4], [3.0001, -1e-3]]}
    sides = {face: {"displacement": (0, None, 0)} for face in ("x-", "x+", "z-", "z+")}
    faces = {**sides, "y-": {"displacement": (0, 0, 0)}, "y+": {"traction": (0, table, 0), "pressure": 0}}
    time = {"end": 4.0, "step": 0.25, "ramp_increments": 1, "ramp_step": 0.25, "profiles": ()}
    problem = confined_column(4, 1.0, size=(0.1, 2.0, 0.1), time=time, boundary=faces)
    solver = Solver()
    solution = solver.solve(solver.prepare(problem), LAW)
    assert solution.history.time[solution.history.pressure_max.argmax()] == pytest.approx(3.0001)
    assert "comes 0.0001 after the start of the loading" in unresolved(problem, 0.1, solution)
    faces["y+"] = {"pressure": {"table": [[0, 0], [1e-4, 1e-3]]}}
    problem = confined_column(4, 1.0, size=(0.1, 2.0, 0.1), time=time, boundary=faces)
    solution = solver.solve(solver.prepare(problem), LAW)
    assert np.isclose(solution.history.pressure_max.max(), 1e-3)
    assert unresolved(problem, 0.1, solution) is None
