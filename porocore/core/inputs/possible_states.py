"""Check of states before they are solved: det F > 0 and bearable magnitudes; least det F in a box."""

from __future__ import annotations

import itertools

import numpy as np
import numpy.typing as npt

from porocore.core.inputs.input_space import NAMES, InputSpace, value_text
from porocore.core.models.bounds import LARGEST_GRADIENT, LARGEST_PRESSURE
from porocore.errors import ConfigurationError
from porocore.states import Array


def require_possible(grad_u: npt.ArrayLike, p: float, modulus: float, what: str) -> None:
    """Refuse a state that no cell can be in; see :func:`why_impossible`.

    Raises
    ------
    ConfigurationError
        It is one; the message begins with ``what``.
    """
    if why := why_impossible(grad_u, p, modulus):
        raise ConfigurationError(f"{what}: {why}")


def why_impossible(grad_u: npt.ArrayLike, p: float, modulus: float = 1.0) -> str:
    """Return why no cell can be in a state; empty if one may.

    Parameters
    ----------
    grad_u : (3, 3)
        H_ij = ∂u_i/∂X_j.
    p
        Pore pressure [E].
    modulus
        Young's modulus of the stiffest solid [E].
    """
    H = np.asarray(grad_u, dtype=float).reshape(3, 3)
    if not (np.abs(H) <= LARGEST_GRADIENT).all():
        return f"expected components of H of at most {LARGEST_GRADIENT:g}, got {np.abs(H).max():g}"
    if not abs(p) <= LARGEST_PRESSURE * modulus:
        return (
            f"expected a pressure p of at most {LARGEST_PRESSURE:g} times the solid's "
            f"{value_text('p', modulus)}, got {value_text('p', p)}"
        )
    J = float(np.linalg.det(np.eye(3) + H))
    if J <= 0:
        return (
            f"det F = {J:.4g} with F = I + H, but a solid has det F > 0: it would be pressed to nothing or turned "
            "inside out; give a smaller H"
        )
    return ""


def least_volume(inputs: InputSpace) -> tuple[float, dict[str, float]]:
    """Return the smallest det F in a box of inputs, and the components of H by name at the corner where it is.

    det F is linear in every single component of H, so that no point of the box has less than its least corner.
    """
    moving = [i for i, column in enumerate(inputs.columns) if column < 9]
    corners = np.array(list(itertools.product(*((inputs.lower[i], inputs.upper[i]) for i in moving))))
    H: Array = np.zeros((len(corners), 9))
    H[:, [inputs.columns[i] for i in moving]] = corners
    J = np.linalg.det(np.eye(3) + H.reshape(-1, 3, 3))
    least = int(J.argmin())
    return float(J[least]), {
        NAMES[inputs.columns[i]]: float(x) for i, x in zip(moving, corners[least], strict=True)
    }
