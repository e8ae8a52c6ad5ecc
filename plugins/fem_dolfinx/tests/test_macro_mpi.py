"""Checkpoints over backends and numbers of processes, and a process that fails alone."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import textwrap
from dataclasses import fields
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

if not find_spec("dolfinx"):
    pytest.skip("dolfinx is not installed", allow_module_level=True)
if shutil.which("mpirun") is None and not os.environ.get("CI"):
    pytest.skip("mpirun is missing", allow_module_level=True)

from porocore.interfaces.solution import History, MacroSolution
from porocore.macro.laws.composed import RegionLaw
from porocore.macro.laws.relaxation import RelaxingLaw
from porocore.macro.problem import MacroProblem
from porocore.plugins.registry import registry
from porocore.testing.macro_checks.bodies import squeezed
from porocore.testing.macro_checks.runs import NONLINEAR, STORM, TIMID
from porocore.testing.synthetic.cell import parametric_law
from porocore.testing.synthetic.response import GradientLaw

BEGIN = """
    import sys
    from pathlib import Path
    from porocore.plugins.registry import registry

    folder, backend = Path(sys.argv[1]), sys.argv[2]
    solver = registry().get("macro solver", backend)(checkpoint_seconds=0)
"""
PREPARED = """
    from porocore.testing.macro_checks.runs import STORM, TIMID
    prepared, law = solver.prepare(STORM), TIMID
"""
#: The same for a problem from a file, of a solid that relaxes.
RELAXING = """
    from porocore.macro.laws.relaxation import RelaxingLaw
    from porocore.macro.problem import MacroProblem
    from porocore.testing.macro_checks.runs import NONLINEAR
    problem = MacroProblem.model_validate_json((folder / "problem.json").read_text())
    prepared, law = solver.prepare(problem), RelaxingLaw(NONLINEAR, 1)
"""
INTERRUPTED = """
    class Killed(Exception):
        pass

    def stop(report):
        if report.time > 0.5:
            raise Killed

    try:
        solver.solve(prepared, law, checkpoint=folder / "macro.h5", on_step=stop)
    except Killed:
        pass
    else:
        raise AssertionError("ran to its end")
"""
CONTINUED = """
    solution = solver.solve(prepared, law, checkpoint=folder / "macro.h5")
    if solver.communicator.rank == 0:
        solution.save(folder / "solution.h5")
"""
KILLED = f"""{PREPARED}
    import os, signal, time

    def stop(report):
        if report.time > 0.5 and solver.communicator.rank == 1:
            os.kill(os.getpid(), signal.SIGKILL)

    solver.solve(prepared, TIMID, checkpoint=folder / "macro.h5", on_step=stop)
"""
ALONE = f"""{PREPARED}
    import porocore_fem_dolfinx.macro_communicator as macro_communicator
    macro_communicator.PATIENCE = 0.5

    class Faulty(type(TIMID)):
        def respond(self, *arguments, **how):
            if solver.communicator.rank == 1:
                raise RuntimeError("only me")
            return super().respond(*arguments, **how)

    TIMID.__class__ = Faulty
    with solver.communicator.united():
        solver.solve(prepared, TIMID)
"""
DERIVATIVES = """
    import json
    import numpy as np
    from porocore.interfaces.sensitivities import HISTORY_SERIES, BoundaryChange, HistoryWeights, InitialPressureChange
    from porocore.interfaces.sensitivities import ModulusChange, ViscosityChange
    from porocore.macro.problem import MacroProblem
    from porocore.testing.macro_checks.runs import NONLINEAR

    changes = [ModulusChange(), ViscosityChange(), InitialPressureChange()]
    changes += [BoundaryChange("y+", "plate"), BoundaryChange("side", "follower")]
    prepared = solver.prepare(MacroProblem.model_validate(json.loads((folder / "problem.json").read_text())))
    _, found = solver.solve_with_sensitivities(prepared, NONLINEAR, changes)
    if solver.communicator.rank == 0:
        values = {name: getattr(found, name) for name in HISTORY_SERIES}
        np.savez(folder / f"{backend}.npz", **values, **found.reactions, inflow=found.inflow["side"])

    def weights(solution):
        n = len(solution.history.time)
        forces = {name: np.full((n, 3, 1), 0.5) for name in solution.reactions}
        ones, inflow = np.ones((n, 1)), {"side": np.full((n, 1), 0.3)}
        every = {name: ones for name in HISTORY_SERIES}
        return HistoryWeights(1, **every, reactions=forces, inflow=inflow)

    _, gradients = solver.solve_with_gradients(prepared, NONLINEAR, changes, weights)
    total = sum(getattr(found, name).sum(axis=0) for name in HISTORY_SERIES)
    total = total + sum(0.5 * each.sum(axis=(0, 1)) for each in found.reactions.values())
    total = total + 0.3 * found.inflow["side"].sum(axis=0)
    assert np.abs(gradients[0] - total).max() <= 1e-9 * np.abs(total).max(), (gradients[0], total)
