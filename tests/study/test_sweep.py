"""Sweeps over parameters of the cell: one family, learned once; its bodies, table and picture; what is refused."""

from __future__ import annotations

import copy
import csv
import io
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import porocore
from porocore.core.console import Console
from porocore.errors import ConfigurationError, RunFolderError, SolveError
from porocore.macro.laws.composed import BoundLaw
from porocore.plugins.border import body_solution_of
from porocore.report.figures.style import png_bytes
from porocore.study.run.composition import macro_laws, make_backend
from porocore.study.run.folder import RunFolder
from porocore.study.sweep import run as sweeping
from porocore.study.sweep.figure import sweep_figure
from porocore.study.sweep.plan import SweepPlan
from porocore.study.sweep.results import ParameterSweep
from tests.helpers.invoked import invoke, refusal

pytest.importorskip("porocore_fem_skfem")

SIDE = {"displacement": [0, None, 0]}
STUDY: dict[str, Any] = {
    "cell": {
        "material": {"poisson_ratio": 0.3},
        "mesh": {"size": 0.5, "fluid_size": 0.5, "element": "linear"},
    },
    "sampling": {
        "sampler": "sobol",
        "inputs": {"H22": {"range": [-0.1, 0.02]}, "p": {"range": [-0.02, 0.05]}},
        "options": {"count": 10, "states_per_member": 4},
        "test": {"count": 2},
        "workers": 1,
    },
    "surrogate": {"backend": "polynomial"},
    "closure": "potential",
    "macro": {
        "body": {"kind": "box", "size": [0.1, 7.5, 0.1], "elements": [1, 4, 1]},
        "boundary": {
            **dict.fromkeys(("x-", "x+", "z-", "z+"), SIDE),
            "y-": {"displacement": [0, 0, 0]},
            "y+": {"traction": [0, 1, 0], "pressure": 0},
        },
        "loads": [-0.04],
        "time": {"end": 400, "step": 20, "ramp_increments": 2, "ramp_step": 0.5},
    },
}
HEIGHT, LOAD = 7.5, -0.04
VALUES = (0.2, 0.3, 0.4)
NAMES = (
    "poisson_ratio", "porosity", "K_11", "K_22", "K_33", "final_settlement", "time_to_50_percent", "time_to_95_percent",
    "largest_heave", "largest_displacement", "max_pressure", "time_of_max_pressure", "drained", "flagged_largest",
)  # fmt: skip


def with_settings(**changes: Any) -> dict[str, Any]:
    study = copy.deepcopy(STUDY)
    for key, value in changes.items():
        section, _, name = key.rpartition("__")
        (study[section] if section else study)[name] = value
    return study


def ranged(ends: list[float]) -> dict[str, Any]:
    return with_settings(
        cell__material={"poisson_ratio": {"range": ends}},
        macro={**STUDY["macro"], "fields": {"poisson_ratio": 0.3}},
        sampling__parameters="ranges",
    )


def made(out: Path, settings: dict[str, Any] = STUDY) -> porocore.Study:
    return porocore.Study(settings, out=out, progress=False, store=False)


@pytest.fixture(autouse=True)
def laid_out(recwarn: pytest.WarningsRecorder) -> Iterator[None]:
    """Every figure finds a layout."""
    yield
    assert not [each for each in recwarn if "constrained_layout" in str(each.message)]


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> porocore.Study:
    return made(tmp_path_factory.mktemp("sweep") / "one")


@pytest.fixture(scope="module")
def swept(study: porocore.Study) -> ParameterSweep:
    return study.sweep("poisson_ratio", VALUES)


@pytest.fixture(scope="module")
def moved(tmp_path_factory: pytest.TempPathFactory) -> ParameterSweep:
    """A quick move of the top, with forces of 1e-5 N."""
    settings = with_settings(
        cell={**STUDY["cell"], "viscosity": "1 mPa s"},
        macro__boundary={**STUDY["macro"]["boundary"], "y+": {"displacement": [0, 1, 0], "pressure": 0}},
        macro__loads=[-0.3],
        scales={"modulus": "20 kPa", "length": "1 mm", "pore": "1 um", "viscosity": "1 Pa s"},
    )
    return made(tmp_path_factory.mktemp("sweep") / "moved", settings).sweep("poisson_ratio", VALUES[:2])


