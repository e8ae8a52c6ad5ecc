"""Discovery of plugins: fake distributions on sys.path, read by the same machinery as installed ones."""

import inspect
import re
import subprocess
import sys
import textwrap
from dataclasses import replace
from importlib import metadata
from importlib.resources import files
from typing import get_args

import pytest

from porocore import interfaces, testing
from porocore.errors import PluginError
from porocore.plugins.discovery import Offered, Source
from porocore.plugins.hookspecs import Hooks, Offer
from porocore.plugins.kinds import FIRST_PARTY, KINDS, Kind, Versions
from porocore.plugins.registry import Registry
from tests.helpers.platform_parts import without

GOOD = """
    from porocore import Offer, hookimpl

    def load():
        from porocore import Sampler

        class Grid(Sampler):
            def __init__(self, inputs, **options): ...
            def ask(self): return []
            def tell(self, key, response): ...
            done = True
            expected = 0

        return Grid

    @hookimpl
    def porocore_samplers():
        return [Offer(name="grid", load=load, summary="a grid")]
"""


@pytest.fixture
def install(tmp_path, monkeypatch):
    """A function that installs a distribution with one entry point and one module."""
    monkeypatch.syspath_prepend(str(tmp_path))
    modules = []

    def install(distribution, module, source, entry_point="extra", version="1.0"):
        info = tmp_path / f"{distribution.replace('-', '_')}-{version}.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {distribution}\nVersion: {version}\n")
        (info / "entry_points.txt").write_text(f"[porocore]\n{entry_point} = {module}\n")
        (tmp_path / f"{module}.py").write_text(textwrap.dedent(source))
        modules.append(module)

    yield install
    for module in modules:
        sys.modules.pop(module, None)


def broken_reason(registry, distribution):
    reasons = [b.reason for b in registry.broken if b.source.distribution == distribution]
    assert reasons, f"{distribution} is not among {registry.broken}"
    return reasons[0]


def test_a_plugin_is_found_and_its_class_returned(install):
    install("acme-grid", "acme_grid", GOOD)
    registry = Registry.discover()
    assert "grid" in registry.names("sampler")
    assert registry.get("sampler", "grid").__name__ == "Grid"
    (row,) = [row for row in registry.table() if row.name == "grid"]
    assert (row.kind, row.distribution, row.state) == ("sampler", "acme-grid 1.0", "ready")
    assert (row.source.distribution, row.source.version, row.interface) == ("acme-grid", "1.0", 1)


@pytest.mark.parametrize(
    ("source", "reason"),
    [
        ("import a_module_that_does_not_exist", "ModuleNotFoundError"),
        ("raise SystemExit('no licence')", "SystemExit: no licence"),
        ("def porocore_samplers(:", "SyntaxError"),
        (
            "from porocore import hookimpl\n@hookimpl\ndef porocore_samplers(extra): return []",
            "PluginValidationError",
        ),
        (
            "from porocore import hookimpl\n@hookimpl\ndef porocore_smaplers(): return []",
            "there is no hook 'porocore_smaplers'; did you mean 'porocore_samplers'?",
        ),
        (
            "from porocore import hookimpl\n@hookimpl\ndef colours(): return []",
            "there is no hook 'colours'; the hooks are porocore_cell_solvers, porocore_macro_solvers, "
            "porocore_surrogates, porocore_samplers and porocore_commands",
        ),
        (
            "def porocore_samplers(): return []",
            "no function of acme_broken is marked @hookimpl; the hooks are",
        ),
        (
            "from porocore import hookimpl\n@hookimpl\ndef porocore_samplers(): raise ValueError('later')",
            "ValueError: later",
        ),
        (
            "from porocore import hookimpl\n@hookimpl\ndef porocore_samplers(): return ['grid']",
            "porocore.Offer",
        ),
    ],
)
def test_a_broken_plugin_is_kept_with_its_reason_and_stops_no_other(install, source, reason):
    install("acme-broken", "acme_broken", source, entry_point="a_first")
    install("acme-grid", "acme_grid", GOOD, entry_point="z_last")
    registry = Registry.discover()
    assert reason in broken_reason(registry, "acme-broken")
    assert registry.get("sampler", "grid").__name__ == "Grid"
    (row,) = [row for row in registry.table() if row.distribution == "acme-broken 1.0"]
    assert row.state == "broken"
    assert reason in row.advice


def test_a_hook_that_fails_verification_takes_its_plugins_earlier_hooks_along(install):
    source = """
        from porocore import Offer, hookimpl

        @hookimpl
        def porocore_cell_solvers():
            return [Offer(name="half", load=object, summary="")]

        @hookimpl
        def porocore_samplers(unexpected):
            return []
    """
    install("acme-half", "acme_half", source)
    registry = Registry.discover()
    assert "PluginValidationError" in broken_reason(registry, "acme-half")
    assert "half" not in registry.names("cell solver")


