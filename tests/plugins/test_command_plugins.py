"""Commands as plugins: found by their hooks, with a section of a study and a call from Python."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from porocore import Study, load_config
from porocore.cli.entry import whole_program
from porocore.errors import ConfigurationError, PluginError
from porocore.plugins.discovery import own_offers
from porocore.plugins.hookspecs import CommandOffer
from porocore.plugins.kinds import OWN_HOOKS
from porocore.plugins.registry import Registry, find_command, make_command, own, registry
from porocore.study.config.schema import configuration_schema
from tests.helpers.invoked import BENCHMARK, invoke

HOOKS = """
from porocore import CommandOffer, hookimpl

def load():
    import acme_count_command
    return acme_count_command.Count

@hookimpl
def porocore_commands():
    return [
        CommandOffer("count-up", load, "Count up.", section="counting", file_keys=("numbers",)),
        CommandOffer("sweep", load, "Sweep in another way."),
        CommandOffer("tally", load, "Count in a cell.", group="cell"),
    ]
"""
COMMAND = '''
from pathlib import Path
from typing import Annotated

import typer
from porocore import Command, FileCheck, StrictModel

class Counting(StrictModel):
    most: int = 3
    """Last number."""
    rates: list[float] = []
    """Of the count."""

class Count(Command):
    def run(self, config: Annotated[Path, typer.Argument()], resume: bool = False) -> None:
        """Count up."""
        if config.name == "stop":
            raise KeyboardInterrupt
        print("counted")

    def section(self):
        return Counting

    def check(self, document, config, settings):
        if config is None:
            return FileCheck(["numbers of its own"])
        return FileCheck([f"counts to {settings.most}"], {"resume": True})

    def call(self, study, step=1):
        return list(range(0, study.section("counting").most, step))
'''


@pytest.fixture
def site(tmp_path, monkeypatch):
    info = tmp_path / "site" / "acme_count-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: acme-count\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[porocore]\nacme = acme_count\n")
    (info.parent / "acme_count.py").write_text(HOOKS)
    (info.parent / "acme_count_command.py").write_text(COMMAND)
    monkeypatch.syspath_prepend(str(info.parent))
    registry.cache_clear()
    yield info.parent
    registry.cache_clear()
    for name in ("acme_count", "acme_count_command"):
        sys.modules.pop(name, None)


def study(folder: Path, **more: object) -> Path:
    path = folder / "study.yaml"
    path.write_text(yaml.safe_dump({**yaml.safe_load(BENCHMARK.read_text("utf-8")), **more}), "utf-8")
    return path


def test_the_commands_of_porocore_come_by_the_hook():
    offers = {offered.offer.name: offered for offered in own_offers() if offered.kind == "command"}
    assert {"calibrate", "sweep", "tune", "sensitivity", "reproduce", "crosscheck", "rev"} <= set(offers)
    assert {"stability", "verify"} <= set(offers)
    assert {str(offered.source.distribution) for offered in offers.values()} == {"porocore"}
    program = whole_program()
    for name, offered in offers.items():
        group = program.commands["cell"] if offered.offer.group else program
        # What the page of all commands says is what the command itself says.
        said = group.commands[name].help.partition("\n\n")[0]
        assert " ".join(said.split()) == offered.offer.summary, name


def test_own_offers_need_no_metadata(monkeypatch):
    code = """
        import importlib.metadata as m
        m.distributions = lambda *a, **k: 1 / 0
        from porocore.plugins.registry import find_command
        print(find_command(lambda offer: offer.name == "tune").offer.name)
    """
    lines = "\n".join(line.strip() for line in code.splitlines())
    done = subprocess.run([sys.executable, "-c", lines], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "tune"
    assert {module.split(".")[1] for module in OWN_HOOKS} == {"sampling", "surrogates", "commands"}


def test_a_command_of_a_plugin_is_listed_and_runs(site):
    page = invoke("--help").stdout
    assert page.index("Commands of plugins") < page.index("count-up") < page.index("Count up.")
    assert "tally" in invoke("cell", "--help").stdout
    assert "counted" in invoke("count-up", BENCHMARK).stdout
    assert "counted" in invoke("cell", "tally", BENCHMARK).stdout
    assert "did you mean 'count-up'?" in " ".join(invoke("count-upp").output.split())


def test_an_interrupted_command_of_a_plugin_says_how_to_go_on(site):
    path = os.pathsep.join([str(site), os.environ.get("PYTHONPATH", "")])
    words = [sys.executable, "-m", "porocore", "count-up", "stop"]
    done = subprocess.run(
        words, env={**os.environ, "PYTHONPATH": path}, capture_output=True, text=True, check=False
    )
    assert done.returncode == 130
    assert "interrupted; continue with: porocore count-up stop --resume" in done.stderr


def test_no_plugin_takes_the_place_of_a_command_of_porocore(site):
    assert find_command(lambda offer: offer.name == "sweep").source.distribution == "porocore"
    assert "counted" not in invoke("sweep", "no-such.yaml").stdout
    with pytest.raises(PluginError, match="offered by"):
        registry().find("command", "sweep")


def test_a_command_whose_arguments_cannot_be_read_is_one_message(site):
    code = site / "acme_count_command.py"
    twice = "resume: Annotated[bool, typer.Option(), typer.Argument()] = False"
    code.write_text(code.read_text().replace("resume: bool = False", twice))
    done = invoke("count-up", "study.yaml")
    assert isinstance(done.exception, PluginError)
    assert "command 'count-up' of acme-count 1.0 has arguments that typer cannot read" in str(done.exception)


def test_a_section_is_checked_by_its_command(site, tmp_path):
    path = study(tmp_path, counting={"most": 4})
    config = load_config(path)
    assert config.sections == {"counting": {"most": 4}}
    assert load_config(study(tmp_path, **yaml.safe_load(config.resolved_yaml()))) == config
    assert Study(path).check()[-1] == "counts to 4"
    done = invoke("check", path)
    assert "counts to 4" in done.stdout
    assert done.stdout.splitlines()[-1] == f"no faults; next: porocore count-up {path} --resume"
    assert "counting" in configuration_schema()["properties"]


def test_a_file_of_a_commands_own_is_checked(site, tmp_path):
    path = tmp_path / "numbers.yaml"
    path.write_text("numbers: [1]\n")
    assert invoke("check", path).stdout == f"numbers of its own\nno faults; next: porocore count-up {path}\n"


@pytest.mark.parametrize(
    ("section", "message"),
    [
        ({"counting": {"least": 1}}, "counting.least: unknown key; "),
        ({"counting": {"most": "many"}}, "counting.most: expected a whole number, got 'many'"),
        (
            {"counting": {"rates": [0.0, float("nan")]}},
            "counting.rates.1: expected a finite number, got .nan",
        ),
        ({"counting": [1]}, "counting: expected a section with keys below it, got [1]"),
    ],
)
def test_faults_of_a_section_have_their_line(site, tmp_path, section, message):
    path = study(tmp_path, **section)
    with pytest.raises(ConfigurationError) as error:
        Study(path).check()
    assert str(error.value).startswith(f"{path}:")
    assert message in str(error.value)


def test_a_section_without_its_plugin_is_one_message(tmp_path):
    with pytest.raises(ConfigurationError) as error:
        load_config(study(tmp_path, zyxw={"most": 4}))
    assert str(error.value).endswith(
        "zyxw: unknown key; no installed command has a section of this name; install its plugin ('porocore plugins' "
        "lists those that are there), or remove it"
    )


def test_a_command_is_called_from_python(site, tmp_path):
    one = Study(study(tmp_path), counting={"most": 4})
    assert one.count_up() == [0, 1, 2, 3]
    assert one.count_up(step=2) == [0, 2]
    assert one.section("counting").most == 4
    with pytest.raises(AttributeError, match="a study has no 'verify', and no installed command"):
        _ = one.verify
    with pytest.raises(ConfigurationError, match="zyxw: no installed plugin has a command with this section"):
        one.section("zyxw")


def test_a_check_that_returns_something_else_names_the_plugin(site, tmp_path):
    code = site / "acme_count_command.py"
    code.write_text(code.read_text().replace('return FileCheck([f"counts', 'return (["counts'))
    with pytest.raises(PluginError, match=r"acme-count 1\.0 .*expected a porocore.FileCheck, got"):
        Study(study(tmp_path, counting={})).check()


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("section", "my study", "CommandOffer.section: expected the key of a section"),
        ("file_keys", "unknowns", "CommandOffer.file_keys: expected a list or tuple of keys, got 'unknowns'"),
        ("group", 3, "CommandOffer.group: expected the name of a group of commands"),
    ],
)
def test_an_offer_says_what_is_wrong_with_it(field, value, message):
    with pytest.raises(PluginError, match=message.replace("(", r"\(")):
        CommandOffer("count", dict, "", **{field: value})


def test_an_offer_of_another_kind_is_no_command(tmp_path, monkeypatch):
    info = tmp_path / "acme_plain-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: acme-plain\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[porocore]\nacme = acme_plain\n")
    source = "from porocore import Offer, hookimpl\n@hookimpl\ndef porocore_commands(): return [Offer('a', dict, '')]"
    (tmp_path / "acme_plain.py").write_text(source)
    monkeypatch.syspath_prepend(str(tmp_path))
    reasons = [b.reason for b in Registry.discover().broken if b.source.distribution == "acme-plain"]
    assert "expected a list of porocore.CommandOffer, got Offer(" in reasons[0]


@pytest.mark.parametrize(
    "offered", [o for o in own().offers if o.kind == "command"], ids=lambda o: o.offer.name
)
def test_the_commands_of_porocore_pass_the_checks(offered, tmp_path):
    """Those that need no run; each run has tests of its own."""
    from porocore.testing import CommandSuite

    name = f"{offered.offer.group} {offered.offer.name}".strip()
    suite = type("TestOwn", (CommandSuite,), {"name": name, "kit_version": "5"})
    suite.make_command = classmethod(lambda cls: make_command(offered))
    one = suite()
    one.test_numbers_have_their_units_in_the_help()
    if make_command(offered).section() is not None:
        one.test_its_section_refuses_unknown_keys()


def test_the_list_of_plugins_has_the_commands(site):
    rows = {(row["kind"], row["name"]): row for row in json.loads(invoke("plugins", "--json").stdout)}
    assert rows["command", "calibrate"]["distribution"] == "porocore"
    assert rows["command", "count-up"]["state"] == "ready"