def rows_of(sweep: ParameterSweep) -> list[dict[str, str]]:
    with sweep.table.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_the_table_has_a_row_for_each_value(study: porocore.Study, swept: ParameterSweep) -> None:
    rows = rows_of(swept)
    assert [float(row["poisson_ratio"]) for row in rows] == list(VALUES)
    assert tuple(rows[0])[: len(NAMES)] == NAMES
    assert tuple(rows[0])[len(NAMES) :] == tuple(f"linear: {name}" for name in NAMES[5:-1])
    for name, column in swept.figures.items():
        np.testing.assert_allclose([float(row[name]) for row in rows], column, rtol=1e-7)
    assert all(path.stat().st_size > 10_000 for path in swept.pictures)
    assert swept.folder.path == Path(f"{study.path}-over-poisson_ratio")
    assert swept.plan.family.sampling.parameters == "ranges"
    assert "range" in (swept.folder.path / "config.yaml").read_text(encoding="utf-8")


@pytest.mark.parametrize("of", ["swept", "moved"])
def test_no_legend_covers_a_curve(of: str, swept: ParameterSweep, moved: ParameterSweep) -> None:
    """Legends lay within the panels, over the curves of some sweeps."""
    figure = sweep_figure({"swept": swept, "moved": moved}[of])
    png_bytes(figure)
    legends = [each for axes in figure.axes if (each := axes.get_legend()) is not None] + figure.legends
    assert len(legends) >= 3
    boxes = [each.get_window_extent() for each in legends]
    for axes in figure.axes:
        taken = [
            axes.get_window_extent(),
            axes.xaxis.get_tightbbox(),
            axes.yaxis.get_offset_text().get_window_extent(),
        ]
        assert not any(
            box.overlaps(other) for box in boxes for other in taken if other is not None and other.width
        )
    for box in boxes:
        assert figure.bbox.x0 <= box.x0 < box.x1 <= figure.bbox.x1


def test_linear_settlements_and_the_cell_are_those_of_each_member(swept: ParameterSweep) -> None:
    """From the member's own cell: h P/C_22, φ_f and K."""
    for k, value in enumerate(VALUES):
        member = porocore.CellProblem(
            {**STUDY["cell"], "material": {"poisson_ratio": {"range": [0.2, 0.4]}}},
            parameters={"poisson_ratio": value},
            store=False,
        )
        response = member.response(np.zeros((3, 3)))
        assert response.tangent is not None
        assert response.tangent.stress_grad_u is not None
        expected = HEIGHT * abs(LOAD) / response.tangent.stress_grad_u[0, 1, 1, 1, 1]
        # The end of the run is not quite the end of the consolidation.
        assert swept.figures["linear: final_settlement"][k] == pytest.approx(expected, rel=1e-4)
        assert swept.figures["K_22"][k] == pytest.approx(member.conductivity[1, 1], rel=1e-6)
        assert response.fluid_volume is not None
        assert swept.figures["porosity"][k] == pytest.approx(response.fluid_volume[0], rel=1e-9)


def test_a_value_is_the_body_of_the_law_with_it_bound(study: porocore.Study, swept: ParameterSweep) -> None:
    """To round-off: the field of the sweep against the law with a constant in its place, in a body without fields."""
    problem = study.config.macro.problem(LOAD)
    with ExitStack() as stack:
        laws = macro_laws(swept.folder, stack, ("surrogate", "linear"))
        for kind, run in laws.items():
            law = BoundLaw(run.law, {"poisson_ratio": 0.3})
            solver = make_backend("macro solver", study.config)
            alone = body_solution_of(solver, solver.prepare(problem), law, problem).history
            found = swept.solutions(poisson_ratio=0.3)[LOAD][kind]
            for mine, its in (
                (found.settlement, alone.settlement),
                (found.pressure, alone.pressure_max),
                (found.drained, alone.drained),
            ):
                np.testing.assert_allclose(mine, its, rtol=1e-10, atol=1e-13 * np.abs(its).max())


def test_a_value_is_a_study_of_its_own(tmp_path: Path, swept: ParameterSweep) -> None:
    """Within the errors of two surrogates from ten states each."""
    own = made(tmp_path / "own", with_settings(cell__material={"poisson_ratio": 0.4}))
    alone = own.solve(("surrogate",))[LOAD].nonlinear
    found = swept.solutions(poisson_ratio=0.4)[LOAD].nonlinear
    np.testing.assert_allclose(found.settlement, alone.settlement, atol=2e-3 * alone.settlement[-1])


