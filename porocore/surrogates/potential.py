"""Model of the potential W(ln U, p) (PotentialModel), its training data, saturation outside their box.

A polynomial of high degree, or a network, means nothing outside its training states and soon loses convexity. So only
W₂ and a polynomial of low degree are continued there; all finer parts are evaluated at variables that follow y inside
the sampled box and saturate a little beyond it.

W = W₂ + polynomial + refinement + network, where W₂ is the exact second-order expansion at rest and the other parts
begin at third order; the last two, the fine ones, come to rest where the sampled states end. So W, P_E and their
gradients are exact at rest; P_E and −φ are derivatives of one function, so that a closed cycle does no work; and W
depends on F through U only, so it is objective.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt

from porocore.core.inputs import SampledRange
from porocore.core.tensors import PointGroup
from porocore.errors import DataError
from porocore.interfaces.surrogate import TrainingSet
from porocore.states import Array, CellResponse, CellTangent, IntArray, MacroState, Status
from porocore.surrogates.error_estimate.estimate import ErrorEstimate
from porocore.surrogates.network.network import Derivatives, Evaluator
from porocore.surrogates.polynomial.composition import TermSum
from porocore.surrogates.polynomial.monomials import Polynomial, Terms, plain
from porocore.surrogates.stretch import PLACES, LogStretch
from porocore.surrogates.symmetry import on_one, on_places, on_variables, stabiliser

#: A variable below this in all states was not sampled.
STILL = 1e-9
#: Stress and energy at rest below this share of the stiffness are round-off.
NOTHING = 1e-10
#: ∂L/∂y of the six components of L, (6, 3, 3).
STRETCHES = np.array(
    [[[(r, c) in {(i, j), (j, i)} for c in range(3)] for r in range(3)] for i, j in PLACES], float
)


def variables(stretch: LogStretch, p: Array) -> Array:
    """Return y (7, n): six components of ln U, and p."""
    return np.concatenate([stretch.L, p[None]])


@dataclass(frozen=True, eq=False)
class RestExpansion:
    """Quadratic expansion of W at rest, W₂(y) = W₀ + T·L − φ p + ½ y·A y: exact in the limit of small loads.

    A cell that is held while its solid swells has an energy W₀, a stress T and a mean gradient at rest; of others they
    are zero, and φ is φ_f.

    Attributes
    ----------
    porosity
        φ at rest.
    matrix : (7, 7)
        A: the drained stiffness, minus Biot's coupling, minus the inverse of the Biot modulus.
    mean_grad : (9, 7)
        ∂<∇u¹>_s/∂y.
    symmetry
        The cell's point group, which all of them have exactly.
    value
        W₀.
    stress : (6,)
        T = ∂W/∂L, where shears count twice.
    held : (9,)
        <∇u¹>_s at rest.
    """

    porosity: float
    matrix: Array
    mean_grad: Array
    symmetry: PointGroup
    value: float = 0.0
    stress: Array = field(default_factory=lambda: np.zeros(6))
    held: Array = field(default_factory=lambda: np.zeros(9))

    @classmethod
    def from_response(cls, reference: CellResponse, symmetry: PointGroup) -> RestExpansion:
        """Return the expansion from the response of the undeformed cell (one row) with its tangent.

        The error of a free mesh breaks the cell's symmetry and is averaged out.

        Raises
        ------
        DataError
            A derivative is missing.
        """
        t = reference.tangent
        if (
            t is None
            or reference.fluid_volume is None
            or t.stress_grad_u is None
            or t.stress_p is None
            or t.fluid_volume_p is None
            or t.mean_grad_grad_u is None
            or t.mean_grad_p is None
        ):
            raise DataError(
                "a potential needs stress, fluid volume and all derivatives of the undeformed cell; "
                "solve it with tangent=True"
            )
        A = np.zeros((7, 7))
        m = np.zeros((9, 7))
        for a, (i, j) in enumerate(PLACES):
            column = _symmetric(t.stress_grad_u[0], i, j)
            for b, (k, l) in enumerate(PLACES):
                A[b, a] = column[k, l] if k == l else column[k, l] + column[l, k]
            A[6, a] = A[a, 6] = t.stress_p[0, i, j] if i == j else t.stress_p[0, i, j] + t.stress_p[0, j, i]
            m[:, a] = _symmetric(t.mean_grad_grad_u[0], i, j).ravel()
        A[6, 6] = -t.fluid_volume_p[0]
        m[:, 6] = t.mean_grad_p[0].ravel()
        y, places, one = on_variables(symmetry), on_places(symmetry), on_one(symmetry)
        value, P, held = _held(reference, float(np.abs(A).max()))
        # F = I + L + L²/2 + …, so that a stress at rest works on second order of L.
        curved = np.einsum("ij,aik,bkj->ab", P, STRETCHES, STRETCHES)
        A[:6, :6] += (curved + curved.T) / 2
        T = np.append(np.einsum("ij,aij->a", P, STRETCHES), 0.0)
        return cls(
            float(reference.fluid_volume[0]),
            y.mean(y, (A + A.T) / 2),
            places.mean(y, m),
            symmetry,
            value,
            y.mean(one, T[:, None])[:6, 0],
            places.mean(one, held.reshape(9, 1))[:, 0],
        )

    def potential(self, y: Array) -> tuple[Array, Array]:
        """Return W₂ (n,) and ∂W₂/∂y (7, n); the Hessian is ``matrix``."""
        gradient = self.matrix @ y
        value = (y * gradient).sum(axis=0) / 2 - self.porosity * y[6]
        gradient[6] -= self.porosity
        if self.value or self.stress.any():
            value += self.value + self.stress @ y[:6]
            gradient[:6] += self.stress[:, None]
        return value, gradient


def _held(reference: CellResponse, stiffness: float) -> tuple[float, Array, Array]:
    """Return W₀, P (3, 3) and <∇u¹>_s (3, 3) of a cell at rest; exact zeros where they are but round-off."""
    P = np.zeros((3, 3)) if reference.stress is None else reference.stress[0]
    W = 0.0 if reference.potential is None else float(reference.potential[0])
    held = np.abs(P).max() > NOTHING * stiffness or abs(W) > NOTHING * stiffness
    return (W, P, reference.mean_grad[0]) if held else (0.0, np.zeros((3, 3)), np.zeros((3, 3)))


def _symmetric(tensor: Array, i: int, j: int) -> Array:
    """Return ∂(3, 3)/∂ one component of a symmetric argument."""
    column: Array = tensor[:, :, i, j] if i == j else tensor[:, :, i, j] + tensor[:, :, j, i]
    return column


@dataclass(frozen=True, eq=False)
class PotentialData:
    """Data of n states in the variables y.

    Attributes
    ----------
    rest
        The undeformed cell.
    y : (7, n)
        Variables.
    active
        Those that were sampled.
    value : (n,), gradient : (7, n)
        W and ∂W/∂y. Only the rows of ``active`` are used by those who learn in these alone.
    mean_grad : (9, n), mean_grad_by_y : (9, 7, n)
        Rᵀ<∇u¹>_s, which depends on U and p only, and its derivatives.
    """

    rest: RestExpansion
    y: Array
    active: tuple[int, ...]
    value: Array
    gradient: Array
    mean_grad: Array
    mean_grad_by_y: Array

    @classmethod
    def from_training_set(cls, data: TrainingSet) -> PotentialData:
        """Return the data of the stable states; those beyond an instability would mislead a potential.

        Raises
        ------
        DataError
            A response or a derivative is missing, or fewer than two states are left.
        """
        kept = np.flatnonzero(data.responses.stable)
        states, responses = data.states[kept], data.responses[kept]
        missing = [
            name
            for name in ("potential", "stress", "fluid_volume", "tangent")
            if getattr(responses, name) is None
        ]
        if missing:
            raise DataError(
                f"a potential is learned from {', '.join(missing)}, which these states lack; sample again"
            )
        if len(kept) < 2:
            raise DataError(f"expected at least two stable training states, got {len(kept)}; sample more")
        rest = RestExpansion.from_response(data.reference, data.symmetry)
        assert responses.potential is not None
        assert responses.stress is not None
        assert responses.fluid_volume is not None
        stretch = LogStretch.from_gradient(states.grad_u)
        y = variables(stretch, states.p)
        gradient = np.concatenate(
            [stretch.pull(np.moveaxis(responses.stress, 0, -1)), -responses.fluid_volume[None]]
        )
        active = tuple(int(a) for a in np.flatnonzero(np.abs(y).max(axis=1) > STILL))
        mean_grad, gradients = unrotated(stretch, responses)
        return cls(rest, y, active, responses.potential.copy(), gradient, mean_grad, gradients)

    def __len__(self) -> int:
        return self.y.shape[1]

    @cached_property
    def remainder(self) -> tuple[Array, Array]:
        """Remainder of W (n,) and of ∂W/∂y (7, n) beyond the expansion at rest."""
        value, gradient = self.rest.potential(self.y)
        return self.value - value, self.gradient - gradient

    @property
    def mean_grad_remainder(self) -> tuple[Array, Array]:
        """Remainder of Rᵀ<∇u¹>_s (9, n) and of its derivatives (9, 7, n) beyond the linear limit at rest."""
        slopes = self.rest.mean_grad
        value = self.rest.held[:, None] + slopes @ self.y
        return self.mean_grad - value, self.mean_grad_by_y - slopes[:, :, None]

    @cached_property
    def scales(self) -> Array:
        """Root mean square of W and of each ∂W/∂y about their means, (8,), by which errors are weighted.

        The means of variables that were not sampled count as much as the largest of the others.
        """
        spread = np.concatenate([[self.value.std()], self.gradient.std(axis=1)])
        floor = 1e-3 * spread[1:7].max(initial=0.0)
        spread[1:7] = np.maximum(spread[1:7], floor)
        return np.where(spread > 0, spread, 1.0)


def unrotated(stretch: LogStretch, responses: CellResponse) -> tuple[Array, Array]:
    """Return Rᵀ m (9, n) and its derivatives by y (9, 7, n); along pure stretches R does not change."""
    t = responses.tangent
    assert t is not None
    if t.mean_grad_grad_u is None or t.mean_grad_p is None:
        raise DataError("the derivatives of <∇u¹> are missing; solve the states with tangent=True")
    n = len(responses)
    R = None if stretch.rotation is None else np.moveaxis(stretch.rotation, -1, 0)

    def back(tensor: Array) -> Array:
        turned = tensor if R is None else R.swapaxes(1, 2) @ tensor
        return np.moveaxis(turned.reshape(n, 9), 0, -1)

    M = t.mean_grad_grad_u.reshape(n, 9, 9)
    gradients = np.empty((9, 7, n))
    for component in range(6):
        direction = np.moveaxis(stretch.pull_direction(component), -1, 0).reshape(n, 9, 1)
        gradients[:, component] = back((M @ direction).reshape(n, 3, 3))
    gradients[:, 6] = back(t.mean_grad_p)
    return back(responses.mean_grad), gradients


#: Width of the saturation beyond the box, as a share of its size.
MARGIN = 0.1
#: The box is enlarged by this share at each end in many variables, where the sampled states leave the corners empty.
EXTENSION, MANY = 0.1, 4


@dataclass(frozen=True, eq=False)
class TrainingBox:
    """Box of the training states in the variables y.

    Attributes
    ----------
    active
        Variables that were sampled; the others are left as they are.
    low, high : (d,)
        Bounds of the active variables; rest, y = 0, lies inside.
    """

    active: tuple[int, ...]
    low: Array
    high: Array

    @classmethod
    def from_states(cls, y: Array, active: tuple[int, ...], group: PointGroup) -> TrainingBox:
        """Return the box around the states y (7, n), with the symmetry of a group as far as it leads to no other."""
        low, high = np.minimum(y.min(axis=1), 0.0), np.maximum(y.max(axis=1), 0.0)
        action, ends = on_variables(stabiliser(group, active)), np.stack([low, high])
        for to, sign in zip(action.to, action.sign, strict=True):
            image = np.sort(ends * sign, axis=0)
            low[to], high[to] = np.minimum(low[to], image[0]), np.maximum(high[to], image[1])
        more = EXTENSION * (high - low) if len(active) >= MANY else 0.0 * low
        return cls(active, (low - more)[list(active)], (high + more)[list(active)])

    def beyond(self, y: Array) -> IntArray:
        """Return which of the states y (7, n) lie outside the box."""
        return self.beyond_active(y[list(self.active)])

    def beyond_active(self, inner: Array) -> IntArray:
        """Return the same for the active variables alone, (d, n)."""
        outside = (inner < self.low[:, None]) | (inner > self.high[:, None])
        return np.flatnonzero(outside.any(axis=0))

    def saturated(self, y: Array) -> tuple[Array, Array, Array]:
        """Return z(y) (7, n) with its first and second derivatives, (7, n) each.

        z = y inside the box, and c + δ tanh((y − c)/δ) beyond an end c of it, which is twice continuously
        differentiable.
        """
        active = list(self.active)
        z, first, second = y.copy(), np.ones_like(y), np.zeros_like(y)
        z[active], first[active], s = self.saturated_active(y[active])
        second[active] = -2 / self._margin * s * first[active]
        return z, first, second

    def saturated_active(self, inner: Array) -> tuple[Array, Array, Array]:
        """Return z (d, n) of the active variables ``inner`` (d, n), its first derivative, and tanh((y − c)/δ)."""
        ends = np.minimum(np.maximum(inner, self.low[:, None]), self.high[:, None])
        s = np.tanh((inner - ends) / self._margin)
        return ends + self._margin * s, 1 - s * s, s

    @cached_property
    def _margin(self) -> Array:
        """Width δ (d, 1) of the saturation."""
        return MARGIN * np.maximum(self.high - self.low, 1e-12)[:, None]


@dataclass(frozen=True, eq=False)
class NetworkPart:
    """Network N(t) less its expansion up to second order in y, for some terms t(y).

    With terms that the operations of a cell leave alone, N has its symmetry whatever the weights are.

    Attributes
    ----------
    network
        N, with one output.
    terms
        t; a term of weight w is of order w in y.
    """

    network: Evaluator
    terms: Terms

    def start(self, t: Array) -> Callable[[], Derivatives]:
        """Start the evaluation of N less its expansion and its derivatives at t (k, n)."""
        pending = self.network.start(np.ascontiguousarray(t.T))

        def finish() -> Derivatives:
            value, gradient, hessian = pending()
            v0, g0, h0 = self._at_rest
            h0_t = h0 @ t
            value = value - v0 - g0 @ t - (t * h0_t).sum(axis=0) / 2
            gradient = gradient - g0[:, None] - h0_t
            for i, j in np.argwhere(h0):
                hessian[i, j] -= h0[i, j]
            return value, gradient, hessian

        return finish

    @cached_property
    def _at_rest(self) -> tuple[Array, Array, Array]:
        """Value, gradient and Hessian by the terms at y = 0, as far as they belong to orders up to the second in y."""
        value, gradient, hessian = self.network.value_gradient_hessian(np.zeros((1, len(self.terms.weights))))
        first, second = low_orders(self.terms)
        return value, gradient[:, 0] * first, hessian[:, :, 0] * second


def low_orders(terms: Terms) -> tuple[Array, Array]:
    """Return 1 for gradients (k,) and Hessians (k, k) by the terms of orders up to the second in y, else 0."""
    weights = np.array(terms.weights)
    linear = (weights == 1).astype(float)
    return (weights <= 2).astype(float), linear[:, None] * linear


@dataclass(frozen=True, eq=False)
class PotentialModel:
    """Model of W and <∇u¹>_s for any state.

    Attributes
    ----------
    rest
        W₂, and the linear limit of <∇u¹>_s.
    terms, polynomial
        Third order and a little higher, continued beyond the sampled states; None where there is no such part.
    network
        Finer part; None where there is no such part.
    mean_grad
        Polynomial in the variables ``active``: components of Rᵀ<∇u¹>_s beyond the linear limit, (9 outputs).
    active
        The variables that were sampled.
    sampled
        Hull of the training states.
    training_box
        Their box in the variables y.
    refinement
        Finer part as a polynomial in the same terms; None where there is no such part.
    estimate
        Estimate of its errors, which flags states; None: those beyond the hull are flagged.
    """

    rest: RestExpansion
    terms: Terms | None
    polynomial: Polynomial | None
    network: NetworkPart | None
    mean_grad: Polynomial
    active: tuple[int, ...]
    sampled: SampledRange
    training_box: TrainingBox
    refinement: Polynomial | None = None
    estimate: ErrorEstimate | None = None

    def potential(self, y: Array) -> tuple[Array, Array, Array]:
        """Return W (n,), ∂W/∂y (7, n) and ∂²W/∂y² (7, 7, n)."""
        return self._start(y)()

    def _start(self, y: Array) -> Callable[[], Derivatives]:
        """Start the evaluation of :meth:`potential`, in the background if the backend can."""
        parts = [part.start(y) for part in self._everything]

        def finish() -> Derivatives:
            value, gradient, hessian = self._second_order(y)
            for add_to in parts:
                add_to(value, gradient, hessian)
            beyond = self.training_box.beyond(y) if self._fine else ()
            if len(beyond):
                value[beyond], gradient[:, beyond], hessian[:, :, beyond] = self._beyond(y[:, beyond])
            return value, gradient, hessian

        return finish

    def _beyond(self, y: Array) -> Derivatives:
        """Return the same at states outside the sampled box."""
        value, gradient, hessian = self._second_order(y)
        for part in self._coarse:
            part.start(y)(value, gradient, hessian)
        z, first, second = self.training_box.saturated(y)
        v, g, h = np.zeros_like(value), np.zeros_like(gradient), np.zeros_like(hessian)
        for part in self._fine:
            part.start(z)(v, g, h)
        hessian += first[:, None] * first[None, :] * h
        hessian[np.arange(len(y)), np.arange(len(y))] += second * g
        return value + v, gradient + first * g, hessian

    def _second_order(self, y: Array) -> tuple[Array, Array, Array]:
        """Return W₂ and its derivatives."""
        value, gradient = self.rest.potential(y)
        hessian = np.empty((*self.rest.matrix.shape, y.shape[1]))
        hessian[:] = self.rest.matrix[:, :, None]
        return value, gradient, hessian

    @cached_property
    def _everything(self) -> list[TermSum]:
        return self._sums([self.polynomial, self.refinement], self.network)

    @cached_property
    def _coarse(self) -> list[TermSum]:
        return self._sums([self.polynomial], None)

    @cached_property
    def _fine(self) -> list[TermSum]:
        return self._sums([self.refinement], self.network)

    def _sums(self, polynomials: list[Polynomial | None], network: NetworkPart | None) -> list[TermSum]:
        """Return one sum for each set of terms, so that each term is differentiated once."""
        terms = self.terms or plain(())
        found = [Polynomial.zero(len(terms.weights), 1), *(p for p in polynomials if p is not None)]
        if network is not None:
            rows = terms.rows_of(network.terms)
            if rows is None:
                own, k = network.terms, len(network.terms.weights)
                alone = TermSum(own, Polynomial.zero(k, 1), network, tuple(range(k)))
                return [*self._sums(polynomials, None), alone]
        if network is None and len(found) == 1:
            return []
        both = Polynomial(
            np.concatenate([p.exponents for p in found]),
            np.concatenate([p.coefficients for p in found], axis=1),
        )
        return [TermSum(terms, both) if network is None else TermSum(terms, both, network, rows or ())]

    def predict(self, states: MacroState, *, tangent: bool) -> CellResponse:
        """Return all responses of n states and, if ``tangent``, their exact derivatives."""
        stretch = LogStretch.from_gradient(states.grad_u)
        y = variables(stretch, states.p)
        pending = self._start(y)
        mean_grad, derivatives = self._mean_grad(stretch, y, tangent)
        value, gradient, hessian = pending()
        if not tangent:
            stress = stretch.stress(gradient[:6])
        else:
            stress, stress_p = stretch.stresses(gradient[:6], hessian[:6, 6])
            by_H, by_p = derivatives
            gradients = CellTangent(
                mean_grad_grad_u=by_H,
                mean_grad_p=by_p,
                stress_grad_u=stretch.tangent(gradient[:6], hessian[:6, :6]),
                stress_p=stress_p,
                fluid_volume_grad_u=-stress_p,
                fluid_volume_p=-hessian[6, 6],
            )
        return CellResponse(
            mean_grad=mean_grad,
            status=np.full(len(states), int(Status.converged), dtype=np.int64),
            potential=value,
            stress=stress,
            fluid_volume=-gradient[6],
            tangent=gradients if tangent else None,
            outside_training_range=self._outside(states, y, gradient),
        )

    def beyond_rest(self, y: Array, judged: tuple[int, ...], gradient: Array | None = None) -> Array:
        """Return ∂(W − W₂)/∂y (c, n) of the judged variables at y (7, n); ∂W/∂y may be given."""
        whole = self.potential(y)[1] if gradient is None else gradient
        return (whole - self.rest.potential(y)[1])[list(judged)]

    def error(self, states: MacroState) -> Array:
        """Return the estimated error of n states, a share of the range of stress or fluid volume; NaN without one."""
        if self.estimate is None:
            return np.full(len(states), np.nan)
        y = variables(LogStretch.from_gradient(states.grad_u), states.p)
        return self.estimate.error(y, self.beyond_rest(y, self.estimate.judged))

    def _outside(self, states: MacroState, y: Array, gradient: Array) -> npt.NDArray[np.bool_]:
        """Return which states are flagged, (n,): far from all known ones, or by the estimated error."""
        unrotated = self.sampled.inputs.without_rotation(states)
        if self.estimate is None:
            return self.sampled.outside(unrotated)
        found = self.beyond_rest(y, self.estimate.judged, gradient)
        return self.sampled.far(unrotated) | self.estimate.flagged(y, found)

    def _mean_grad(self, stretch: LogStretch, y: Array, tangent: bool) -> tuple[Array, tuple[Array, Array]]:
        n = y.shape[1]
        t = y[list(self.active)]
        beyond, steepness = self.training_box.beyond_active(t), None
        if len(beyond):
            t[:, beyond], steepness, _ = self.training_box.saturated_active(t[:, beyond])
        unrotated = self.rest.held[:, None] + self.rest.mean_grad @ y
        if tangent:
            more, gradients, _ = self.mean_grad.entries(t, second=False)
        else:
            more = self.mean_grad.evaluate(t)
        unrotated += more
        turned = np.ascontiguousarray(unrotated.T).reshape(n, 3, 3)
        R = stretch.rotations
        if R is not None:
            turned = R @ turned
        if not tangent:
            return turned, (turned, turned)
        by_y: dict[tuple[int, int], Array | float] = dict(self._linear_slopes)
        for (output, variable), row in gradients:
            at = output, self.active[variable]
            if steepness is not None:
                row[beyond] *= steepness[variable]
            row += by_y.get(at, 0.0)
            by_y[at] = row
        by_p = np.zeros((n, 3, 3))
        for output in range(9):
            if (output, 6) in by_y:
                by_p[:, output // 3, output % 3] = by_y.pop((output, 6))
        by_H = stretch.rotated_gradient(unrotated.reshape(3, 3, n), by_y)
        return turned, (by_H.reshape(n, 3, 3, 3, 3), by_p if R is None else R @ by_p)

    @cached_property
    def _linear_slopes(self) -> dict[tuple[int, int], float]:
        """∂Rᵀ<∇u¹>_s/∂y at rest, by (place, variable), where it is not zero."""
        matrix = self.rest.mean_grad
        return {(int(o), int(a)): float(matrix[o, a]) for o, a in np.argwhere(matrix)}
