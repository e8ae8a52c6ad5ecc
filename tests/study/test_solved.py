"""Macro solutions from Python: arrays, xarray and pyvista, with units and without; figures and tables with units."""

import sys
from dataclasses import replace
from types import SimpleNamespace

import h5py
import numpy as np
import pytest

import porocore
from porocore.core.files.plain_data import merged
from porocore.core.units import OutputUnits, ResultUnits, Scales, using_units, value_of
from porocore.errors import ConfigurationError, DataError, PluginError
from porocore.interfaces.solution import MacroSolution, all_series
from porocore.report.context import LoadingMode
from porocore.report.dimensional import dimensional_metrics, dimensional_rows
from porocore.report.figures import body_figure, history_figure, series_figure
from porocore.report.metrics import case_metrics
from porocore.study.api.solved import LawsSolved, Solutions, Solved
from porocore.study.api.study import Study
from porocore.study.run.composition import require_laws
from porocore.study.run.solving import _kept

UNITS = ResultUnits(
    Scales(modulus=2000, length=0.01, pore=5e-6), OutputUnits(length="mm", stress="kPa", time="h", force="mN")
)


@pytest.fixture
def solution(column):
    """A column with a probe, a reaction and an inflow."""
    found = column(elements=(1, 4, 1))
    steps = np.arange(len(found.history.time), dtype=float)
    return replace(
        found,
        probes={"tip": np.outer(steps, [0, -1, 0, 0.5])},
        reactions={"y-": np.outer(steps, [0, 3, 0])},
        compression={"y-": 3 * steps},
        inflow={"y+": -steps},
    )


def test_a_file_of_a_solution_knows_the_units_of_its_study(solution, tmp_path):
    path = tmp_path / "s.h5"
    replace(solution, units=UNITS).save(path)
    read = porocore.MacroSolution.load_file(path)
    assert read.units == UNITS
    assert read.units.name("length") == "mm"
    assert read.history.time[-1] * read.units.factor("time") == pytest.approx(
        solution.history.time[-1] * 0.01**2 / (5e-6**2 * 2000) / 3600
    )
    solution.save(path)
    assert porocore.MacroSolution.load_file(path).units == ResultUnits()
    for text in ("{", "[]", '{"scales": {}, "output_units": {}}'):
        with h5py.File(path, "a") as file:
            file.attrs["units"] = text
        with pytest.raises(DataError, match=r"s\.h5: not a complete porocore solution"):
            porocore.MacroSolution.load_file(path)


def test_a_solution_that_stays_takes_the_units_that_the_study_has_now(solution, tmp_path):
    """Scales and output units are no part of a run, and may change while it goes on."""
    path = tmp_path / "s.h5"
    replace(solution, units=UNITS).save(path)
    for units in (replace(UNITS, units=OutputUnits(length="um")), ResultUnits()):
        config = SimpleNamespace(macro=SimpleNamespace(loads=[solution.load]), result_units=units)
        folder = SimpleNamespace(solution=lambda law, load: path, config=config)
        found = _kept(folder, [solution.law], None)
        assert found[solution.law, solution.load][0]
        assert porocore.MacroSolution.load_file(path).units == units


def test_the_whole_specimen_is_kept_in_files(solution, tmp_path):
    replace(solution, copies=4.0).save(tmp_path / "s.h5")
    read = type(solution).load_file(tmp_path / "s.h5")
    assert read.copies == 4
    np.testing.assert_array_equal(read.compression["y-"], solution.compression["y-"])


def test_columns_say_what_is_positive(solution):
    columns = {each.column for each in all_series(solution)}
    assert {
        "y-: compressive force (+ in compression)",
        "y-: force 2 (+ along y)",
        "y+: inflow (+ into the body)",
        "settlement",
    } <= columns
    compressed = Solved(solution)
    np.testing.assert_array_equal(compressed.compression["y-"], solution.compression["y-"])
    assert compressed.forces["y-"]["force"] == "compressive"
    peak = compressed.forces["y-"]["peak"]
    in_units = Solved(solution, units=UNITS).forces["y-"]["peak"]
    assert in_units == {"value": pytest.approx(200 * peak), "unit": "mN", "dimensionless": peak}