@pytest.mark.usefixtures("undrawn")
def test_more_values_between_the_ends_go_on_and_solve_no_cell(
    study: porocore.Study, swept: ParameterSweep
) -> None:
    table = swept.table.read_bytes()
    files = [path for path in swept.folder.path.rglob("*.h5") if path.is_file()]
    before = {path: path.stat().st_mtime_ns for path in files}
    more = study.sweep("poisson_ratio", (0.2, 0.25, 0.3, 0.4))
    assert {path: path.stat().st_mtime_ns for path in files} == before
    new = {path for path in swept.folder.path.rglob("*.h5")} - set(files)
    assert {path.parent.parent.name for path in new} == {"poisson_ratio=0.25"}
    assert len(rows_of(more)) == 4
    # One of the solutions of a value, as after an interruption.
    (lacking,) = (swept.folder.path / "sweep" / "poisson_ratio=0.3" / "solutions").glob("linear*.h5")
    lacking.unlink()
    study.sweep("poisson_ratio", VALUES)
    assert {path for path, time in before.items() if path.stat().st_mtime_ns != time} == {lacking}
    assert swept.table.read_bytes() == table


@pytest.mark.usefixtures("undrawn")
def test_the_folder_is_the_run_of_the_family(study: porocore.Study, swept: ParameterSweep) -> None:
    """A family that is written by hand goes on in it, at another value."""
    settings = ranged([0.2, 0.4])
    samples = (swept.folder.path / "samples.h5").stat().st_mtime_ns
    family = made(swept.folder.path, settings)
    law = family.law()
    assert law.parameters == ("poisson_ratio",)
    found = law.at(poisson_ratio=0.3)
    assert found.porosity == pytest.approx(swept.figures["porosity"][1], rel=1e-12)
    grad_u = np.diag([0.0, -0.05, 0.0])
    given = law.response(grad_u, 0.01, parameters={"poisson_ratio": 0.3})
    np.testing.assert_array_equal(found.response(grad_u, 0.01).stress, given.stress)
    linear = family.law("linear").at(poisson_ratio=0.3).response(1e-9 * grad_u, tangent=True)
    nonlinear = found.response(1e-9 * grad_u, tangent=True)
    np.testing.assert_allclose(linear.stress, nonlinear.stress, rtol=1e-6, atol=1e-17)
    np.testing.assert_allclose(linear.fluid_volume, nonlinear.fluid_volume, rtol=1e-12)
    with pytest.raises(ConfigurationError, match=r"poisson_ratio: expected a number from 0\.2 to 0\.4"):
        law.at(poisson_ratio=0.45)
    assert family.sweep("poisson_ratio", (0.25, 0.3)).folder.path == swept.folder.path
    assert (swept.folder.path / "samples.h5").stat().st_mtime_ns == samples
    study.sweep("poisson_ratio", VALUES)


@pytest.mark.usefixtures("undrawn")
def test_processes_side_by_side_give_the_same(
    study: porocore.Study, swept: ParameterSweep, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sweeping, "bodies_at_once", lambda *given: 2)
    plan = SweepPlan.over(swept.plan.family, {"poisson_ratio": VALUES})
    folder = RunFolder.claim(tmp_path / "run", plan.family)
    for name in ("cell.json", "surrogate.h5"):
        (tmp_path / "run" / name).write_bytes((swept.folder.path / name).read_bytes())
    found = sweeping.run_sweep(folder, plan, console=Console(io.StringIO()), laws=("surrogate", "linear"))
    for name, column in swept.figures.items():
        np.testing.assert_allclose(found.figures[name], column, rtol=1e-10, err_msg=name)


@pytest.mark.usefixtures("undrawn")
def test_a_value_without_solution_is_an_empty_row(
    study: porocore.Study, swept: ParameterSweep, monkeypatch: pytest.MonkeyPatch
) -> None:
    solve, failing = sweeping.SweepSeries.function, {0.24}

    def fails(tell: Any, folder: Any, laws: Any) -> str:
        if folder.config.macro.fields["poisson_ratio"] in failing:
            raise SolveError("the step failed")
        return solve(tell, folder, laws)

    monkeypatch.setattr(sweeping.SweepSeries, "function", fails)
    found = study.sweep("poisson_ratio", (0.2, 0.24, 0.26, 0.4))
    rows = rows_of(found)
    assert [row["final_settlement"] == "" for row in rows] == [False, True, False, False]
    assert float(rows[1]["porosity"]) > 0.3
    with pytest.raises(ConfigurationError, match=r"poisson_ratio=0\.24: the body could not be solved"):
        found.solutions(poisson_ratio=0.24)
    failing |= {0.2, 0.4}
    with pytest.raises(SolveError, match="no value could be solved; the step failed"):
        study.sweep("poisson_ratio", (0.2, 0.4), out=_another(swept))
    study.sweep("poisson_ratio", VALUES)


