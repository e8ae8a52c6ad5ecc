"""Tables of configuration.md, cell.md and calibration.md, made from the models, classes and fields that they describe.

.venv/bin/python docs/make_configuration.py [--check]

A table stands between two HTML comments, and the first one says which table it is:

    <!-- keys cell fem -->                     the keys of these sections, and of all below them
    <!-- kinds cell.geometry -->               the kinds of a section
    <!-- keys-by-kind cell.geometry -->        the keys of the kinds but the default one
    <!-- fields porocore.core.formulas.TimeFunction -->    the keys of one model
    <!-- parameters PATH CLASS -->             the options of a class, by its docstring
    <!-- responses cell -->                    the fields of a response that cell solvers provide
    <!-- end -->

Everything else is written by hand and stays as it is. With --check nothing is written; the exit status is 1 where the
page is not what this makes.
"""

from __future__ import annotations

import importlib
import re
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path

from configuration_tables.models import Key, all_keys, keys_by_kind, keys_of, kinds_at
from configuration_tables.parameters import options_of

from porocore.core.files.atomic import atomic_path
from porocore.states import CELL_FIELDS
from porocore.study.config.schema import field_docstrings

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "configuration.md"
PAGES = (PAGE, ROOT / "docs" / "cell.md", ROOT / "docs" / "calibration.md")
TABLE = re.compile(
    r"^<!-- (?P<table>keys|kinds|keys-by-kind|fields|parameters|responses) (?P<of>[^\n]+) -->\n.*?^<!-- end -->$",
    flags=re.MULTILINE | re.DOTALL,
)
#: Pages that say more of a key.
SEE = {
    "cell.geometry.kind": "cell.md#geometries",
    "cell.material.kind": "materials.md",
    "cell.materials": "materials.md#several-materials",
    "cell.mesh.element": "cell.md#meshes-and-elements",
    "cell.contact.kind": "contact.md",
    "cell.supercell": "cell.md#supercells",
    "sampling.sampler": "sampling.md",
    "sampling.executor": "cluster.md",
    "surrogate.model": "surrogates.md",
    "closure": "theory.md#closures",
    "conductivity": "conductivity.md",
    "macro.body.kind": "bodies.md",
    "macro.contact.INDENTER.shape.kind": "bodies.md#indenters",
}


def with_tables(text: str) -> str:
    """The page with every table made anew."""
    makers: dict[str, Callable[..., str]] = {
        "keys": _keys,
        "kinds": _kinds,
        "keys-by-kind": _keys_by_kind,
        "fields": _fields,
        "parameters": _parameters,
        "responses": _responses,
    }

    def made(found: re.Match[str]) -> str:
        table = makers[found["table"]](*found["of"].split())
        return f"<!-- {found['table']} {found['of']} -->\n\n{table}\n<!-- end -->"

    return TABLE.sub(made, text)


def _keys(*sections: str) -> str:
    keys = [key for key in all_keys() if any(re.match(rf"{section}(\.|$)", key.name) for section in sections)]
    return _table("key", keys)


def _fields(name: str) -> str:
    module, _, cls = name.rpartition(".")
    keys = keys_of(getattr(importlib.import_module(module), cls), carried="of the value")
    return _table("key", keys)


def _parameters(path: str, cls: str) -> str:
    return _table("option", options_of(ROOT / path, cls))


def _responses(_: str) -> str:
    rows = [
        [
            f"`{name}`",
            field.heading,
            _cell(field.unit),
            _cell(field.meaning.removesuffix(".").replace("``", "`")),
        ]
        for name, field in CELL_FIELDS.items()
    ]
    return _lines([["field", "shape", "unit", "meaning"], *rows])


def _kinds(section: str) -> str:
    lines = (
        ["kind", "what it is"],
        *(
            [f"`{kind}`", _cell(field_docstrings(model)["kind"].removesuffix("."))]
            for kind, model in kinds_at(section).items()
        ),
    )
    return _lines(lines)


def _keys_by_kind(section: str) -> str:
    found = keys_by_kind(section)
    units = any(key.unit for _, key in found)
    head = ["kind", "key", "type", "default", *(["unit"] if units else []), "meaning"]
    lines = [head]
    above: list[str] = []
    for kinds, key in found:
        named = ", ".join(f"`{kind}`" for kind in kinds) if kinds != above else ""
        lines.append([named, *_row(key, units)])
        above = kinds
    return _lines(lines)


def _table(first: str, keys: Iterable[Key]) -> str:
    keys = [_with_link(key) for key in keys]
    units = any(key.unit for key in keys)
    head = [first, "type", "default", *(["unit"] if units else []), "meaning"]
    return _lines([head, *(_row(key, units) for key in keys)])


def _with_link(key: Key) -> Key:
    if key.name not in SEE:
        return key
    page = SEE[key.name]
    return replace(key, meaning=f"{key.meaning}; see [{page.partition('#')[0]}]({page})")


def _row(key: Key, units: bool) -> list[str]:
    return [
        f"`{key.name}`",
        _cell(key.type),
        key.default,
        *([key.unit or "–"] if units else []),
        _cell(key.meaning),
    ]


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def _lines(rows: Iterable[list[str]]) -> str:
    def lines() -> Iterator[str]:
        for i, row in enumerate(rows):
            yield f"| {' | '.join(row)} |"
            if i == 0:
                yield f"|{'---|' * len(row)}"

    return "".join(f"{line}\n" for line in lines()).replace("|  |", "| |")


def main() -> None:
    """Write the pages, or tell whether they are up to date."""
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        made = with_tables(text)
        if sys.argv[1:] == ["--check"]:
            if made != text:
                sys.exit(f"{page} is out of date; run python docs/make_configuration.py")
            continue
        with atomic_path(page) as part:
            part.write_text(made, encoding="utf-8")


if __name__ == "__main__":
    main()
