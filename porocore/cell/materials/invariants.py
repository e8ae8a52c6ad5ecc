"""Invariants of C = FᵀF with derivatives by F; strain energies from text, as numpy functions.

I₁ = tr C, I₂ = (I₁² − tr C²)/2, J = det F; of a fibre along the unit vector a, I₄ = a·Ca and I₅ = a·C²a (Spencer 1984,
Constitutive theory for strongly anisotropic solids); of the principal stretches, T_α = λ₁^α + λ₂^α + λ₃^α.

:mod:`porocore.core.formulas` reads the text: numbers, names and arithmetic; it executes nothing. The names
of the configuration do not enter the sympy expression.
"""

from __future__ import annotations

import ast
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, ClassVar

import numpy as np

from porocore.core.echo import echo
from porocore.core.formulas import Expression
from porocore.core.tensors import add_cofactor_tangent, cofactor, determinant, symmetric_eigen
from porocore.states import Array


class Kinematics:
    """Kinematic quantities of F (3, 3, n), points last; each is computed when it is first used."""

    def __init__(self, F: Array) -> None:
        self.F = F

    @cached_property
    def C(self) -> Array:
        """Right Cauchy–Green tensor FᵀF, (3, 3, n)."""
        return _symmetric_product(self.F.swapaxes(0, 1))

    @cached_property
    def B(self) -> Array:
        """Left Cauchy–Green tensor FFᵀ, (3, 3, n)."""
        return _symmetric_product(self.F)

    @cached_property
    def J(self) -> Array:
        """Volume ratio det F, (n,)."""
        return determinant(np.moveaxis(self.F, -1, 0))

    @cached_property
    def cofactor(self) -> Array:
        """Cofactor of F, (3, 3, n)."""
        return np.moveaxis(cofactor(np.moveaxis(self.F, -1, 0)), 0, -1)

    @cached_property
    def principal(self) -> tuple[Array, Array, Array]:
        """Squared stretches c_a (3, n), their reference axes N_ia (3, 3, n), and the logarithm of c_a, (3, n)."""
        squares, axes = symmetric_eigen(self.C)
        return squares, axes, np.log(squares)

    @cached_property
    def dyads(self) -> Array:
        """Dyads M_ab = (F N_a) ⊗ N_b, (3, 3, 3, 3, n), indices a, b, i, j."""
        _, N, _ = self.principal
        f = product(self.F, N)  # columns
        return np.asarray(np.einsum("ian,jbn->abijn", f, N))


def product(A: Array, B: Array) -> Array:
    """Return A_ik B_kj of (3, 3, n), by contiguous slices, which is faster than n small products."""
    rows = [[A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j] for j in range(3)] for i in range(3)]
    return np.array(rows)


def _symmetric_product(A: Array) -> Array:
    """Return A_ik A_jk of (3, 3, n)."""
    out = np.empty_like(A)
    for i in range(3):
        for j in range(i, 3):
            out[i, j] = out[j, i] = A[i, 0] * A[j, 0] + A[i, 1] * A[j, 1] + A[i, 2] * A[j, 2]
    return out


def ramp(x: Array) -> Array:
    """Return 0 for x ≤ 0, x³ − x⁴/2 up to 1, x − ½ beyond: a positive part with two continuous derivatives."""
    t = _clipped(x)
    return np.asarray(t**3 - t**4 / 2 + np.where(np.real(x) > 1, x - 1, 0.0))


def ramp_derivative(x: Array) -> Array:
    """Return the first derivative of the ramp, 3x² − 2x³ between 0 and 1."""
    t = _clipped(x)
    return np.asarray(t * t * (3 - 2 * t))


def ramp_curvature(x: Array) -> Array:
    """Return the second derivative of the ramp, 6x (1 − x) between 0 and 1."""
    t = _clipped(x)
    return np.asarray(6 * t * (1 - t))


def _clipped(x: Array) -> Array:
    """Return x between 0 and 1; a complex x is clipped by its real part, as a complex step needs it."""
    if not np.iscomplexobj(x):
        return np.clip(x, 0.0, 1.0)
    return np.where(np.real(x) < 0, 0.0, np.where(np.real(x) > 1, 1.0, x))


