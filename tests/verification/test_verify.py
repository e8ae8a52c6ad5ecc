"""The ladder of known answers apart from its cases: who climbs, what counts as passed, what is printed."""

import json
import sys

import numpy as np
import pytest

from porocore.cli import main
from porocore.commands.backends import Backends
from porocore.commands.verify import cases as ladder
from porocore.commands.verify.case import Check, VerificationCase, observed_order, relative_check
from porocore.commands.verify.cases import (
    CaseResult,
    run_cases,
    select_cases,
    select_solvers,
)
from porocore.errors import ConfigurationError, PluginError
from porocore.plugins import registry
from porocore.plugins.table import PluginRow


@pytest.fixture
def porocore_command(monkeypatch, capsys):
    """Run the command line in this process: status, standard output, standard error."""

    def run(*words):
        monkeypatch.setattr(sys, "argv", ["porocore", *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            main()
        captured = capsys.readouterr()
        return ended.value.code, captured.out, captured.err

    return run


def right(solver, long):
    return [relative_check("a number", 2.0, 2.01 if long else 2.001, 1e-3, order=2.0, note="of a fake")]


def wrong(solver, long):
    return [Check("a field", 0.2, 0.1), Check("a hole", float("nan"), 0.1)]


def broken(solver, long):
    raise ZeroDivisionError("by design")


FAKES = {
    "good": VerificationCase("good", "nobody", "macro solver", {"only": right}),
    "bad": VerificationCase(
        "bad", "nobody", "macro solver", {"first": broken, "second": wrong, "third": right}
    ),
}


@pytest.fixture
def fakes(monkeypatch):
    """Two cases in place of the ladder's, on a backend that does nothing."""

    class Registry:
        def get(self, kind, name):
            return object

        def table(self):
            return []

    monkeypatch.setattr(ladder, "CASES", FAKES)
    monkeypatch.setattr(ladder, "registry", Registry)
    monkeypatch.setattr(
        ladder, "select_solvers", lambda fem: Backends({"cell solver": (), "macro solver": ("fake",)})
    )


def test_observed_order_is_the_slope():
    sizes = [0.4, 0.2, 0.1, 0.05]
    assert observed_order(sizes, [3 + 7 * h**2 for h in sizes], exact=3.0) == pytest.approx(2, rel=1e-12)
    # Against the last of very different sizes it is nearly so.
    sizes = [0.4, 0.2, 0.1, 1e-4]
    assert observed_order(sizes, [3 - 7 * h**3 for h in sizes]) == pytest.approx(3, rel=1e-6)


def test_what_passes():
    assert relative_check("x", -4.0, -4.04, 0.0101).error == pytest.approx(0.01)
    assert relative_check("x", -4.0, -4.04, 0.0101).passed
    assert not relative_check("x", -4.0, -4.04, 0.0099).passed
    assert not relative_check("x", 1.0, float("inf"), 0.1).passed
    assert not CaseResult("a", "b", "c", None, "raised").passed


def test_an_item_that_raises_is_a_failed_row_and_the_others_go_on(fakes):
    told = []
    rows = run_cases(
        select_cases(),
        ladder.select_solvers(()),
        on_item=lambda what, done, count: told.append((what, done, count)),
    )
    assert [(r.case, r.item, r.passed) for r in rows] == [
        ("good", "only", True),
        ("bad", "first", False),
        ("bad", "second", False),
        ("bad", "second", False),
        ("bad", "third", True),
    ]
    assert rows[1].reason == "ZeroDivisionError: by design"
    assert rows[1].describe() == "bad, first, fake: ZeroDivisionError: by design"
    assert rows[2].describe() == "bad, second, fake: a field: error 2.00e-01, allowed 0.1"
    assert told[0] == ("good, only, fake", 0, 4)
    assert told[-1] == ("", 4, 4)


def test_the_long_form_is_asked_for(fakes):
    assert not run_cases(select_cases(["good"]), ladder.select_solvers(()), long=True)[0].passed


def test_the_document_is_json_without_nan(fakes):
    rows = run_cases(select_cases(), ladder.select_solvers(()))
    data = json.loads(json.dumps(ladder.document(rows, long=False)), parse_constant=pytest.fail)
    assert (data["format"], data["form"], data["passed"]) == ("porocore-verification", "short", False)
    assert data["rows"][0]["ours"] == 2.001
    assert data["rows"][1]["reason"] == "ZeroDivisionError: by design"
    assert data["rows"][3]["error"] is None
    assert data["rows"][0]["source"] == "nobody"


def test_cases_come_in_the_order_of_the_ladder():
    assert [case.name for case in select_cases(["terzaghi", "channel"])] == ["channel", "terzaghi"]
    names = [case.name for case in select_cases()]
    assert {"spheres", "cylinders", "homogeneous", "identities", "mandel", "xie-leo", "small-strain"} < set(
        names
    )
    for case in select_cases():
        assert case.source
        assert case.items


def test_unknown_names_are_refused():
    with pytest.raises(ConfigurationError, match="unknown case 'sphere'; the cases are channel, spheres, "):
        select_cases(["sphere"])
    with pytest.raises(PluginError, match="unknown cell solver 'fenics'"):
        select_solvers(["fenics"])


def test_a_broken_plugin_is_a_failure_unless_backends_are_named(monkeypatch):
    rows = registry.registry().table()
    fault = PluginRow("", "bent", "porocore-bent 1", "broken", "", "ImportError: no")
    missing = PluginRow("cell solver", "thin", "porocore-thin 1", "missing dependency", "", "pip")

    class Registry:
        def table(self):
            return [*rows, fault, missing]

    monkeypatch.setattr("porocore.commands.backends.registry", Registry)
    found = select_solvers()
    (row,) = run_cases([], found)
    assert row.describe() == "porocore-bent 1: broken: ImportError: no"
    assert found.absent == ("thin (missing dependency): pip",)
    name = found.names["cell solver"][0]
    assert select_solvers([name]) == Backends({"cell solver": (name,), "macro solver": (name,)})


def test_the_command_prints_a_table_and_the_status(fakes, porocore_command, tmp_path):
    status, out, err = porocore_command("verify", "--case", "good")
    assert status == 0, err
    assert [word for word in out.splitlines()[1].split() if word] == [
        *("good", "only", "fake", "a", "number", "2", "2.001", "5.0e-04", "1.0e-03", "2.0", "pass")
    ]
    assert "good: nobody" in out
    assert "good, only: of a fake" in out
    path = tmp_path / "found.json"
    status, out, err = porocore_command("verify", "--json", "--out", path)
    assert status == 1
    assert "3 of 5 checks; the first: bad, first, fake: ZeroDivisionError: by design" in err
    assert path.read_text() == out
    assert json.loads(out)["passed"] is False


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--case", "cylinder"), "unknown case 'cylinder'; the cases are"),
        (("--fem", "fenics"), "unknown cell solver 'fenics'"),
        (("--out", "/dev/null/all.json"), "--out /dev/null/all.json: /dev/null is a device, not a folder"),
        (("--out", "/dev"), "--out /dev: no file can be written there: expected a file, got a folder"),
    ],
)
def test_bad_use_is_a_message_and_status_2(porocore_command, words, message):
    status, out, err = porocore_command("verify", *words)
    assert (status, out) == (2, "")
    assert message in err
    assert "Traceback" not in err


def test_numbers_of_the_papers_are_in_the_order_that_they_must_have():
    """More solid, less flow: a mistyped entry would stand out against its neighbours."""
    from porocore.commands.verify.cell_cases import CYLINDERS, SPHERES

    for table in (SPHERES, CYLINDERS):
        c, drag = np.array(list(table)), np.array(list(table.values()))
        assert (np.diff(c) > 0).all()
        assert (np.diff(np.log(drag)) > 0).all()
