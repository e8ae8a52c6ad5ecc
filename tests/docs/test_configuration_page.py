"""The configuration page: its tables are those of docs/make_configuration.py, and these say what the code does."""

import inspect
import re
from importlib.util import find_spec
from typing import Annotated

import make_configuration
import pytest
import yaml
from configuration_tables.models import all_keys, keys_by_kind, keys_of
from configuration_tables.parameters import options_of
from configuration_tables.words import default_words, type_words
from pydantic import BaseModel, Field
from pydantic.fields import FieldInfo

from porocore.core.units import Dimension, Unit
from porocore.plugins.registry import registry
from porocore.study.config.schema import configuration_schema
from porocore.surrogates.network.options import MlpOptions, PotentialOptions
from tests.docs.pages import page, rows
from tests.helpers.nested_settings import config_from

PAGE = "docs/configuration.md"


def tables():
    """Of the page: what a table is of → its rows, heading first."""
    found = re.findall(
        r"^<!-- ([a-z-]+ [^\n]+) -->\n\n(.*?)\n<!-- end -->", page(PAGE), re.MULTILINE | re.DOTALL
    )
    return {of: list(rows(table)) for of, table in found}


@pytest.mark.parametrize("path", make_configuration.PAGES, ids=lambda path: path.name)
def test_a_page_is_what_the_generator_makes(path):
    text = path.read_text(encoding="utf-8")
    assert make_configuration.with_tables(text) == text, "run .venv/bin/python docs/make_configuration.py"


def test_a_table_that_was_changed_by_hand_is_made_anew():
    text = page(PAGE)
    assert text.count("Size of the solid's tetrahedra") == 1
    changed = text.replace("Size of the solid's tetrahedra", "Size of the elephants")
    assert make_configuration.with_tables(changed) == text
    beside = text.replace("Nothing is started before", "Nothing is begun before")
    assert make_configuration.with_tables(beside) == beside != text


def test_every_key_stands_on_the_page_once():
    shown = [
        cells[0].strip("`") for of, table in tables().items() if of.startswith("keys ") for cells in table[1:]
    ]
    assert sorted(shown) == sorted(key.name for key in all_keys())
    assert len(set(shown)) == len(shown) > 70


def test_no_property_of_the_schema_is_left_out():
    """The schema knows the models by pydantic alone: sections, kinds, entries of lists and mappings."""
    shown = {
        cells[of.startswith("keys-by-kind ")].strip("`").split(".")[-1]
        for of, table in tables().items()
        for cells in table[1:]
    }
    sections = {"cell", "fem", "sampling", "surrogate", "macro", "scales", "output_units"}
    sections |= {
        "geometry",
        "shape",
        "material",
        "mesh",
        "contact",
        "test",
        "body",
        "initial",
        "time",
        "newton",
    }
    sections |= {
        "calibration",
        "fit",
        "posterior",
        "prior",
        "field",
        "times",
        "camera",
        "relaxation",
        "charges",
    }
    for section in [configuration_schema(), *configuration_schema()["$defs"].values()]:
        assert set(section.get("properties", {})) - sections <= shown, section.get("title")


def test_the_defaults_are_those_of_a_configuration_that_gives_nothing_else():
    given = {
        "sampling": {"inputs": {"p": {"range": [0, 1], "step": 0.1}}},
        "macro": {
            "boundary": {"y-": {}},
            "surfaces": {"part": {"of": "y+", "x": [0, 1]}},
            "fields": {"radius": {"formula": "0.2"}},
            "contact": {
                "ball": {
                    "shape": {"radius": 1},
                    "place": [0, 9, 0],
                    "displacement": 1,
                    "surfaces": ["y+"],
                }
            },
            "regions": {"top": {"above": 1}},
            "charges": {"density": 1, "bath": 1},
            "loads": [1],
        },
        "cell": {"viscosity": 0.001},
        "scales": {"modulus": 1, "length": 1, "pore": 1},
        "output_units": {},
    }
    settings = yaml.safe_load(config_from(given).resolved_yaml())
    names = {
        "INDENTER": "ball",
        "NAME": "p",
        "SURFACE": "y-",
        "PART": "part",
        "PARAMETER": "radius",
        "REGION": "top",
    }
    compared = 0
    for of, table in tables().items():
        for key, _, default, *_ in table[1:] if of.startswith("keys ") and of != "keys calibration" else ():
            value = settings
            for part in key.strip("`").split("."):
                value = value.get(names.get(part, part)) if isinstance(value, dict) else None
            wanted = yaml.safe_load(default.strip("`"))
            if default == "required" or value != wanted:
                last = key.strip("`").split(".")[-1]
                assert default == "required" or last in (
                    "modulus",
                    "x",
                    "step",
                    "surfaces",
                    "swelling",
                    "fields",
                    "regions",
                    "above",
                    "contact",
                    "displacement",
                    "constants",
                ), key
            else:
                compared += 1
    assert compared > 60