def test_two_distributions_with_one_entry_point_name_are_both_seen(install):
    install("acme-grid", "acme_grid", GOOD, entry_point="samplers")
    install("other-grid", "other_grid", GOOD.replace('"grid"', '"sobol"'), entry_point="samplers")
    names = Registry.discover().names("sampler")
    assert "grid" in names
    assert "sobol" in names


def test_a_name_offered_twice_is_an_error_only_when_asked_for(install):
    install("acme-grid", "acme_grid", GOOD)
    install("other-grid", "other_grid", GOOD)
    registry = Registry.discover()
    assert {row.state for row in registry.table() if row.name == "grid"} == {"offered twice"}
    with pytest.raises(PluginError, match="offered by") as error:
        registry.get("sampler", "grid")
    assert "acme-grid 1.0" in str(error.value)
    assert "other-grid 1.0" in str(error.value)


def test_a_missing_dependency_is_found_without_importing_and_names_the_command(install):
    source = """
        from porocore import Offer, hookimpl

        @hookimpl
        def porocore_surrogates():
            needs = ("numpy", "no_such_module.sub")
            return [Offer("magic", lambda: 1 / 0, "", requires=needs, install="conda install magic")]
    """
    install("acme-magic", "acme_magic", source)
    registry = Registry.discover()
    with pytest.raises(PluginError, match=r"needs no_such_module\.sub.*conda install magic"):
        registry.get("surrogate", "magic")
    (row,) = [row for row in registry.table() if row.name == "magic"]
    assert (row.state, row.advice) == ("missing dependency", "conda install magic")


def offered(name, load, kind="sampler"):
    return Offered(kind, Offer(name=name, load=load, summary=""), Source("acme", "1.0", "extra"))


def test_a_class_that_cannot_be_loaded_names_reason_and_distribution():
    def load():
        raise OSError("libmagic.so.1: cannot open shared object file")

    with pytest.raises(PluginError, match=r"'grid' of acme 1\.0 cannot be loaded.*libmagic"):
        Registry([offered("grid", load)], []).get("sampler", "grid")


def test_a_class_that_does_not_implement_the_interface_is_refused():
    from porocore import Sampler

    class Half(Sampler):
        def __init__(self, inputs):
            pass

        def ask(self):
            return []

    registry = Registry([offered("other", lambda: dict), offered("half", lambda: Half)], [])
    with pytest.raises(PluginError, match=r"subclass of porocore\.Sampler"):
        registry.get("sampler", "other")
    with pytest.raises(PluginError, match="does not implement done, expected and tell"):
        registry.get("sampler", "half")


def test_a_name_of_another_kind_gets_the_key_that_chooses(install):
    install("acme-grid", "acme_grid", GOOD)
    with pytest.raises(PluginError) as error:
        Registry.discover().get("macro solver", "grid")
    expected = "unknown macro solver 'grid', which is a sampler; choose another by macro.backend or --macro; "
    assert str(error.value).startswith(expected)


def test_an_unknown_name_gets_the_nearest_and_what_is_installed():
    registry = Registry([offered("density-sweep", dict), offered("latin-hypercube", dict)], [])
    with pytest.raises(PluginError, match=r"did you mean 'density-sweep'\?") as error:
        registry.find("sampler", "densty-sweep")
    assert "latin-hypercube (acme 1.0)" in str(error.value)
    with pytest.raises(PluginError, match="installed: none"):
        registry.find("surrogate", "abaqus")
    with pytest.raises(PluginError, match=r"unknown sampler 'skfem'"):
        registry.find("sampler", "skfem")


@pytest.mark.parametrize("name", list(FIRST_PARTY))
def test_a_first_party_plugin_that_is_not_installed_comes_with_its_command(name):
    distribution, kinds = FIRST_PARTY[name]
    empty = Registry([], [])
    for kind in kinds:
        with pytest.raises(PluginError, match=rf"not installed; install it: pip install {distribution}$"):
            empty.find(kind, name)
    states = {(row.kind, row.state, row.advice) for row in empty.table() if row.name == name}
    assert states == {(kind, "not installed", f"pip install {distribution}") for kind in kinds}


def test_first_party_names_are_those_that_the_installed_plugins_use():
    installed = {d.name for d in metadata.distributions()}
    registry = Registry.discover()
    here = {name: offered for name, offered in FIRST_PARTY.items() if not without(name)}
    assert {"skfem", "torch", "jax"} <= set(here)
    for name, (distribution, kinds) in here.items():
        assert distribution in installed, "the test environment installs every first-party plugin"
        for kind in kinds:
            assert registry.find(kind, name).source.distribution == distribution


@pytest.mark.parametrize(("kind", "record"), KINDS.items())
def test_the_record_of_a_kind_names_what_there_is(kind, record):
    """Hook, abstract class, suite with its factory, and scaffold are found by the names in one record."""
    assert set(KINDS) == set(get_args(Kind))
    assert record.hook in dir(Hooks)
    assert inspect.isabstract(getattr(interfaces, record.interface))
    assert callable(getattr(getattr(testing, record.suite), record.factory))
    templates = files("porocore.plugins.scaffold") / "templates" / record.word
    assert (templates / f"{kind.replace(' ', '_')}.py.txt").is_file()


