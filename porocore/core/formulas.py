"""Formulas from text, read without executing anything; functions of time; where a formula has no value."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from operator import itemgetter
from typing import Annotated, Any

import numpy as np
from pydantic import Discriminator, Field, Tag, model_validator

from porocore.core.echo import comma_within, did_you_mean, echo
from porocore.core.models.bounds import MOST_TIMES
from porocore.core.models.strict import StrictModel
from porocore.core.units import Carried, Dimension, InScales
from porocore.errors import ConfigurationError
from porocore.states import Array

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
        binary: Mapping[type[ast.operator], Callable[[Any, Any], Any]] = _BINARY,
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
                    return binary[type(node.op)](visit(node.left), visit(node.right))
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
        if "if" in re.findall(r"[A-Za-z_]+", text):
            raise ValueError(f"{echo(text)} is no formula: {_no_conditions(names)}") from None
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


#: Functions of other languages that choose between values.
CONDITIONS = ("where", "piecewise", "heaviside", "step", "ifelse", "iif", "select")


def _no_conditions(names: Iterable[str]) -> str:
    """Return the message for a condition in a formula of these names, and what there is instead."""
    steps = "; steps are a 'table:'" if {"t", "x"} & {*names} else ""
    parts = ", and other values in a part of the body 'macro.regions:'" if "x" in names else ""
    return f"formulas have no conditions{steps}{parts}"


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
                raise refuse(_unknown_function(name, names, functions))
            _check(argument, text, names, functions, depth + 1)
        case ast.Call(func=ast.Name(id=name)) if name in functions:
            raise refuse(f"{name} takes one argument")
        case ast.Call(func=ast.Name(id=name)):
            raise refuse(_unknown_function(name, names, functions))
        case _:
            chooses = isinstance(node, ast.IfExp | ast.Compare | ast.BoolOp)
            raise refuse(
                "only numbers, names, + - * / **, brackets and functions of one argument may stand here"
                f"{f'; {_no_conditions(names)}' if chooses else ''}"
            )


def _unknown_function(name: str, names: tuple[str, ...], functions: tuple[str, ...]) -> str:
    there = f"unknown function; there are {', '.join(functions)}, each of one argument"
    if name.casefold() in CONDITIONS:
        return f"{there}; {_no_conditions(names)}"
    if name.casefold() in ("min", "max") and names == ("t",):
        return f"{there}; a load that comes up and then stays is {{ramp: ..., until: ...}}"
    return there


def _number(node: ast.AST) -> float | None:
    """Return the value of a constant with its signs; None for anything else."""
    if isinstance(node, ast.UnaryOp):
        inner = _number(node.operand)
        return None if inner is None else -inner
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        return float(node.value)
    return None


ROOT, LOGARITHM = (
    "takes the root of a negative number",
    "takes the logarithm of a number that is not positive",
)
DIVISION, POLE, OVERFLOW = "divides by zero", "has a pole", "becomes too large a number"
#: Of functions that have no value everywhere, the mask of points where they have none, and why.
_WITHOUT_VALUE: dict[str, tuple[Callable[[Array], Any], str]] = {
    "sqrt": (lambda at: at < 0, ROOT),
    "log": (lambda at: at <= 0, LOGARITHM),
    "tan": (lambda at: _zeros(np.cos(at)), POLE),
}


def first_fault(expression: Expression, points: Array) -> tuple[int, str] | None:
    """Return where a formula of one variable has no value for the first time, and why; None if it always has one.

    A denominator that changes its sign between two points is zero between them; so is a pole of the tangent found.
    The place is the index of the point, or of the one behind the zero.

    Parameters
    ----------
    expression
        A formula of one name, or of none.
    points : (n,)
        Ascending values of the variable, dense where it may move.
    """
    faults: list[tuple[int, str]] = []

    def note(where: Any, why: str) -> None:
        if where.any():
            faults.append((int(where.argmax()), why))

    def divided(a: Array, b: Array) -> Array:
        note(_zeros(b), DIVISION)
        return a / b

    def power(a: Array, b: Array) -> Array:
        note((a < 0) & (b != np.round(b)), ROOT)
        note(_zeros(a) & (b < 0), DIVISION)
        return np.asarray(a**b)

    def watched(name: str) -> Callable[[Array], Any]:
        def call(at: Array) -> Any:
            if name in _WITHOUT_VALUE:
                where, why = _WITHOUT_VALUE[name]
                note(where(at), why)
            return FUNCTIONS[name](at)

        return call

    def everywhere(number: float) -> Array:
        return np.full(len(points), float(number))

    with np.errstate(all="ignore"):
        value = expression.convert(
            lambda name: everywhere(CONSTANTS[name]) if name in CONSTANTS else points,
            {name: watched(name) for name in FUNCTIONS},
            everywhere,
            _BINARY | {ast.Div: divided, ast.Pow: power},
        )
        note(~(np.abs(value) <= LARGEST_NUMBER), OVERFLOW)
    return min(faults, key=itemgetter(0), default=None)


def _zeros(values: Array) -> Any:
    """Return the mask of points that are zero, or behind a change of sign."""
    found = values == 0
    found[1:] |= values[1:] * np.sign(values[:-1]) < 0
    return found


Positive = Annotated[float, Field(gt=0)]


def require_later(times: Sequence[float], of: str) -> None:
    """Refuse times of which one is not after that before it.

    Raises
    ------
    ValueError
        There is one; the message has the place in the list, since times have no unit yet.
    """
    for k, (one, other) in enumerate(pairwise(times), start=1):
        if other <= one:
            raise ValueError(
                f"the times of {of} do not ascend: entry {k + 1} is not after entry {k}; sort them"
            )


class TimeFunction(StrictModel):
    """A function of time of its own, instead of the common ramp: one of ``table``, ``ramp``, ``expression``."""

    table: Annotated[
        tuple[tuple[Annotated[float, Field(ge=0), Dimension("time")], Annotated[float, Carried()]], ...],
        Field(max_length=MOST_TIMES),
    ] = ()
    """[time, value] with ascending times, linear in between, constant before the first and after the last."""
    ramp: Annotated[float | None, Carried()] = None
    """From 0 at t = 0 linearly to this value at ``until``, and constant from then on."""
    until: Annotated[Positive | None, Dimension("time")] = None
    """End of the ramp."""
    expression: Annotated[str, Field(max_length=LONGEST), InScales()] | None = None
    """A formula of t such as ``0.1*sin(2*pi*t)``; t and the result are dimensionless, also where there are scales."""

    @model_validator(mode="after")
    def _one_of_them(self) -> TimeFunction:
        given = [bool(self.table), self.ramp is not None, self.expression is not None]
        if sum(given) != 1:
            raise ValueError("expected exactly one of table, ramp (with until) and expression")
        if (self.ramp is None) != (self.until is None):
            raise ValueError("ramp and until belong together: the value, and the time at which it is reached")
        times = [time for time, _ in self.table]
        require_later(times, "the table")
        if self.expression is not None:
            Expression.parse(self.expression, ("t",))
        return self

    @property
    def corners(self) -> tuple[float, ...]:
        """Times at which the slope changes, which a time step should hit."""
        return (self.until,) if self.until is not None else tuple(time for time, _ in self.table)

    def at(self, time: float) -> float:
        """Return its value.

        Raises
        ------
        ConfigurationError
            The expression has no value at this time; :mod:`porocore.study.preflight` finds that before a run.
        """
        if self.ramp is not None and self.until is not None:
            return self.ramp * min(1.0, time / self.until)
        if self.table:
            times, values = zip(*self.table, strict=True)
            return float(np.interp(time, times, values))
        assert self.expression is not None
        value = float(Expression.parse(self.expression, ("t",))(t=time))
        if not np.isfinite(value):
            raise ConfigurationError(f"{echo(self.expression)} is no finite number at t = {time:g}")
        return value


def _form(value: Any) -> str:
    return "course" if isinstance(value, dict | TimeFunction) else "number"


#: A number follows the common ramp of the time plan; a course has its own.
Value = Annotated[
    Annotated[float, Tag("number")] | Annotated[TimeFunction, Tag("course")], Discriminator(_form)
]
