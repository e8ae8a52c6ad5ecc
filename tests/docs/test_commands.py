"""Commands that stand in a sentence, and those that are shown but cannot be run by a test."""

from __future__ import annotations

import argparse
import re
import runpy
import shlex
import sys
import tomllib

import pytest
import typer

from porocore.cli.entry import whole_program
from tests.docs.commands import all_commands, commands_of
from tests.docs.not_run import REASONS, reason
from tests.docs.pages import PAGES, ROOT, all_blocks, blocks_of, name_of, page

COMMANDS = list(all_commands())
#: Commands of porocore within a sentence, without those that leave something out or only ask for help.
IN_WORDS = sorted(
    {
        " ".join(text.split())
        for path in PAGES
        for text in re.findall(
            r"(?<!`)`(porocore [^`]+)`(?!`)",
            re.sub(r"^```.*?^```", "", path.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL),
        )
        if not re.search(r"…|\.\.\.|--help|--version|COMMAND", text)
    }
)


@pytest.mark.parametrize("text", IN_WORDS)
def test_a_command_in_a_sentence_is_one(text):
    words = shlex.split(text)[1:]
    group = whole_program()
    while isinstance(group, typer.core.TyperGroup) and words and words[0] in group.commands:
        group = group.commands[words.pop(0)]
    if isinstance(group, typer.core.TyperGroup) and not words:
        return
    shown = {word.split("=")[0] for word in words if word.startswith("--")}
    while isinstance(group, typer.core.TyperGroup):
        assert "state" in group.commands, f"{words[0]} is no command"
        group = group.commands["state"]
    known = {name for parameter in group.params for name in (*parameter.opts, *parameter.secondary_opts)}
    assert shown <= known


def test_the_tour_shows_every_command():
    shown = {c.words[1] for c in COMMANDS if c.page == "docs/tour.md" and c.is_porocore}
    assert shown == set(whole_program().commands)


def test_the_readme_names_the_two_commands_first():
    first = next(block for block in blocks_of(page("README.md"), "README.md") if block.language == "sh")
    assert [c.words for c in commands_of(first)] == [["make", "run"], ["make", "test"]]
    assert first.line < 8


@pytest.mark.parametrize("pattern", REASONS)
def test_what_is_not_run_is_still_shown(pattern):
    assert any(re.fullmatch(pattern, c.text.split(" #")[0].strip()) for c in COMMANDS), "take it off the list"


def test_few_commands_are_not_run():
    left = [c for c in COMMANDS if reason(c.text) is not None]
    assert len(left) < 0.2 * len(COMMANDS)
    assert not any(c.is_porocore for c in left)


def test_a_make_target_that_is_shown_is_one():
    targets = set(re.findall(r"^([a-z-]+):", page("Makefile"), flags=re.MULTILINE))
    named = {c.words[1] for c in COMMANDS if c.words[0] == "make"}
    assert {"run", "test"} <= named <= targets


def test_extras_that_are_shown_exist():
    project = tomllib.loads(page("pyproject.toml"))["project"]
    shown = {
        extra.strip()
        for path in PAGES
        for extras in re.findall(r"porocore\[([a-z, ]+)\]", path.read_text(encoding="utf-8"))
        for extra in extras.split(",")
    }
    assert {"skfem", "torch"} <= shown <= set(project["optional-dependencies"])


class _Parsed(Exception):
    pass


SCRIPTS = sorted(
    {c.text.split(" #")[0].strip() for c in COMMANDS if re.search(r"python benchmarks/", c.text)}
)


@pytest.mark.parametrize("text", SCRIPTS)
def test_a_script_takes_the_arguments_that_are_shown(text, monkeypatch):
    _, script, *arguments = shlex.split(text)
    if script == "benchmarks/run.py":
        names = re.findall(r'"(\w+)"', re.search(r"SCRIPTS = [(\[](.*?)[)\]]", page(script), re.DOTALL)[1])
        assert set(arguments) <= set(names)
        return
    parse = argparse.ArgumentParser.parse_args

    def parsed(self, *words):
        parse(self, *words)
        raise _Parsed

    monkeypatch.setattr(argparse.ArgumentParser, "parse_args", parsed)
    monkeypatch.setattr(sys, "argv", [script, *arguments])
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    with pytest.raises(_Parsed):
        runpy.run_path(str(ROOT / script), run_name="__main__")


def test_every_block_has_a_language_that_is_known():
    """So that no snippet goes by unseen because of how it is marked."""
    known = {"sh", "python", "yaml", "toml", "text", ""}
    languages = {
        re.sub(r"^\{.*", "", line[3:].strip()) if line.startswith("```{") else line[3:].strip()
        for path in PAGES
        for line in path.read_text(encoding="utf-8").splitlines()
        if re.match(r"```\S", line)
    }
    assert languages <= known, f"{languages - known} in {[name_of(p) for p in PAGES]}"
    assert sum(1 for _ in all_blocks("sh")) > 40
