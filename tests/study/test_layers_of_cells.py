"""Bodies of several cells, each with samples and a surrogate of its own: closed forms, the plain study, resuming."""

from __future__ import annotations

import copy
import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from porocore import Study
from porocore.core.files.plain_data import merged
from porocore.errors import ConfigurationError, RunFolderError
from porocore.macro.analytic import LayeredConsolidation, SoilLayer
from porocore.study.run.results import RunResults, linear_coefficients, load_reference, load_solution
from porocore.study.run.summary import report_context

pytest.importorskip("porocore_fem_skfem")

SIDE = {"displacement": [0, None, 0]}
HEIGHTS = (1.0, 1.0)
COARSE = {"size": 0.5, "fluid_size": 0.5, "element": "linear"}
#: The upper layer is soft and open, the lower one stiff and dense.
UPPER = {"geometry": {"kind": "orthogonal-channels", "radius": 0.3}, "mesh": COARSE}
LOWER = {
    "geometry": {"kind": "orthogonal-channels", "radius": 0.2},
    "material": {"kind": "neo-hookean", "poisson_ratio": 0.2},
    "mesh": COARSE,
}
LOAD = 2e-5
STUDY: dict[str, Any] = {
    "cell": UPPER,
    "cells": {"clay": LOWER},
    "sampling": {
        "sampler": "sobol",
        "inputs": {"H22": {"range": [-1e-3, 5e-4]}, "p": {"range": [-1e-4, 5e-4]}},
        "options": {"count": 8},
        "test": {"count": 3},
        "workers": 1,
    },
    "surrogate": {"backend": "polynomial"},
    "closure": "potential",
    "macro": {
        "body": {"kind": "box", "size": [0.1, sum(HEIGHTS), 0.1], "elements": [1, 16, 1]},
        "regions": {"deep": {"below": HEIGHTS[0], "cell": "clay"}},
        "boundary": {
            **dict.fromkeys(("x-", "x+", "z-", "z+"), SIDE),
            "y-": {"displacement": [0, 0, 0]},
            "y+": {"traction": [0, 1, 0], "pressure": 0},
        },
        "loads": [-LOAD],
        "time": {
            "end": 2,
            "step": 0.2,
            "tolerance": 1e-4,
            "ramp_increments": 10,
            "ramp_step": 0.01,
            "profiles": [0.3, 1],
        },
    },
}

SHORT = {"tolerance": None, "end": 2, "step": 1, "ramp_increments": 2, "ramp_step": 0.5, "profiles": []}
FEW = {"body": {"elements": [1, 2, 1]}, "time": SHORT}


def study_in(folder: Path, **changes: Any) -> Study:
    return Study(merged(STUDY, changes), out=folder, progress=False, store=False)


@pytest.fixture(scope="module")
def solved(tmp_path_factory: pytest.TempPathFactory) -> Study:
    study = study_in(tmp_path_factory.mktemp("layers") / "run")
    study.solve()
    return study


def closed_form(study: Study) -> LayeredConsolidation:
    layers = []
    for name, height in (("clay", HEIGHTS[0]), (None, HEIGHTS[1])):
        files = study.folder.of_cell(name)
        coefficients = linear_coefficients(files)
        layers.append(SoilLayer.from_coefficients(coefficients, height))
    time = study.config.macro.time
    return LayeredConsolidation(layers, LOAD, ramp=time.ramp_increments * time.ramp_step)


@pytest.mark.parametrize("law", ["potential", "linear"])
def test_two_layers_consolidate_as_the_closed_form_says(solved: Study, law: str) -> None:
    """At small strain, within 0.5 % of the final settlement and of the largest pressure."""
    exact, found = closed_form(solved), solved.solve()[-LOAD][law]
    final = exact.settlement(1e6)
    for time in (0.2, 0.5, 1.0, 1.5, 2.0):
        settlement = float(np.interp(time, found.time, found.settlement))
        assert settlement == pytest.approx(exact.settlement(time), abs=0.005 * final)
    assert exact.settlement(0.2) < 0.6 * final < exact.settlement(1.5)
    heights = load_solution(solved.folder, law, -LOAD).points[:, 1]
    for time in (0.3, 1.0):
        pressure = exact.pressure(heights, time)
        assert found.profile(time).p == pytest.approx(pressure, abs=0.005 * pressure.max())
        assert pressure.max() > 0.1 * LOAD


def test_each_cell_has_samples_and_a_surrogate_of_its_own(solved: Study) -> None:
    rest, clay = solved.sample(), solved.sample(cell="clay")
    assert (rest.x == clay.x).all()
    assert not np.allclose(rest.responses.potential, clay.responses.potential, rtol=0.1)
    H = np.diag([0.0, -1e-4, 0.0])
    for name in (None, "clay"):
        files = solved.folder.of_cell(name)
        exact = linear_coefficients(files)
        law = solved.law(cell=name)
        assert law.porosity == load_reference(files).porosity
        assert law.response([H]).stress[0, 1, 1] == pytest.approx(
            -1e-4 * exact.stiffness[1, 1, 1, 1], rel=0.01
        )
    assert solved.train(cell="clay").identity == solved.config.of_cell("clay").stages.cell
    with pytest.raises(ConfigurationError, match="cell: the study has no cell 'caly'; did you mean 'clay'"):
        solved.law(cell="caly")


