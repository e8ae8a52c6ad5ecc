"""Help of every command: its own, and none for a word that is no command."""

import pytest

from porocore.cli.entry import whole_program
from tests.helpers.invoked import invoke


def commands(command, path=()):
    """Yield the words of every command and group, with True for a group."""
    children = getattr(command, "commands", {})
    yield path, bool(children)
    for name, child in children.items():
        yield from commands(child, (*path, name))


ALL = [(path, group) for path, group in commands(whole_program()) if path]


@pytest.mark.parametrize(("path", "group"), ALL, ids=[" ".join(path) for path, _ in ALL])
@pytest.mark.parametrize("option", ["--help", "-h"])
def test_a_command_shows_its_own_help(path, group, option):
    done = invoke(*path, option)
    words = " ".join(done.stdout.split())
    assert done.exit_code == 0
    assert f"Usage: root {' '.join(path)} [OPTIONS]" in words
    assert (" COMMAND " in words.partition("[OPTIONS]")[2][:20]) == group


@pytest.mark.parametrize("path", [path for path, group in ALL if group], ids=" ".join)
def test_a_word_that_is_no_command_has_no_help(path):
    """``porocore cell representative --help`` showed the help of ``porocore cell state``."""
    for words in (("representative", "--help"), ("--help-me",), ("representative",)):
        done = invoke(*path, *words)
        assert done.exit_code == 2
        assert "Options" not in done.output


def test_a_group_names_its_commands_where_a_word_is_none():
    words = " ".join(invoke("cell", "representative").output.replace("│", " ").split())
    assert (
        "There is no command and no file 'representative'; the commands are rev, state, fields and show"
        in words
    )
