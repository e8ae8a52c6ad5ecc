"""`make test` runs on every backend of the project; on CI one that is missing fails here instead of being skipped."""

import os

import pytest

from porocore.plugins.kinds import FIRST_PARTY
from porocore.plugins.registry import Registry
from tests.helpers.platform_parts import without

BACKENDS = [(kind, name) for name, (_, kinds) in FIRST_PARTY.items() for kind in kinds]


@pytest.mark.parametrize(("kind", "name"), BACKENDS, ids=lambda word: word.replace(" ", "-"))
def test_every_backend_of_the_project_can_be_used_here(kind, name):
    registry = Registry.discover()
    (row,) = [row for row in registry.table() if (row.kind, row.name) == (kind, name)]
    missing = row.state in ("not installed", "missing dependency")
    if missing and (not os.environ.get("CI") or without(name)):
        pytest.skip(f"{row.state}; {row.advice}")
    assert row.state == "ready", row.advice
    registry.get(kind, name)


def test_nothing_that_is_installed_is_broken():
    assert [f"{broken.source}: {broken.reason}" for broken in Registry.discover().broken] == []
