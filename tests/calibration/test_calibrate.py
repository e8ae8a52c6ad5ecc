"""A calibration from made-up data to its files: truth, determinism, killed runs, further cells, the command."""

from __future__ import annotations

import csv
import io
import json
import shutil
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import porocore
from porocore.commands.calibration.calibrate import _identity, _with_made_up_data
from porocore.commands.calibration.cells import families
from porocore.commands.calibration.command import print_unknowns
from porocore.commands.calibration.experiment import ExperimentModel
from porocore.commands.calibration.observations import by_curve
from porocore.commands.calibration.problem import Unknown
from porocore.core.console import Console
from porocore.core.files.store import ResultStore
from porocore.errors import RunFolderError, SolveError
from porocore.macro.laws.linear import EffectiveProperties
from tests.helpers.calibration_models import Formula
from tests.helpers.curve_experiment import planned
from tests.helpers.invoked import invoke
from tests.helpers.report_page import Page

pytest.importorskip("porocore_fem_skfem")

SIDE = {"displacement": [0, None, 0]}
TIMES = {"first": 5, "last": 3000, "count": 8}
STUDY: dict[str, Any] = {
    "title": "A twin",
    "cell": {
        "geometry": {"kind": "orthogonal-channels", "radius": 0.24},
        "material": {"poisson_ratio": 0.35},
        "viscosity": 1.0,
        "mesh": {"size": 0.5, "fluid_size": 0.5, "element": "linear"},
    },
    "sampling": {
        "sampler": "sobol",
        "inputs": {"H22": {"range": [-0.16, 0.02]}, "p": {"range": [-0.02, 0.08]}},
        "options": {"count": 20, "corners": True, "states_per_member": 4},
        "test": {"count": 1},
        "workers": 1,
    },
    "surrogate": {"backend": "polynomial"},
    "closure": "potential",
    "macro": {
        "body": {"kind": "box", "size": [0.1, 1.0, 0.1], "elements": [1, 2, 1]},
        "boundary": {
            **dict.fromkeys(("x-", "x+", "z-", "z+"), SIDE),
            "y-": {"displacement": [0, 0, 0]},
            "y+": {"traction": [0, 1, 0], "pressure": 0},
        },
        "loads": [-0.04],
        "time": {"end": 3000, "step": 600, "ramp_increments": 1, "ramp_step": 2, "profiles": []},
    },
    "calibration": {
        "unknowns": {
            "radius": {"lower": 0.2, "upper": 0.28},
            "modulus": {"lower": 0.5, "upper": 2},
            "viscosity": {"lower": 0.4, "upper": 2.5},
        },
        "observations": {"settlement": {"quantity": "settlement", "deviation_share": 0.002, "times": TIMES}},
        "fit": {"starts": 1, "rays": 0},
    },
}


def results(folder: Path) -> dict[str, Any]:
    """What a calibration found; its time is another each time."""
    found: dict[str, Any] = json.loads((folder / "calibration.json").read_text(encoding="utf-8"))
    del found["seconds"]
    return found


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("calibrate")


@pytest.fixture(scope="module")
def done(base: Path) -> porocore.Calibration:
    return porocore.calibrate(STUDY, base / "twin", synthetic=True, progress=False, store=base / "store")


def test_the_truth_lies_in_the_intervals(done: porocore.Calibration) -> None:
    truth = {"radius": 0.24, "modulus": 1.0, "viscosity": 1.0}
    for name, value in truth.items():
        low, high = done.intervals[name]
        assert low is not None
        assert high is not None
        assert low < value < high, name
        assert low < done.values[name] < high
    assert 1e-3 < done.quality.chance < 1 - 1e-3
    assert done.warnings == ()