def test_units_are_public_and_name_what_they_do_not_know():
    """They were those of a solution alone; nothing converted what the law returns."""
    study = Study("brain-indentation", progress=False)
    assert isinstance(study.units, porocore.ResultUnits)
    assert (study.units.factor("length"), study.units.name("length")) == (10, "mm")
    assert study.units.factor("p") == study.units.factor("stress") == 2000
    assert study.units.factor("conductivity") == pytest.approx((5e-3) ** 2 / 1)
    assert Study("cartilage-confined", progress=False).units.factor("stress") == 1
    for units in (UNITS, ResultUnits()):
        for ask in (units.factor, units.name):
            with pytest.raises(
                ConfigurationError, match="unknown quantity 'stres'; expected one of displacement"
            ):
                ask("stres")


def test_a_solution_as_a_dataset(solution):
    pytest.importorskip("xarray")
    plain, dimensional = Solved(solution).to_xarray(), Solved(solution, UNITS).to_xarray()
    steps = len(solution.history.time)
    assert dict(plain.sizes) == {
        "time": steps,
        "probe": 1,
        "component": 3,
        "surface": 1,
        "drain": 1,
    }
    assert plain.probe_displacement.sel(probe="tip", component="y").values[2] == -2
    assert plain.probe_pressure.sel(probe="tip").values[2] == 1
    assert {v.attrs["units"] for v in plain.variables.values() if "units" in v.attrs} == {"1"}
    for name, unit, quantity in (
        ("settlement", "mm", "displacement"),
        ("probe_pressure", "kPa", "pressure"),
        ("reaction", "mN", "force"),
        ("compression", "mN", "force"),
        ("inflow", "mm³/h", "flow"),
        ("drained", "mm³", "volume"),
        ("ramp", "1", ""),
        ("time", "h", "time"),
    ):
        assert dimensional[name].attrs["units"] == unit
        assert dimensional[name].attrs["long_name"]
        np.testing.assert_allclose(dimensional[name], plain[name].values * UNITS.factor(quantity), rtol=1e-14)
    assert dimensional.attrs["law"] == solution.law
    history = replace(solution.history, time=np.full(steps, value_of("0.3 h", "time", UNITS.scales)))
    assert set(Solved(replace(solution, history=history), UNITS).to_xarray().time.values) == {0.3}


def test_a_solution_as_a_grid(solution):
    pytest.importorskip("pyvista")
    profile = solution.profiles[1]
    grid = Solved(solution, UNITS).to_pyvista(profile.time)
    assert (grid.n_cells, grid.n_points) == (4, len(solution.points))
    np.testing.assert_allclose(grid.points, 10 * solution.points, rtol=1e-6)
    np.testing.assert_allclose(grid["u"], 10 * profile.u)
    np.testing.assert_allclose(grid["p"], 2 * profile.p)
    np.testing.assert_allclose(grid["P_E"][:, 4], 2 * profile.stress[:, 1, 1])
    volumes = grid.compute_cell_sizes(length=False, area=False)["Volume"]
    np.testing.assert_allclose(volumes.sum(), 1000 * np.ptp(solution.points, axis=0).prod(), rtol=1e-6)
    with pytest.raises(ConfigurationError, match=r"the fields were kept at 1, 10, .*, not at 7"):
        Solved(solution).to_pyvista(7)


@pytest.mark.parametrize(("package", "method"), [("xarray", "to_xarray"), ("pyvista", "to_pyvista")])
def test_a_missing_package_is_named(solution, package, method, monkeypatch):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(
        PluginError, match=rf"{package} is not installed; install it with: pip install {package}"
    ):
        getattr(Solved(solution), method)()


def test_solutions_are_found_by_load_and_law(column):
    both = LawsSolved({"potential": Solved(column(law="potential")), "linear": Solved(column(law="linear"))})
    solutions = Solutions({-0.2: both})
    assert solutions[-0.2].nonlinear.law == "potential"
    assert solutions[-0.2].linear is both["linear"]
    assert list(solutions) == [-0.2]
    assert 0.1 not in solutions
    assert solutions.get(0.1) is None
    with pytest.raises(ConfigurationError, match=r"nothing was solved for 0.1; there is -0.2"):
        _ = solutions[0.1]