@pytest.mark.usefixtures("undrawn")
def test_the_report_shows_each_cell_where_the_body_has_it(solved: Study) -> None:
    page = solved.report().read_text()
    metrics = json.loads(solved.folder.metrics.read_text())
    for anchor, of in (("", "rest of the body"), ("-clay", "clay")):
        assert f'<section id="cell{anchor}">\n<h2>The cell, {of}</h2>' in page
        assert f'<section id="surrogate{anchor}">\n<h2>The surrogate, {of}</h2>' in page
        assert f'<a href="#cell{anchor}">Cell, {of}</a>' in page
    assert '<td>deep</td><td class="n">clay</td><td class="n">50.0 %</td>' in page
    assert {"samples.png", "samples_clay.png"} <= {path.name for path in solved.folder.figures.iterdir()}
    clay = metrics["cells"]["clay"]
    for name, found in ((None, metrics), ("clay", clay)):
        files = solved.folder.of_cell(name)
        assert found["cell"]["porosity"] == load_reference(files).porosity
        assert found["sampling"]["states"] == 8
        assert max(found["surrogate"]["rms_error_percent_of_range"].values()) < 0.1
    assert clay["cell_states"][0][-1]["time"] == metrics["macro"][0]["cell_states"][-1]["time"] == 2.0
    assert {"sampling", "sampling, clay", "training, clay", "cell, clay"} <= metrics["stages"].keys()


def test_results_of_a_cell_are_those_of_its_elements(solved: Study) -> None:
    results = RunResults.load(solved.folder)
    whole = results.solutions[-LOAD]["potential"]
    low, high = (results.by_cell[name].solutions[-LOAD]["potential"] for name in ("clay", None))
    for part, deep in ((low, True), (high, False)):
        heights = part.points[part.cells, 1].mean(axis=1)
        assert len(heights) == 8
        assert ((heights < HEIGHTS[0]) == deep).all()
        inside = np.flatnonzero((whole.points[whole.cells, 1].mean(axis=1) < HEIGHTS[0]) == deep)
        assert (part.profiles[1].grad_u == whole.profiles[1].grad_u[inside]).all()
        assert part.profiles[1].u.shape == whole.profiles[1].u.shape


def test_a_body_beyond_the_samples_of_a_cell_is_told_of_that_cell(tmp_path: Path) -> None:
    """The lower layer is sampled to a tenth of what it reaches."""
    inputs = {"H22": {"range": [-4e-6, 2e-6]}}
    study = study_in(tmp_path / "run", sampling={"cells": {"clay": {"inputs": inputs}}}, macro=FEW)
    told = [line for line in study.check() if "leaves the sampled ranges" in line]
    assert len(told) == 1
    assert told[0].startswith(
        "note: cell clay: by linear poroelasticity up to 100.0 % of its part of the body leaves"
    )
    assert told[0].endswith("write under 'sampling.cells.clay.inputs:'")
    study.solve()
    results = RunResults.load(study.folder)
    case = report_context(results).cases[0]
    assert case.flagged.startswith("cell clay: Beyond what was sampled: H22 = ")
    assert case.flagged.count("Beyond") == 1


def test_a_run_that_lacks_a_part_is_completed_to_the_same_answer(tmp_path: Path) -> None:
    solved = study_in(tmp_path / "one", macro=FEW)
    solved.solve()
    shutil.copytree(solved.path, tmp_path / "run")
    samples = tmp_path / "run" / "cells" / "clay" / "samples.h5"
    before = samples.stat().st_mtime_ns
    for name in ("cells/clay/surrogate.h5", f"solutions/potential_load{-LOAD!r}.h5"):
        (tmp_path / "run" / name).unlink()
    again = study_in(tmp_path / "run", macro=FEW)
    one, other = (each.solve()[-LOAD]["potential"] for each in (solved, again))
    assert (one.settlement == other.settlement).all()
    assert samples.stat().st_mtime_ns == before
    with pytest.raises(RunFolderError, match=r"holds another run; this one has cells\.clay\.viscosity"):
        study_in(tmp_path / "run", cells={"clay": {"viscosity": 2}}, macro=FEW).sample()


def test_regions_of_equal_cells_are_the_plain_study(tmp_path: Path) -> None:
    """With every law, to round-off: each point has the law of its region, and all of these are the same."""
    laws = ("surrogate", "linear", "direct", "fallback")
    parts = study_in(
        tmp_path / "parts", cells={"clay": UPPER | {"material": {"poisson_ratio": 0.35}}}, macro=FEW
    )
    plain = copy.deepcopy(merged(STUDY, {"macro": FEW}))
    del plain["cells"], plain["macro"]["regions"]
    one, other = (
        each.solve(laws)[-LOAD]
        for each in (parts, Study(plain, out=tmp_path / "plain", progress=False, store=False))
    )
    assert parts.config.cells["clay"].specification() == parts.config.cell.specification()
    assert list(one) == list(other) == ["potential", "linear", "direct-potential", "potential-fallback"]
    for law in one:
        assert one[law].settlement == pytest.approx(other[law].settlement, rel=1e-9, abs=1e-16)
        assert one[law].pressure == pytest.approx(other[law].pressure, rel=1e-9, abs=1e-16)
    work = [
        json.loads((path / "direct.json").read_text()) for path in (parts.path, parts.path / "cells" / "clay")
    ]
    assert all(record[f"direct-potential_load{-LOAD!r}"]["solves"] > 0 for record in work)
