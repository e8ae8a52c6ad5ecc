"""What runs the snippets sees what is there, and notices what fails."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import porocore
from tests.docs.clone import Clone
from tests.docs.coarse import HOLDERS
from tests.docs.commands import Command, commands_of
from tests.docs.fragments import role, with_fragment
from tests.docs.pages import Block, blocks_of
from tests.docs.services import Service
from tests.docs.shell import Shell

PAGE = """# Title

<!-- tests: file a.py -->
```python
one = 1
```

1. In a list:

   ```sh
   # a remark
   echo one \\
     two
   for i in 1 2; do
     echo $i   # another
   done
   cat > b.txt <<END
   text
   END
   ```
"""


def test_blocks_are_found_in_order_with_their_lines_and_remarks():
    python, shell = blocks_of(PAGE, "page.md")
    assert (python.language, python.line, python.text, role(python)) == (
        "python",
        5,
        "one = 1\n",
        ("file", "a.py"),
    )
    assert (shell.language, shell.line, role(shell)) == ("sh", 11, ("", ""))
    assert [(c.line, c.text.split()[0]) for c in commands_of(shell)] == [
        (12, "echo"),
        (14, "for"),
        (17, "cat"),
    ]


def test_an_unknown_remark_is_told():
    with pytest.raises(AssertionError, match="unknown remark"):
        role(Block("page.md", 1, "yaml", "a: 1\n", "tests: fille a.yaml"))


@pytest.mark.parametrize(
    ("text", "plain", "piped"),
    [
        ('porocore cell --grad-u "0 0 0; 0 -0.1 0; 0 0 0" --p 0.05', True, False),
        ('porocore sample my.yaml --scheduler "$(cat scheduler.txt)"', False, False),
        ("porocore cell --json > state.json", False, True),
        ("porocore init   # lists; the examples", True, False),
    ],
)
def test_commands_that_need_a_shell_are_known(text, plain, piped):
    command = Command("page.md", 1, text)
    assert command.is_porocore
    assert (command.plain, command.piped and not plain) == (plain, piped)


def test_a_fragment_replaces_what_it_names():
    base = {"cell": {"material": {"kind": "a"}, "viscosity": 1}, "sampling": {"sampler": "a", "tolerance": 1}}
    part = {"cell": {"materials": {"x": {}}}, "sampling": {"sampler": "b"}}
    assert with_fragment(base, part) == {
        "cell": {"materials": {"x": {}}, "viscosity": 1},
        "sampling": {"sampler": "b"},
    }


@pytest.fixture
def shell(tmp_path):
    clone = Clone(tmp_path)
    made = Shell(clone, clone.folder, Service())
    yield made
    made.close()


def run(shell, text):
    shell.run(Command("page.md", 7, text))


def test_folder_and_variables_stay(shell):
    run(shell, "mkdir new && cd new && export GREETING='good day'")
    run(shell, 'test "$GREETING" = "good day" && touch here')
    assert (shell.folder.name, (shell.folder / "here").exists()) == ("new", True)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("false", r"page\.md:7: false\nstatus 1"),
        ("cat missing.yaml", "No such file"),
        ("porocore check missing.yaml", "status 2\nerror: missing.yaml: no such file"),
        ("porocore units --no-such-option", "status 2"),
        ("sed -i 's/radius: 0.7/radius: 0.2/' examples/dehghani2022.yaml", "there is no 'radius: 0.7'"),
        ("pip install -e missing-project", "missing-project"),
    ],
)
def test_what_fails_is_told_with_its_place(shell, text, message):
    with pytest.raises(AssertionError, match=message):
        run(shell, text)


def test_all_that_make_a_configuration_are_made_coarse():
    """A module that takes the function by name keeps the one of the moment when it is imported."""
    for path in (Path(porocore.__file__).parent).rglob("*.py"):
        if re.search(
            r"^from porocore\.config import .*\bvalidated\b", path.read_text(encoding="utf-8"), re.MULTILINE
        ):
            name = ".".join(path.relative_to(Path(porocore.__file__).parents[1]).with_suffix("").parts)
            assert name in {module.__name__ for module in HOLDERS}
