"""Formulas from text, read without executing anything: numbers, names, arithmetic, functions."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from porocore.core.echo import comma_within, did_you_mean, echo

#: What may be called, all of one argument.
FUNCTIONS: dict[str, Callable[[Any], Any]] = {
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "exp": np.exp,
    "log": np.log,
    "sqrt": np.sqrt,
    "sinh": np.sinh,
    "cosh": np.cosh,
    "tanh": np.tanh,
    "abs": np.abs,
}
CONSTANTS = {"pi": float(np.pi)}
_BINARY: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: lambda a, b: a + b,
    ast.Sub: lambda a, b: a - b,
    ast.Mult: lambda a, b: a * b,
    ast.Div: lambda a, b: a / b,
    ast.Pow: lambda a, b: a**b,
}
#: Longer texts, deeper trees, larger powers and numbers are a mistake or an attack.
LONGEST, DEEPEST, LARGEST_POWER, LARGEST_NUMBER = 2000, 400, 100, 1e100


@dataclass(frozen=True)
class Expression:
    """A formula in given names; call it with their values, numbers or arrays alike."""

    text: str
    tree: ast.expr

    @classmethod
    def parse(cls, text: str, names: Iterable[str], functions: Iterable[str] = FUNCTIONS) -> Expression:
        """Read the formula ``text``.

        Raises
        ------
        ValueError
            It is no formula, or holds anything but numbers, these names and functions, + − * / ** and brackets; the
            message says what and where.
        """
        return _parse(text, tuple(names), tuple(functions))

    @property
    def names(self) -> set[str]:
        """Names that occur, without the constants."""
        found = {node.id for node in ast.walk(self.tree) if isinstance(node, ast.Name)}
        return found - set(FUNCTIONS) - set(CONSTANTS)

    def __call__(self, **values: Any) -> Any:
        """Return its value; NaN or infinite where it has none."""
        known = CONSTANTS | values
        with np.errstate(all="ignore"):
            return self.convert(lambda name: np.asarray(known[name], float)[()], FUNCTIONS, np.float64)

    def convert(
        self,
        name: Callable[[str], Any],
        functions: dict[str, Callable[[Any], Any]],
        number: Callable[[float], Any] = float,
    ) -> Any:
        """Return the formula in any algebra with + − * / **, given the values of names, functions and numbers."""

        def visit(node: ast.expr) -> Any:
            match node:
                case ast.Constant():
                    return number(node.value)  # type: ignore[arg-type]
                case ast.Name():
                    return name(node.id)
                case ast.UnaryOp():
                    operand = visit(node.operand)
                    return -operand if isinstance(node.op, ast.USub) else operand
                case ast.BinOp():
                    return _BINARY[type(node.op)](visit(node.left), visit(node.right))
                case ast.Call(func=ast.Name() as function):
                    return functions[function.id](visit(node.args[0]))
            raise AssertionError(node)

        return visit(self.tree)


#: A number and a word after it, as in ``0.2 mm``, but no function.
_UNIT = re.compile(
    r"(?<![\w.])(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?\s*([A-Za-zµμΩ°]+|%)(?![A-Za-zµμΩ°]|\s*\()"
)


@lru_cache(maxsize=256)
def _parse(text: str, names: tuple[str, ...], functions: tuple[str, ...]) -> Expression:
    if len(text) > LONGEST:
        raise ValueError(f"the formula has {len(text)} characters; at most {LONGEST} are read")
    if "\0" in text:
        raise ValueError(f"{echo(text)} is no formula: it holds a null character")
    try:
        tree = ast.parse(text.strip(), mode="eval").body
        _check(tree, text.strip(), names, functions)
    except SyntaxError as error:
        known = {*names, *functions, *CONSTANTS}
        if unit := next((found for found in _UNIT.finditer(text) if found[1] not in known), None):
            raise ValueError(_takes_no_units(text, unit, names)) from None
        raise ValueError(
            f"{echo(text)} is no formula: {error.msg} at character {error.offset or 1}; write for example "
            f"2*x**2 - exp(-x){comma_within(text)}"
        ) from None
    except (RecursionError, MemoryError):
        raise ValueError(f"the formula {echo(text)} is nested too deeply") from None
    except ValueError as error:
        raise ValueError(f"{error}{comma_within(text)}") from None
    return Expression(text, tree)


def _takes_no_units(text: str, unit: re.Match[str], names: tuple[str, ...]) -> str:
    """Return the message for a number with a unit in a formula, and what its names count."""
    of_places = "x, y and z are multiples of the length scale" if {"x", "y", "z"} <= set(names) else ""
    of_time = "t is a multiple of the time scale" if "t" in names else ""
    counted = " and ".join(filter(None, (of_places, of_time)))
    return (
        f"{echo(text)} has the unit of {echo(unit[0])} at character {unit.start() + 1}, but formulas take no units; "
        f"expected plain numbers{f': {counted}' if counted else ', in multiples of the scales of the study'}"
    )


def _check(
    node: ast.AST, text: str, names: tuple[str, ...], functions: tuple[str, ...], depth: int = 1
) -> None:
    def refuse(why: str) -> ValueError:
        piece = ast.get_source_segment(text, node) or text
        where = getattr(node, "col_offset", 0) + 1
        return ValueError(f"{echo(piece)} at character {where} of {echo(text)}: {why}")

    if depth > DEEPEST:
        raise refuse(f"sums, products, powers and functions are nested more than {DEEPEST} levels deep")
    match node:
        case ast.Constant(value=value):
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise refuse("only numbers, names and formulas of them may stand here")
            if not abs(value) <= LARGEST_NUMBER:
                raise refuse(f"numbers beyond {LARGEST_NUMBER:g} are refused")
        case ast.Name(id=name):
            if name not in (*names, *CONSTANTS):
                hint = did_you_mean(name, [*names, *CONSTANTS, *functions])
                known = ", ".join([*names, *CONSTANTS])
                raise refuse(f"unknown name; {hint and f'{hint} '}there are {known}")
        case ast.UnaryOp(op=ast.USub() | ast.UAdd(), operand=operand):
            _check(operand, text, names, functions, depth + 1)
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _BINARY:
            _check(left, text, names, functions, depth + 1)
            _check(right, text, names, functions, depth + 1)
            if isinstance(op, ast.Pow) and abs(_number(right) or 0.0) > LARGEST_POWER:
                raise refuse(f"powers beyond {LARGEST_POWER} are refused")
        case ast.BinOp(op=ast.BitXor()):
            raise refuse("write a power as **")
        case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]):
            if name not in functions:
                raise refuse(f"unknown function; there are {', '.join(functions)}, each of one argument")
            _check(argument, text, names, functions, depth + 1)
        case ast.Call(func=ast.Name(id=name)) if name in functions:
            raise refuse(f"{name} takes one argument")
        case _:
            raise refuse(
                "only numbers, names, + - * / **, brackets and functions of one argument may stand here"
            )


def _number(node: ast.AST) -> float | None:
    """Return the value of a constant with its signs; None for anything else."""
    if isinstance(node, ast.UnaryOp):
        inner = _number(node.operand)
        return None if inner is None else -inner
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        return float(node.value)
    return None