"""
#: A problem, a law and options of the solver from a file; the solution goes into another.
SOLVED = """
    import json
    from porocore.macro.problem import MacroProblem
    from porocore.macro.laws.composed import RegionLaw
    from porocore.testing.macro_checks.runs import NONLINEAR
    from porocore.testing.synthetic.cell import parametric_law
    from porocore.testing.synthetic.response import GradientLaw

    problem, law, options = json.loads((folder / "problem.json").read_text())
    solver = registry().get("macro solver", backend)(**options)
    prepared = solver.prepare(MacroProblem.model_validate(problem))
    assert all(map(len, prepared.plates)), "a plate lies on one process alone"
    laws = {"one cell": NONLINEAR, "family": parametric_law(), "layer": RegionLaw([NONLINEAR, GradientLaw(NONLINEAR)])}
    if law == "layer":
        mesh = prepared.mesh
        inside = mesh.points[mesh.cells[prepared.elements], 1].mean(axis=1).min() < 0.3
        assert prepared.communicator.sum(float(inside)) == 1, "the layer lies on both processes"
    solution = solver.solve(prepared, laws[law])
    if solver.communicator.rank == 0:
        assert "iterative" not in options.values() or solution.work["iterations"][1:].all()
        solution.save(folder / "solution.h5")
