"""The configuration page and the models: every key and option with its default and unit."""

import inspect
import json
import re
import types
from importlib.util import find_spec
from typing import Annotated, Union, get_args, get_origin

import pytest
import yaml
from pages import page, rows
from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from porocore.config import RunConfig
from porocore.courses import Course
from porocore.dimensions import Dimension
from porocore.registry import registry
from porocore.sampling.density import DensitySweep
from porocore.surrogates.options import MlpOptions, PotentialOptions
from porocore.surrogates.polynomial_surrogate import PolynomialSurrogate

#: What stands for the keys of a mapping in a dotted key.
ANY_KEY = {
    "materials": "REGION",
    "inputs": "NAME",
    "boundary": "SURFACE",
    "surfaces": "PART",
    "scenarios": "NAME",
}
#: Of the dimension that is declared beside a key, as the table shows it.
UNITS = {
    "displacement": "length",
    "time": "time",
    "stress": "E",
    "pressure": "E",
    "force": "E × area",
    "body-force": "E / length",
    "velocity": "velocity",
    "viscosity": "μ_c",
}
SI = {"force": "N", "stress": "Pa", "displacement": "m", "viscosity": "Pa s"}


def section_of(annotation):
    """(model, whether it is the value of a mapping) of a key that has keys below it, else (None, False)."""
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Annotated or origin in (Union, types.UnionType):
        for argument in arguments:
            if section_of(argument)[0]:
                return section_of(argument)
    if origin is dict:
        return section_of(arguments[1])[0], True
    if annotation is Course:  # the page has one table for all values
        return None, False
    is_section = isinstance(annotation, type) and issubclass(annotation, BaseModel)
    return (annotation if is_section else None), False


def keys_of(model, above=""):
    """Dotted key → default, for all that a configuration may hold; PydanticUndefined where it must be given."""
    for name, field in model.model_fields.items():
        below, mapped = section_of(field.annotation)
        key = f"{above}{name}"
        if below is None or mapped:
            yield key, field.default
        if below is not None:
            yield from keys_of(below, f"{key}.{ANY_KEY[name]}." if mapped else f"{key}.")


def dimensions_of(model, above=""):
    """Dotted key → the dimensions that are declared for its numbers."""
    for name, field in model.model_fields.items():
        below, mapped = section_of(field.annotation)
        key = f"{above}{name}"
        if found := list(declared(field.annotation, field.metadata)):
            yield key, found
        if below is not None:
            yield from dimensions_of(below, f"{key}.{ANY_KEY[name]}." if mapped else f"{key}.")


def declared(annotation, metadata=()):
    yield from (extra for extra in metadata if isinstance(extra, Dimension))
    if get_origin(annotation) is Annotated:
        yield from declared(get_args(annotation)[0], get_args(annotation)[1:])
    elif annotation is not Course:
        for argument in get_args(annotation):
            yield from declared(argument)


def shown(default):
    """A default as the table shows it."""
    if default is PydanticUndefined:
        return "required"
    plain = json.loads(json.dumps(default))  # lists for tuples, and none of them twice the same
    text = yaml.safe_dump(plain, default_flow_style=True, width=1000).strip().removesuffix("...").strip()
    return f"`{text}`"


def test_every_key_stands_in_the_configuration_page_with_its_default():
    documented = {}
    for cells in rows(page("docs/configuration.md")):
        key = cells[0].strip("`")
        if len(cells) == 5 and (re.fullmatch(r"\w+(\.\w+)+", key) or key in RunConfig.model_fields):
            assert key not in documented, f"{key} is documented twice"
            documented[key] = cells[2]
    expected = {key: shown(default) for key, default in keys_of(RunConfig)}
    assert len(expected) > 30
    assert documented == expected


def test_the_unit_of_a_key_is_that_of_its_dimension():
    units = {
        cells[0].strip("`"): cells[3]
        for cells in rows(page("docs/configuration.md"))
        if len(cells) == 5 and "." in cells[0]
    }
    found = dict(dimensions_of(RunConfig))
    assert {"macro.body.size", "macro.time.end", "macro.boundary.SURFACE.plate", "cell.viscosity"} <= set(
        found
    )
    for key, dimensions in found.items():
        if key in units:
            first = dimensions[0]
            assert units[key].split(",")[0] == (SI if first.si else UNITS)[first.quantity], key
    given = {key for key, unit in units.items() if unit.split(",")[0] in UNITS.values()}
    assert given <= set(found), "a unit without a dimension"


def options_below(heading):
    """Option → default of the first table below a line of the configuration page."""
    text = page("docs/configuration.md").split(heading)[1]
    table = re.search(r"(\| .*?\n)\n", text + "\n", flags=re.DOTALL)[1]
    return {cells[0].strip("`"): cells[2] for cells in rows(table) if cells[0].startswith("`")}


def test_the_options_of_the_cell_solver():
    solver = pytest.importorskip("porocore_fem_skfem.cell_solver").SkfemCellSolver
    parameters = inspect.signature(solver).parameters.values()
    expected = {p.name: shown(p.default) for p in parameters if p.kind is not p.VAR_KEYWORD}
    assert options_below("Options of `skfem`") == expected


def test_the_options_of_the_cell_solver_of_dolfinx():
    pytest.importorskip("porocore_fem_dolfinx.hooks")
    if find_spec("dolfinx") is None:
        pytest.skip("dolfinx is not installed")
    from porocore_fem_dolfinx.cell_solver import DolfinxCellSolver

    parameters = inspect.signature(DolfinxCellSolver).parameters.values()
    expected = {p.name: shown(p.default) for p in parameters if p.kind is not p.VAR_KEYWORD}
    assert options_below("Options of the cell solver of `dolfinx`") == expected


@pytest.mark.parametrize(("model", "options"), [("mlp", MlpOptions), ("potential", PotentialOptions)])
def test_the_options_of_the_networks(model, options):
    expected = {name: shown(field.default) for name, field in options.model_fields.items()}
    assert options_below(f"ptions of `torch` and `jax` for `model: {model}`") == expected


def test_the_option_of_the_polynomial():
    parameters = inspect.signature(PolynomialSurrogate).parameters.values()
    expected = {
        p.name: shown(p.default) for p in parameters if p.kind is not p.VAR_KEYWORD and p.name != "model"
    }
    assert options_below("Option of `polynomial`") == expected


def test_the_options_of_the_density_sweep():
    parameters = inspect.signature(DensitySweep).parameters.values()
    found = {
        p.name: shown(p.default)
        for p in parameters
        if p.kind is not p.VAR_KEYWORD and p.default is not p.empty
    }
    assert found.pop("step") == "`null`"
    assert found.pop("tolerance") == "`0.05`"
    assert "(0.05 for `density-sweep`)" in page("docs/configuration.md")
    assert options_below("option of `density-sweep` beside") == found


@pytest.mark.parametrize(
    ("heading", "name"),
    [
        ("Options of `sobol` and", "sobol"),
        ("Options of `sobol` and", "latin-hypercube"),
        ("Options of `active`; with", "active"),
        ("Options of `macro-driven`; `sampling.tolerance`", "macro-driven"),
    ],
)
def test_the_options_of_the_other_samplers(heading, name):
    parameters = inspect.signature(registry().get("sampler", name)).parameters.values()
    found = {
        p.name: shown(p.default)
        for p in parameters
        if p.kind is not p.VAR_KEYWORD and p.default is not p.empty
    }
    tolerance = found.pop("tolerance", None)
    assert tolerance in (None, "`null`") or f"{tolerance.strip('`')} by default" in page(
        "docs/configuration.md"
    )
    assert options_below(heading) == found
