"""A publication recomputed: which figures there are, how claims are judged, what the pages say, and refusals."""

import dataclasses
import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from porocore.cli.entry import app
from porocore.commands.reproduce.claims import CheckedClaim, Finding, compare_number, judge_statement
from porocore.commands.reproduce.figures import FIGURES, SKETCHES, select_figures
from porocore.commands.reproduce.make import CLAIMS, RECORD, claim_results, draw, html, markdown, write_pages
from porocore.commands.reproduce.study import Results
from porocore.core.console import Console
from porocore.errors import ConfigurationError, DataError, RunFolderError
from porocore.study.config.loading import as_stated_path, benchmark_path, load_config
from tests.helpers.browser import too_wide

DOCUMENT = Path(__file__).parents[2] / "docs" / "reproduction.md"


def test_every_figure_of_the_paper_but_its_sketches_is_there():
    assert {figure.number for figure in FIGURES} == set(range(2, 24)) - set(SKETCHES)
    assert len({figure.file for figure in FIGURES}) == len(FIGURES)
    assert len({figure.label for figure in FIGURES}) == len(FIGURES)


def test_figures_are_chosen_by_number_or_panel():
    assert [figure.name for figure in select_figures(["13", "16b", "13a"])] == ["13a", "13b", "16b"]
    assert select_figures(None) == FIGURES


@pytest.mark.parametrize("name", ["1", "24", "13c", "x"])
def test_a_figure_that_does_not_exist_is_refused(name):
    with pytest.raises(
        ConfigurationError, match=f"there is no figure '{name}' to be computed; expected one of 2, 3"
    ):
        select_figures([name])


def test_numbers_agree_within_their_tolerance_only():
    assert compare_number(2.0, 2.01, 0.01) == Finding("2.010 (+0.5 %)", "yes")
    assert compare_number(-0.32, -0.36, 0.05, "why").verdict == "no"
    assert judge_statement(False, "text", "why") == Finding("text", "no", "why")
    assert judge_statement(True, "text", "why").why == ""


ROWS = {
    "cell": [CheckedClaim("Figure 2a", "one | two", "three", "yes", "")],
    "cost": [CheckedClaim("Figure 11", "four", "five", "–", "because")],
    "column": [CheckedClaim("Figure 13", "six", "seven <b>", "no", "that is so")],
}


def test_the_pages_say_what_was_found():
    text = markdown(ROWS, "porocore reproduce dehghani2022", {"column": 60.0, "figures": 5.0})
    assert "Of 3 rows, 1 agree, 0 agree in part, 1 do not" in text
    assert "| Figure 2a | one \\| two | three | yes |" in text
    assert "| Figure 13 | six | seven <b>. That is so | no |" in text
    assert "in 65 s" in text
    page = html(ROWS, FIGURES[:2], {"column": 60.0})
    assert "seven &lt;b&gt;" in page
    assert 'src="figures/figure-02a.png"' in page
    assert too_wide(page) == []


def test_the_document_has_a_row_for_every_claim():
    text = DOCUMENT.read_text(encoding="utf-8")
    for claims in CLAIMS.values():
        for claim in claims:
            assert f"| {claim.where} | {claim.said} |" in text, "write docs/reproduction.md again"
    assert len(re.findall(r"^\| (?!where|---)", text, flags=re.M)) == sum(map(len, CLAIMS.values()))


def coarse(path):
    """The benchmark in a form that takes seconds."""
    config = load_config(path)
    cell = config.cell.model_copy(
        update={"mesh": config.cell.mesh.model_copy(update={"size": 0.4, "fluid_size": 0.3})}
    )
    macro = config.macro.model_copy(
        update={
            "body": config.macro.body.coarsened(12),
            "time": config.macro.time.model_copy(update={"step": 3.0}),
        }
    )
    surrogate = config.surrogate.model_copy(update={"backend": "polynomial"})
    test = config.sampling.test.model_copy(update={"count": 10})
    sampling = config.sampling.model_copy(update={"test": test, "workers": 2})
    return config.model_copy(
        update={"cell": cell, "macro": macro, "surrogate": surrogate, "sampling": sampling}
    )


@pytest.fixture
def results(tmp_path):
    return Results(
        tmp_path / "out", coarse(benchmark_path()), coarse(as_stated_path()), 2, Console(), pictures=False
    )


def test_a_folder_belongs_to_one_reproduction(results, tmp_path):
    claim_results(results, resume=False)
    with pytest.raises(RunFolderError, match="add --resume"):
        claim_results(results, resume=False)
    claim_results(results, resume=True)
    other = dataclasses.replace(results, config=load_config(benchmark_path()))
    with pytest.raises(RunFolderError, match="holds a reproduction with other backends"):
        claim_results(other, resume=True)
    (results.folder / RECORD).write_text("{", encoding="utf-8")
    with pytest.raises(DataError, match="not the record of a reproduction"):
        claim_results(results, resume=True)


def test_a_folder_with_something_else_is_refused(results):
    results.folder.mkdir()
    (results.folder / "thesis.tex").touch()
    with pytest.raises(RunFolderError, match="is not empty and holds no reproduction"):
        claim_results(results, resume=False)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["dehghani2021"], "unknown publication 'dehghani2021'; expected dehghani2022"),
        (["dehghani2022", "--figure", "12"], "there is no figure '12'"),
        (["dehghani2022", "--workers", "0"], "--workers: expected 1 to 512, got 0"),
    ],
)
def test_bad_use_is_refused(words, message, tmp_path):
    found = CliRunner().invoke(app, ["reproduce", *words, "--out", str(tmp_path / "out")])
    assert message in str(found.exception)
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_all_figures_and_claims_on_a_coarse_cell(results):
    claim_results(results, resume=False)
    wanted = [figure for figure in FIGURES if figure.stage != "fields"]
    paths = draw(results, wanted)
    assert [path.name for path in paths] == [figure.file for figure in wanted]
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in paths)
    page = write_pages(results, wanted, "porocore reproduce dehghani2022")
    text = (page.parent / "reproduction.md").read_text(encoding="utf-8")
    agree = re.search(r"Of (\d+) rows, (\d+) agree", text)
    # The mesh is coarse, the qualitative statements hold all the same.
    assert int(agree[1]) == sum(map(len, CLAIMS.values()))
    assert int(agree[2]) > 40

    again = dataclasses.replace(results)
    before = (page.parent / "sensitivity" / "sensitivity.h5").stat().st_mtime_ns
    claim_results(again, resume=True)
    draw(again, select_figures(["5a", "13a"]))
    assert (page.parent / "sensitivity" / "sensitivity.h5").stat().st_mtime_ns == before


@pytest.mark.slow
def test_one_figure_computes_no_more_than_it_needs(results):
    claim_results(results, resume=False)
    (path,) = draw(results, select_figures(["8a"]))
    assert path.exists()
    assert not (results.folder / "column").exists()
