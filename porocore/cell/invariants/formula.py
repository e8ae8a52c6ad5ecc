"""Strain energies from text to sympy, bounds on their cost, and the term that cancels stress at rest.

:mod:`porocore.core.formulas.expressions` reads the text: numbers, names and arithmetic; it executes nothing. The names
of the configuration do not enter the sympy expression.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from porocore.cell.materials.ramp import ramp, symbolic_ramp
from porocore.core.echo import echo
from porocore.core.formulas.expressions import Expression

#: Functions of one argument that an energy may use.
FUNCTIONS = ("exp", "log", "sqrt", "sinh", "cosh", "tanh", "sin", "cos", "ramp")
#: Limits on the numbers, names and operations of one energy, and on nested functions, powers and quotients.
MOST_PARTS, DEEPEST = 400, 12
#: Limit on the product of nested constant exponents: (x**a)**b counts as a·b.
LARGEST_POWER = 64.0


@dataclass(frozen=True)
class Formula:
    """Text of an energy, names of its invariants with their values at F = I, and names of its parameters."""

    text: str
    invariants: tuple[tuple[str, int], ...]
    parameters: tuple[str, ...] = ()


def tree(formula: Formula) -> tuple[Any, list[Any], list[Any]]:
    """Return the energy as a sympy expression, and the symbols of invariants and parameters.

    Raises
    ------
    ValueError
        The text is no energy; the message names the place.
    """
    import sympy  # a third of a second, and few need it

    names = [name for name, _ in formula.invariants]
    parsed = Expression.parse(formula.text, (*names, *formula.parameters), FUNCTIONS)
    _bound(parsed)
    symbols = [sympy.Symbol(f"invariant_{i}", positive=True) for i in range(len(names))]
    constants = [sympy.Symbol(f"parameter_{i}", real=True) for i in range(len(formula.parameters))]
    known = dict(zip((*names, *formula.parameters), (*symbols, *constants), strict=True)) | {"pi": np.pi}

    def either(name: str) -> Callable[[Any], Any]:
        """Return a function that evaluates numbers in floating point; exact ones of exp(exp(exp(9))) never end."""
        symbolic = symbolic_ramp() if name == "ramp" else getattr(sympy, name)
        numerical: Callable[[Any], Any] = ramp if name == "ramp" else getattr(np, name)
        return lambda x: float(numerical(x)) if isinstance(x, int | float) else symbolic(x)

    try:
        with np.errstate(all="raise"):
            functions = {name: either(name) for name in FUNCTIONS}
            energy = sympy.sympify(parsed.convert(known.__getitem__, functions, lambda number: number))
    except (ArithmeticError, TypeError):
        energy = sympy.nan
    if energy.has(sympy.zoo, sympy.nan, sympy.oo, -sympy.oo, sympy.I):
        raise ValueError(
            f"{echo(formula.text)} holds a number that is not real or too large, by a division by zero, a huge power, "
            "or a root or logarithm of a negative number"
        )
    return energy, symbols, constants


def _bound(parsed: Expression) -> None:
    """Refuse a formula that would take long to differentiate.

    Raises
    ------
    ValueError
        The formula has too many parts, is nested too deeply, or has too large nested powers.
    """
    count = sum(isinstance(node, ast.expr) for node in ast.walk(parsed.tree))
    if count > MOST_PARTS:
        raise ValueError(
            f"the energy has {count} numbers, names and operations; at most {MOST_PARTS} are read"
        )

    def visit(node: ast.AST, depth: int, power: float) -> None:
        if isinstance(node, ast.Call) or (
            isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow | ast.Div)
        ):
            depth += 1
        if depth > DEEPEST:
            raise ValueError(
                f"functions, powers and quotients of the energy are nested more than {DEEPEST} levels deep"
            )
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
            visit(node.right, depth, power)
            power *= max(1.0, abs(_exponent(node.right)))
            if power > LARGEST_POWER:
                raise ValueError(
                    f"{echo(ast.unparse(node))}: powers whose exponents multiply to more than {LARGEST_POWER:g} are "
                    "refused"
                )
            visit(node.left, depth, power)
            return
        for child in ast.iter_child_nodes(node):
            visit(child, depth, power)

    visit(parsed.tree, 0, 1.0)


def _exponent(node: ast.expr) -> float:
    """Return the value of an exponent of numbers only, else 1, since powers of symbols are not expanded."""
    if any(isinstance(part, ast.Name | ast.Call) for part in ast.walk(node)):
        return 1.0
    exponent = float(Expression(ast.unparse(node), node)())
    if not math.isfinite(exponent):  # too large, or not real
        raise ValueError(f"expected an exponent that is a real number, got {echo(ast.unparse(node))}")
    return exponent


def stress_at_rest(
    formula: Formula, slopes: dict[str, int], of_fibres: set[str], values: dict[str, float]
) -> tuple[str, bool]:
    """Return the term in log(J), as text, that cancels the residual stress, and whether fibres contribute to it.

    Parameters
    ----------
    slopes
        ∂I/∂F of each invariant at F = I, in units of the unit tensor or of a ⊗ a.
    of_fibres
        Invariants in units of a ⊗ a.
    values
        Values of the parameters.
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
