"""Draws from a density by emcee's ensemble of walkers (EnsembleDraws)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np

from porocore.errors import ConfigurationError
from porocore.states import Array

#: Share of the steps that are left out at the beginning.
BURN_IN = 0.25
#: Steps between two reports of the progress.
REPORTED = 100


@dataclass(frozen=True, eq=False)
class EnsembleDraws:
    """Draws of all walkers.

    Attributes
    ----------
    steps : (s, w, k)
        Position of each walker after each step that is kept.
    autocorrelation
        Steps after which a walker has forgotten where it was, the largest of the k; NaN where too few tell.
    """

    steps: Array
    autocorrelation: float

    @property
    def flat(self) -> Array:
        """All draws, (s·w, k)."""
        return self.steps.reshape(-1, self.steps.shape[2])


def require_emcee() -> Any:
    """Return the package emcee.

    Raises
    ------
    ConfigurationError
        It cannot be imported.
    """
    try:
        return import_module("emcee")
    except ImportError as error:
        raise ConfigurationError(
            f"needs emcee, which cannot be imported here ({error}); pip install emcee, or remove the section"
        ) from error


def ensemble_draws(
    log_density: Callable[[Array], Array],
    first: Array,
    steps: int,
    seed: int,
    tell: Callable[[int], None] = lambda step: None,
) -> EnsembleDraws:
    """Return draws from a density by affine-invariant stretch moves (Goodman & Weare 2010).

    Parameters
    ----------
    log_density
        Its logarithm (n,) at points (n, k).
    first : (w, k)
        First positions of the walkers.
    steps
        Steps of each walker; the first quarter is left out.
    seed
        Of the random numbers.
    tell
        Called with the number of steps that are done, now and then.
    """
    emcee = require_emcee()
    sampler = emcee.EnsembleSampler(*first.shape, log_density, vectorize=True)
    start = emcee.State(first, random_state=np.random.RandomState(seed).get_state())
    for step, _ in enumerate(sampler.sample(start, iterations=steps, skip_initial_state_check=True)):
        if step % REPORTED == 0:
            tell(step)
    kept = np.asarray(sampler.get_chain(discard=int(BURN_IN * steps)), dtype=float)
    with np.errstate(invalid="ignore", divide="ignore"):
        times = emcee.autocorr.integrated_time(kept, quiet=True, tol=0)
    return EnsembleDraws(kept, float(np.max(times)))
