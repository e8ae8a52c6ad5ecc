"""The report page: what is in it, that it stands alone, and that nothing in it can be executed."""

from __future__ import annotations

import base64
import json
import os
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from porocore.cell.materials.neo_hookean import NeoHookean
from porocore.core.inputs.input_space import InputSpace
from porocore.core.units.results import OutputUnits, ResultUnits
from porocore.core.units.scales import Scales
from porocore.core.units.texts import value_of
from porocore.errors import RunFolderError
from porocore.macro.closure_error import ClosureError
from porocore.macro.laws.linear import LinearCoefficients
from porocore.report.context import (
    CellSummary,
    DirectCost,
    ReportContext,
    SamplingSummary,
    Stage,
    SurrogateSummary,
    TrainingCurve,
)
from porocore.report.dimensional import FIGURES, figures_with_units
from porocore.report.format import number
from porocore.report.html import render, write_report
from porocore.report.loading_mode import LoadingMode, reactions
from porocore.report.metrics import LoadCase, OutputCheck, case_metrics
from porocore.report.page import file_stem
from porocore.report.text import all_warnings
from porocore.report.words.cell import cell_rows, conductivity_sentence
from porocore.states import CellResponse, CellTangent, Status
from porocore.study.publication import DEHGHANI_ZILIAN

VOID = {"meta", "img", "br"}
ODD = 'A <script>alert("1")</script> & <b>bold</b> title'


class Page(HTMLParser):
    """Tags, attributes and the visible text; fails on tags that do not close in order."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []
        self.text = ""
        self.feed(html)
        self.close()
        assert not self.open, f"not closed: {self.open}"

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] != "style":
            self.text += data

    @property
    def words(self) -> str:
        return " ".join(self.text.split())

    def all(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.tags if name == tag]


def reference() -> CellResponse:
    """M and Q of the benchmark's cell, the values that the table must show."""
    M = np.zeros((1, 3, 3, 3, 3))
    for i in range(3):
        for j in range(3):
            M[0, i, i, j, j] = -0.2297 if i == j else -0.0754
    Q = -0.1135 * np.eye(3)[None]
    tangent = CellTangent(mean_grad_grad_u=M, mean_grad_p=Q)
    return CellResponse(np.zeros((1, 3, 3)), np.zeros(1, int), tangent=tangent)


@pytest.fixture(scope="module")
def context(column) -> ReportContext:
    rng = np.random.default_rng(1)
    inputs = InputSpace(("p", "H22"), (-0.02, -0.4), (0.24, 0.04))
    x = rng.uniform(inputs.lower, inputs.upper, (60, 2))
    status = np.where(x[:, 1] < -0.2, int(Status.overlap), int(Status.converged))
    status[0] = Status.not_converged
    solved = rng.uniform(-0.02, 0.08, 40)
    check = OutputCheck(
        r"$\langle\nabla_Y u^1\rangle_{22}$", "⟨∇u¹⟩₂₂", solved, solved + 1e-4, 0.1, np.arange(40) >= 30
    )
    tetrahedron = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    epoch = np.arange(1.0, 50)
    return ReportContext(
        title=ODD,
        cell=CellSummary(
            "Three channels of radius 0.25 & a neo-Hookean solid",
            0.4123,
            1e-3,
            LinearCoefficients.from_reference(reference(), 0.5877, NeoHookean(), 1.94 * np.eye(3)),
            {"solid tetrahedra": "13,104"},
            (tetrahedron, np.array([[0, 1, 2, 3]])),
            (-0.15, -0.33),
        ),
        sampling=SamplingSummary(inputs, x, status, status == Status.converged),
        surrogate=SurrogateSummary(
            "torch",
            "3 × 40 sigmoid network",
            42,
            (check,),
            TrainingCurve(epoch, 1 / epoch, 2 / epoch),
            ClosureError(0.913, 7.48, 1.26, 3.57),
        ),
        cases=(LoadCase(column(), column(law="linear", final=2.6, rate=0.08, beyond=None)),),
        stages=(Stage("sampling", 312.4, "60 states <i>"), Stage("training", 28.0)),
        provenance={"porocore": "0.1.0", "seed <1>": "7"},
        config_text="cell: <radius> & {0.25}",
        published=DEHGHANI_ZILIAN,
        warnings=("Handed in <first> & shown",),
    )


@pytest.fixture(scope="module")
def html(context) -> str:
    return render(context)


@pytest.fixture(scope="module")
def page(html) -> Page:
    return Page(html)


