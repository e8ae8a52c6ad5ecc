"""States (H, p) as users give them: by names of components, as numbers, nested lists or arrays."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from porocore.core.echo import cut, did_you_mean
from porocore.core.inputs.input_space import NAMES
from porocore.errors import ConfigurationError
from porocore.states import Array, MacroState


def given_states(grad_u: npt.ArrayLike, p: npt.ArrayLike = 0.0) -> MacroState:
    """Return one state or n of them.

    Parameters
    ----------
    grad_u : (3, 3) or (n, 3, 3)
        H_ij = ∂u_i/∂X_j.
    p : number or (n,)
        Pore pressure, positive in compression [E].

    Raises
    ------
    ConfigurationError
        These are no finite numbers of such shapes.
    """
    H, pressures = _numbers("grad_u", grad_u), _numbers("p", p)
    if H.shape[-2:] != (3, 3) or H.ndim not in (2, 3):
        raise ConfigurationError(f"grad_u: expected shape (3, 3), or (n, 3, 3) for n states, got {H.shape}")
    H = H.reshape(-1, 3, 3)
    if pressures.shape not in ((), (1,), (len(H),)):
        raise ConfigurationError(
            f"p: expected one number, or one for each of the n = {len(H)} states of grad_u, got shape {pressures.shape}"
        )
    return MacroState(H, np.broadcast_to(pressures, len(H)).copy())


def named_state(components: Mapping[str, float]) -> Array:
    """Return a state (10,), H row by row, then p, from the components that are not zero.

    Raises
    ------
    ConfigurationError
        A name is unknown, or a value no finite number.
    """
    row = np.zeros(10)
    for name, value in components.items():
        if name not in NAMES or not isinstance(value, int | float | np.number) or not np.isfinite(value):
            question = "" if name in NAMES else did_you_mean(str(name), NAMES, cutoff=0.5)
            raise ConfigurationError(
                f"expected finite values of some of {', '.join(NAMES)}, got {cut(str(name))} = {cut(str(value))}"
                + (f"; {question}" if question else "")
            )
        row[NAMES.index(name)] = value
    return row


def _numbers(name: str, value: Any) -> Array:
    try:
        found: Array = np.array(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise ConfigurationError(
            f"{name}: expected numbers in rows of equal length, got {cut(repr(value))}"
        ) from error
    if not np.isfinite(found).all():
        raise ConfigurationError(f"{name}: expected finite numbers, got {found[~np.isfinite(found)][0]:g}")
    return found