@lru_cache(maxsize=1)
def symbolic_ramp() -> Any:
    """Return :func:`ramp` as a sympy function with derivatives named like the functions above."""
    import sympy

    class ramp_curvature(sympy.Function):  # type: ignore[misc]
        pass

    class ramp_derivative(sympy.Function):  # type: ignore[misc]
        def fdiff(self, argindex: int = 1) -> Any:
            return ramp_curvature(self.args[0])

    class ramp(sympy.Function):  # type: ignore[misc]
        def fdiff(self, argindex: int = 1) -> Any:
            return ramp_derivative(self.args[0])

    return ramp


#: Below this |t| two terms of the series of sinh(kt)/sinh(t) are exact to round-off for |k| up to 100.
SMALL = 1e-5


class Invariant(ABC):
    """Scalar invariant I(F); points are the last axis of every array."""

    #: Value at F = I, and the factor of its slope there: of the unit tensor, or of a ⊗ a for a fibre.
    rest: ClassVar[int]
    gradient_at_rest: ClassVar[int]

    @abstractmethod
    def value(self, at: Kinematics) -> Array:
        """Return I, (n,)."""

    @abstractmethod
    def gradient(self, at: Kinematics) -> Array:
        """Return ∂I/∂F_ij, (3, 3, n)."""

    @abstractmethod
    def add_hessian(self, A: Array, weight: Array, at: Kinematics) -> None:
        """Add weight (n,) times ∂²I/∂F_ij∂F_kl to A (3, 3, 3, 3, n)."""


@dataclass(frozen=True)
class Trace(Invariant):
    """First invariant I₁."""

    rest, gradient_at_rest = 3, 2

    def value(self, at: Kinematics) -> Array:
        return np.asarray((at.F * at.F).sum(axis=(0, 1)))

    def gradient(self, at: Kinematics) -> Array:
        return 2 * at.F

    def add_hessian(self, A: Array, weight: Array, at: Kinematics) -> None:
        for i in range(3):
            for j in range(3):
                A[i, j, i, j] += 2 * weight


@dataclass(frozen=True)
class Second(Invariant):
    """Second invariant I₂."""

    rest, gradient_at_rest = 3, 4

    def value(self, at: Kinematics) -> Array:
        C = at.C
        return np.asarray(
            C[0, 0] * C[1, 1] + C[1, 1] * C[2, 2] + C[2, 2] * C[0, 0]
            - C[0, 1] * C[0, 1] - C[1, 2] * C[1, 2] - C[0, 2] * C[0, 2]
        )  # fmt: skip

    def gradient(self, at: Kinematics) -> Array:
        """Return 2 (I₁ F − F C)."""
        return np.asarray(2 * (np.trace(at.C) * at.F - product(at.F, at.C)))

    def add_hessian(self, A: Array, weight: Array, at: Kinematics) -> None:
        """Add 2 (2 F_ij F_kl − F_il F_kj + I₁ δ_ik δ_jl − δ_ik C_jl − B_ik δ_jl)."""
        F, twice = at.F, 2 * weight
        for i in range(3):
            for j in range(3):
                left, across = 2 * twice * F[i, j], twice * F[:, j]
                for k in range(3):
                    for l in range(3):
                        A[i, j, k, l] += left * F[k, l] - F[i, l] * across[k]
        inner = twice * (np.trace(at.C) * np.eye(3)[:, :, None] - at.C)
        outer = twice * at.B
        for i in range(3):
            A[i, :, i, :] += inner
            A[:, i, :, i] -= outer


@dataclass(frozen=True)
class Volume(Invariant):
    """Volume ratio J."""

    rest, gradient_at_rest = 1, 1

    def value(self, at: Kinematics) -> Array:
        return at.J

    def gradient(self, at: Kinematics) -> Array:
        return at.cofactor

    def add_hessian(self, A: Array, weight: Array, at: Kinematics) -> None:
        """Add ε_ikm ε_jln F_mn."""
        add_cofactor_tangent(A, weight * at.F)


@dataclass(frozen=True)
class Third(Volume):
    """Third invariant I₃ = det C = J²."""

    rest, gradient_at_rest = 1, 2

    def value(self, at: Kinematics) -> Array:
        return np.asarray(at.J * at.J)

    def gradient(self, at: Kinematics) -> Array:
        """Return 2 J cof F."""
        return 2 * at.J * at.cofactor

    def add_hessian(self, A: Array, weight: Array, at: Kinematics) -> None:
        """Add 2 cof F ⊗ cof F + 2 J ∂cof F/∂F."""
        add_outer(A, 2 * weight * at.cofactor, at.cofactor)
        super().add_hessian(A, 2 * at.J * weight, at)