def test_stands_alone_and_runs_nothing(html, page):
    assert {tag for tag, _ in page.tags}.isdisjoint({"script", "link", "iframe", "object", "embed", "base"})
    for tag, attributes in page.tags:
        for name, value in attributes.items():
            assert not name.startswith("on"), f"{tag} has a handler {name}"
            if name in {"src", "href", "srcset", "action", "style"}:
                assert value is not None
                assert value.startswith(("data:image/", "#")), f"{tag} refers to {value[:60]}"
    css = html[html.index("<style>") : html.index("</style>")]
    assert "url(" not in css
    assert "@import" not in css
    targets = {a["href"] for a in page.all("a")}
    assert targets == {f"#{section['id']}" for section in page.all("section")}


def test_has_all_sections(page):
    sections = [section["id"] for section in page.all("section")]
    assert sections == ["summary", "cell", "sampling", "surrogate", "macro", "times", "provenance"]


def test_figures_are_whole_images_with_a_text(page):
    images = page.all("img")
    # the cell, the samples, one output, the training, two histories and seven profiles
    assert len(images) == 1 + 1 + 1 + 1 + 2 + 7
    for image in images:
        assert image["alt"]
        kind, data = image["src"].split(";base64,")
        decoded = base64.b64decode(data, validate=True)
        if kind == "data:image/png":
            assert decoded.startswith(b"\x89PNG")
        else:
            assert kind == "data:image/svg+xml"
            assert ET.fromstring(decoded).tag.endswith("svg")
    assert len({image["alt"] for image in images}) == len(images)


def test_text_of_the_user_is_shown_and_not_interpreted(page):
    for text in (ODD, "60 states <i>", "seed <1>", "cell: <radius> & {0.25}", "Handed in <first> & shown"):
        assert text in page.words


def test_says_the_result_in_numbers_beside_the_publication(page):
    # 2 (1 − e^{−10}) and 2.6 (1 − e^{−8}): 23.1 % smaller
    for text in ("settlement is 2.000", "and 2.599", "23.1 % smaller", "around 20 % smaller", "at t = 38"):
        assert text in page.words
    assert "considerably shorter time" in page.words
    for published, found in (("1.943", "1.940"), ("−0.23", "−0.2297"), ("−0.113", "−0.1135")):
        assert f"{published} {found}" in page.words or f"{published}{found}" in page.text
    assert "H₂₂ ≈ −0.15 − 0.33 p" in page.words


@pytest.mark.usefixtures("undrawn")
def test_warnings_come_before_the_summary(context, page):
    handed_in, flagged = (
        page.words.index("Handed in <first>"),
        page.words.index("surrogate.tolerance, or no cell was solved for a similar state."),
    )
    assert handed_in < flagged < page.words.index("Under the load −0.2")
    calm = replace(
        context, warnings=(), cases=(LoadCase(replace_outside(context, 0.0), context.cases[0].linear),)
    )
    assert not Page(render(calm)).all("aside")


@pytest.mark.usefixtures("undrawn")
def test_a_flagged_share_that_is_zero_in_words_is_not_shown(context):
    for share, shown in ((4e-4, False), (6e-4, True)):
        case = LoadCase(replace_outside(context, share), context.cases[0].linear)
        text = render(replace(context, warnings=(), cases=(case,)))
        assert ("The flagged share of the body is 0.1 % at most" in text) == shown
        assert "0.0 % at most" not in text
        assert "at most 0.0 %" not in text


@pytest.mark.usefixtures("undrawn")
def test_says_that_the_linear_law_carries_a_follower_too(context):
    said = "The linear law carries the follower, too, on the surface that it has deformed."
    assert said in render(replace(context, loading_mode=LoadingMode(follows=True)))
    assert said not in render(context)


def replace_outside(context, share):
    solution = context.cases[0].nonlinear
    outside = np.full_like(solution.history.outside_training_range, share)
    return replace(solution, history=replace(solution.history, outside_training_range=outside))


def test_says_how_far_the_conductivity_rises(context, page):
    found = re.search(
        r"as in the paper.*At t = (\S+) the values in the body are (\S+)(?: to (\S+))? for K_ref,22 and "
        r"(\S+)(?: to (\S+))? for K_t,22; in the undeformed cell both are 1\.94",
        page.words,
    )
    assert found
    time, *ends = map(float, (found[1], found[2], found[3] or found[2], found[4], found[5] or found[4]))
    last = context.cases[0].nonlinear.profiles[-1]
    # 1.943 (1 − 0.7 H_22) is the K_t,22 of the made-up column.
    K_t = 1.943 * (1 - 0.7 * last.grad_u[:, 1, 1])
    K_ref = K_t * np.linalg.det(last.deformation)
    assert time == pytest.approx(last.time)
    assert ends == pytest.approx([K_ref.min(), K_ref.max(), K_t.min(), K_t.max()], abs=0.006)


