"""From the text of a strain energy to numpy functions of its invariants: value, first and second derivatives.

The text becomes a tree of sympy's by :mod:`porocore.expressions`, which reads numbers, names and arithmetic and
executes nothing. Names of the user do not enter the code that sympy generates.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from porocore.expressions import Expression
from porocore.states import Array

#: What may be called in the text of an energy, each of one argument.
FUNCTIONS = ("exp", "log", "sqrt", "sinh", "cosh", "tanh", "sin", "cos", "ramp")
#: Numbers, names and operations of one energy, and how deeply they are nested.
MOST_PARTS, DEEPEST = 400, 40
#: Product of the constant exponents on the way to any part: x**a**b and (x**a)**b count alike.
LARGEST_POWER = 64.0
#: Operations of the generated code.
MOST_OPERATIONS = 40_000


@dataclass(frozen=True)
class Formula:
    """An energy as text: names of the invariants with their values at F = I, and names of the parameters."""

    text: str
    invariants: tuple[tuple[str, int], ...]
    parameters: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Derivatives:
    """Of W(I, parameters).

    Attributes
    ----------
    used
        Indices of the invariants that occur, m of them.
    value
        W less its value at F = I, (n,); called with the used invariants and all parameters.
    first
        The m first derivatives.
    second
        The m first derivatives, then the second ones row by row of the upper triangle.
    """

    used: tuple[int, ...]
    value: Callable[..., Any]
    first: Callable[..., Any]
    second: Callable[..., Any]


@lru_cache(maxsize=64)
def derivatives(formula: Formula) -> Derivatives:
    """Differentiate and generate the code, once for each text.

    Raises
    ------
    ValueError
        The text is no energy; the message says what and where.
    """
    import sympy  # third of a second, and few need it

    energy, symbols, constants = tree(formula)
    used = tuple(i for i, s in enumerate(symbols) if energy.has(s))
    own = [symbols[i] for i in used]
    rest = energy.subs({s: sympy.Integer(v) for s, (_, v) in zip(symbols, formula.invariants, strict=True)})
    if rest.is_finite is False or rest.has(sympy.I, sympy.zoo, sympy.nan):
        raise ValueError(f"expected an energy that is real and finite at F = I, got {rest} there")
    first = [sympy.diff(energy, s) for s in own]
    second = [sympy.diff(first[i], own[j]) for i in range(len(own)) for j in range(i, len(own))]
    size = sum(int(part.count_ops()) for part in second)
    if size > MOST_OPERATIONS:
        raise ValueError(f"its derivatives take {size} operations; at most {MOST_OPERATIONS} are generated")

    def generate(parts: Sequence[Any]) -> Callable[..., Any]:
        modules: list[Any] = [{"ramp": ramp, "ramp_slope": ramp_slope, "ramp_bend": ramp_bend}, "numpy"]
        return sympy.lambdify([*own, *constants], list(parts), modules=modules, cse=True)  # type: ignore[no-any-return]

    return Derivatives(used, generate([energy - rest]), generate(first), generate([*first, *second]))


def tree(formula: Formula) -> tuple[Any, list[Any], list[Any]]:
    """The energy as sympy's tree, and the symbols of invariants and parameters.

    Raises
    ------
    ValueError
        See :func:`derivatives`.
    """
    import sympy

    names = [name for name, _ in formula.invariants]
    parsed = Expression.parse(formula.text, (*names, *formula.parameters), FUNCTIONS)
    bound(parsed)
    symbols = [sympy.Symbol(f"invariant_{i}", positive=True) for i in range(len(names))]
    constants = [sympy.Symbol(f"parameter_{i}", real=True) for i in range(len(formula.parameters))]
    known = dict(zip((*names, *formula.parameters), (*symbols, *constants), strict=True))
    known["pi"] = sympy.Float(np.pi)
    functions = {name: getattr(sympy, name) for name in FUNCTIONS if name != "ramp"} | {"ramp": _ramp()}
    energy = sympy.sympify(parsed.convert(known.__getitem__, functions, _number), strict=True)
    if energy.has(sympy.zoo, sympy.nan, sympy.oo, -sympy.oo, sympy.I):
        raise ValueError(
            f"'{formula.text}' divides by zero, or takes the root or logarithm of a negative number"
        )
    return energy, symbols, constants


def _number(value: float) -> Any:
    import sympy

    return sympy.Integer(value) if isinstance(value, int) and abs(value) < 10**9 else sympy.Float(value)


def bound(parsed: Expression) -> None:
    """Refuse what would take long to differentiate.

    Raises
    ------
    ValueError
        The formula has too many parts, is nested too deeply, or piles powers on powers.
    """
    count = sum(isinstance(node, ast.expr) for node in ast.walk(parsed.tree))
    if count > MOST_PARTS:
        raise ValueError(
            f"the energy has {count} numbers, names and operations; at most {MOST_PARTS} are read"
        )

    def visit(node: ast.AST, depth: int, power: float) -> None:
        if depth > DEEPEST:
            raise ValueError(f"the energy is nested more than {DEEPEST} levels deep")
        raised = power
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
            raised = power * max(1.0, abs(_exponent(node.right)))
            if raised > LARGEST_POWER:
                raise ValueError(
                    f"'{ast.unparse(node)}': powers whose exponents multiply to more than {LARGEST_POWER:g} are refused"
                )
            visit(node.right, depth + 1, power)
            visit(node.left, depth + 1, raised)
            return
        for child in ast.iter_child_nodes(node):
            visit(child, depth + 1, power)

    visit(parsed.tree, 0, 1.0)


def _exponent(node: ast.expr) -> float:
    """Its value if it is made of numbers only, else 1: powers of symbols stay as they are written."""
    if any(isinstance(part, ast.Name | ast.Call) for part in ast.walk(node)):
        return 1.0
    try:
        return float(Expression(ast.unparse(node), node)())
    except (OverflowError, ZeroDivisionError, TypeError) as error:  # too large, or not real
        raise ValueError(f"'{ast.unparse(node)}' is no exponent: {error}") from None


def ramp(x: Array) -> Array:
    """0 for x ≤ 0, x³ − x⁴/2 up to 1, x − ½ beyond: a positive part with two continuous derivatives."""
    t = np.clip(x, 0.0, 1.0)
    return np.asarray(t**3 - t**4 / 2 + np.maximum(x - 1, 0.0))


def ramp_slope(x: Array) -> Array:
    """Its derivative, 3x² − 2x³ between 0 and 1."""
    t = np.clip(x, 0.0, 1.0)
    return np.asarray(t * t * (3 - 2 * t))


def ramp_bend(x: Array) -> Array:
    """Its second derivative, 6x (1 − x) between 0 and 1."""
    t = np.clip(x, 0.0, 1.0)
    return np.asarray(6 * t * (1 - t))


@lru_cache(maxsize=1)
def _ramp() -> Any:
    """:func:`ramp` as a function of sympy's."""
    import sympy

    class ramp_bend(sympy.Function):  # type: ignore[misc]
        pass

    class ramp_slope(sympy.Function):  # type: ignore[misc]
        def fdiff(self, argindex: int = 1) -> Any:
            return ramp_bend(self.args[0])

    class ramp(sympy.Function):  # type: ignore[misc]
        def fdiff(self, argindex: int = 1) -> Any:
            return ramp_slope(self.args[0])

    return ramp


