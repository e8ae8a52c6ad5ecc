"""Report page of a calibration: its words, tables and figures; axes and bands of the figures."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import porocore
from porocore.commands.calibration.derived import DerivedCell
from porocore.commands.calibration.figures import (
    correlation_figure,
    field_figure,
    fit_figure,
    plane_figure,
    profile_figure,
    smooth_profile,
    smooth_rim,
)
from porocore.commands.calibration.fit import FitQuality
from porocore.commands.calibration.infer import infer
from porocore.commands.calibration.page import render, write_report
from porocore.commands.calibration.plan import CalibrationPlan, FittedField
from porocore.commands.calibration.posterior import sample_posterior
from porocore.commands.calibration.problem import CurveData, Misfit, NormalPrior, Unknown
from porocore.commands.calibration.results import Calibration
from porocore.commands.calibration.settings import FitSettings, PosteriorSettings
from tests.helpers.browser import too_wide
from tests.helpers.calibration_models import Consolidation, Formula, data_of, experiment, misfit_of
from tests.helpers.curve_experiment import planned
from tests.helpers.report_page import ODD, Page

T = np.geomspace(0.02, 6, 24)
SEEN = (
    Unknown("modulus", 1.0, 0.01, 100.0, "log", unit="kPa"),
    Unknown("conductivity", 1.0, 0.01, 100.0, "log"),
)
NOISE = np.random.default_rng(3).normal(size=24)


def ratio(v):
    return 12 / v[0] * (1 - 0.8 * np.exp(-v[1] / v[2] * T))


def results_of(title, misfit, inference, **more):
    """Results without a study."""
    plan = CalibrationPlan(title, (), (), FitSettings())
    quality = FitQuality.of_fit(misfit, inference.best)
    return Calibration(Path(), plan, misfit.data, inference, quality, **more)


@pytest.fixture(scope="module")
def unseen():
    """Two tests, of which neither sees conductivity and viscosity apart."""
    unknowns = tuple(
        Unknown(name, 1.5, 0.02, 60.0, "log") for name in ("modulus", "conductivity", "viscosity")
    )
    model = Formula(unknowns, lambda v: np.concatenate([ratio(v), 3 * ratio(v)]))
    values = model.curves(np.array([2.0, 1.0, 1.3])).values + 0.05 * np.concatenate([NOISE, NOISE[::-1]])
    data = CurveData(
        values, np.full(48, 0.05), np.repeat([0, 1], 24), np.tile(T, 2), ("one: settlement", "two: force"),
        ("mm", "mm**2*kPa"), ("s", "s"),
    )  # fmt: skip
    misfit = Misfit(model, data)
    best = misfit.at(misfit.start)
    alone = experiment(
        "a permeation test", Formula(unknowns, lambda v: v[1] * T), best.coordinates, np.full(24, 0.05)
    )
    return results_of(
        ODD, misfit, infer(misfit, best, further=[alone], rays=8), truth=np.array([2.0, 1.0, 1.3]),
        cell_solves=24, warnings=("Look <here>.",),
    )  # fmt: skip


@pytest.fixture(scope="module")
def seen():
    misfit = misfit_of(Consolidation(SEEN, T), [1.2, 0.8], 0.001, NOISE, times=T)
    return results_of("Seen", misfit, infer(misfit, misfit.at(misfit.start), rays=8))


def test_no_table_is_cut_off(unseen, undrawn):
    assert too_wide(render(unseen)) == []


def test_the_page_of_an_unseen_direction(unseen, undrawn):
    page = Page(render(unseen))
    for words in (
        ODD,
        "The data are synthetic, with noise.",
        "Look <here>.",
        "One combination of the unknowns is non-identifiable, 2 of 3 are identifiable:",
        "Only the ratio conductivity/viscosity is identifiable, not the two separately.",
        "a permeation test",
        "makes all combinations identifiable",
        "no lower end: the data set no end here; only conductivity at its bound",
        "Cell solves24",
        f"porocore{porocore.__version__}",
    ):
        assert words in page.words, words
    assert "– … –" in page.words
    # Two fits, profiles, plane, correlations, each with a text.
    images = page.all("img")
    assert len(images) == 5
    assert all(image["alt"] for image in images)


def test_the_page_where_everything_is_seen(seen, undrawn):
    words = Page(render(seen)).words
    assert "All combinations of the unknowns are identifiable" in words
    assert "synthetic" not in words
    assert "with priors" not in words
    assert "modulus" in words
    assert "kPa" in words


def test_without_what_helps_another_test_is_asked_for(unseen, undrawn):
    alone = replace(unseen, inference=replace(unseen.inference, suggestions=()))
    assert "another test, another load or another quantity is needed" in Page(render(alone)).words


def test_a_page_without_derived_results_says_why(unseen, undrawn):
    words = "There are no derived results, such as the aggregate modulus H_A and the permeability: they are"
    plan = planned()
    (name,) = (each.name for each in plan.experiments)
    assert words in Page(render(replace(unseen, plan=plan))).words
    cell = DerivedCell((name,), "", ())
    assert words not in Page(render(replace(unseen, plan=plan, derived=(cell,)))).words
    assert words not in Page(render(unseen)).words


def test_one_unknown_has_no_plane_and_no_correlations(undrawn):
    model = Formula((Unknown("rate", 1.0, 0.01, 20.0, "log"),), lambda v: np.exp(-v[0] * T))
    misfit = misfit_of(model, [1.3], 0.02, NOISE, times=T)
    done = results_of("One", misfit, infer(misfit, misfit.at(misfit.start)))
    assert len(Page(render(done)).all("img")) == 2


def test_a_posterior_has_medians_a_picture_and_its_error(undrawn):
    pytest.importorskip("emcee", reason="pip install emcee")
    misfit = misfit_of(Consolidation(SEEN, T), [1.2, 0.8], 0.001, NOISE, times=T)
    found = infer(misfit, misfit.at(misfit.start), rays=0)
    posterior = sample_posterior(misfit, found.points, found.best, PosteriorSettings(steps=200))
    page = Page(render(results_of("D", misfit, found, posterior=posterior)))
    assert "95 % credible interval" in page.words
    assert f"{posterior.medians[0]:.4g}"[:5] in page.words
    assert f"ln of the density is off by {posterior.check.error:.2g}" in page.words
    assert f"no probability is off by more than about {posterior.check.distance:.2g}" in page.words
    assert "Posterior distribution of the unknowns" in [image["alt"] for image in page.all("img")]


def test_priors_have_a_column_and_a_curve(undrawn):
    unknowns = (replace(SEEN[0], prior=NormalPrior(0.2, 0.001)), SEEN[1])
    misfit = misfit_of(Consolidation(unknowns, T), [1.2, 0.8], 0.01, NOISE, times=T)
    done = results_of("P", misfit, infer(misfit, misfit.at(misfit.start), rays=4))
    assert "intervalwith priors" in Page(render(done)).words
    labels = [line.get_label() for line in profile_figure(done.inference).axes[0].get_lines()]
    assert "with priors" in labels


@pytest.mark.filterwarnings("error")
def test_a_profile_of_one_point_has_an_axis_and_an_open_band(unseen):
    found = unseen.inference
    interval = found.data_intervals[2]
    alone = replace(interval, coordinates=found.data_best.coordinates[None, :], roots=np.zeros(1))
    assert alone.values == (None, None)
    intervals = (*found.data_intervals[:2], alone)
    one = replace(found, intervals=intervals, data_intervals=intervals)
    panel = profile_figure(one).axes[2]
    low, high = panel.get_xlim()
    best = unseen.inference.unknowns[2].value(float(found.data_best.coordinates[2]))
    assert low < best < high < 1.5 * low
    assert panel.texts[0].xy[0] < best < panel.texts[1].xy[0]
    # The curve with priors is drawn whole where it is the longer one.
    longer = profile_figure(replace(found, data_intervals=intervals)).axes[2]
    ends = np.exp(interval.coordinates[[0, -1], 2])
    assert longer.get_xlim()[0] < ends[0] < ends[1] < longer.get_xlim()[1]


def test_files_of_the_report(seen, tmp_path):
    drawn = []
    path = write_report(replace(seen, path=tmp_path), drawn.append)
    assert path == tmp_path / "report.html"
    names = {"fit_curve", "profiles", "plane", "correlations"}
    assert set(drawn) == names
    assert {file.name for file in (tmp_path / "figures").iterdir()} == {
        f"{name}.{form}" for name in names for form in ("svg", "png")
    }
    assert "data:image/svg+xml;base64," in path.read_text(encoding="utf-8")


def test_the_fit_has_data_prediction_and_residuals(unseen):
    upper, lower = fit_figure(unseen, 1).axes
    assert upper.get_ylabel() == "two: force [mm² kPa]"
    assert lower.get_xlabel() == "time $t$ [s]"
    assert lower.get_xscale() == "log"
    residuals = lower.get_lines()[-1].get_ydata()
    np.testing.assert_allclose(residuals, -unseen.inference.best.residuals[24:48], rtol=1e-10)


def test_a_profile_passes_the_threshold_at_the_ends_of_its_interval(seen):
    for i, interval in enumerate(seen.inference.data_intervals):
        x, rise = smooth_profile(interval, i)
        ends = [SEEN[i].coordinate(value) for value in interval.values]
        np.testing.assert_allclose(np.interp(ends, x, rise), 3.841458820694124, rtol=0.02)


def test_an_interval_without_ends_says_so(unseen):
    panels = profile_figure(unseen.inference, unseen.truth).axes
    texts = [[text.get_text() for text in axes.texts] for axes in panels]
    assert texts == [[], ["no end", "no end"], ["no end", "no end"]]
    assert panels[1].get_xscale() == "log"


def test_the_rim_is_smooth_and_passes_its_rays(seen):
    plane = seen.inference.plane
    _, radii = smooth_rim(plane)
    np.testing.assert_allclose(radii[:: (len(radii) - 1) // 8][:8], plane.radii, rtol=1e-12)
    assert radii[0] == pytest.approx(radii[-1])
    axes = plane_figure(seen.inference).axes[0]
    assert axes.get_xlabel() == "modulus [kPa]"
    low, high = axes.get_xlim()
    assert low < np.exp(plane.rim[:, 0].min()) < np.exp(plane.rim[:, 0].max()) < high


def test_a_valley_is_shown_by_the_paths_of_the_profiles(unseen):
    axes = plane_figure(unseen.inference, unseen.truth).axes[0]
    lines = {line.get_label(): line for line in axes.get_lines()}
    assert "95 % region of the data" not in lines
    x, y = lines["profile of viscosity"].get_data()
    assert np.ptp(np.log(x / y)) < 0.3 < np.ptp(np.log(x))


def test_an_open_part_of_a_region_has_marks_and_no_outline(seen):
    plane = replace(seen.inference.plane, closed=np.arange(8) != 3)
    axes = plane_figure(replace(seen.inference, plane=plane)).axes[0]
    lines = {line.get_label(): line for line in axes.get_lines()}
    assert len(lines["goes on here"].get_xdata()) == 1
    assert np.isnan(lines["95 % region of the data"].get_xdata()).mean() == pytest.approx(0.25, abs=0.01)


def test_correlations_have_their_numbers(unseen):
    texts = [text.get_text() for text in correlation_figure(unseen.inference).axes[0].texts]
    assert texts[0] == "1"
    assert "> 0.9999" in texts
    assert "−0.00" not in texts


def test_data_without_axes_are_dimensionless():
    assert fit_figure(plain(), 0).axes[0].get_ylabel() == "curve [–]"


def plain():
    model = Formula((Unknown("level", 1.0, -9.0, 9.0),), lambda v: v[0] * np.ones(5))
    misfit = Misfit(model, data_of([1, 2, 1, 2, 1], 0.5))
    return results_of("C", misfit, infer(misfit, misfit.at(misfit.start)))


def test_a_fitted_field_is_drawn_over_its_coordinate(seen, unseen):
    field = FittedField("modulus", {"y": (0.0, 2.0)}, "mm", (0, 1))
    (axes,) = field_figure(seen, field).axes
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("y [mm]", "modulus [kPa]")
    line, *_ = axes.containers[0].lines
    np.testing.assert_allclose(line.get_xdata(), field.lines["y"])
    np.testing.assert_allclose(line.get_ydata(), seen.inference.values)
    (bars,) = axes.containers[0].lines[2]
    for bar, interval in zip(bars.get_segments(), seen.inference.intervals, strict=True):
        np.testing.assert_allclose(bar[:, 1], interval.values)
    bounds = {"lower": 0.15, "upper": 0.3, "start": 0.21}
    graded = planned({"radius": {**bounds, "field": {"along": "y", "at": [0.0, 0.7, 1.5]}}})
    assert "Field of radius" in render(replace(unseen, plan=graded))
    assert "Field of" not in render(unseen)
