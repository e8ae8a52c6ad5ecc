"""Every kind of bad offer is one line that names the plugin and its file, and everything else goes on."""

import json
import sys
from contextlib import redirect_stdout
from importlib import metadata

import pytest

import porocore
from porocore.errors import PluginError
from porocore.plugins import registry
from porocore.plugins import table as plugin_table
from porocore.plugins.hookspecs import Offer
from tests.helpers.bad_offers import LAZY, NOTED, SOURCES, good
from tests.helpers.invoked import invoke

#: Rows that there are for a plugin; all else is one.
ROWS = {"twice": 2}


class Shop:
    """A folder on ``sys.path`` with distributions as an installer leaves them."""

    def __init__(self, folder):
        self.folder = folder

    def add(self, name, source, entry_point=None, value=None):
        module = f"bad_{name.replace('-', '_')}"
        info = self.folder / f"bad_{module}-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: bad-{name}\nVersion: 1.0\n", "utf-8")
        (info / "entry_points.txt").write_text(
            f"[porocore]\n{entry_point or name} = {value or module}\n", "utf-8"
        )
        if source is not None:
            (self.folder / f"{module}.py").write_text(source, "utf-8")

    def file(self, name):
        return str(self.folder / f"bad_{name.replace('-', '_')}.py")


@pytest.fixture(scope="module")
def shop(tmp_path_factory):
    """All bad plugins, and one good one, in one place."""
    shop = Shop(tmp_path_factory.mktemp("site"))
    for name, (source, *_) in (SOURCES | LAZY | NOTED).items():
        shop.add(name, source)
    shop.add("good", good("fine-grid"))
    shop.add("missing-module", None)
    shop.add("missing-attribute", good("missing-attribute"), value="bad_missing_attribute:hooks")
    shop.add("invalid-value", None, value="no module!")
    patch = pytest.MonkeyPatch()
    patch.syspath_prepend(str(shop.folder))
    patch.setattr(plugin_table, "SLOW", 0.25)
    _ = porocore.Sampler  # whose import would be counted for the plugin that asks for it first
    # Without the backends, whose classes take seconds to import.
    real, base = metadata.distributions, str(tmp_path_factory.getbasetemp())

    def here():
        return [*real(path=[p for p in sys.path if p.startswith(base)]), metadata.distribution("porocore")]

    patch.setattr("porocore.plugins.discovery.metadata.distributions", here)
    registry.registry.cache_clear()
    yield shop
    patch.undo()
    registry.registry.cache_clear()
    for module in [name for name in sys.modules if name.startswith("bad_") and name != "bad_offers"]:
        del sys.modules[module]


@pytest.fixture(scope="module")
def listed(shop):
    """Rows of ``porocore plugins --json`` by distribution, without and with ``--load``."""
    found = []
    for words in ((), ("--load",)):
        done = invoke("plugins", "--json", *words)
        assert done.exit_code == 0, done.output
        rows = {}
        for row in json.loads(done.stdout):
            rows.setdefault(row["distribution"].removeprefix("bad-"), []).append(row)
        found.append(rows)
    return found


@pytest.mark.parametrize("name", SOURCES)
def test_a_bad_offer_is_a_line_with_the_file(shop, listed, name):
    rows = listed[0][name]
    assert len(rows) == ROWS.get(name, 1)
    for row in rows:
        assert row["state"] == ("offered twice" if name == "twice" else "broken")
        assert SOURCES[name][1] in " ".join(row["advice"].replace("\x1b", " ").split())
        assert shop.file(name) in row["advice"]
        assert row["file"] == shop.file(name)
        assert len(row["advice"]) < 800


@pytest.mark.parametrize("name", LAZY)
def test_a_class_that_cannot_be_used_is_a_line_where_it_is_loaded(shop, listed, name):
    (offered,), (loaded,) = listed[0][name], listed[1][name]
    assert (offered["state"], loaded["state"]) == ("ready", "broken")
    assert LAZY[name][1] in loaded["advice"]
    assert shop.file(name) in loaded["advice"]


@pytest.mark.parametrize("name", NOTED)
def test_what_works_and_should_be_mended_is_said(shop, listed, name):
    _, words, only_loaded = NOTED[name]
    (offered,), (loaded,) = listed[0][name], listed[1][name]
    assert offered["works"] is loaded["works"] is True
    for found, expected in ((offered["notes"], words and not only_loaded), (loaded["notes"], words)):
        # On a busy machine any of them may take long to import.
        notes = [note for note in found if " took " not in note or words in note]
        assert len(notes) == bool(expected)
        if expected:
            assert words in notes[0]
            assert shop.file(name) in notes[0]


