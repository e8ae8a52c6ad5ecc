"""Every installed backend takes part by its name; a test is repeated for each, or for each pair.

Those that the project publishes are always expected. One that cannot be loaded is a skip on a developer's
machine and a failure where the variable CI is set.
"""

from __future__ import annotations

import os
from functools import cache
from itertools import combinations

import pytest

from porocore.errors import PluginError
from porocore.plugins.kinds import FIRST_PARTY
from porocore.plugins.registry import registry
from tests.helpers.platform_parts import without

#: Fixture of a test → the kind of backend that it is repeated for.
KINDS = {"cell_solver": "cell solver", "macro_solver": "macro solver", "surrogate": "surrogate"}


def expected(kind):
    """Names that are offered, and those that should be."""
    return sorted(
        {*registry().names(kind), *(name for name, (_, kinds) in FIRST_PARTY.items() if kind in kinds)}
    )


def pytest_generate_tests(metafunc):
    for fixture, kind in KINDS.items():
        if fixture in metafunc.fixturenames:
            metafunc.parametrize(fixture, expected(kind))
        if f"{fixture}_pair" in metafunc.fixturenames:
            pairs = list(combinations(expected(kind), 2))
            metafunc.parametrize(f"{fixture}_pair", pairs, ids=["-".join(pair) for pair in pairs])


def unavailable(reason, environment=os.environ):
    """Skip, or fail where everything ought to be installed."""
    if environment.get("CI") and not without(reason, environment):
        pytest.fail(f"CI is set, and so every backend must load: {reason}")
    pytest.skip(reason)


@cache
def loaded(kind, name):
    """The class, or the error that says why there is none."""
    try:
        return registry().get(kind, name)
    except PluginError as error:
        return error


@pytest.fixture(scope="session")
def load():
    """``load(kind, name)`` is an instance with default options."""

    def make(kind, name):
        found = loaded(kind, name)
        if isinstance(found, PluginError):
            unavailable(str(found))
        return found()

    return make