def test_listing_plugins_imports_nothing_heavy():
    code = """
        import sys
        from porocore.plugins.registry import plugins_table
        assert {row.name for row in plugins_table()} >= {"density-sweep", "skfem", "torch"}
        print([name for name in ("torch", "skfem", "gmsh", "matplotlib", "h5py") if name in sys.modules])
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"


NEWER = """
    from porocore import Offer, hookimpl

    POROCORE_INTERFACES = {"sampler": 2, "surrogate": 1}

    @hookimpl
    def porocore_samplers(interface, something_new):
        raise AssertionError("a hook of another interface is not called")

    @hookimpl
    def porocore_surrogates():
        return [Offer("magic", dict, "")]
"""


@pytest.mark.parametrize(
    ("version", "advice"),
    [
        (
            2,
            "made for version 2 .* newer than this porocore, which takes version 1; upgrade porocore: pip .* porocore$",
        ),
        (0, "made for version 0 .* older than this porocore, .* upgrade it: pip install --upgrade acme-odd$"),
    ],
)
def test_a_plugin_for_another_interface_is_told_so_and_the_rest_works(install, version, advice):
    """Its kinds of this interface work too, and so do the other plugins."""
    source = NEWER.replace("2,", f"{version},").replace("interface, something_new", "")
    install("acme-odd", "acme_odd", source)
    install("acme-grid", "acme_grid", GOOD)
    found = Registry.discover()
    (row,) = [row for row in found.table() if row.state == "other interface"]
    assert (row.kind, row.name, row.distribution, row.interface) == (
        "sampler",
        "extra",
        "acme-odd 1.0",
        version,
    )
    assert re.match(advice, row.advice)
    assert "magic" in found.names("surrogate")
    assert found.get("sampler", "grid").__name__ == "Grid"
    with pytest.raises(PluginError, match=r"the plugin of acme-odd 1\.0 was made for version"):
        found.find("sampler", "griddy")


def test_hooks_of_a_newer_interface_that_cannot_be_registered_are_no_fault_of_the_plugin(install):
    install("acme-new", "acme_new", NEWER)
    assert "made for version 2 of the sampler interface" in broken_reason(Registry.discover(), "acme-new")


def test_of_a_plugin_for_another_interface_only_those_are_told_who_ask_for_its_kind(install):
    install("acme-odd", "acme_odd", NEWER.replace("interface, something_new", ""))
    found = Registry.discover()
    with pytest.raises(PluginError, match=r"acme-odd 1\.0 was made for version 2 of the sampler interface"):
        found.find("sampler", "griddy")
    with pytest.raises(PluginError) as error:
        found.find("macro solver", "griddy")
    assert "acme-odd" not in str(error.value)


def test_a_hook_that_need_not_be_there_is_allowed(install):
    """As pluggy has it, for plugins that also serve a later porocore."""
    source = (
        GOOD
        + """
    @hookimpl(optionalhook=True)
    def porocore_meshers():
        return []
"""
    )
    install("acme-grid", "acme_grid", source)
    assert Registry.discover().get("sampler", "grid").__name__ == "Grid"


def test_versions_of_interfaces_that_mean_nothing_are_named(install):
    install("acme-odd", "acme_odd", "POROCORE_INTERFACES = {'smapler': 1}")
    assert "expected a number for some of 'cell solver'" in broken_reason(Registry.discover(), "acme-odd")


def test_older_versions_work_as_long_as_they_are_taken(monkeypatch, install):
    monkeypatch.setitem(KINDS, "sampler", replace(KINDS["sampler"], versions=Versions(present=3, oldest=1)))
    install("acme-grid", "acme_grid", GOOD)
    assert Registry.discover().get("sampler", "grid").__name__ == "Grid"
    assert "takes versions 1 to 3" in KINDS["sampler"].versions.complaint("sampler", 4, "acme-grid")


def test_a_hook_gets_those_arguments_that_it_names(install):
    """So that hooks can gain arguments: plugins that do not name them go on working."""
    source = GOOD.replace("def porocore_samplers()", "def porocore_samplers(interface)")
    install("acme-grid", "acme_grid", source.replace('summary="a grid"', 'summary=f"interface {interface}"'))
    install("other-grid", "other_grid", GOOD.replace('"grid"', '"plain"'))
    found = Registry.discover()
    assert {"grid", "plain"} <= set(found.names("sampler"))
    (row,) = [row for row in found.table() if row.name == "grid"]
    assert row.summary == "interface 1"


def test_requirements_come_from_the_metadata(install, tmp_path):
    install("acme-grid", "acme_grid", GOOD)
    needs = "Requires-Dist: porocore\nRequires-Dist: scipy>=1.11\nRequires-Dist: pytest; extra == 'dev'\n"
    metadata_file = tmp_path / "acme_grid-1.0.dist-info" / "METADATA"
    metadata_file.write_text(metadata_file.read_text() + needs)
    (row,) = [row for row in Registry.discover().table() if row.name == "grid"]
    assert row.source.requirements == ("porocore", "scipy>=1.11")