@pytest.mark.parametrize(
    ("name", "words"),
    [
        (
            "missing-module",
            "ModuleNotFoundError: No module named 'bad_missing_module' (entry point missing-module =",
        ),
        ("missing-attribute", "AttributeError: module 'bad_missing_attribute' has no attribute 'hooks'"),
        (
            "invalid-value",
            "entry point invalid-value: expected a module, or module:attribute, got 'no module!'",
        ),
    ],
)
def test_an_entry_point_to_nothing_is_a_line(shop, listed, name, words):
    (row,) = listed[0][name]
    assert row["state"] == "broken"
    assert words in row["advice"]
    assert str(shop.folder) in row["advice"]


def test_all_else_goes_on(listed):
    for rows in listed:
        assert [row["works"] for row in rows["good"]] == [True]
        assert {row["name"] for row in rows["porocore"] if row["works"]} >= {"sobol", "polynomial", "active"}
    assert registry.get("sampler", "fine-grid").__name__ == "Grid"


def test_the_time_of_every_import_is_told(listed):
    assert listed[0]["imports-long"][0]["seconds"] >= 0.3
    assert all(
        row["seconds"] < 0.25
        for rows in listed[0].values()
        for row in rows
        if row["distribution"] == "porocore"
    )


def test_the_table_has_a_line_for_each(shop):
    """With the letters of a terminal's commands taken out."""
    done = invoke("plugins")
    assert done.exit_code == 0
    lines = done.stdout.splitlines()
    assert "\x1b[2J" not in done.stdout
    for name in SOURCES:
        (place,) = [i for i, line in enumerate(lines) if f" bad-{name} 1.0" in line][
            : 1 if name == "twice" else None
        ]
        assert shop.file(name) in lines[place + 1]
    assert len([line for line in lines if "prints when it is imported" in line]) == 2


def test_a_class_that_prints_does_not_reach_standard_output(shop, capfd):
    shop.add("chatty", good("chatty").replace("lambda: Grid", "lambda: print('loading') or Grid"))
    found = registry.Registry.discover()
    capfd.readouterr()
    assert found.get("sampler", "chatty").__name__ == "Grid"
    out, err = capfd.readouterr()
    assert (out, err) == ("", "loading\n")


@pytest.mark.parametrize(
    ("text", "expected"),
    [("[porocore]\nno equals sign\n", 1), ("[porocore\nx = y\n", 0), ("[porocore]\n", 0)],
)
def test_damaged_metadata_stop_no_other(tmp_path, monkeypatch, text, expected):
    info = tmp_path / "odd-1.0.dist-info"
    info.mkdir()
    (info / "entry_points.txt").write_text(text, "utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    found = registry.Registry.discover()
    assert {"sobol", "active"} <= set(found.names("sampler"))
    faults = [fault.reason for fault in found.broken if str(tmp_path) in fault.reason]
    assert len(faults) == expected
    assert all("entry_points.txt cannot be read" in fault for fault in faults)


def test_one_entry_point_that_is_written_twice_is_one(tmp_path, monkeypatch):
    shop = Shop(tmp_path)
    shop.add("double", good("double"), value="bad_double\nagain = bad_double")
    monkeypatch.syspath_prepend(str(tmp_path))
    found = registry.Registry.discover()
    monkeypatch.delitem(sys.modules, "bad_double")
    assert [offered.offer.name for offered in found.offers].count("double") == 1
    assert not [fault for fault in found.broken if fault.source.distribution == "bad-double"]


def test_ctrl_c_at_an_import_goes_through(tmp_path, monkeypatch):
    Shop(tmp_path).add("interrupts", "raise KeyboardInterrupt\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(KeyboardInterrupt):
        registry.Registry.discover()


def test_who_makes_a_bad_offer_is_told_at_once():
    with pytest.raises(
        PluginError, match=r"Offer\.requires: expected a list or tuple of modules.*got 'numpy'"
    ):
        Offer("grid", dict, "", requires="numpy")
    assert Offer("my_grid-2", dict, "").faults() == []
    with redirect_stdout(None):
        assert Offer("grid", dict, "", ["numpy.linalg"]).faults() == []