def _another(sweep: ParameterSweep) -> Path:
    """A folder of the same family with its surrogate and without solutions."""
    path = sweep.folder.path.with_name("another")
    RunFolder.claim(path, sweep.plan.family)
    for name in ("cell.json", "surrogate.h5"):
        (path / name).write_bytes((sweep.folder.path / name).read_bytes())
    return path


def test_a_plane_of_two_numbers_and_a_range_of_the_file(tmp_path: Path) -> None:
    """K ∝ 1/μ_f: the fluid's viscosity scales the times of consolidation, and no cell depends on it."""
    settings = with_settings(
        cell={**STUDY["cell"], "viscosity": {"range": [5e-4, 2e-3]}},
        macro={**STUDY["macro"], "fields": {"viscosity": 1e-3}},
        sampling__options={"count": 12, "states_per_member": 4},
    )
    found = made(tmp_path / "plane", settings).sweep(
        {"poisson_ratio": [0.2, 0.4], "viscosity": [1e-3, 2e-3]}, laws=("surrogate",)
    )
    np.testing.assert_array_equal(found.values, [[0.2, 1e-3], [0.2, 2e-3], [0.4, 1e-3], [0.4, 2e-3]])
    K = found.figures["K_22"]
    np.testing.assert_allclose(K[::2], 2 * K[1::2], rtol=1e-9)
    settled = found.figures["final_settlement"]
    np.testing.assert_allclose(settled[::2], settled[1::2], rtol=1e-2)
    assert settled[0] > 1.1 * settled[2]
    assert found.pictures[0].stat().st_size > 10_000
    point = found.plan.points[1]
    assert point.name == "poisson_ratio=0.2,viscosity=0.002"
    assert (found.folder.path / "sweep" / point.name / "solutions").is_dir()


def test_a_body_that_rises_has_its_heave(tmp_path: Path) -> None:
    """Tension lifts a linear column as far as the same pressure lowers it."""
    down = with_settings(macro__loads=[0.04])
    found = made(tmp_path / "up", down).sweep("poisson_ratio", VALUES[:2])
    risen, fallen = (found.figures[f"linear: {name}"] for name in ("largest_heave", "final_settlement"))
    assert found.heaves_alone
    for k, value in enumerate(VALUES[:2]):
        member = porocore.CellProblem(
            {**STUDY["cell"], "material": {"poisson_ratio": {"range": [0.2, 0.3]}}},
            parameters={"poisson_ratio": value},
            store=False,
        )
        tangent = member.response(np.zeros((3, 3))).tangent
        assert tangent is not None
        assert tangent.stress_grad_u is not None
        assert risen[k] == pytest.approx(HEIGHT * 0.04 / tangent.stress_grad_u[0, 1, 1, 1, 1], rel=1e-4)
    np.testing.assert_allclose(fallen, 0, atol=1e-9)
    labels = [axes.get_ylabel() for axes in sweep_figure(found).axes]
    assert labels[0].startswith("heave")
    assert any(label.startswith("largest heave") for label in labels)


@pytest.mark.usefixtures("undrawn")
def test_moved_surfaces_several_loads_and_units(tmp_path: Path) -> None:
    """A thicker fluid resists a quick move more, and not the slow one."""
    settings = with_settings(
        cell={**STUDY["cell"], "viscosity": "1 mPa s"},
        macro__boundary={**STUDY["macro"]["boundary"], "y+": {"displacement": [0, 1, 0], "pressure": 0}},
        macro__loads=[-0.1, -0.3],
        scales={"modulus": "0.5 MPa", "length": "1 mm", "pore": "50 nm", "viscosity": "1 Pa s"},
        output_units={"length": "mm", "stress": "kPa", "force": "mN"},
    )
    found = made(tmp_path / "units", settings).sweep("viscosity", [0.001, 0.004])
    rows = rows_of(found)
    assert [float(row["viscosity [Pa s]"]) for row in rows] == [0.001, 0.004]
    peaks = [float(row["load -0.3: y+: peak [mN]"]) for row in rows]
    assert peaks[1] > peaks[0] > 2 * float(rows[0]["load -0.1: y+: peak [mN]"]) > 0
    times = [float(row["load -0.3: y+: relaxed_95_percent [s]"]) for row in rows]
    assert times[1] > 2 * times[0]
    ends = [float(row["load -0.3: y+: final [mN]"]) for row in rows]
    assert ends[1] == pytest.approx(ends[0], rel=1e-2)
    solved = found.solutions(viscosity=0.004)[-0.3].linear.forces["y+"]["peak"]
    assert solved["value"] == pytest.approx(float(rows[1]["load -0.3: linear: y+: peak [mN]"]), rel=1e-6)
    assert not [name for name in rows[0] if "settlement" in name]
    with pytest.raises(
        ConfigurationError, match=r"the sweep has no point at 0\.002; it has viscosity 0\.001, 0\.004"
    ):
        found.solutions(viscosity=0.002)