"""

SMALL_STEPS = {"end": 0.1, "step": 0.05, "ramp_increments": 1, "ramp_step": 0.05, "profiles": ()}
#: At every step processes wait for one another, which takes long where they share a core with others.
FEW_STEPS = SMALL_STEPS | {"end": 0.2, "ramp_increments": 2}
LARGE = {
    "block": {
        "body": {"kind": "box", "elements": (4, 4, 4), "size": (1, 1, 1)},
        "boundary": {
            "y-": {"displacement": (0, 0, 0)},
            "x-": {"normal": 0},
            "y+": {"traction": (0.1, 1, 0), "pressure": 0},
        },
        "load": -0.03,
        "time": SMALL_STEPS,
        "newton": {"tolerance": 1e-11},
    },
    "frames, a plate and a follower": {
        "body": {"kind": "wedge", "radius": 1, "height": 0.7, "elements": (3, 3, 2), "angle": 60},
        "boundary": {
            "oblique": {"normal": 0},
            "z-": {"normal": 0},
            "y-": {"displacement": (None, 0, None)},
            "y+": {"plate": -0.03},
            "side": {"pressure": 0, "follower": 0.01},
        },
        "time": SMALL_STEPS,
        "newton": {"tolerance": 1e-11},
    },
}


def run(processes, part, folder, backend="dolfinx"):
    environment = os.environ | {
        "OMPI_ALLOW_RUN_AS_ROOT": "1",
        "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
        "OMPI_MCA_mpi_yield_when_idle": "1",
        "OMP_NUM_THREADS": "1",
    }
    code = textwrap.dedent(BEGIN) + textwrap.dedent(part)
    launcher = ["mpirun", "--oversubscribe", "-n", str(processes)] if processes > 1 else []
    return subprocess.run(
        [*launcher, sys.executable, "-c", code, str(folder), backend],
        env=environment,
        capture_output=True,
        text=True,
        timeout=300,  # for processes that wait for one another for ever; the longest test takes 10 s alone
        check=False,
    )


def solved_by_two(folder, problem, law="one cell", **options):
    (folder / "problem.json").write_text(json.dumps([problem, law, options]))
    done = run(2, SOLVED, folder)
    assert done.returncode == 0, done.stderr
    return MacroSolution.load_file(folder / "solution.h5")


def solved_by_one(problem, law=NONLINEAR, **options):
    solver = registry().get("macro solver", "dolfinx")(**options)
    return solver.solve(solver.prepare(MacroProblem.model_validate(problem)), law)


@pytest.fixture(scope="module")
def whole():
    solver = registry().get("macro solver", "dolfinx")()
    return solver.solve(solver.prepare(STORM), TIMID)


@pytest.mark.parametrize(
    ("begun", "continued"),
    [
        pytest.param((2, "dolfinx"), (1, "dolfinx"), marks=pytest.mark.slow, id="two to one process"),
        pytest.param((1, "skfem"), (2, "dolfinx"), marks=pytest.mark.slow, id="scikit-fem to two processes"),
        pytest.param((2, "dolfinx"), (1, "skfem"), marks=pytest.mark.slow, id="two processes to scikit-fem"),
    ],
)
def test_a_checkpoint_is_continued_by_any_backend_on_any_number_of_processes(
    tmp_path, whole, begun, continued
):
    if "skfem" in (begun[1], continued[1]) and not find_spec("skfem"):
        pytest.skip("scikit-fem is not installed")
    assert_continued(tmp_path, whole, PREPARED, begun, continued)


def assert_continued(folder, whole, prepared, begun, continued):
    """Begun and continued by a number of processes of a backend each; to the solution of a whole run."""
    for (processes, backend), part in ((begun, INTERRUPTED), (continued, CONTINUED)):
        done = run(processes, prepared + part, folder, backend)
        assert done.returncode == 0, done.stderr
    found = MacroSolution.load_file(folder / "solution.h5")
    for field in fields(History):
        if field.name == "iterations":  # one process keeps its factor for several, more than one do not
            continue
        mine, theirs = getattr(found.history, field.name), getattr(whole.history, field.name)
        scale = abs(theirs).max() if field.name != "stress_spread" else 0.1
        np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-9 * scale, err_msg=field.name)
    assert len(found.profiles) == len(whole.profiles)
    for one, other in zip(found.profiles, whole.profiles, strict=True):
        mine = one.arrays()
        assert mine.keys() == other.arrays().keys()
        for name, theirs in other.arrays().items():
            np.testing.assert_allclose(mine[name], theirs, rtol=0, atol=1e-9, err_msg=name)


#: A solid whose time differs from element to element, by steps of the length that their error allows.
RELAXED = {
    "body": {"kind": "box", "elements": (2, 3, 2), "size": (1, 1, 1)},
    "boundary": {"y-": {"displacement": (0, 0, 0)}, "y+": {"traction": (0.1, 1, 0), "pressure": 0}},
    "load": -0.01,
    "time": {
        "end": 0.7,
        "step": 0.5,
        "ramp_increments": 2,
        "ramp_step": 0.1,
        "profiles": (0.2,),
        "tolerance": 0.05,
    },
    "fields": {"relaxation.1.strength": 1.0, "relaxation.1.time": "0.1 + x + y"},
    "newton": {"tolerance": 1e-11},
}


@pytest.fixture(scope="module")
def relaxed():
    return solved_by_one(RELAXED, RelaxingLaw(NONLINEAR, 1))


@pytest.mark.slow
@pytest.mark.parametrize(("begun", "continued"), [(1, 2), (2, 3), (3, 1)])
def test_a_solid_relaxes_alike_on_any_number_of_processes(tmp_path, relaxed, begun, continued):
    """Begun by some and continued by others, with the internal variables of each point."""
    (tmp_path / "problem.json").write_text(json.dumps(RELAXED))
    assert_continued(tmp_path, relaxed, RELAXING, (begun, "dolfinx"), (continued, "dolfinx"))
    last, plain = relaxed.profiles[-1], solved_by_one({**RELAXED, "fields": {}})
    assert np.abs(last.internal["overstress_1"]).max() > 1e-4
    assert np.ptp(last.u[:, 1]) < 0.99 * np.ptp(plain.profiles[-1].u[:, 1])


@pytest.mark.slow
def test_two_processes_have_the_derivatives_of_one(tmp_path):
    """With oblique planes, a plate and a follower, against scikit-fem."""
    pytest.importorskip("skfem")
    (tmp_path / "problem.json").write_text(json.dumps(LARGE["frames, a plate and a follower"]))
    for processes, backend in ((2, "dolfinx"), (1, "skfem")):
        done = run(processes, DERIVATIVES, tmp_path, backend)
        assert done.returncode == 0, done.stderr
    mine, theirs = (np.load(tmp_path / f"{backend}.npz") for backend in ("dolfinx", "skfem"))
    assert set(mine) == set(theirs)
    for name in mine:
        scale = np.abs(theirs[name]).max()
        np.testing.assert_allclose(mine[name], theirs[name], rtol=0, atol=1e-7 * scale, err_msg=name)


@pytest.mark.slow
def test_a_process_that_is_killed_ends_all_and_leaves_the_checkpoint(tmp_path, whole):
    done = run(2, KILLED, tmp_path)
    assert done.returncode != 0
    done = run(1, PREPARED + CONTINUED, tmp_path)
    assert done.returncode == 0, done.stderr
    found = MacroSolution.load_file(tmp_path / "solution.h5")
    np.testing.assert_array_equal(found.history.time, whole.history.time)
    np.testing.assert_allclose(
        found.history.settlement, whole.history.settlement, rtol=0, atol=1e-9 * whole.history.settlement.max()
    )


@pytest.mark.slow
@pytest.mark.parametrize("body", ["block", "frames, a plate and a follower"])
def test_two_processes_iterate_to_the_solution_of_one(tmp_path, body):
    """The smoother and the coarse levels differ, the solution only by the solver's tolerance."""
    one = solved_by_one(LARGE[body], solver="direct")
    two = solved_by_two(tmp_path, LARGE[body], solver="iterative")
    np.testing.assert_allclose(two.profiles[-1].u, one.profiles[-1].u, rtol=0, atol=1e-9)
    np.testing.assert_allclose(two.profiles[-1].p, one.profiles[-1].p, rtol=0, atol=1e-9)
    assert abs(one.profiles[-1].u).max() > 1e-3