def test_says_that_the_conductivity_is_that_of_the_deformed_pore(context):
    cell = replace(context.cell, law="deformed")
    words = conductivity_sentence(context.cases[0], cell)
    assert "K_ref relates ∇p to the flux through reference area. It is that of the deformed pore" in words
    assert "in the undeformed cell both are 1.94" in words
    assert "as in the paper" not in words


def test_flux_in_space_and_through_reference_area(context):
    """q = J₀ F₀⁻¹ times the flux in space, which is −k ∇_x p with ∇_x p = F₀⁻ᵀ ∇_X p."""
    last, g = context.cases[0].nonlinear.profiles[-1], np.array([0.3, -1.0, 0.2])
    F0 = np.eye(3) + last.grad_u
    inverse = np.linalg.inv(F0)
    in_space = -np.einsum("nij,nkj,k->ni", last.spatial_conductivity, inverse, g)
    q = np.linalg.det(F0)[:, None] * np.einsum("nij,nj->ni", inverse, in_space)
    np.testing.assert_allclose(q, -last.reference_conductivity @ g, rtol=1e-12)


def test_says_how_an_image_became_a_cell(context, unpictured):
    cell = replace(
        context.cell, remarks=("a layer of 8 voxels is <blended>", "edges of the cell: 1 x 1 x 2 µm")
    )
    words = Page(render(replace(context, cell=cell))).words
    assert "A layer of 8 voxels is <blended>." in words
    assert "Edges of the cell: 1 x 1 x 2 µm." in words


def test_shows_the_porosity_of_the_image_beside_that_of_the_mesh(context):
    assert "porosity of the image" not in [row.name for row in cell_rows(context.cell, None)]
    mesh, image, *_ = cell_rows(replace(context.cell, image_porosity=0.2731), None)
    assert (mesh.name, mesh.found) == ("porosity φ_f", number(context.cell.porosity))
    assert (image.name, image.found) == ("porosity of the image", "0.2731")


def test_says_where_no_held_out_state_lies_in_the_sampled_range(context, unpictured):
    (check,) = context.surrogate.outputs
    beyond = replace(check, outside_training_range=np.ones(len(check.outside_training_range), bool))
    other = replace(context, surrogate=replace(context.surrogate, outputs=(beyond,)))
    (warning,) = [text for text in all_warnings(other) if "held-out" in text]
    assert warning.startswith("None of the 40 held-out states lies within the range")
    assert not [text for text in all_warnings(context) if "held-out" in text]
    text = Page(render(other)).text
    assert "40, all beyond" in text
    assert "not for the states inside" in text
    assert "all beyond" not in Page(render(context)).text


def test_forces_are_shown_where_a_surface_is_moved(context, unpictured):
    assert "Forces on the body" not in Page(render(context)).text
    force = np.zeros((len(context.cases[0].nonlinear.history.time), 3))
    force[3, 1], force[-1, 1] = -0.8125, -0.25
    case = context.cases[0]
    pushed = replace(
        context,
        loading_mode=LoadingMode(("y+",), stressed=False),
        cases=(replace(case, nonlinear=replace(case.nonlinear, reactions={"a": force, "y+": force})),),
    )
    when = f"{case.nonlinear.history.time[3]:.3f}"
    text = Page(render(pushed)).text
    rows = [
        text.find(f"{name}nonlinearalong y−0.8125{when}−0.2500still changing3.25") for name in ("y+", "a")
    ]
    assert 0 < rows[0] < rows[1], "what is moved comes first"
    force[3:, 1] = -0.8125
    force[-1, 1] = -0.8123
    assert "−0.8123still changing1.0002drop below 0.1 %" in Page(render(pushed)).text.replace(
        "in equilibrium", "still changing"
    )
    # Nor is a settlement that is prescribed a result, or the time that it takes.
    assert "finalsettlement" in Page(render(context)).text
    assert "finalsettlement" not in text
    assert "95 % of the settlement" not in text


@pytest.fixture
def unpictured(undrawn, monkeypatch):
    """Leave out the pictures of the body too, which take the most of the rest."""
    none = {"histories": [], "series": [], "bodies": [], "profiles": []}
    monkeypatch.setattr("porocore.report.html._case_pictures", lambda *arguments: none)
    monkeypatch.setattr("porocore.report.html._cell_picture", lambda *arguments: None)


