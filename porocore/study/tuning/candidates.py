"""Network architectures that a search tries, and the configuration of one."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from porocore.core.echo import cut, echo
from porocore.errors import ConfigurationError
from porocore.study.backends import make_backend
from porocore.study.config.config import RunConfig
from porocore.surrogates.network.options import MOST_LAYERS, MOST_WIDTH

#: More networks than this are not tried.
MOST_CANDIDATES = 1000
DEPTHS, WIDTHS = (1, 2, 3), (8, 16, 24, 40)
#: Tried in this order; a backend takes those that its model knows.
ACTIVATIONS = ("sigmoid", "tanh", "softplus", "relu", "gelu", "silu", "elu")


@dataclass(frozen=True)
class Candidate:
    """One architecture: ``depth`` hidden layers of ``width``."""

    depth: int
    width: int
    activation: str

    @property
    def hidden(self) -> list[int]:
        """Return the widths of the hidden layers, as in the configuration."""
        return [self.width] * self.depth

    @property
    def key(self) -> str:
        """Name of the candidate's file."""
        return f"{self.depth}x{self.width}-{self.activation}"

    def parameters(self, inputs: int, outputs: int) -> int:
        """Return the number of weights and biases."""
        widths = [inputs, *self.hidden, outputs]
        return sum((a + 1) * b for a, b in itertools.pairwise(widths))


def candidates(
    config: RunConfig,
    depths: Sequence[int] = DEPTHS,
    widths: Sequence[int] = WIDTHS,
    activations: Sequence[str] | None = None,
) -> list[Candidate]:
    """Return all combinations; without ``activations`` those with every activation of the model.

    Raises
    ------
    ConfigurationError
        The surrogate has no options ``hidden`` and ``activation``, or does not take these values; or the cell is a
        family.
    PluginError
        The surrogate is unknown or missing.
    """
    config.cell.require_member("the architecture is chosen for one cell: give one number")
    make_backend("surrogate", config)  # reports any other fault first
    known = [name for name in ACTIVATIONS if _takes(config, Candidate(1, 4, name))]
    if not known:
        name = config.surrogate.backend
        raise ConfigurationError(
            f"surrogate.backend: '{name}' has no options hidden and activation, so there is no architecture to "
            "choose; choose another surrogate, such as --surrogate torch"
        )
    chosen = known if activations is None else list(activations)
    for activation in chosen:
        if activation not in known:
            raise ConfigurationError(
                f"--activations: expected some of {', '.join(known)}, got {echo(activation)}; leave it out to try all"
            )
    for option, values in (("--depths", depths), ("--widths", widths)):
        most = MOST_LAYERS if option == "--depths" else MOST_WIDTH
        if not values or min(values) < 1 or max(values) > most:
            raise ConfigurationError(
                f"{option}: expected whole numbers from 1 to {most}, such as 1,2,3, got {cut(_listed(values))}"
            )
    if (count := len(set(depths)) * len(set(widths)) * len(set(chosen))) > MOST_CANDIDATES:
        raise ConfigurationError(
            f"--depths, --widths and --activations make {count} candidates; at most {MOST_CANDIDATES} are trained"
        )
    grid = itertools.product(dict.fromkeys(depths), dict.fromkeys(widths), dict.fromkeys(chosen))
    return [Candidate(depth, width, activation) for depth, width, activation in grid]


def with_architecture(config: RunConfig, candidate: Candidate) -> RunConfig:
    """Return the configuration whose surrogate has this architecture."""
    return with_options(config, {"hidden": candidate.hidden, "activation": candidate.activation})


def with_options(config: RunConfig, update: dict[str, Any]) -> RunConfig:
    """Return the configuration with other options for the architecture; the remaining options stay."""
    kept = {k: v for k, v in config.surrogate.options.items() if k not in ("hidden", "activation")}
    surrogate = config.surrogate.model_copy(update={"options": {**kept, **update}})
    return config.model_copy(update={"surrogate": surrogate})


def _takes(config: RunConfig, candidate: Candidate) -> bool:
    try:
        make_backend("surrogate", with_architecture(config, candidate))
    except ConfigurationError:
        return False
    return True


def _listed(values: Sequence[int]) -> str:
    return ",".join(map(str, values)) or "nothing"