def test_a_process_that_fails_alone_ends_all_and_says_why(tmp_path):
    done = run(2, ALONE, tmp_path)
    assert done.returncode == 70
    assert "RuntimeError: only me" in done.stderr
    assert "Traceback" not in done.stderr
    (line,) = [line for line in done.stderr.splitlines() if "the whole of it is in" in line]
    whole = Path(line.split("the whole of it is in ")[1].split(";")[0])
    assert "Traceback" in whole.read_text()


def test_more_processes_than_elements_can_be_shared_among_are_refused(tmp_path):
    part = """
        from porocore.errors import ConfigurationError
        from porocore.testing.synthetic.response import confined_column
        try:
            solver.prepare(confined_column(1))
        except ConfigurationError as error:
            if solver.communicator.rank == 0:
                (folder / "message").write_text(str(error))
    """
    done = run(2, part, tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "message").read_text() == (
        "macro.body: 1 elements are too few for 2 processes; start fewer"
    )


@pytest.mark.slow
def test_two_processes_share_a_plate(tmp_path):
    """Its unknowns lie on both, and its equation is the sum over both."""
    problem = squeezed({"plate": 1}, time=FEW_STEPS).model_dump(mode="json", exclude_unset=True)
    one, two = solved_by_one(problem), solved_by_two(tmp_path, problem)
    np.testing.assert_allclose(two.history.settlement, one.history.settlement, rtol=1e-9)
    np.testing.assert_allclose(two.profiles[-1].u, one.profiles[-1].u, rtol=0, atol=1e-10)
    assert np.ptp(two.profiles[-1].u[two.points[:, 1] == 1, 1]) == 0