def test_figures_and_metrics_have_the_units(solution):
    with using_units(UNITS):
        figure = history_figure(solution, solution)
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert [label.split("[")[1] for label in labels] == ["mm]", "kPa]", "mm³]"]
    curve = figure.axes[0].lines[0]
    np.testing.assert_allclose(curve.get_ydata(), 10 * solution.history.settlement)
    np.testing.assert_allclose(curve.get_xdata(), solution.history.time * UNITS.factor("time"))
    with using_units(UNITS):
        axes = series_figure(solution, solution, "forces of held or moved surfaces").axes[0]
    assert (axes.get_xlabel(), axes.get_ylabel()) == (
        "time $t$ [h]",
        "compressive force [mN]\n(positive in compression)",
    )
    np.testing.assert_allclose(axes.lines[0].get_ydata(), 200 * solution.reactions["y-"][:, 1])
    with using_units(UNITS):
        body = body_figure(solution, solution.profiles[0])
    assert body.axes[0].get_zlabel() == "$x_2$ [mm]"
    assert body.axes[1].get_ylabel() == "pore pressure $p$ [kPa]"
    (found,) = dimensional_metrics([solution], UNITS)
    assert found["series"]["y-: force 2"]["unit"] == "mN"
    assert found["series"]["y-: force 2"]["final"] == pytest.approx(200 * solution.reactions["y-"][-1, 1])
    assert found["series"]["settlement"]["at"] == pytest.approx(found["end_time"])
    times = np.full(len(solution.history.time), value_of("0.3 h", "time", UNITS.scales))
    (found,) = dimensional_metrics([replace(solution, history=replace(solution.history, time=times))], UNITS)
    assert (found["series"]["settlement"]["at"], found["end_time"]) == (0.3, 0.3)


def test_the_table_of_the_report_has_the_units_of_the_study(case):
    rows = dimensional_rows(
        case_metrics(case), case.nonlinear, np.eye(3), {"this study": UNITS}, LoadingMode()
    )
    by_name = {row.name: row for row in rows}
    final = case.nonlinear.history.settlement[-1]
    text = by_name["final settlement"].values[0]
    assert text.endswith(" mm")
    assert float(text.split()[0]) == pytest.approx(10 * final, rel=5e-3)


@pytest.fixture
def case(column):
    from porocore.report.metrics import LoadCase

    return LoadCase(column(), column(law="linear", final=2.5))


def test_settings_are_merged_section_by_section():
    below = {"macro": {"body": {"kind": "box", "size": 1}, "loads": [1]}, "surrogate": {"options": {"a": 1}}}
    assert merged(below, {"macro": {"loads": np.array([2])}})["macro"] == {
        "body": {"kind": "box", "size": 1},
        "loads": [2],
    }
    assert merged(below, {"macro": {"body": {"kind": "wedge"}}})["macro"]["body"] == {"kind": "wedge"}
    assert merged(below, {"surrogate": {"options": {}}})["surrogate"] == {"options": {}}
    assert merged(below, {"surrogate": {"backend": "jax"}})["surrogate"] == {"backend": "jax"}
    assert below["macro"]["loads"] == [1]


def test_a_study_is_named_by_its_source_and_writes_nothing_yet(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    study = Study("crosscheck", macro={"loads": [-0.01]})
    assert (str(study.path), study.config.macro.loads) == ("runs/crosscheck", (-0.01,))
    assert repr(study) == "<porocore study 'Crosscheck of the installed backends' in runs/crosscheck>"
    assert Study(study.config, macro={"loads": [-0.02]}).config.macro.loads == (-0.02,)
    assert Study(study.config).config.identity == study.config.identity
    with pytest.raises(ConfigurationError, match="no such file"):
        Study("absent.yaml")
    assert not list(tmp_path.iterdir())


def test_the_path_of_a_solution_may_be_a_text(solution, tmp_path):
    path = tmp_path / "solution.h5"
    solution.save(path)
    assert MacroSolution.load_file(str(path)).law == solution.law
    with pytest.raises(DataError, match=r"missing\.h5: no such file"):
        MacroSolution.load_file(str(tmp_path / "missing.h5"))


@pytest.mark.parametrize(
    ("laws", "words"),
    [
        (("exact",), "no law is called 'exact'; the kinds of laws are surrogate, linear, direct, fallback"),
        (("linaer",), "did you mean 'linear'?"),
        ("linear", "expected a sequence, such as ('linear',), got the text 'linear'"),
        ((None,), "no law is called"),
    ],
)
def test_an_unknown_law_is_refused_before_anything_is_solved(laws, words):
    with pytest.raises(ConfigurationError) as caught:
        require_laws(laws)
    assert words in str(caught.value)
