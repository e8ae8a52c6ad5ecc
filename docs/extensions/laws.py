"""The directive ``suite``: a class of the conformance kit, what its author gives it, and its laws in words."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from typing import Any

from docutils import nodes
from sphinx.util.docutils import SphinxDirective

import porocore.testing

#: Functions that an author gives or may give; the others serve the laws.
_GIVEN = re.compile(r"make_|checkpoint_often")
_TEST = "test_"


def suites() -> list[str]:
    """Names of all of them, but for the one that they derive from."""
    found = {name: getattr(porocore.testing, name) for name in porocore.testing.__all__}
    return [name for name, suite in found.items() if inspect.isclass(suite) and name != "Suite"]


def laws(name: str) -> Iterator[str]:
    """Each law of a suite as an item of a list, but for those of the suites that it derives from."""
    suite = getattr(porocore.testing, name)
    bases = [getattr(porocore.testing, other) for other in suites()]
    bases = [base for base in bases if base is not suite and issubclass(suite, base)]
    for base in bases:
        yield f"- those of {{py:obj}}`~porocore.testing.{base.__name__}`"
    for law in dir(suite):
        own = law.startswith(_TEST) and not hasattr(porocore.testing.Suite, law)
        if own and not any(hasattr(base, law) for base in bases):
            more = inspect.getdoc(getattr(suite, law))
            words = law.removeprefix(_TEST).replace("_", " ")
            yield f"- **{words}**" + (f": {' '.join(more.split())}" if more else "")


def given(name: str) -> list[str]:
    """What the subclass defines: functions and attributes."""
    suite, common = getattr(porocore.testing, name), dir(porocore.testing.Suite)
    public = [member for member in dir(suite) if not member.startswith(("_", _TEST)) and member not in common]
    data = [
        member for member in public if not callable(getattr(suite, member)) and not _fixture(suite, member)
    ]
    return [member for member in public if member in data or _GIVEN.match(member)]


def _fixture(suite: Any, member: str) -> bool:
    return "Fixture" in type(inspect.getattr_static(suite, member)).__name__


class SuiteDirective(SphinxDirective):
    """A suite by its name."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        name = self.arguments[0]
        described = ["```{eval-rst}", f".. autoclass:: porocore.testing.{name}", ""]
        for member in given(name):
            kind = "method" if callable(getattr(getattr(porocore.testing, name), member)) else "attribute"
            described.append(f"   .. auto{kind}:: porocore.testing.{name}.{member}")
        described.append("```")
        return self.parse_text_to_nodes("\n".join([*described, "", "Laws:", "", *laws(name)]))


def setup(app: Any) -> dict[str, Any]:
    app.add_directive("suite", SuiteDirective)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
