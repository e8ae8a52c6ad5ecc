"""Offers of the samplers that come with porocore, by their names."""

from __future__ import annotations

from functools import partial
from pkgutil import resolve_name

from porocore.plugins.hookspecs import Offer, hookimpl

#: Name, module and class in :mod:`porocore.sampling.samplers`, and summary.
SAMPLERS = (
    (
        "density-sweep",
        "density:DensitySweep",
        "one input at a time; the step is halved where <∇u¹> bends (Dehghani & Zilian)",
    ),
    ("sobol", "designs:SobolDesign", "a scrambled Sobol sequence, with or without the corners"),
    ("latin-hypercube", "designs:LatinHypercube", "each input takes as many values as there are states"),
    ("active", "active:Active", "round by round where a committee of surrogates disagrees"),
    (
        "macro-driven",
        "macro_driven:MacroDriven",
        "where macro runs with the present surrogate go, until their results stay",
    ),
)


@hookimpl
def porocore_samplers() -> list[Offer]:
    """Offer sweeps, space-filling designs and two samplers that learn."""
    return [
        Offer(name, partial(resolve_name, f"porocore.sampling.samplers.{place}"), summary)
        for name, place, summary in SAMPLERS
    ]
