"""``dir`` and the page of all names show what is public, and nothing else."""

import inspect
import re
import subprocess
import sys
from enum import Enum

import pytest

import porocore
from tests.docs.pages import ROOT

PAGE = (ROOT / "docs/reference/names.md").read_text(encoding="utf-8")
#: Page and rows of each group.
GROUPS = [
    (link, dict(re.findall(r"^\| `(\w+)` \| (.*) \|$", text, re.MULTILINE)))
    for link, text in re.findall(
        r"^Described in \[[^]]*\]\((\S+)\)\.$(.*?)(?=^## |\Z)", PAGE, re.MULTILINE | re.DOTALL
    )
]


def test_dir_shows_the_public_names_also_when_some_were_used():
    code = "import porocore, porocore.testing; porocore.Study; print(*dir(porocore))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == sorted([*porocore.__all__, "__version__"])
    assert not {"Any", "annotations", "TYPE_CHECKING", "importlib"} & set(dir(porocore))


def test_every_name_is_in_one_group_with_what_it_is():
    assert len(GROUPS) > 5
    assert sorted(name for _, rows in GROUPS for name in rows) == porocore.__all__
    for link, rows in GROUPS:
        described = (ROOT / "docs/reference" / link.partition("#")[0]).read_text(encoding="utf-8")
        for name, told in rows.items():
            assert re.search(rf":: porocore\.{name}$", described, re.MULTILINE), f"{name} is not in {link}"
            first = inspect.getdoc(getattr(porocore, name)).split("\n\n")[0].replace("\n", " ")
            plain = re.sub(r":\w+:`~?(?:[\w.]+\.)?(\w+)`", r"\1", first)
            assert told.replace("`", "") == plain.replace("`", ""), name


@pytest.mark.parametrize("name", porocore.__all__)
def test_a_public_name_has_types(name):
    """Every parameter of what can be called is annotated."""
    value = getattr(porocore, name)
    if name == "hookimpl" or (inspect.isclass(value) and issubclass(value, BaseException | Enum)):
        return
    called = value.__init__ if inspect.isclass(value) else value
    if not inspect.isfunction(called):  # of dict, of int, or none
        return
    parameters = list(inspect.signature(called).parameters.values())
    bare = [p.name for p in parameters if p.annotation is p.empty and p.name != "self"]
    assert not bare, f"{name}: {bare}"
