"""Learning the conductivity of the deformed pore from solved states."""

from __future__ import annotations

from itertools import permutations, product

import numpy as np

from porocore.errors import DataError
from porocore.interfaces.surrogate import TrainingSet
from porocore.sampled_range import SampledRange
from porocore.states import Array
from porocore.surrogates.components import COMPONENT, PLACES
from porocore.surrogates.conductivity import ConductivityModel, conducting_basis, triangle
from porocore.surrogates.least_squares import EQUATIONS_PER_TERM, FOLDS, RIDGE
from porocore.surrogates.monomials import IntArray, Polynomial
from porocore.surrogates.potential_data import STILL, Rest, variables
from porocore.surrogates.reach import Reach
from porocore.surrogates.stretch import LogStretch
from porocore.surrogates.terms import VARIABLES, plain
from porocore.tensors.symmetric_functions import logarithm

LARGEST_DEGREE = 6
#: Of K₀: it is the same in all directions to this share.
ISOTROPIC = 1e-6


def fit_conductivity(data: TrainingSet) -> tuple[ConductivityModel, float] | None:
    """A model of K_ref, and its cross-validated error in ln K; None where the states hold no conductivity.

    The degree of the polynomial is the one with the smallest cross-validated error. In a cell with the symmetry of the
    cube every state stands for its images under the rotations of the cube, so that the model has that symmetry too.

    Raises
    ------
    DataError
        Too few states have a conductivity, or the undeformed cell has none.
    """
    found, rest = data.responses.conductivity, data.reference.conductivity
    if found is None or rest is None:
        return None
    basis = conducting_basis(rest[0])
    r = basis.shape[1]
    if r == 0:
        raise DataError("the undeformed pore conducts in no direction, so there is no conductivity to learn")
    finite = data.responses.stable & np.isfinite(found).all(axis=(1, 2))
    S = np.full((len(found), r, r), np.nan)
    S[finite] = logarithm(basis.T @ found[finite] @ basis)
    kept = np.flatnonzero(np.isfinite(S).all(axis=(1, 2)))
    if len(kept) < 2:
        raise DataError(
            f"only {len(kept)} of {len(found)} stable states have a conductivity of the deformed pore; sample where "
            "no walls touch, or choose conductivity: piola"
        )
    log_rest = logarithm(basis.T @ rest[0] @ basis)
    log_rest = (log_rest + log_rest.T) / 2
    states = data.states[kept]
    y = variables(LogStretch.of(states.grad_u), states.p)
    active = tuple(int(a) for a in np.flatnonzero(np.abs(y).max(axis=1) > STILL))
    rotations = _rotations(active) if _is_cubic(data, rest[0]) else [np.eye(3)]
    polynomial, error = _fit(y, S[kept] - log_rest, active, rotations)
    model = ConductivityModel(
        basis,
        log_rest,
        polynomial,
        active,
        Reach.of(y, active, cubic=len(rotations) > 1 and {0, 1, 2} <= set(active)),
        SampledRange.around(data.inputs, data.inputs.gather(states)),
    )
    return model, error


def _is_cubic(data: TrainingSet, K: Array) -> bool:
    scale = float(np.abs(K).max())
    return Rest.of(data.reference, data.isotropic).cubic and bool(
        np.abs(K - K[0, 0] * np.eye(3)).max() <= ISOTROPIC * scale
    )


def _rotations(active: tuple[int, ...]) -> list[Array]:
    """The rotations of the cube (3, 3) that lead from the variables that were sampled to no others.

    Its reflections change no symmetric tensor in another way than its rotations do.
    """
    found = []
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        Q = np.eye(3)[list(order)] * np.array(signs)
        images = {_images(Q)[0][a] for a in active}
        if np.linalg.det(Q) > 0 and images == set(active):
            found.append(Q)
    return found


def _images(Q: Array) -> tuple[IntArray, Array]:
    """To which variable each goes by L → Q L Qᵀ for a signed permutation Q, and with which sign."""
    place = np.abs(Q).argmax(axis=0)
    sign = Q[place, np.arange(3)]
    to, factor = np.arange(VARIABLES), np.ones(VARIABLES)
    for a, (i, j) in enumerate(PLACES):
        to[a], factor[a] = COMPONENT[place[i], place[j]], sign[i] * sign[j]
    return to, factor


def _fit(y: Array, S: Array, active: tuple[int, ...], rotations: list[Array]) -> tuple[Polynomial, float]:
    """Of the upper triangle of S (n, r, r) − what it is at rest, and the cross-validated root mean square error."""
    n, pairs = len(S), triangle(S.shape[1])
    images = []
    for Q in rotations:
        to, factor = _images(Q)
        moved = np.empty_like(y)
        moved[to] = factor[:, None] * y
        turned = Q @ S @ Q.T if len(rotations) > 1 else S
        images.append((moved[list(active)], np.stack([turned[:, i, j] for i, j in pairs])))
    t, values = np.stack([a for a, _ in images]), np.stack([b for _, b in images])
    # Images that coincide are no further equations.
    equations = n * len(np.unique(t[:, :, 0].round(9), axis=0))
    terms = plain(active)
    folds = np.arange(n) % min(FOLDS, n)
    errors: dict[int, float] = {}
    for degree in range(1, LARGEST_DEGREE + 1):
        exponents = terms.monomials(1, degree)
        if len(exponents) * EQUATIONS_PER_TERM > equations * (1 - 1 / FOLDS) and errors:
            break
        wrong = np.empty_like(values[0])
        for fold in range(int(folds.max()) + 1):
            test, train = folds == fold, folds != fold
            wrong[:, test] = _solve(t[:, :, train], values[:, :, train], exponents).evaluate(t[0][:, test])
        errors[degree] = float(np.sqrt(((wrong - values[0]) ** 2).mean()))
    best = min(errors, key=lambda degree: errors[degree])
    return _solve(t, values, terms.monomials(1, best)), errors[best]


def _solve(t: Array, values: Array, exponents: IntArray) -> Polynomial:
    """Least squares over all images: t (images, variables, n), values (images, outputs, n)."""
    rows = Polynomial(exponents, np.eye(len(exponents))).evaluate(np.concatenate(t, axis=1)).T
    right = np.concatenate(values, axis=1).T
    size = np.sqrt((rows**2).sum(axis=0))
    size[size == 0] = 1.0
    ridge = np.sqrt(RIDGE) * np.eye(len(size))
    solution = np.linalg.lstsq(
        np.concatenate([rows / size, ridge]),
        np.concatenate([right, np.zeros((len(size), right.shape[1]))]),
        rcond=None,
    )[0]
    return Polynomial(exponents, (solution / size[:, None]).T.copy())