def test_the_files_hold_what_was_found(done: porocore.Calibration) -> None:
    found = results(done.path)
    assert [*found["unknowns"]] == ["radius", "modulus", "viscosity"]
    for name, entry in found["unknowns"].items():
        assert entry["value"] == done.values[name]
        assert tuple(entry["interval95"]) == done.intervals[name]
        assert entry["identifiable"] is done.identifiable[name]
        assert entry["unit"] == ""
    assert found["misfit"] == pytest.approx(done.quality.chi_square)
    samples, held_out = 20, 1
    assert found["cell_solves"] == done.cell_solves > samples + held_out
    with (done.path / "curves.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    residuals = [(float(row["fitted"]) - float(row["measured"])) / float(row["deviation"]) for row in rows]
    assert len(rows) == TIMES["count"]
    assert np.square(residuals).sum() == pytest.approx(found["misfit"], rel=1e-3)
    with (done.path / "samples.csv").open(encoding="utf-8") as file:
        tried = [float(row["chi_square"]) for row in csv.DictReader(file)]
    assert min(tried) == pytest.approx(found["misfit"], rel=1e-3)
    assert "A twin" in (done.path / "report.html").read_text(encoding="utf-8")


def resolved(radius: float, modulus: float, viscosity: float) -> EffectiveProperties:
    """The fitted cell solved anew, in units of the study."""
    found = porocore.CellProblem(STUDY["cell"], parameters={"radius": radius}, store=False).properties
    K, c_v = found.conductivity / viscosity, found.consolidation_coefficients * modulus / viscosity
    confined, young = found.confined_moduli * modulus, found.young_moduli * modulus
    return replace(
        found, confined_moduli=confined, young_moduli=young, conductivity=K, consolidation_coefficients=c_v
    )


def test_derived_numbers_are_those_of_the_cell_solved_anew(done: porocore.Calibration) -> None:
    """Values against a solve, intervals against slopes by differences of solves."""
    (cell,) = done.derived

    def numbers(radius: float, modulus: float, viscosity: float) -> dict[str, float]:
        found = resolved(radius, modulus, viscosity)
        return {
            "porosity": found.porosity,
            "aggregate_modulus": found.confined_moduli[0],
            "young_modulus": found.young_moduli[1],
            "poisson_ratio": found.poisson_ratios[0, 1],
            "shear_modulus": found.shear_moduli[0] * modulus,
            "hydraulic_permeability": found.conductivity[0, 0],
            "intrinsic_permeability": found.permeability[2, 2],
            "consolidation_coefficient": found.consolidation_coefficients[0],
            "aggregate_modulus_times_permeability": found.confined_moduli[0] * found.conductivity[0, 0],
        }

    best = list(done.values.values())
    expected, covariance = numbers(*best), done.inference.with_priors.covariance
    assert [*expected] == [each.name for each in cell.numbers]
    # The last two unknowns are searched in ln x.
    steps = [(1e-3, 1e-3), (1e-3 * best[1], 1e-3), (1e-3 * best[2], 1e-3)]
    ends = [
        [numbers(*(np.array(best) + sign * step * np.eye(3)[i])) for sign in (-1, 1)]
        for i, (step, _) in enumerate(steps)
    ]
    for each in cell.numbers:
        form = np.asarray if each.name in ("porosity", "poisson_ratio") else np.log
        assert each.value == pytest.approx(expected[each.name], rel=2e-3)
        assert each.unit == ""
        slopes = [
            (form(high[each.name]) - form(low[each.name])) / (2 * by)
            for (low, high), (_, by) in zip(ends, steps, strict=True)
        ]
        deviation = np.sqrt(slopes @ covariance @ slopes)
        low, high = each.interval.values
        assert low is not None
        assert high is not None
        assert form(high) - form(low) == pytest.approx(2 * 1.96 * deviation, rel=0.02), each.name
        assert form(high) + form(low) == pytest.approx(2 * form(each.value), rel=1e-9)
    entries = results(done.path)["derived"]["cells"][0]["numbers"]
    assert entries["aggregate_modulus"]["interval95"] == list(cell.intervals["aggregate_modulus"])
    assert entries["aggregate_modulus"]["value"] == cell.values["aggregate_modulus"]


def test_the_report_can_be_cited(done: porocore.Calibration) -> None:
    """It had no version, configuration, bounds or data, and the title of the study."""
    page = Page((done.path / "report.html").read_text(encoding="utf-8"))
    for words in (
        "Calibration: A twin",
        f"porocore{porocore.__version__}",
        "cell skfem, surrogate polynomial, body skfem",
        "0.5000 … 2.000",
        "synthetic",
        "aggregate modulus H_A",
        "intrinsic permeability k",
        "deviation_share: 0.002",
        "Please cite porocore",
    ):
        assert words in page.words, words


def test_the_data_are_made_up_by_the_first_evaluation(done: porocore.Calibration) -> None:
    with (done.path / "samples.csv").open(encoding="utf-8") as file:
        tried = [[float(text) for text in row[:3]] for row in list(csv.reader(file))[1:]]
    assert len(tried) == len({*map(tuple, tried)})
    np.testing.assert_allclose(tried[0], [0.24, 1.0, 1.0])


def test_values_at_which_no_data_can_be_made_up_are_told(done: porocore.Calibration) -> None:
    model = Formula((Unknown("rate", 2.0, 1.0, 3.0),), lambda v: v, computable=((0.0, 1.0),))
    with pytest.raises(
        SolveError, match="start values of the unknowns, rate 2; give other bounds, or a 'start:'"
    ):
        _with_made_up_data(done.plan, model)


def killed(done: porocore.Calibration, folder: Path, evaluations: int) -> Path:
    """A copy of a folder as a process leaves it that is killed during an evaluation."""
    shutil.copytree(done.path, folder)
    (folder / "calibration.json").unlink()
    record = folder / "evaluations-0.jsonl"
    lines = record.read_text(encoding="utf-8").splitlines(keepends=True)
    record.write_text("".join(lines[: evaluations + 1]) + lines[-1][:40], encoding="utf-8")
    return folder


def test_a_killed_calibration_ends_at_the_same_answer(done: porocore.Calibration, tmp_path: Path) -> None:
    known = len((done.path / "evaluations-0.jsonl").read_text(encoding="utf-8").splitlines()) - 1
    folder = killed(done, tmp_path / "killed", known - 3)
    with pytest.raises(RunFolderError, match="already holds this calibration; add --resume"):
        porocore.calibrate(STUDY, folder, synthetic=True, progress=False)
    porocore.calibrate(STUDY, folder, synthetic=True, resume=True, progress=False, store=False)
    assert results(folder) == results(done.path)
    again = (folder / "evaluations-0.jsonl").read_text(encoding="utf-8")
    assert again == (done.path / "evaluations-0.jsonl").read_text(encoding="utf-8")


@pytest.mark.slow
@pytest.mark.parametrize("evaluations", [0, 1, 5, 12])
def test_a_calibration_killed_at_any_evaluation_ends_the_same(
    evaluations: int, done: porocore.Calibration, tmp_path: Path
) -> None:
    folder = killed(done, tmp_path / "killed", evaluations)
    porocore.calibrate(STUDY, folder, synthetic=True, resume=True, progress=False, store=False)
    assert results(folder) == results(done.path)


@pytest.mark.slow
def test_a_graded_radius_lies_in_the_intervals(base: Path) -> None:
    """Two control values, seen by the displacement of a point in the middle."""
    study: dict[str, Any] = json.loads(json.dumps(STUDY))
    study["macro"]["probes"] = {"middle": [0.05, 0.5, 0.05]}
    move = {"quantity": "displacement", "probe": "middle", "component": 2}
    curve = {"deviation_share": 0.002, "times": TIMES}
    field = {"along": "y", "at": [0, 1], "start": [0.22, 0.26]}
    study["calibration"] |= {
        "unknowns": {"radius": {"lower": 0.2, "upper": 0.28, "field": field}},
        "observations": {"settlement": {"quantity": "settlement", **curve}, "move": {**move, **curve}},
    }
    done = porocore.calibrate(study, base / "graded", synthetic=True, progress=False, store=base / "store")
    for name, truth in {"radius[0]": 0.22, "radius[1]": 0.26}.items():
        low, high = done.intervals[name]
        assert low is not None
        assert high is not None
        assert low < truth < high, name
        assert done.identifiable[name]
    found = results(done.path)["fields"]["radius"]
    assert found == {"along": "y", "at": [0.0, 1.0], "unit": "", "unknowns": ["radius[0]", "radius[1]"]}
    first, second = done.derived
    assert (first.title, second.title) == ("y = 0", "y = 1")
    assert first.values["porosity"] < second.values["porosity"]
    assert first.values["aggregate_modulus"] > second.values["aggregate_modulus"]
    assert None not in first.intervals["hydraulic_permeability"]
    assert "Field of radius" in (done.path / "report.html").read_text(encoding="utf-8")


@pytest.mark.slow
def test_a_calibration_killed_among_its_cells_ends_the_same(
    done: porocore.Calibration, base: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "killed"
    (folder / "cells").mkdir(parents=True)
    shutil.copy(done.path / "calibrate.json", folder)
    porocore.calibrate(STUDY, folder, synthetic=True, resume=True, progress=False, store=base / "store")
    assert results(folder) == results(done.path)


@pytest.mark.slow
def test_a_posterior_is_added_later_and_a_killed_one_ends_at_the_same_draws(
    done: porocore.Calibration, tmp_path: Path
) -> None:
    pytest.importorskip("emcee", reason="pip install emcee")
    wanted = {**STUDY, "calibration": {**STUDY["calibration"], "posterior": {"steps": 1000}}}
    folder = tmp_path / "later"
    shutil.copytree(done.path, folder)
    first = porocore.calibrate(
        wanted, folder, synthetic=True, resume=True, progress=False, store=False
    ).posterior
    assert first is not None
    assert first.check.passed
    found = results(folder)
    for one, (low, high) in zip(first.unknowns, first.intervals, strict=True):
        entry = found["posterior"]["unknowns"][one.name]
        assert entry["interval95"] == [low, high]
        # Nearly linear within the noise, so that both kinds of intervals are about the same.
        np.testing.assert_allclose(entry["interval95"], done.intervals[one.name], rtol=0.02)
    assert {name: found[name] for name in results(done.path)} == results(done.path) | {
        "warnings": found["warnings"]
    }
    record, draws = folder / "evaluations-0.jsonl", (folder / "posterior.csv").read_text(encoding="utf-8")
    lines = record.read_text(encoding="utf-8").splitlines(keepends=True)
    known = len((done.path / "evaluations-0.jsonl").read_text(encoding="utf-8").splitlines())
    assert len(lines) == known + first.runs
    record.write_text("".join(lines[: known + 3]), encoding="utf-8")
    porocore.calibrate(wanted, folder, synthetic=True, resume=True, progress=False, store=False)
    assert results(folder) == found
    assert (folder / "posterior.csv").read_text(encoding="utf-8") == draws
    assert record.read_text(encoding="utf-8") == "".join(lines)


def test_a_folder_of_another_calibration_is_refused(done: porocore.Calibration) -> None:
    other = {**STUDY, "calibration": {**STUDY["calibration"], "fit": {"starts": 1, "rays": 0, "seed": 1}}}
    with pytest.raises(
        RunFolderError, match="holds another calibration, with other settings of the fit; choose"
    ):
        porocore.calibrate(other, done.path, synthetic=True, resume=True, progress=False)
    unknowns = {**STUDY["calibration"]["unknowns"]}
    unknowns["modulus"] = {**unknowns["modulus"], "upper": 77}
    other = {**STUDY, "calibration": {**STUDY["calibration"], "unknowns": unknowns}}
    with pytest.raises(RunFolderError, match="holds another calibration, with other unknowns; choose"):
        porocore.calibrate(other, done.path, synthetic=True, resume=True, progress=False)


def test_the_command_prints_the_results(done: porocore.Calibration, base: Path) -> None:
    config = base / "twin.yaml"
    config.write_text(yaml.safe_dump(STUDY, sort_keys=False), encoding="utf-8")
    words = ("calibrate", config, "--out", done.path, "--synthetic", "--resume", "--no-store")
    told = invoke(*words)
    assert told.exit_code == 0, told.output
    row = next(line for line in told.stdout.splitlines() if line.startswith("radius"))
    assert f"{done.values['radius']:.4g}" in row
    assert "calibration.json" in told.stdout
    printed = json.loads(invoke(*words, "--json").stdout)
    assert printed["unknowns"] == results(done.path)["unknowns"]


def test_intervals_of_data_that_nothing_explains_are_told_as_such(
    done: porocore.Calibration, capsys: pytest.CaptureFixture[str]
) -> None:
    print_unknowns(done)
    assert "presume" not in capsys.readouterr().out
    print_unknowns(replace(done, quality=replace(done.quality, chi_square=1e4, freedom=20, chance=0.0)))
    assert "presume a right model, but the reduced chi-square is 500" in capsys.readouterr().out


def measured(base: Path, folder: Path, values: np.ndarray, times: np.ndarray) -> dict[str, Any]:
    """The study with a file of data in place of made-up ones."""
    rows = "".join(f"{t},{value}\n" for t, value in zip(times, values, strict=True))
    (folder / "data.csv").write_text(f"time,settlement\n{rows}", encoding="utf-8")
    settings = {"quantity": "settlement", "deviation_share": 0.002, "file": str(folder / "data.csv")}
    study: dict[str, Any] = json.loads(json.dumps(STUDY))
    study["calibration"]["observations"] = {"settlement": settings}
    return study


def test_intervals_hold_the_truth_in_spite_of_long_steps(
    done: porocore.Calibration, base: Path, tmp_path: Path
) -> None:
    """Data without noise, of steps that are 64 times as short."""
    store, console = ResultStore(base / "store"), Console(io.StringIO())
    truth = np.array([0.24, 1.0, 1.0])
    with ExitStack() as stack:
        (family,) = families(done.plan, tmp_path / "exact", stack, console, store)
        family.learn()
        experiment = done.plan.experiments[0]
        model = ExperimentModel(experiment, done.plan.unknowns, family.laws()(experiment.config))
        exact = model.halved(6).values(truth)
    study = measured(base, tmp_path, exact, done.plan.curves[0].times)
    found = porocore.calibrate(study, tmp_path / "out", progress=False, store=store)
    error = found.inference.systematic
    assert error is not None
    assert error.counted
    moved = found.inference.best.coordinates + error.shift
    for one, x, value in zip(found.inference.unknowns, moved, truth, strict=True):
        low, high = found.intervals[one.name]
        assert low is not None
        assert high is not None
        assert low < value < high, one.name
        # Ever shorter steps lead to the truth, to first order for these very long ones.
        assert abs(one.value(float(x)) - value) < 0.4 * abs(found.values[one.name] - value), one.name
    assert error.size > 2
    entry = results(found.path)["error_of_steps"]
    assert entry["counted"] is True
    assert entry["shift"]["modulus"] == pytest.approx(np.exp(moved[1]) - found.values["modulus"], rel=1e-9)
    assert any("the steps in time are long for these data" in warning for warning in found.warnings)
    page = (found.path / "report.html").read_text(encoding="utf-8")
    assert "Error of the steps in time" in page
    # The runs with halved steps are kept.
    before = (found.path / "halved-steps.json").read_bytes()
    again = porocore.calibrate(study, found.path, resume=True, progress=False, store=False)
    assert results(again.path)["error_of_steps"] == entry
    assert (found.path / "halved-steps.json").read_bytes() == before


def test_the_steps_of_made_up_data_are_those_of_the_fit(done: porocore.Calibration) -> None:
    entry = results(done.path)["error_of_steps"]
    assert entry["counted"] is False
    assert entry["largest_shift_in_deviations"] > 2
    assert done.warnings == ()


def test_no_further_cells_are_solved_for_data_that_nothing_explains(
    done: porocore.Calibration, base: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Values of another sign and unit: it is said before anything else is computed."""
    times, values = done.plan.curves[0].times, done.plan.curves[0].measured
    assert values is not None
    study = measured(base, tmp_path, 12 * values, times)
    study["calibration"]["fit"]["evaluations"] = 8
    found = porocore.calibrate(study, tmp_path / "out", store=base / "store")
    told = capsys.readouterr().err
    assert not (found.path / "cells" / "rounds.json").exists()
    assert found.inference.best.prediction.flagged
    first = told.index("warning: fit: no values of the unknowns explain the data")
    assert "at t = 0 the load of the study begins" in told
    assert "at the bound of the search, " in told
    assert "; check the units and signs of the data first; where they are right, widen the bounds" in told
    assert told.index("no further cells are solved there, since they would not explain the data") > first
    assert told.index("intervals: ") > first
    assert any("no further cells were solved there" in warning for warning in found.warnings)
    assert not any("raise fit.rounds" in warning for warning in found.warnings)


@pytest.mark.slow
def test_further_cells_are_solved_where_the_fitted_body_leaves_the_samples(
    base: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Data of the wide samples, fitted from samples that end at a fifth of the strain."""
    narrow: dict[str, Any] = json.loads(json.dumps(STUDY))
    narrow["sampling"]["inputs"] = {"H22": {"range": [-0.03, 0.005]}, "p": {"range": [-0.01, 0.03]}}
    wide = porocore.calibrate(STUDY, tmp_path / "wide", synthetic=True, progress=False, store=base / "store")
    with (wide.path / "curves.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    table = "".join(f"{row['time']},{row['measured']}\n" for row in rows)
    (tmp_path / "data.csv").write_text(f"time,settlement\n{table}", encoding="utf-8")
    settings = {"quantity": "settlement", "deviation_share": 0.002, "file": str(tmp_path / "data.csv")}
    narrow["calibration"]["observations"] = {"settlement": settings}
    found = porocore.calibrate(narrow, tmp_path / "narrow", store=base / "store")
    assert "\nfurther cells: t = 3000 of 3000" in capsys.readouterr().err
    rounds = json.loads((tmp_path / "narrow" / "cells" / "rounds.json").read_text(encoding="utf-8"))
    assert sum(map(len, rounds)) > 0
    assert (tmp_path / "narrow" / "evaluations-1.jsonl").exists()
    assert not found.inference.best.prediction.flagged
    for name, value in wide.values.items():
        low, high = wide.intervals[name]
        assert low is not None
        assert high is not None
        assert abs(found.values[name] - value) < 0.5 * (high - low), name
    resumed = tmp_path / "resumed"
    shutil.copytree(tmp_path / "narrow", resumed)
    record = resumed / "evaluations-1.jsonl"
    lines = record.read_text(encoding="utf-8").splitlines(keepends=True)
    record.write_text("".join(lines[:3]), encoding="utf-8")
    porocore.calibrate(narrow, resumed, resume=True, progress=False, store=False)
    assert results(resumed) == results(tmp_path / "narrow")


def test_each_deviation_of_a_long_curve_counts_for_what_a_folder_is_of() -> None:
    plan = planned()
    (experiment,) = plan.experiments
    spread = np.full(3000, 0.1)

    def identity() -> dict[str, str]:
        curves = (replace(experiment.curves[0], spread=spread.copy()), *experiment.curves[1:])
        return _identity(replace(plan, experiments=(replace(experiment, curves=curves),)), False)

    before = identity()
    assert identity() == before
    spread[1500] *= 2
    assert {name for name, hash_ in identity().items() if hash_ != before[name]} == {"data of 'settlement'"}


def film_rows(found: porocore.Calibration, moved: bool = False) -> str:
    """The measured film as a CSV file; at the places to which the fitted particles have come if ``moved``."""
    curves = found.plan.curves
    fitted = by_curve(found.inference.best.prediction.values, curves)
    places = curves[0].series.places + (np.stack([*fitted, 0 * fitted[0]], axis=1) if moved else 0.0)
    columns = [*places.T, curves[0].times, *(curve.measured for curve in curves)]
    return "\n".join(
        ["x,y,z,t,u1,u2", *(",".join(map(repr, row)) for row in np.stack(columns, axis=1).tolist())]
    )


@pytest.mark.slow
def test_a_film_in_a_file_is_fitted_as_the_same_made_up_one(base: Path) -> None:
    """Made-up values of a film, written and read, give the same answer; so do the places where its points come to."""
    film = {
        "grid": [4, 30, 1],
        "fixed": {"z": 0.05},
        "times": TIMES,
        "quantities": ["u1", "u2"],
        "deviation": 1e-4,
    }
    unknowns = {"radius": {"lower": 0.2, "upper": 0.28}}
    section = {"unknowns": unknowns, "points": {"film": film}, "fit": {"starts": 1, "rays": 0}}
    store = base / "store"

    def run(section: dict[str, Any], name: str, **how: Any) -> porocore.Calibration:
        study = {**STUDY, "calibration": section}
        return porocore.calibrate(study, base / name, progress=False, store=store, **how)

    made = run(section, "film", synthetic=True)
    low, high = made.intervals["radius"]
    assert low is not None
    assert high is not None
    assert low < 0.24 < high
    assert (made.path / "points.csv").read_text(encoding="utf-8").count("\n") == 1 + 2 * 120 * 8
    for name, moved in (("read", False), ("moved", True)):
        path = base / f"{name}.csv"
        path.write_text(film_rows(made, moved), encoding="utf-8")
        place = "deformed" if moved else "reference"
        of_file = {"file": str(path), "deviation": 1e-4, "place": place}
        again = run({**section, "points": {"film": of_file}}, name)
        assert again.values["radius"] == pytest.approx(made.values["radius"], rel=1e-5)
    found = results(again.path)
    resumed = run({**section, "points": {"film": of_file}}, name, resume=True)
    assert results(resumed.path) == found