@dataclass(frozen=True)
class Fibre(Invariant):
    """Invariant I₄, the squared stretch along a unit vector of the reference configuration."""

    direction: tuple[float, float, float]
    rest, gradient_at_rest = 1, 2

    def _pushed(self, at: Kinematics) -> Array:
        """Return F a, (3, n)."""
        return np.asarray(np.tensordot(at.F, np.array(self.direction), axes=(1, 0)))

    def value(self, at: Kinematics) -> Array:
        f = self._pushed(at)
        return np.asarray((f * f).sum(axis=0))

    def gradient(self, at: Kinematics) -> Array:
        """Return 2 (F a) ⊗ a."""
        return np.asarray(2 * self._pushed(at)[:, None] * np.array(self.direction)[None, :, None])

    def add_hessian(self, A: Array, weight: Array, at: Kinematics) -> None:
        """Add 2 δ_ik a_j a_l."""
        a = np.array(self.direction)
        added = 2 * np.outer(a, a)[:, :, None] * weight
        for i in range(3):
            A[i, :, i, :] += added


@dataclass(frozen=True)
class SecondFibre(Fibre):
    """Invariant I₅ of a unit vector of the reference configuration."""

    rest, gradient_at_rest = 1, 4

    def value(self, at: Kinematics) -> Array:
        c = np.tensordot(at.C, np.array(self.direction), axes=(1, 0))
        return np.asarray((c * c).sum(axis=0))

    def _vectors(self, at: Kinematics) -> tuple[Array, Array, Array]:
        """Return F a, C a and F C a, (3, n)."""
        c = np.tensordot(at.C, np.array(self.direction), axes=(1, 0))
        return self._pushed(at), c, np.asarray((at.F * c).sum(axis=1))

    def gradient(self, at: Kinematics) -> Array:
        """Return 2 (F a ⊗ C a + F C a ⊗ a)."""
        f, c, g = self._vectors(at)
        a = np.array(self.direction)
        return np.asarray(2 * (f[:, None] * c + g[:, None] * a[:, None]))

    def add_hessian(self, A: Array, weight: Array, at: Kinematics) -> None:
        """Add 2 [δ_ik (c_j a_l + a_j c_l) + f_i f_k δ_jl + f_i a_l F_kj + a_j f_k F_il + B_ik a_j a_l]."""
        f, c, _ = self._vectors(at)
        a, twice = np.array(self.direction), 2 * weight
        mixed = twice * (c[:, None] * a[:, None] + a[:, None, None] * c)
        for i in range(3):
            A[i, :, i, :] += mixed
            A[:, i, :, i] += twice * f[:, None] * f
        fa = f[:, None] * a[:, None]  # f_i a_l
        A += twice * np.einsum("iln,kjn->ijkln", fa, at.F)
        A += twice * np.einsum("kjn,iln->ijkln", fa, at.F)
        A += twice * np.einsum("ikn,j,l->ijkln", at.B, a, a)


@dataclass(frozen=True)
class PowerSum(Invariant):
    """Power sum T_α = tr C^(α/2) of real α; equal stretches are regular, since no eigenvector is differentiated."""

    exponent: float
    rest = 3

    def value(self, at: Kinematics) -> Array:
        _, _, log = at.principal
        return np.asarray(np.exp(self.exponent / 2 * log).sum(axis=0))

    def gradient(self, at: Kinematics) -> Array:
        """Return 2 F h(C) = Σ_a 2 h(c_a) M_aa with h(c) = α/2 c^(α/2 − 1)."""
        h = self._slope(at)
        return np.asarray(2 * sum(h[a] * at.dyads[a, a] for a in range(3)))

    def add_hessian(self, A: Array, weight: Array, at: Kinematics) -> None:
        """Add 2 δ_ik h(C)_jl + 4 Σ_a h[a,a] M_aa⊗M_aa + 2 Σ_a<b h[a,b] (M_ab + M_ba)⊗(M_ab + M_ba).

        h[a,b] are the divided differences of h in the derivative of h(C) (Daleckii & Krein 1965).
        """
        _, N, log = at.principal
        k = self.exponent / 2 - 1
        inner = np.asarray(np.einsum("jan,lan,an->jln", N, N, 2 * weight * self._slope(at)))
        for i in range(3):
            A[i, :, i, :] += inner
        for a in range(3):
            for b in range(a, 3):
                h = self.exponent / 2 * power_difference(log[a], log[b], k)
                M = at.dyads[a, a] if a == b else at.dyads[a, b] + at.dyads[b, a]
                add_outer(A, (4 if a == b else 2) * weight * h * M, M)

    def _slope(self, at: Kinematics) -> Array:
        return np.asarray(self.exponent / 2 * np.exp((self.exponent / 2 - 1) * at.principal[2]))


