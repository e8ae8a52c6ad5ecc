"""What the report says in words: results, warnings, statuses, and what the laws differ by."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from porocore.report.context import (
    DirectCost,
    LoadingMode,
    Stage,
)
from porocore.report.format import number
from porocore.report.html import render
from porocore.report.metrics import LoadCase
from porocore.report.page import citations
from porocore.report.text import all_warnings
from porocore.report.words.cell import cell_rows, conductivity_sentence
from porocore.states import Status
from tests.helpers.report_page import Page


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
    said = "In the linear law, too, the follower pressure acts on the deformed surface."
    assert said in render(replace(context, loading_mode=LoadingMode(follows=True)))
    assert said not in render(context)


def replace_outside(context, share):
    solution = context.cases[0].nonlinear
    outside = np.full_like(solution.history.flagged, share)
    return replace(solution, history=replace(solution.history, flagged=outside))


def test_says_how_far_the_conductivity_rises(context, page):
    found = re.search(
        r"F̄ of the solid.*At t = (\S+), K_ref,22 is (\S+)(?: to (\S+))? in the body, and K_t,22 is "
        r"(\S+)(?: to (\S+))?\. In the undeformed cell, both are 1\.94",
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


def test_the_conductivity_is_told_along_the_axes_along_which_the_body_drains(context):
    case = context.cases[0]
    # det F̄ K_t,11 of the made-up column, stretched along x by 2 %.
    bodies = [
        replace(
            profile, conductivity=profile.conductivity * 0 + 1.9 / np.linalg.det(F)[:, None, None] * np.eye(3)
        )
        for profile in case.nonlinear.profiles
        for F in [profile.deformation]
    ]
    inflow = {"x+": np.array([0.0, -1.0]), "y+": np.zeros(2)}
    drained = replace(case, nonlinear=replace(case.nonlinear, profiles=tuple(bodies), inflow=inflow))
    words = conductivity_sentence(drained, context.cell)
    assert "The body drains along x. At t" in words
    assert "K_ref,11" in words
    assert "K_ref,22" not in words
    assert "both are 1.94. Therefore K_ref,11 is lowered." in words
    assert "depends on this increase" not in words


@pytest.mark.usefixtures("undrawn")
def test_a_large_flagged_share_is_told_before_the_results(context):
    for share, first in ((1.0, True), (0.05, False)):
        case = LoadCase(replace_outside(context, share), context.cases[0].linear)
        words = Page(render(replace(context, warnings=(), cases=(case,)))).words
        flagged = words.index("Parts of the body are flagged: there some quantity of the surrogate")
        assert (flagged < words.index("Under the load −0.2")) == first


@pytest.mark.usefixtures("undrawn")
def test_the_stress_spread_is_a_stress(context):
    found = re.search(
        "differs from the mean over the body by at most (.{1,30}?)[.] ", Page(render(context)).words
    )
    assert found
    assert "times" not in found[1]


def test_a_conductivity_that_is_zero_along_an_axis_is_not_raised(context):
    """Tiny shears of a body turn some of K along a channel across it."""
    case = context.cases[0]
    last, closed = case.nonlinear.profiles[-1], np.diag([0.0, 1.0, 0.0])
    turned = np.tile(closed + 1e-11 * np.eye(3), (len(last.conductivity), 1, 1))
    profile = replace(last, conductivity=turned)
    case = replace(case, nonlinear=replace(case.nonlinear, profiles=(profile,)))
    cell = replace(context.cell, linear=replace(context.cell.linear, conductivity=closed))
    words = conductivity_sentence(case, cell)
    assert "K_ref,11 is unchanged" in words
    assert "raised" not in words


def test_says_that_the_conductivity_is_that_of_the_deformed_pore(context):
    cell = replace(context.cell, law="deformed")
    words = conductivity_sentence(context.cases[0], cell)
    assert "K_ref is the conductivity of the deformed pore" in words
    assert "In the undeformed cell, both are 1.94" in words
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
    beyond = replace(check, flagged=np.ones(len(check.flagged), bool))
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


def test_the_paper_is_spoken_of_in_the_report_of_the_benchmark_alone(context, unpictured):
    """Every user's report had a column and three sentences on the paper's own measure of the drained volume."""
    of_the_benchmark = Page(render(context)).words
    for words in (
        "The paper is that of Dehghani and Zilian",
        "the paper’smeasure",
        "compare with the paper only",
    ):
        assert words in of_the_benchmark, words
    words, cite = Page(render(replace(context, published=None))).words.split("How to cite Please")
    assert "paper" not in words
    assert "doi:10.1007/s00466-022-02262-y" in cite


def test_every_page_says_how_to_cite_as_citation_cff_does():
    software, paper = citations()
    document = yaml.safe_load((Path(__file__).parents[2] / "CITATION.cff").read_text(encoding="utf-8"))
    (article,) = document["references"]
    names = [f"{each['given-names'][0]}. {each['family-names']}" for each in article["authors"]]
    assert software == f"{document['authors'][0]['name']}: porocore, version {document['version']}"
    assert paper == (
        f"{' and '.join(names)}: {article['title']}. {article['journal']} {article['volume']}, "
        f"{article['start']}–{article['end']} ({article['year']}), doi:{article['doi']}"
    )


@pytest.mark.usefixtures("undrawn")
def test_times_that_a_store_saved_are_told(context):
    """Times are those of an empty store, and a reader who waited less is told so."""
    assert "empty store" not in render(context)
    stages = (Stage("sampling", 300.0, "", 240.0), Stage("training", 30.0))
    page = " ".join(render(replace(context, stages=stages)).split())
    assert "wall time with<br>an empty store" in page
    assert "The stages of this run itself took 90 s." in page
    assert "do not include the time to start the program or to write this report" in page


@pytest.mark.usefixtures("undrawn")
def test_a_report_without_the_linear_law_compares_with_nothing(context, tmp_path):
    (case,) = context.cases
    without = replace(context, cases=(replace(case, linear=None),))
    page = Page(render(without))
    assert "settlement is 2.000" in page.words
    assert "dashed lines" not in page.words
    assert "with linear poroelasticity" not in page.words
    assert "around 20 % smaller" not in page.words
    for wrong in ("None", "nan"):
        assert wrong not in page.words.split()
    with pytest.raises(ValueError, match="not solved with the linear law"):
        without.cases[0].both  # noqa: B018
