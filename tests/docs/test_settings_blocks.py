"""Every YAML and TOML block: configurations and their fragments are valid, and other files are what they say."""

from __future__ import annotations

import importlib
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml

from porocore.plugins.registry import registry
from porocore.study.config.config import RunConfig
from porocore.study.config.loading import MODELINE, SURFACES, load_config
from porocore.study.notes.checks import place as place_body
from porocore.study.notes.outline import outline
from tests.docs.fragments import example, role, with_fragment
from tests.docs.given import provide
from tests.docs.pages import ROOT, all_blocks
from tests.helpers.nested_settings import config_from

BLOCKS = list(all_blocks("yaml", "yml"))


def parts() -> dict[str, dict[str, Any]]:
    """Parts of configurations by where they stand; one that continues another contains it."""
    found: dict[str, dict[str, Any]] = {}
    last: dict[str, Any] = {}
    for block in BLOCKS:
        data = yaml.safe_load(block.text)
        if isinstance(data, dict) and set(data) <= {*RunConfig.model_fields, "calibration"}:
            if role(block)[0] == "continues":
                data = with_fragment(last, data)
            found[str(block)] = last = data
    return found


PARTS = parts()


def study_with(part: dict[str, Any]) -> dict[str, Any]:
    if {"sampling", "macro"} <= set(part):
        return part
    study = with_fragment(example(), part)
    if set(part) <= {"cell", "scales", "output_units"}:  # a cell alone needs no length of a body
        study.get("scales", {}).setdefault("length", 1.0)
    named = set(study["macro"].get("surfaces", {})) | {"x-", "x+", "y-", "y+", "z-", "z+"}
    kind = part.get("macro", {}).get("body", {}).get("kind", "box")
    if kind != "box" and (own := SURFACES.get(kind)):  # the example's body is a box
        faces = study["macro"]["boundary"]
        study["macro"]["boundary"] = {name: faces[name] for name in own if name in faces}
        named = set(own)
    if not set(study["macro"]["boundary"]) <= named:
        pytest.fail("a fragment prescribes something on a surface that neither it nor the example has")
    return study


def nothing() -> Path:
    pytest.fail("a fragment needs no finished run")


@pytest.mark.parametrize("place", PARTS)
def test_a_configuration_that_is_shown_is_valid(place, tmp_path):
    """Keys and values; and cell, which is coarser here, and body can be meshed, and everything finds its place."""
    study = study_with(PARTS[place])
    provide(str(study), tmp_path, None, nothing)
    assert config_from(study, tmp_path)
    study["cell"]["mesh"] = {"size": 0.5, "fluid_size": 0.5, "element": "linear"}
    config = config_from(study, tmp_path)
    if config.cell.geometry.porosity == 0:  # for one cell; a study of it is refused
        place_body(config)
        config.cell.make_mesh("solid", "whole")
        return
    assert any(line.startswith("cell:") for line in outline(config))


def class_of(kind: str, name: str, patch: pytest.MonkeyPatch) -> type:
    """Of what is installed, or of an example plugin."""
    project = ROOT / "examples" / "plugins" / f"porocore-{kind}-{name}"
    if name in registry().names(kind) or not project.exists():
        return registry().get(kind, name)
    patch.syspath_prepend(project)
    package = project.name.replace("-", "_")
    hooks = importlib.import_module(f"{package}.hooks")
    found = next(offer.load() for offer in getattr(hooks, f"porocore_{kind}s")() if offer.name == name)
    # A page may write and install a package of this name.
    for module in [module for module in sys.modules if module.split(".")[0] == package]:
        del sys.modules[module]
    return found


@pytest.mark.parametrize("place", [place for place, part in PARTS.items() if "surrogate" in part])
def test_options_of_a_surrogate_that_are_shown_are_taken(place, tmp_path, monkeypatch):
    settings = config_from(study_with(PARTS[place]), tmp_path)
    surrogate = class_of("surrogate", settings.surrogate.backend, monkeypatch)
    model = {"model": settings.model_of(surrogate)} if surrogate.models else {}
    surrogate(**settings.surrogate.options, **model)


@pytest.mark.parametrize("place", [place for place, part in PARTS.items() if "sampling" in part])
def test_options_of_a_sampler_that_are_shown_are_taken(place, tmp_path, monkeypatch):
    sampling = config_from(study_with(PARTS[place]), tmp_path).sampling
    sampler = class_of("sampler", sampling.sampler, monkeypatch)
    sampler(sampling.input_space(), **sampling.sampler_options())


def test_what_is_no_configuration_is_known():
    """A line for editors, and a file of dask with keys that dask has."""
    others = [block for block in BLOCKS if str(block) not in PARTS and role(block)[0] != "file"]
    lines = [block.text.strip() for block in others if yaml.safe_load(block.text) is None]
    assert set(lines) <= {MODELINE}
    files = [yaml.safe_load(block.text) for block in others if block.text.strip() not in lines]
    distributed = pytest.importorskip("distributed")
    known = yaml.safe_load(
        (Path(distributed.__file__).parent / "distributed.yaml").read_text(encoding="utf-8")
    )
    for data in files:
        assert set(data) == {"distributed"}
        for section, settings in data["distributed"].items():
            for key, values in settings.items():
                there = known["distributed"][section][key]
                assert set(values) & set(there), f"{key} has nothing of dask's own"


@pytest.mark.parametrize("block", [*all_blocks("toml")], ids=str)
def test_toml_can_be_read(block):
    assert tomllib.loads(block.text)["project"]["entry-points"]["porocore"]


def test_the_examples_are_valid():
    paths = [*ROOT.glob("examples/*.yaml"), *ROOT.glob("benchmarks/*.yaml")]
    assert len([load_config(path) for path in paths]) > 7
