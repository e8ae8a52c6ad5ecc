"""Where no backend is installed, one message says everything that is to be installed."""

import pytest

from porocore.commands import backends
from porocore.commands.crosscheck import comparison as backend_selection
from porocore.commands.verify import cases as ladder
from porocore.errors import PluginError
from porocore.plugins.kinds import OF_A_STUDY
from porocore.plugins.registry import Registry
from porocore.study.config.loading import benchmark_path, load_config
from porocore.study.notes import checks as preflight
from porocore.testing import plugin_check

SKFEM = "'skfem' is not installed; install it: pip install porocore-fem-skfem"
FEM = "skfem (not installed): pip install porocore-fem-skfem; dolfinx (not installed): pip install porocore-fem-dolfinx"


@pytest.fixture(autouse=True)
def bare(monkeypatch):
    """What the core alone offers."""
    offers = [offered for offered in Registry.discover().offers if offered.source.distribution == "porocore"]
    assert offers
    for module in (preflight.registry, backends, ladder, plugin_check):
        monkeypatch.setattr(module, "registry", lambda: Registry(offers, []))


def message(work, *words):
    with pytest.raises(PluginError) as caught:
        work(*words)
    return str(caught.value)


def test_all_that_a_study_lacks_is_told_at_once_and_each_name_once():
    config = load_config(benchmark_path())
    assert message(preflight.check_backends, config).splitlines() == [
        f"cell solver {SKFEM}",
        "surrogate 'torch' is not installed; install it: pip install porocore-surrogate-torch",
    ]
    assert message(preflight.find_backends, config, ("macro solver",)) == f"macro solver {SKFEM}"
    preflight.find_backends(config, ("sampler",))


def test_two_finite_element_backends_are_two_names():
    config = load_config(benchmark_path()).with_backends("dolfinx", "polynomial", "skfem")
    assert [
        line.split(" is ")[0] for line in message(preflight.find_backends, config, OF_A_STUDY).splitlines()
    ] == [
        "cell solver 'dolfinx'",
        "macro solver 'skfem'",
    ]


def test_what_needs_any_backend_names_them_all():
    assert message(backend_selection.select_backends).endswith(
        f"no cell solver takes part; install one: {FEM}"
    )
    assert message(ladder.select_solvers) == f"there is no finite-element backend; install one: {FEM}"


def test_a_plugin_of_the_project_that_is_not_here_is_told_apart_from_an_unknown_one():
    assert message(plugin_check.find_offers, "skfem") == f"cell solver {SKFEM}"
    assert "got 'skfam'; there are active, " in message(plugin_check.find_offers, "skfam")