def add_outer(A: Array, left: Array, right: Array) -> None:
    """Add left_ij right_kl to A (3, 3, 3, 3, n)."""
    rows, l, r = A.reshape(9, 9, -1), left.reshape(9, -1), right.reshape(9, -1)
    for i in range(9):
        rows[i] += l[i] * r


def power_difference(log_x: Array, log_y: Array, k: float) -> Array:
    """Return (x^k − y^k)/(x − y), and k x^(k−1) where x = y, of positive numbers given by their logarithms.

    With t = (ln x − ln y)/2 it is (xy)^((k−1)/2) sinh(kt)/sinh(t), without a difference of nearly equal powers. The
    quotient is an even, smooth function of t, so round-off in t has no effect. Below |t| = 1e-5 its
    series k (1 + (k² − 1) t²/6) is summed instead.
    """
    t = (log_x - log_y) / 2
    small = np.abs(t) < SMALL
    safe = np.where(small, 1.0, t)
    quotient = np.where(small, k * (1 + (k * k - 1) / 6 * t * t), np.sinh(k * safe) / np.sinh(safe))
    return np.asarray(np.exp((k - 1) / 2 * (log_x + log_y)) * quotient)


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


#: Limit on the operations of the first derivatives; the second ones have up to about thirty times as many.
MOST_OPERATIONS = 2000


@dataclass(frozen=True, eq=False)
class Derivatives:
    """Derivatives of W(I, parameters); each function takes the used invariants and all parameters and returns a list.

    Attributes
    ----------
    used
        Indices of the m invariants in the formula.
    value
        Values of W, (n,).
    first
        First derivatives, m of (n,) or numbers where constant.
    second
        First derivatives, then the second ones, row by row of the upper triangle.
    """

    used: tuple[int, ...]
    value: Callable[..., list[Any]]
    first: Callable[..., list[Any]]
    second: Callable[..., list[Any]]


def _absolute(x: Any) -> Any:
    """Return |x|; of a complex number with the sign of its real part, so that a complex step passes."""
    return np.where(np.real(x) < 0, -x, x) if np.iscomplexobj(x) else np.abs(x)


@lru_cache(maxsize=64)
def derivatives(formula: Formula) -> Derivatives:
    """Return the derivatives of a formula; each formula is differentiated once.

    Raises
    ------
    ValueError
        The text is no energy, or its derivatives are too long.
    """
    import sympy  # a third of a second, and few need it

    energy, symbols, constants = tree(formula)
    used = tuple(i for i, s in enumerate(symbols) if energy.has(s))
    if not used:
        raise ValueError(f"'{formula.text}' holds no invariant of the deformation")
    own = [symbols[i] for i in used]
    first = [sympy.diff(energy, s) for s in own]
    size = sum(int(part.count_ops()) for part in first)
    if size > MOST_OPERATIONS:
        raise ValueError(
            f"the first derivatives of the energy take {size} operations, and at most {MOST_OPERATIONS} are generated; "
            "write it with fewer factors and less nesting"
        )
    second = [sympy.diff(first[i], own[j]) for i in range(len(own)) for j in range(i, len(own))]

    def generate(parts: Sequence[Any]) -> Callable[..., list[Any]]:
        functions = {
            "ramp": ramp,
            "ramp_derivative": ramp_derivative,
            "ramp_curvature": ramp_curvature,
            "abs": _absolute,
        }
        modules: list[Any] = [functions, "numpy"]
        return sympy.lambdify([*own, *constants], list(parts), modules=modules, cse=True)  # type: ignore[no-any-return]

    return Derivatives(used, generate([energy]), generate(first), generate([*first, *second]))