def test_every_line_has_a_type_a_default_and_a_meaning():
    for of, table in tables().items():
        for cells in table[1:]:
            assert len(cells) == len(table[0]), (of, cells)
            said = cells[1:] if of.split()[0] == "keys-by-kind" else cells
            assert all(said), (of, cells)


# ---- in words ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("annotation", "constraint", "words"),
    [
        (float, Field(gt=0), "number > 0"),
        (float, Field(gt=-1, lt=0.5), "number, −1 < key < 0.5"),
        (float, Field(ge=0, le=1 / 3), "number, 0 to 1/3"),
        (float, Field(lt=2), "number < 2"),
        (int, Field(ge=1, le=8), "whole number, 1 to 8"),
        (int | None, Field(ge=1), "whole number ≥ 1"),
        (bool, Field(), "true, false"),
        (str, Field(pattern="^(x|y|xy)$"), "`x`, `y`, `xy`"),
        (str, Field(json_schema_extra={"enum": ["one", "two"]}), "`one`, `two`"),
        (tuple[float, float], Field(), "two numbers"),
        (tuple[int | str, ...], Field(min_length=1), "list of whole numbers or texts, not empty"),
        (tuple[tuple[float, float, float], ...], Field(max_length=4), "list of at most 4 triples of numbers"),
        (tuple[tuple[float, float], tuple[float, float]], Field(), "2 × 2 numbers"),
        (tuple[tuple[float, str], ...], Field(), "list of [number, text]"),
        (dict[str, float], Field(), "mapping of names to numbers"),
    ],
)
def test_types_in_words(annotation, constraint, words):
    field = FieldInfo.from_annotated_attribute(annotation, constraint)
    assert type_words(field, "key") == words


def test_defaults_in_words():
    assert default_words(None) == "`null`"
    assert default_words(1e-6) == "`1.0e-06`"
    assert default_words(((1.0, None), "x")) == "`[[1.0, null], x]`"


def test_a_length_is_told_from_a_number():
    keys = {key.name: key.unit for key in all_keys()}
    assert keys["macro.body.size"] == "length"
    assert keys["macro.time.load_curve"] == "time, –"
    assert keys["macro.boundary.SURFACE.plate"] == "E × area"
    assert keys["scales.viscosity"] == "Pa s"
    assert keys["cell.mesh.size"] == "cell"
    assert keys["sampling.inputs.NAME.range"] == "p: E, else –"
    assert keys["macro.time.tolerance"] == ""


class Inner(BaseModel):
    a: int
    """First. Of two."""


class Other(BaseModel):
    b: float
    """Third."""


class Outer(BaseModel):
    inner: Inner
    """Not shown."""
    many: tuple[Other, ...] = ()
    """``code`` and
    more."""


def test_sections_and_lists_of_sections_are_walked_through():
    found = [(key.name, key.type, key.default, key.meaning) for key in keys_of(Outer)]
    assert found == [
        ("inner.a", "whole number", "required", "First. Of two"),
        ("many", "list of `{b}`", "`[]`", "`code` and more"),
        ("many[].b", "number", "required", "Third"),
    ]


def test_keys_that_kinds_share_are_listed_once():
    shared = [kinds for kinds, key in keys_by_kind("macro.body") if key.name == "radius"]
    assert shared == [["cylinder", "quarter-cylinder", "wedge", "axisymmetric"]]


# ---- options -------------------------------------------------------------------------------------


def with_defaults(make):
    parameters = inspect.signature(make).parameters.values()
    return {p.name: default_words(p.default) for p in parameters if p.default is not p.empty}


