"""``porocore crosscheck`` from the command line: it passes when backends agree, and fails when one is wrong."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
import yaml

from porocore.commands.crosscheck import comparison as compared_states
from porocore.commands.crosscheck.bodies import AVERAGES, DERIVATIVES
from porocore.commands.crosscheck.comparison import STATES, failures_of, select_backends, solve_samples
from porocore.plugins import registry
from porocore.plugins.discovery import Offered, Source
from porocore.plugins.hookspecs import Offer
from porocore.study.config.loading import crosscheck_path, load_config
from tests.helpers.browser import too_wide
from tests.helpers.crosscheck_runs import distribution, run, write_case

pytest.importorskip("skfem")


@pytest.fixture(autouse=True, scope="module")
def fakes(tmp_path_factory):
    """The plugin of crosscheck_fakes, found beside the installed ones."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(Path(__file__).parents[1] / "helpers"))
        patch.syspath_prepend(distribution(tmp_path_factory.mktemp("site"), "fakes", "crosscheck_fakes"))
        registry.registry.cache_clear()
        yield
    registry.registry.cache_clear()


@pytest.fixture(autouse=True, scope="module")
def solved_once():
    """The same samples of the same backend are solved by the first that asks for them."""
    done = {}

    def once(config, backend, console):
        key = backend, config.stages.sampling, config.sampling.model_dump_json()
        if key not in done:
            done[key] = solve_samples(config, backend, console)
        return done[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(compared_states, "solve_samples", once)
        yield


@pytest.fixture
def case(tmp_path):
    return write_case(tmp_path / "case.yaml")


@pytest.fixture
def crosscheck(case, tmp_path, undrawn):
    """Run it with these backends."""
    return lambda *words, **how: run(case, tmp_path / "out", *words, **how)


@pytest.fixture(scope="module")
def agreed(tmp_path_factory, fakes):
    """Two backends that agree: the result of :func:`run`, and the folder."""
    folder = tmp_path_factory.mktemp("agreed")
    result = run(write_case(folder / "case.yaml"), folder / "out", fem=["skfem", "twin"], surrogate=["cubic"])
    return *result, folder / "out"


def failures(document):
    """Part, case, quantity of the lines that failed."""
    return [
        (line["part"], line["case"], line["quantity"])
        for line in document["comparisons"]
        if not line["passed"]
    ]


def last(err):
    """The message at the end of standard error, in one line."""
    (found,) = re.findall(r"^failed: (.*)$", err, flags=re.MULTILINE)
    return found


def test_backends_that_agree_pass(agreed):
    status, out, err, document, folder = agreed
    assert status == 0, err
    assert document["passed"] is True
    assert document["failed"] == 0
    assert set(document["cells"]) == {"skfem", "twin"}
    cells = [line for line in document["comparisons"] if line["part"] == "cell"]
    quantities = ["status", *AVERAGES.values(), *DERIVATIVES.values()]
    assert [(line["case"], line["quantity"]) for line in cells] == [
        *((state, quantity) for state in STATES for quantity in quantities),
        ("at rest", "K"),
    ]
    assert {line["case"] for line in document["comparisons"] if line["part"] == "body"} == {
        "law linear",
        "law cubic",
    }
    assert out.splitlines()[-1] == str(folder / "crosscheck.html")
    for word in ("largest displacement", "∂P_E/∂H", "held-out states", "skfem – twin", "pass"):
        assert word in out
    assert "FAIL" not in out
    for note in ("cell, twin: 5 of 5 solves", "training, cubic", "body, cubic, twin"):
        assert note in err


def test_the_document_holds_what_was_compared(agreed):
    *_, document, _ = agreed
    sheared = document["cells"]["skfem"]["states"]["H₁₂ = 0.1, H₂₂ = −0.05, p = 0.05"]
    assert sheared["status"] == "converged"
    assert np.shape(sheared["stress_grad_u"]) == (3, 3, 3, 3)
    assert np.linalg.eigvalsh(document["cells"]["twin"]["conductivity"]).min() > 0
    assert all(seconds >= 0 for run in document["cells"].values() for seconds in run["seconds"].values())
    assert {"python", "numpy", "scikit-fem"} <= set(document["versions"])
    (body,) = [b for b in document["bodies"] if (b["backend"], b["law"]) == ("skfem", "cubic")]
    history = body["history"]
    assert history["time"][-1] == 1.0
    assert len(history["settlement"]) == len(history["time"]) > 10
    assert np.shape(body["profiles"][0]["u"]) == np.shape(body["profiles"][0]["points"])
    assert document["samples"]["learned_from"] >= 15
    assert document["samples"]["held_out"] == 6
    assert 0 < document["surrogates"]["cubic"]["held_out_error"]["mean_grad"] < 5e-3


def test_the_page_stands_alone(agreed):
    *_, document, folder = agreed
    page = (folder / "crosscheck.html").read_text(encoding="utf-8")
    assert page.count('<img src="data:image/svg+xml;base64,') == 2  # one for each law
    assert not re.findall(r'(?:src|href)="(?!data:|#)', page)
    assert "<script" not in page
    assert f"All {len(document['comparisons'])} comparisons pass" in page
    assert page.count('<span class="pass">') == len(document["comparisons"])
    assert '<span class="fail">' not in page
    assert too_wide(page) == []


@pytest.mark.parametrize(("wrong", "quantity"), [("poisson", "∂P_E/∂H"), ("viscosity", "K")])
def test_one_per_cent_of_a_material_constant_fails(crosscheck, wrong, quantity, tmp_path):
    status, out, err, document = crosscheck(fem=["skfem", wrong], surrogate=["cubic"])
    assert status == 1
    found = failures(document)
    assert ("cell", "at rest", quantity) in found
    assert {part for part, _, _ in found} == {"cell"}
    if wrong == "viscosity":
        assert found == [("cell", "at rest", "K")]
    worst = document["worst"]
    assert {worst["one"], worst["other"]} == {"skfem", wrong}
    assert 1e-3 < worst["difference"] < 0.1
    page = (tmp_path / "out" / "crosscheck.html").read_text(encoding="utf-8")
    assert page.count('<span class="fail">') == len(found)
    message = last(err)
    assert f"{len(found)} of {len(document['comparisons'])} comparisons" in message
    assert worst["quantity"] in message
    assert "tolerance 1e-08" in message
    assert "FAIL" in out


def test_a_surrogate_that_is_off_fails(crosscheck):
    status, out, err, document = crosscheck("--json", fem=["skfem"], surrogate=["cubic", "biased"])
    assert (status, json.loads(out)) == (1, document)
    assert failures(document) == [("surrogate", "held-out states", "⟨∇u¹⟩")]
    assert document["surrogates"]["biased"]["held_out_error"]["mean_grad"] > 5e-3
    assert "⟨∇u¹⟩, held-out states, biased – cell solves" in last(err)


def test_a_surrogate_that_is_right_only_where_it_was_looked_at_fails(crosscheck):
    status, _, err, document = crosscheck(fem=["skfem"], surrogate=["cubic", "wavy"])
    assert status == 1
    assert failures(document) == [("surrogate", "between the states", "⟨∇u¹⟩")]
    assert "cubic – wavy" in last(err)


def test_a_macro_solver_that_is_off_fails(crosscheck):
    status, _, err, document = crosscheck(fem=["skfem", "heavier"], surrogate=["cubic"])
    assert status == 1
    found = failures(document)
    assert {(part, case) for part, case, _ in found} == {("body", "law linear"), ("body", "law cubic")}
    assert ("body", "law cubic", "largest displacement") in found
    assert ("body", "law cubic", "u at t = 1") in found
    assert 5e-6 < document["worst"]["difference"] < 1e-4
    assert "heavier – skfem" in last(err) or "skfem – heavier" in last(err)


@pytest.mark.slow
def test_the_conductivity_of_the_deformed_pore_is_compared_too(tmp_path, undrawn):
    """Of the cells, of a surrogate that learns it, and in the flux of the body."""
    case = write_case(tmp_path / "case.yaml", conductivity="deformed", surrogate={"backend": "polynomial"})
    status, _, err, document = run(case, tmp_path / "out", fem=["skfem", "twin"], surrogate=["polynomial"])
    assert status == 0, err
    lines = {(line["part"], line["case"]) for line in document["comparisons"] if line["quantity"] == "K_ref"}
    assert lines == {*(("cell", state) for state in STATES), ("surrogate", "held-out states")}
    assert {run["law"] for run in document["bodies"]} == {"linear", "polynomial"}
    carried = write_case(tmp_path / "carried.yaml", surrogate={"backend": "polynomial"})
    _, _, _, other = run(carried, tmp_path / "carried", fem=["skfem", "twin"], surrogate=["polynomial"])
    ends = [
        found["history"]["settlement"][5]
        for one in (document, other)
        for found in one["bodies"]
        if found["law"] == "polynomial"
    ]
    assert ends[0] < 0.999 * ends[2]


def test_other_time_steps_fail(crosscheck):
    status, out, _, document = crosscheck(fem=["skfem", "hasty"], surrogate=["cubic"])
    assert status == 1
    assert set(failures(document)) == {("body", "law linear", "times"), ("body", "law cubic", "times")}
    assert "other time steps: 14 against 12" in out


@pytest.mark.parametrize(
    ("fem", "surrogate", "failure", "reason"),
    [
        (
            ["skfem", "stumbling"],
            ["cubic"],
            ("cell", [*STATES][2], "solution"),
            "ArithmeticError: a pivot vanished in",
        ),
        pytest.param(
            ["skfem", "late"],
            ["cubic"],
            ("cell", "", "set-up"),
            "RuntimeError: no licence",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            ["skfem", "stuck"],
            ["cubic"],
            ("body", "law cubic", "solution"),
            "SolveError: the smallest step failed",
            marks=pytest.mark.slow,
        ),
        (
            ["skfem", "unimportable"],
            ["cubic"],
            ("body", "law cubic", "solution"),
            "cannot be loaded: KeyError",
        ),
        (["skfem"], ["cubic", "lazy"], ("surrogate", "", "training"), "MemoryError: no room for the weights"),
    ],
)
def test_a_backend_that_fails_is_a_line_and_the_others_go_on(crosscheck, fem, surrogate, failure, reason):
    status, out, err, document = crosscheck(fem=fem, surrogate=surrogate)
    assert status == 1
    assert "Traceback" not in err
    assert failure in failures(document)
    (line,) = [x for x in document["comparisons"] if (x["part"], x["case"], x["quantity"]) == failure]
    assert reason in line["reason"]
    assert line["difference"] is None
    assert reason in out
    assert document["surrogates"]["cubic"]["failure"] is None
    done = {(body["backend"], body["law"]) for body in document["bodies"] if body["history"] is not None}
    assert {("skfem", "linear"), ("skfem", "cubic")} <= done


def test_when_the_first_backend_cannot_sample_the_next_one_does(crosscheck, case):
    write_case(case, fem={"backend": "late"})
    status, _, _, document = crosscheck(fem=["late", "twin"], surrogate=["cubic"])
    assert status == 1
    assert document["samples"]["backend"] == "twin"
    assert ("cell", "", "samples") in failures(document)


def test_a_broken_plugin_is_a_failure(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(distribution(tmp_path, "bad", "no_such_module_at_all"))
    fresh = registry.Registry.discover()
    monkeypatch.setattr("porocore.commands.backends.registry", lambda: fresh)
    (line,) = failures_of(select_backends(fem=["skfem", "twin"]))
    assert (line.passed, line.quantity) == (False, "bad")
    assert "porocore-bad 1.0 is broken: ModuleNotFoundError" in line.reason
    assert not select_backends(fem=["skfem", "twin"], surrogates=["cubic"]).broken


def refused(result):
    """The one message of a command that refused: status 2 and nothing computed."""
    status, out, err, document = result
    assert status == 2
    assert out == ""
    assert document is None
    assert err.startswith("error: ")
    assert "Traceback" not in err
    return " ".join(err.split())


def test_one_of_each_is_nothing_to_compare(crosscheck):
    message = refused(crosscheck(fem=["skfem"], surrogate=["cubic"]))
    assert "nothing to compare" in message
    assert "only skfem and cubic" in message
    assert "repeat them" in message


def test_what_to_install_when_there_is_nothing_to_compare(crosscheck, monkeypatch):
    offers = [
        Offered(kind, Offer(name, dict, "", needs, "apt-get install it"), Source("a", "1", "a"))
        for kind, name, needs in (
            ("cell solver", "skfem", ()),
            ("macro solver", "skfem", ()),
            ("surrogate", "torch", ()),
            ("cell solver", "other", ("no_such_module",)),
        )
    ]
    monkeypatch.setattr("porocore.commands.backends.registry", lambda: registry.Registry(offers, []))
    message = refused(crosscheck())
    assert "only skfem and torch" in message
    assert "other (missing dependency): apt-get install it" in message
    assert "dolfinx (not installed): pip install porocore-fem-dolfinx" in message


@pytest.mark.parametrize("option", ["--fem", "--surrogate"])
def test_an_unknown_name_is_refused(crosscheck, option):
    assert "unknown" in refused(crosscheck(option, "skfim"))


def test_bad_input_is_refused(case, crosscheck, tmp_path):
    case.write_text("cell: {meshh: 3}", encoding="utf-8")
    assert "cell.meshh" in refused(crosscheck(fem=["skfem", "twin"]))


def test_a_folder_that_cannot_be_made_is_refused_before_the_work(crosscheck, tmp_path):
    (tmp_path / "out").write_text("a file")
    message = refused(crosscheck(fem=["skfem", "twin"], surrogate=["cubic"]))
    assert "choose another --out" in message


def test_the_packaged_case_is_the_benchmarks_cell():
    from porocore.study.config.loading import benchmark_path

    small, benchmark = load_config(crosscheck_path()), load_config(benchmark_path())
    assert small.cell.geometry == benchmark.cell.geometry
    assert small.cell.material == benchmark.cell.material
    assert small.cell.mesh.element == benchmark.cell.mesh.element
    assert small.cell.mesh.size >= benchmark.cell.mesh.size
    assert small.closure == benchmark.closure


def test_what_backends_declare_decides_how_closely_they_are_compared(tmp_path, undrawn):
    """A column of finite volumes and kernels, which approximate and say so: every line passes, none is widened else."""
    settings = yaml.safe_load(write_case(tmp_path / "case.yaml").read_text(encoding="utf-8"))
    settings["macro"]["body"]["elements"] = [1, 10, 1]
    case = tmp_path / "column.yaml"
    case.write_text(yaml.safe_dump(settings), encoding="utf-8")
    who = {"fem": ["skfem", "volumes"], "surrogate": ["cubic", "kernels"]}
    status, out, err, document = run(case, tmp_path / "out", **who)
    assert status == 0, err + out
    lines = document["comparisons"]
    bodies = [line for line in lines if line["part"] == "body"]
    assert {line["case"] for line in bodies} == {"law linear", "law cubic", "law kernels"}
    assert {line["tolerance"] for line in bodies} == {8e-2 + 1e-6}
    assert max(line["difference"] for line in bodies) > 1e-6
    held_out = {line["one"]: line for line in lines if line["case"] == "held-out states"}
    assert {name: line["tolerance"] for name, line in held_out.items()} == {"cubic": 5e-3, "kernels": 0.03}


def test_what_a_backend_does_not_offer_is_a_line_that_says_so(tmp_path, undrawn):
    """The column of finite volumes on a body with a plate."""
    plate = {"y+": {"plate": 0.01, "pressure": 0}}
    settings = yaml.safe_load(write_case(tmp_path / "case.yaml").read_text(encoding="utf-8"))
    settings["macro"]["boundary"] |= plate
    case = tmp_path / "plate.yaml"
    case.write_text(yaml.safe_dump(settings), encoding="utf-8")
    status, out, err, document = run(case, tmp_path / "out", fem=["skfem", "volumes"], surrogate=["cubic"])
    assert status == 0, err + out
    skipped = [line for line in document["comparisons"] if line["skipped"]]
    assert {line["one"] for line in skipped} == {"volumes"}
    assert "solution, law linear, volumes: it does not offer plate" in out
