"""The distributions can be installed in any order, together or one by one, and taken away again."""

import json

import pytest

from porocore.plugins.kinds import FIRST_PARTY
from tests.release.environments import CONSTRAINTS, Environment, copy_libraries

pytestmark = pytest.mark.slow

CORE = "porocore"
PLUGINS = sorted({distribution for distribution, _ in FIRST_PARTY.values()})
ORDERS = {
    "all by the extra": [("porocore[all]",)],
    "all at once": [(*PLUGINS, CORE)],
    "the core first": [(CORE,), *((name,) for name in PLUGINS)],
    "plugins first": [*((name,) for name in reversed(PLUGINS)), (CORE,)],
}
#: What the libraries of an environment make of each plugin: pip has no dolfinx.
EVERYTHING = {
    (kind, name): "missing dependency" if name == "dolfinx" else "ready"
    for name, (_, kinds) in FIRST_PARTY.items()
    for kind in kinds
}


@pytest.fixture(scope="module")
def libraries(usual, dist, tmp_path_factory):
    """An environment with all dependencies and nothing of porocore."""
    environment = Environment(tmp_path_factory.mktemp("orders") / "environment")
    copy_libraries(usual, environment)
    environment.install("--find-links", dist, "-c", CONSTRAINTS, "porocore[jax]")
    environment.pip("uninstall", "-q", "-y", CORE, "porocore-surrogate-jax")
    yield environment
    environment.remove()


def own(environment: Environment) -> set[str]:
    rows = json.loads(environment.pip("list", "--format", "json"))
    return {row["name"] for row in rows if row["name"].startswith("porocore")}


@pytest.mark.parametrize("order", ORDERS)
def test_every_order_leads_to_the_same(libraries, dist, order):
    for names in ORDERS[order]:
        libraries.pip("install", "-q", "--no-index", "--find-links", dist, *names)
        # Whichever comes first brings the core.
        assert {CORE, *(name.partition("[")[0] for name in names)} <= own(libraries)
    libraries.pip("check")
    assert own(libraries) == {CORE, *PLUGINS}
    assert libraries.states() == EVERYTHING
    libraries.pip("uninstall", "-q", "-y", CORE, *PLUGINS)
    assert own(libraries) == set()


def test_taking_one_away_leaves_the_others(libraries, dist):
    libraries.pip("install", "-q", "--no-index", "--find-links", dist, "porocore[all]")
    expected = dict(EVERYTHING)
    for name, (distribution, kinds) in FIRST_PARTY.items():
        libraries.pip("uninstall", "-q", "-y", distribution)
        expected |= {(kind, name): "not installed" for kind in kinds}
        assert libraries.states() == expected
    libraries.pip("uninstall", "-q", "-y", CORE)


@pytest.mark.parametrize(
    ("extra", "plugins"),
    [
        *((name, [distribution]) for name, (distribution, _) in FIRST_PARTY.items()),
        ("default", ["porocore-fem-skfem", "porocore-surrogate-torch"]),
    ],
)
def test_an_extra_brings_its_plugins(libraries, dist, extra, plugins):
    words = ("install", "-q", "--dry-run", "--report", "-", "--no-index", "--find-links", dist)
    report = json.loads(libraries.pip(*words, f"porocore[{extra}]"))
    assert sorted(row["metadata"]["name"] for row in report["install"]) == [CORE, *plugins]
