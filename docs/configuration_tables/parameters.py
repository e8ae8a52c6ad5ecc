"""The options of a class, from its signature and the section Parameters of its docstring.

The source is read, not run, so that no backend need be installed.
"""

from __future__ import annotations

import ast
import inspect
import re
from pathlib import Path

from configuration_tables.models import Key
from configuration_tables.words import bounded, codes, default_words

#: What stands at a key of its own in the configuration.
ELSEWHERE = ("inputs", "step", "tolerance", "model")
TYPE = re.compile(
    r"(?P<noun>int|float)(, (?P<least>[\d.]+) to (?P<most>[\d.]+))?"
    r"(, at least (?P<ge>[\d.]+))?(, above (?P<gt>[\d.]+))?(, at most (?P<le>[\d.]+))?(, below (?P<lt>[\d.]+))?"
)


def options_of(path: Path, name: str) -> list[Key]:
    """Of the class of that name.

    Raises
    ------
    ValueError
        An option has no paragraph, or a type that is not understood.
    """
    tree = ast.parse(path.read_text(encoding="utf-8"))
    (cls,) = [node for node in tree.body if isinstance(node, ast.ClassDef) and node.name == name]
    (made,) = [node for node in cls.body if isinstance(node, ast.FunctionDef) and node.name == "__init__"]
    paragraphs = _paragraphs(ast.get_docstring(cls) or "")
    found = []
    for option, default in _defaults(made.args).items():
        if option in ELSEWHERE:
            continue
        if option not in paragraphs:
            raise ValueError(f"{path}: {name} has no paragraph on '{option}' under Parameters; add one")
        kind, meaning = paragraphs[option]
        found.append(Key(option, _type_words(kind, option), default_words(default), "", meaning))
    return found


def _defaults(arguments: ast.arguments) -> dict[str, object]:
    """Argument → default, for those that have one."""
    usual = arguments.args[len(arguments.args) - len(arguments.defaults) :]
    pairs = [*zip(usual, arguments.defaults, strict=True)]
    pairs += [
        (a, d) for a, d in zip(arguments.kwonlyargs, arguments.kw_defaults, strict=True) if d is not None
    ]
    return {argument.arg: ast.literal_eval(default) for argument, default in pairs}


def _paragraphs(docstring: str) -> dict[str, tuple[str, str]]:
    """Name → (type, meaning) of the section Parameters."""
    section = re.search(r"^Parameters\n-+\n(.*?)(?=^\S[^\n]*\n-+\n|\Z)", docstring, re.MULTILINE | re.DOTALL)
    entries = re.findall(
        r"^(\w+)(?: : ([^\n]*))?\n((?: +[^\n]*\n?)*)", section[1] if section else "", re.MULTILINE
    )
    return {
        name: (kind, " ".join(inspect.cleandoc(text).split()).replace("``", "`").removesuffix("."))
        for name, kind, text in entries
    }


def _type_words(kind: str, name: str) -> str:
    """The type of a numpy docstring as the other tables have it."""
    if kind.startswith("{"):
        return codes(ast.literal_eval(f"[{kind[1:-1]}]"))
    if kind == "bool":
        return "true, false"
    if kind == "mapping":
        return kind
    found = TYPE.fullmatch(kind)
    if found is None:
        raise ValueError(f"expected a type such as 'int, at least 1' for '{name}', got '{kind}'")
    low, high = (found["least"] or found["ge"] or found["gt"], found["most"] or found["le"] or found["lt"])
    noun = {"int": "whole number", "float": "number"}[found["noun"]]
    closed = (found["gt"] is None, found["lt"] is None)
    return bounded(noun, name, low and float(low), high and float(high), closed)
