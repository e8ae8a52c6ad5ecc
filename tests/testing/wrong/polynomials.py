"""Shared by the surrogates that break one law each: the polynomial, whose answers are altered."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

from porocore.surrogates.polynomial.surrogate import PolynomialSurrogate
from porocore.testing import PotentialSuite

#: What was fitted to so many states and parameters: all such sets are alike here, and a fit takes longer than a law.
FITTED: dict[tuple[int, tuple[str, ...]], PolynomialSurrogate] = {}


class Altered(PolynomialSurrogate):
    """Answers what ``alter`` makes of the right response."""

    def fit(self, data, *, seed, checkpoint=None, on_progress=None):
        key = len(data.states), data.inputs.parameters
        if key not in FITTED:
            FITTED[key] = PolynomialSurrogate(degree=4).fit(data, seed=seed)
        vars(self).update(vars(FITTED[key]))
        return self

    def alter(self, response, states):
        return response

    def predict(self, states, *, tangent=True):
        return self.alter(super().predict(states, tangent=tangent), states)


def with_slopes(response, **changed):
    if response.tangent is None:
        return response
    slopes = {name: change(getattr(response.tangent, name)) for name, change in changed.items()}
    return replace(response, tangent=replace(response.tangent, **slopes))


class Law(PotentialSuite):
    kit_version = "5"
    random: ClassVar = False
    resumable: ClassVar = False
    caught_by: ClassVar[str]
    surrogate: ClassVar[type[PolynomialSurrogate]] = Altered

    @classmethod
    def make_surrogate(cls):
        return cls.surrogate()