@pytest.mark.parametrize(
    ("over", "said"),
    [
        ({"raduis": [0.2, 0.3]}, "raduis: no parameter of the cell has this name; did you mean 'radius'"),
        ({"radius": [0.2]}, "radius: expected at least two values, got"),
        ({"radius": [0.2, 0.2]}, r"radius: the value 0\.2 is there twice"),
        ({"radius": [0.2, np.nan]}, "radius: expected a finite number"),
        ({"radius": [0.2, "wide"]}, "radius: expected a number, got 'wide'"),
        ({"radius": 0.2}, r"radius: expected a sequence of values, got 0\.2"),
        ({"radius": "0.2"}, "radius: expected a sequence of values"),
        ({"radius": [0.2, 0.6]}, r"cell\.geometry\.radius: .*0\.6"),
        ({"poisson_ratio": [0.2, 0.46]}, r"poisson_ratio: expected a number from 0\.2 to 0\.45, the range of cell"),
        ({"radius": np.linspace(0.2, 0.3, 10_001)}, "expected at most 10000 values in all, got 10001"),
        ({}, "expected one or two parameters, got none"),
        ({name: [0.2, 0.3] for name in ("radius", "poisson_ratio", "viscosity")}, "two parameters, got radius, p"),
        ("radius", r"expected the name of a parameter and its values, such as sweep\('radius'"),
    ],
)  # fmt: skip
def test_what_is_no_sweep_is_refused(tmp_path: Path, over: Any, said: str) -> None:
    settings = ranged([0.2, 0.45])
    with pytest.raises(ConfigurationError, match=said):
        made(tmp_path / "none", settings).sweep(over)
    assert not list(tmp_path.iterdir())


def test_what_the_family_lacks_is_told(tmp_path: Path) -> None:
    settings = with_settings(cell__material={"poisson_ratio": {"range": [0.2, 0.4]}})
    with pytest.raises(ConfigurationError, match=r"macro\.fields\.poisson_ratio: missing"):
        made(tmp_path / "none", settings).sweep("radius", [0.2, 0.25])
    with pytest.raises(
        ConfigurationError, match=r"'mean-gradient' takes .* cell\.material\.poisson_ratio is a range"
    ):
        made(tmp_path / "none", with_settings(closure="mean-gradient")).sweep("poisson_ratio", [0.2, 0.3])
    with pytest.raises(ConfigurationError, match=r"laws: .* some of surrogate, linear, got .direct"):
        made(tmp_path / "none").sweep("radius", [0.2, 0.25], laws=("surrogate", "direct"))
    with pytest.raises(ConfigurationError, match="laws: expected surrogate among them, got linear"):
        made(tmp_path / "none").sweep("radius", [0.2, 0.25], laws=("linear",))
    assert not list(tmp_path.iterdir())


def test_the_command_prints_and_writes_the_same(swept: ParameterSweep, tmp_path: Path) -> None:
    """In the folder that Python has made, where nothing is left to be solved."""
    path = tmp_path / "study.yaml"
    path.write_text(yaml.safe_dump(STUDY), encoding="utf-8")
    words = ("sweep", path, "--over", "poisson_ratio=0.2:0.4:3", "--out", swept.folder.path)
    table = swept.table.read_bytes()
    done = invoke(*words, "--resume")
    assert done.exit_code == 0, done.output
    lines = done.stdout.splitlines()
    assert lines[-3:] == [str(path) for path in (swept.table, *swept.pictures)]
    assert lines[0].split()[:3] == ["poisson_ratio", "porosity", "final_settlement"]
    assert float(lines[2].split()[2]) == pytest.approx(swept.figures["final_settlement"][1], rel=1e-3)
    assert swept.table.read_bytes() == table
    done = invoke(*words)
    assert isinstance(done.exception, RunFolderError)
    assert "already holds this run; add --resume" in str(done.exception)
    done = invoke(*words[:3], "poisson_ratio=0.2,0.35", *words[4:], "--resume")
    assert "poisson_ratio.range ([0.2, 0.35], not [0.2, 0.4])" in str(done.exception)