def test_counts_of_statuses(context, page):
    for status, name in ((Status.converged, "converged"), (Status.overlap, "overlap")):
        count = int((context.sampling.status == status).sum())
        assert f"{name}{count}in equilibrium" in page.text or f"{name}{count}the pore wall" in page.text
    assert "inverted" not in page.words  # none ended so


@pytest.mark.usefixtures("undrawn")
def test_says_what_the_closure_itself_is_off_by(context, page):
    assert "total stress P_E0.91 %7.5 %" in page.words
    assert "fluid taken up or squeezed out1.3 %3.6 %" in page.words
    unknown = replace(context, surrogate=replace(context.surrogate, closure_error=None))
    assert "total stress P_E" not in Page(render(unknown)).words


@pytest.mark.usefixtures("undrawn")
def test_without_a_publication_nothing_is_called_published(context):
    words = Page(render(replace(context, published=None))).words
    assert "published" not in words.lower()
    assert "around 20 %" not in words


@pytest.mark.usefixtures("undrawn")
def test_benchmark_is_not_set_beside_another_load(context, column):
    other = LoadCase(column(load=-0.01), column(load=-0.01, law="linear"))
    assert "considerably shorter time" not in Page(render(replace(context, cases=(other,)))).words


@pytest.mark.usefixtures("undrawn")
def test_is_the_same_bytes_again(context):
    """The page; that each figure is, too, is tested in test_report_figures."""
    assert render(context) == render(context)


def test_written_whole_or_not_at_all(context, html, tmp_path, monkeypatch):
    path = tmp_path / "report.html"
    path.write_text("the old one")
    monkeypatch.setattr("porocore.report.html.render", lambda *arguments: html)
    with monkeypatch.context() as patch:
        patch.setattr("porocore.core.files.atomic.os.replace", disk_full)
        with pytest.raises(RunFolderError, match=r"cannot write .*report\.html"):
            write_report(path, context)
    assert path.read_text() == "the old one"
    write_report(path, context)
    assert path.read_text(encoding="utf-8") == html
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.usefixtures("undrawn")
def test_every_figure_of_the_page_is_a_file_too(context, tmp_path):
    write_report(tmp_path / "report.html", context, tmp_path / "figures")
    images = Page((tmp_path / "report.html").read_text(encoding="utf-8")).all("img")
    by_ending = {
        ending: {path.stem for path in (tmp_path / "figures").glob(f"*.{ending}")}
        for ending in ("png", "svg")
    }
    assert by_ending["png"] == by_ending["svg"]
    assert len(by_ending["png"]) == len(images)
    assert {"cell", "samples", "history_load-0.2", "history_log_load-0.2", "profile_p_load-0.2"} <= by_ending[
        "png"
    ]
    assert len(list((tmp_path / "figures").iterdir())) == 2 * len(images)


@pytest.mark.parametrize(
    ("name", "stem"),
    [
        ("potential_predicted_K₁₁", "potential_predicted_K11"),
        ("fluid volume φ", "fluid-volume"),
        ("body_t=0.2_load-1.0", "body_t=0.2_load-1.0"),
        ("../a b/c", "..-a-b-c"),
    ],
)
def test_names_of_figures_are_names_of_files(name, stem):
    assert file_stem(name) == stem


def disk_full(*_):
    raise OSError(28, "No space left on device")


def test_pyplot_is_not_used():
    script = (
        "import sys, json, matplotlib; before = dict(matplotlib.rcParams)\n"
        "from porocore.report import figures, html\n"
        "import numpy as np; from porocore.report.context import TrainingCurve\n"
        "e = np.arange(1.0, 9); figures.svg_bytes(figures.training_figure(TrainingCurve(e, 1 / e, 2 / e)))\n"
        "print(json.dumps(['matplotlib.pyplot' in sys.modules, dict(matplotlib.rcParams) == before]))"
    )
    # With a backend named, reading the settings does not itself import pyplot to choose one.
    ran = subprocess.run(
        [sys.executable, "-c", script],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "MPLBACKEND": "agg"},
    )
    assert json.loads(ran.stdout) == [False, True]