@pytest.mark.slow
def test_two_processes_share_an_oblique_plane_and_a_pressure_that_follows(tmp_path):
    """Frames of nodes, reactions and entries of the follower lie on both; curved elements."""
    problem = {
        "body": {"kind": "wedge", "radius": 1, "height": 0.7, "elements": (2, 2, 1), "angle": 60},
        "boundary": {
            "oblique": {"normal": 0},
            "z-": {"normal": 0},
            "y-": {"normal": 0},
            "y+": {"pressure": 0},
            "side": {"follower": 0.02},
        },
        "probes": {"rim": (1, 0.35, 0)},
        "time": FEW_STEPS,
    }
    one, two = solved_by_one(problem), solved_by_two(tmp_path, problem)
    np.testing.assert_allclose(two.probes["rim"], one.probes["rim"], atol=1e-10)
    np.testing.assert_allclose(two.profiles[-1].u, one.profiles[-1].u, atol=1e-10)
    for name, force in one.reactions.items():
        np.testing.assert_allclose(two.reactions[name], force, atol=1e-10)
    assert abs(one.probes["rim"]).max() > 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("solver", ["direct", "iterative"])
@pytest.mark.parametrize("kind", ["axisymmetric", "plane-strain"])
def test_two_processes_share_a_flat_body(tmp_path, kind, solver):
    """What is added to the radial forces along the hoop lies on both, and so does a pressure that follows."""
    shape = {"radius": 0.6, "inner_radius": 0.2, "height": 0.7}
    side, shape = ("side", shape) if kind == "axisymmetric" else ("x+", {"size": (0.4, 0.7), "depth": 0.3})
    problem = {
        "body": {"kind": kind, "elements": (4, 5), **shape},
        "boundary": {
            "y-": {"displacement": (0, 0, 0)},
            "y+": {"traction": (0, -0.01, 0)},
            side: {"pressure": 0, "follower": 0.01},
        },
        "time": FEW_STEPS,
        "newton": {"tolerance": 1e-11},
    }
    one, two = solved_by_one(problem, solver="direct"), solved_by_two(tmp_path, problem, solver=solver)
    np.testing.assert_allclose(two.profiles[-1].u, one.profiles[-1].u, rtol=0, atol=1e-10)
    np.testing.assert_allclose(two.profiles[-1].stress, one.profiles[-1].stress, rtol=0, atol=1e-10)
    np.testing.assert_allclose(two.reactions["y-"], one.reactions["y-"], rtol=0, atol=1e-10)
    assert (two.revolved, two.depth) == (one.revolved, one.depth)
    assert abs(one.profiles[-1].u).max() > 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("elements", [2, 5])
def test_two_processes_share_a_plate_beside_an_oblique_plane(tmp_path, elements):
    """Below and above 3,000 unknowns; reactions are told apart by the stress on both processes."""
    problem = {
        "body": {
            "kind": "wedge",
            "radius": 1,
            "height": 0.7,
            "elements": (elements, elements, 2),
            "angle": 60,
        },
        "boundary": {
            "oblique": {"normal": 0},
            "z-": {"normal": 0},
            "y-": {"displacement": (None, 0, 0)},
            "y+": {"plate": -0.03},
            "side": {"pressure": 0, "follower": 0.01},
        },
        "time": FEW_STEPS,
        "newton": {"tolerance": 1e-11},
    }
    one, two = solved_by_one(problem), solved_by_two(tmp_path, problem)
    np.testing.assert_allclose(two.profiles[-1].u, one.profiles[-1].u, rtol=0, atol=1e-9)
    for name, force in one.reactions.items():
        np.testing.assert_allclose(two.reactions[name], force, rtol=0, atol=1e-9)
    assert abs(one.profiles[-1].u).max() > 1e-3


#: Other cells in each quarter, turned axes, and pores that shrink with time.
COMPOSED = {
    "body": {"kind": "box", "elements": (2, 3, 2), "size": (1, 1, 1)},
    "boundary": {"y-": {"displacement": (0, 0, 0)}, "y+": {"traction": (0.1, 1, 0), "pressure": 0}},
    "load": -0.01,
    "time": SMALL_STEPS | {"end": 0.2},
    "fields": {
        "radius": {"formula": "0.2 + 0.02*y", "initial": 0.25, "over": {"ramp": 1, "until": 0.1}},
        "stiffness": 1.3,
        "axes": {"about": (0, 0, 1), "angle": "30*x"},
    },
    "regions": {"low": {"kind": "layer", "below": 0.4, "fields": {"stiffness": "2 + x"}}},
    "newton": {"tolerance": 1e-11},
}