@pytest.mark.parametrize(
    ("over", "said"),
    [
        ((), "--over: expected a parameter and its values, such as radius=0.16:0.28:7 or radius=0.16,0.2,0.28, got"),
        (("radius",), "--over: expected a parameter and its values"),
        (("radius=",), "--over: expected a parameter and its values"),
        (("raduis=0.2,0.3",), "--over: raduis: no parameter of the cell has this name; did you mean 'radius'?"),
        (("radius=0.2,wide",), "--over: radius: expected a number, got 'wide'"),
        (("radius=0.2:0.3",), "--over: radius: expected LOW:HIGH:COUNT, such as 0.16:0.28:7, got '0.2:0.3'"),
        (("radius=0.2:0.3:2.5",), "--over: radius: expected LOW:HIGH:COUNT"),
        (("radius=0.2:0.3:1",), "--over: radius: expected a COUNT from 2 to 10000, got 1"),
        (("radius=0.2:0.3:100000",), "--over: radius: expected a COUNT from 2 to 10000"),
        (("radius=0.3:0.2:3",), "--over: radius: expected LOW:HIGH:COUNT with LOW below HIGH"),
        (("radius=0.2:nan:3",), "--over: radius: expected a finite number, got 'nan'"),
        (("radius=0.2",), "--over: radius: expected at least two values, got [0.2]"),
        (("radius=0.2,0.3", "radius=0.2,0.3"), "--over: 'radius' is there twice"),
        (("radius=0.2,0.6",), "--over: cell.geometry.radius: expected"),
        (("viscosity=1 mPa s,2 mPa s",), "--over: viscosity: '1 mPa s' has a unit, but the configuration"),
    ],
)  # fmt: skip
def test_a_faulty_option_is_told_in_one_line(tmp_path: Path, over: tuple[str, ...], said: str) -> None:
    path = tmp_path / "study.yaml"
    path.write_text(yaml.safe_dump(STUDY), encoding="utf-8")
    options = [word for text in over for word in ("--over", text)]
    message = refusal("sweep", path, *options, "--out", tmp_path / "out")
    assert message.startswith(said)
    assert "\n" not in message
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_sweep_of_an_indented_disc(tmp_path: Path) -> None:
    """In its meridian; a stiffer solid bears more, and the contact is as wide."""
    ball = {
        "shape": {"kind": "sphere", "radius": 2},
        "place": [0, 1, 0],
        "displacement": {"ramp": 0.05, "until": 1},
        "surfaces": ["y+"],
        "outside": "drained",
    }
    macro = {
        "body": {"kind": "axisymmetric", "radius": 2, "height": 1, "elements": [3, 2], "grading": [3, 0.5]},
        "boundary": {"y-": {"displacement": [0, 0, 0]}, "side": {"normal": 0}},
        "contact": {"ball": ball},
        "loads": [1],
        "time": {"end": 200, "step": 100, "ramp_increments": 2, "ramp_step": 0.5},
    }
    strains = {name: {"range": [-0.1, 0.04]} for name in ("H11", "H22", "H33", "H12")}
    sampling = {**STUDY["sampling"], "inputs": {**strains, "p": {"range": [-0.02, 0.05]}}}
    sampling["options"] = {"count": 24, "states_per_member": 4}
    settings = {**STUDY, "macro": macro, "sampling": sampling}
    found = made(tmp_path / "out", settings).sweep({"poisson_ratio": [0.2, 0.4]})
    figures = found.figures
    assert (np.diff(figures["ball: peak"]) > 0).all()
    assert (figures["ball: peak"] > figures["ball: final"]).all()
    np.testing.assert_array_equal(figures["ball: largest_displacement"], 0.05)
    np.testing.assert_allclose(*figures["ball: largest_radius"], rtol=1e-3)
    assert found.quantity("ball: peak") == "force"
    assert png_bytes(sweep_figure(found))