@pytest.mark.slow
def test_closures_stand_side_by_side_and_direct_solves_say_what_they_cost(context, column):
    case = context.cases[0]
    others = (column(law="mean-gradient", final=2.1), column(law="direct-potential", final=2.01))
    main = replace(case, nonlinear=column(law="potential"), others=others)
    exact = replace(context.surrogate, closure="potential", exact_closure=True)
    both = replace(
        context,
        surrogate=exact,
        cases=(main,),
        other_surrogates=(replace(context.surrogate, description="for the other closure"),),
        direct=(DirectCost("direct-potential", -0.2, 1234, 567, 8, 90.0, 120.0, 0.5),),
    )
    page = Page(render(both))
    assert "Comparison of the laws" in page.words
    assert "−0.50 %" in page.text  # 2 against 2.01
    cells = [text.strip() for text in re.findall(r"<td[^>]*>([^<]*)", render(both))]
    where = cells.index("1234")
    assert cells[where : where + 3] == ["1234", "567", "8"]
    assert "240" in cells[where:]  # 120 s against 0.5 s
    assert "It adds no error to them" in page.words
    assert "for the other closure" in page.words
    alone = Page(render(context))
    assert "Comparison of the laws" not in alone.words
    assert "Cost of direct FE²" not in alone.words


def test_a_study_with_units_speaks_in_them(context):
    """Summary, cell, body, warnings and the texts of pictures; only factors and shares are plain numbers."""
    units = ResultUnits(
        Scales(modulus=2e3, length=1e-2, pore=5e-6), OutputUnits(length="mm", stress="mmHg", time="min")
    )
    page = Page(render(replace(context, units=units, published=None)))
    minutes = number(case_metrics(context.cases[0])["nonlinear"]["time_to_95_percent"] * 2000 / 60, 3)
    for text in (
        "final settlement is 20.00 mm",
        f"95 % of its final value at t = {minutes} min",
        "settlement [mm]",
        "pressure [mmHg]",
        "volume [mm³]",
        "The first points are flagged at t = ",
        f"{number(context.cell.linear.stiffness[1, 1, 1, 1] * 2000 / 133.322387415)} mmHg",
        "4.850 · 10⁻¹⁴ m²",
        "−0.007566 1/mmHg",
        "Numbers have the units of the study",
        "the scales are in SI units, and by them all other values are made dimensionless",
    ):
        assert text in page.words.replace("|", ""), text
    assert "Numbers without a unit are dimensionless" not in page.words
    texts = " ".join(image["alt"] for image in page.all("img"))
    assert "along the column at t = 33.3333 min, 333.333 min, 1333.33 min" in texts


def test_figures_of_metrics_have_their_unit_beside_them():
    units = ResultUnits(
        Scales(modulus=2e3, length=1e-2, pore=5e-6), OutputUnits(length="mm", stress="mmHg", time="min")
    )
    given = {"load": -0.2, "nonlinear": {"final_settlement": 0.25, "time_to_95_percent": None, "steps": 3}}
    found = figures_with_units(given, units)
    assert found["nonlinear"]["final_settlement"] == {"value": 2.5, "unit": "mm", "dimensionless": 0.25}
    assert (found["load"], found["nonlinear"]["steps"]) == (-0.2, 3)
    assert found["nonlinear"]["time_to_95_percent"] is None
    assert figures_with_units(given, ResultUnits()) == given
    times = [value_of(f"{k / 10} min", "time", units.scales) for k in range(1, 30)]
    told = figures_with_units({"end_time": times, "potential": np.array([[1.0], [2.0]])}, units)
    assert told["end_time"]["value"] == [k / 10 for k in range(1, 30)]
    assert np.shape(told["potential"]["value"]) == (2, 1)


def test_every_figure_of_a_solution_has_a_unit_or_is_known_to_have_none(context):
    """A new figure is listed in FIGURES, or here."""
    plain = {"load", "steady_drift", "flagged_end", "flagged_largest", "flagged_time_mean", "stress_spread"}
    plain |= {"steps", "newton_iterations", "drift", "drop", "peak_over_final", "drained_paper_ratio"}
    plain |= {"settlement_ratio", "time_to_95_percent_ratio", "time_to_99_percent_ratio", "drained_ratio"}

    def names(figures):
        for key, value in figures.items():
            if isinstance(value, dict):
                yield from names(value)
            elif isinstance(value, float | int):
                yield key

    moved = {"punch": np.linspace(0, 1, len(context.cases[0].nonlinear.history.time))[:, None] * np.ones(3)}
    force = reactions(replace(context.cases[0].nonlinear, reactions=moved))["punch"]
    assert {*names(case_metrics(context.cases[0])), *names(force)} <= plain | set(FIGURES)


@pytest.mark.usefixtures("undrawn")
def test_times_that_a_store_saved_are_told(context):
    """Times are those of an empty store, and a reader who waited less is told so."""
    assert "empty store" not in render(context)
    stages = (Stage("sampling", 300.0, "", 240.0), Stage("training", 30.0))
    page = " ".join(render(replace(context, stages=stages)).split())
    assert "wall time with<br>an empty store" in page
    assert "This run itself took 90 s." in page