@pytest.mark.slow
def test_two_processes_see_the_fields_of_their_elements(tmp_path):
    one, two = solved_by_one(COMPOSED, parametric_law()), solved_by_two(tmp_path, COMPOSED, "family")
    for name in ("u", "p", "stress", "flux"):
        mine, theirs = getattr(two.profiles[-1], name), getattr(one.profiles[-1], name)
        np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-9 * max(abs(theirs).max(), 1e-3))
    assert abs(one.profiles[-1].u).max() > 1e-3
    assert two.element_cells.regions == one.element_cells.regions == ("low",)
    for name in ("region", "values", "axes"):
        np.testing.assert_allclose(
            getattr(two.element_cells, name), getattr(one.element_cells, name), rtol=0, atol=1e-13
        )


@pytest.mark.slow
@pytest.mark.parametrize("solver", ["direct", "iterative"])
def test_two_processes_agree_on_a_tangent_that_depends_on_more_in_a_layer_of_one(tmp_path, solver):
    """Stress and storage depend on the gradient of the pressure there alone, where one process has its elements."""
    problem = {
        "body": {"kind": "box", "elements": (1, 6, 1), "size": (0.3, 1, 0.3)},
        "boundary": {"y-": {"displacement": (0, 0, 0)}, "y+": {"traction": (0.1, 1, 0), "pressure": 0}},
        "load": -0.01,
        "time": FEW_STEPS,
        "regions": {"low": {"kind": "layer", "below": 0.3}},
        "newton": {"tolerance": 1e-11},
    }
    one = solved_by_one(problem, RegionLaw([NONLINEAR, GradientLaw(NONLINEAR)]), solver="direct")
    two = solved_by_two(tmp_path, problem, "layer", solver=solver)
    plain = solved_by_one(problem, RegionLaw([NONLINEAR, NONLINEAR]), solver="direct")
    for name in ("u", "p"):
        mine, theirs, other = (getattr(each.profiles[-1], name) for each in (two, one, plain))
        np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-8 * abs(theirs).max(), err_msg=name)
        assert abs(theirs - other).max() > 1e-4 * abs(theirs).max()
    most = plain.history.iterations.max() + 1
    assert max(each.history.iterations.max() for each in (one, two)) <= most


@pytest.mark.slow
@pytest.mark.parametrize("solver", ["direct", "iterative"])
@pytest.mark.parametrize("by", ["displacement", "force"])
def test_two_processes_share_an_indenter(tmp_path, by, solver):
    """The facets that it touches lie on both, and under a force so does the displacement that it takes."""
    ball = {"shape": {"kind": "sphere", "radius": 0.8}, "place": (0, 1, 0), "surfaces": ["y+"]}
    ball |= {"under": "sealed", "outside": "drained", by: 0.05 if by == "displacement" else 2e-3}
    problem = {
        "body": {"kind": "box", "size": (1, 1, 1), "elements": (3, 2, 3), "grading": (2, 0.5, 2)},
        "boundary": {name: {"normal": 0} for name in ("x-", "y-", "z-")},
        "contact": {"ball": ball},
        "time": FEW_STEPS,
        "newton": {"tolerance": 1e-12},
    }
    one, two = solved_by_one(problem, solver="direct"), solved_by_two(tmp_path, problem, solver=solver)
    series = one.contact["ball"]
    assert series[-1, 2] > 0.03
    scales = np.abs(series).max(axis=0)
    np.testing.assert_allclose(two.contact["ball"] / scales, series / scales, rtol=0, atol=1e-9)
    for name in ("u", "p", "contact_pressure"):
        mine, theirs = (getattr(each.profiles[-1], name) for each in (two, one))
        np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-9 * np.abs(theirs).max(), err_msg=name)