def stress_at_rest(
    formula: Formula, slopes: dict[str, int], of_fibres: set[str], values: dict[str, float]
) -> tuple[str, bool]:
    """The term in log(J) that takes the residual stress away, as text, and whether fibres have a share in that stress.

    Parameters
    ----------
    slopes
        ∂I/∂F of each invariant at F = I, in units of the unit tensor or of a ⊗ a.
    of_fibres
        Invariants of the latter kind.
    values
        Of the parameters.
    """
    import sympy

    energy, symbols, constants = tree(formula)
    names = [name for name, _ in formula.invariants]
    rest = {s: sympy.Integer(v) for s, (_, v) in zip(symbols, formula.invariants, strict=True)}
    spoken = {c: sympy.Symbol(name, real=True) for c, name in zip(constants, formula.parameters, strict=True)}
    numbers = {c: values[name] for c, name in zip(constants, formula.parameters, strict=True)}
    shares = {
        name: slopes[name] * sympy.diff(energy, s).subs(rest) for name, s in zip(names, symbols, strict=True)
    }
    fibres = any(abs(float(shares[name].subs(numbers))) > 1e-12 for name in of_fibres)
    total = sum(share for name, share in shares.items() if name not in of_fibres)
    lacking = (-total).subs(spoken) * sympy.Function("log")(sympy.Symbol("J"))
    return str(lacking), fibres