def options_in(table):
    return {cells[0].strip("`"): cells[2] for cells in tables()[table][1:]}


def test_the_options_of_the_cell_solver():
    solver = pytest.importorskip("porocore_fem_skfem.cell_solver").SkfemCellSolver
    path = "plugins/fem_skfem/porocore_fem_skfem/cell_solver.py"
    assert options_in(f"parameters {path} SkfemCellSolver") == with_defaults(solver)


def test_the_options_of_the_solvers_of_dolfinx():
    pytest.importorskip("porocore_fem_dolfinx.hooks")
    if find_spec("dolfinx") is None:
        pytest.skip("dolfinx is not installed")
    from porocore_fem_dolfinx.cell_solver import DolfinxCellSolver
    from porocore_fem_dolfinx.macro import DolfinxMacroSolver

    folder = "plugins/fem_dolfinx/porocore_fem_dolfinx"
    assert options_in(f"parameters {folder}/cell_solver.py DolfinxCellSolver") == with_defaults(
        DolfinxCellSolver
    )
    assert options_in(f"parameters {folder}/macro.py DolfinxMacroSolver") == with_defaults(DolfinxMacroSolver)


@pytest.mark.parametrize("options", [MlpOptions, PotentialOptions])
def test_the_options_of_the_networks(options):
    expected = {name: default_words(field.default) for name, field in options.model_fields.items()}
    assert options_in(f"fields porocore.surrogates.network.options.{options.__name__}") == expected


@pytest.mark.parametrize(
    ("table", "kind", "name", "elsewhere"),
    [
        (
            "porocore/surrogates/polynomial/surrogate.py PolynomialSurrogate",
            "surrogate",
            "polynomial",
            {"model"},
        ),
        (
            "porocore/sampling/samplers/density.py DensitySweep",
            "sampler",
            "density-sweep",
            {"step", "tolerance"},
        ),
        ("porocore/sampling/samplers/designs.py Design", "sampler", "sobol", set()),
        ("porocore/sampling/samplers/designs.py Design", "sampler", "latin-hypercube", set()),
        ("porocore/sampling/samplers/active.py Active", "sampler", "active", {"tolerance"}),
        ("porocore/sampling/samplers/macro_driven.py MacroDriven", "sampler", "macro-driven", {"tolerance"}),
    ],
)
def test_the_options_of_what_is_built_in(table, kind, name, elsewhere):
    expected = with_defaults(registry().get(kind, name))
    assert elsewhere <= set(expected)
    for option in elsewhere:
        default = expected.pop(option).strip("`")
        assert default == "null" or f"{default} by default" in page(PAGE)
    assert options_in(f"parameters {table}") == expected


def test_an_option_without_a_paragraph_is_refused(tmp_path):
    path = tmp_path / "sampler.py"
    source = '''
class Mine:
    """Mine.

    Parameters
    ----------
    count : {type}
        Number of ``things``
        to do.

    Raises
    ------
    ValueError
        Never.
    """

    def __init__(self, inputs, count=3, {more}**unknown):
        pass
'''
    path.write_text(source.format(type="int, above 2, at most 9", more=""), encoding="utf-8")
    (option,) = options_of(path, "Mine")
    assert (option.name, option.type, option.default) == ("count", "whole number, 2 < count ≤ 9", "`3`")
    assert option.meaning == "Number of `things` to do"
    path.write_text(source.format(type="int, positive", more=""), encoding="utf-8")
    with pytest.raises(ValueError, match="for 'count', got 'int, positive'"):
        options_of(path, "Mine")
    path.write_text(source.format(type="int", more="seed=0, "), encoding="utf-8")
    with pytest.raises(ValueError, match="Mine has no paragraph on 'seed'"):
        options_of(path, "Mine")


# ---- declarations --------------------------------------------------------------------------------


def test_declarations_say_nothing_to_pydantic():
    """A dimension or a unit beside a key changes neither what is read nor what is hashed."""

    class Plain(BaseModel):
        a: float = 1.0

    class Declared(BaseModel):
        a: Annotated[float, Unit("cell"), Dimension("time")] = 1.0
        """Described."""

    assert Plain(a=2).model_dump_json() == Declared(a=2).model_dump_json()
