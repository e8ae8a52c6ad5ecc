"""Half spaces and layers of finite size whose elements grow away from the contact."""

from __future__ import annotations

import numpy as np

from porocore.macro.body.kinds import Axisymmetric, Box
from porocore.macro.body.mesh import BodyMesh, box, rectangle


class HalfSpace(Axisymmetric):
    """A disc whose surface y+ is at y = height, with given edges of the elements."""

    r: tuple[float, ...]
    y: tuple[float, ...]

    def make(self) -> BodyMesh:
        return rectangle((np.array(self.r), np.array(self.y)), revolved=True)


class Quarter(Box):
    """A quarter of a layer with given edges of the elements, the same along x and z, whose planes are x- and z-."""

    x: tuple[float, ...]
    y: tuple[float, ...]

    def make(self) -> BodyMesh:
        return box((np.array(self.x), np.array(self.y), np.array(self.x)))


def quarter(x, y) -> Quarter:
    """Return a quarter of a layer with the edges ``x`` of the elements along x and z, and ``y`` above its base."""
    size, elements = (x[-1], y[-1], x[-1]), (len(x) - 1, len(y) - 1, len(x) - 1)
    return Quarter(kind="box", size=size, elements=elements, symmetry=("x-", "z-"), x=tuple(x), y=tuple(y))


def growing(first: float, end: float, ratio: float) -> np.ndarray:
    """Places from 0 to ``end`` whose distances begin near ``first`` and grow by near ``ratio``."""
    n = int(np.ceil(np.log(1 + end / first * (ratio - 1)) / np.log(ratio)))
    steps = ratio ** np.arange(n)
    return np.concatenate([[0.0], np.cumsum(steps)]) * end / steps.sum()


def half_space(parts, far: float, first: float, ratio: float, fine_to: float | None = None) -> HalfSpace:
    """Return a meridian of radius and height ``far``.

    Parameters
    ----------
    parts
        Edges of the elements along the radius, of the part that is in contact or near it.
    far
        Radius and height.
    first
        Size of the first element below the surface, and of the first one outside ``parts``.
    ratio
        Growth of the elements from there.
    fine_to
        Depth down to which elements have the size ``first``; None: they grow at once.
    """
    near = np.asarray(parts, dtype=float)
    r = np.concatenate([near, near[-1] + growing(first, far - near[-1], ratio)[1:]])
    uniform = np.arange(first, fine_to, first) if fine_to else np.empty(0)
    begin = uniform[-1] if len(uniform) else 0.0
    depth = np.concatenate([[0.0], uniform, begin + growing(first, far - begin, ratio)[1:]])
    y = far - depth[::-1]
    y[0] = 0.0
    return HalfSpace(
        kind="axisymmetric", radius=far, height=far, elements=(len(r) - 1, len(y) - 1), r=tuple(r), y=tuple(y)
    )


def edge_at(radius: float, first: float, ratio: float) -> np.ndarray:
    """Return edges of elements from the axis to ``radius``, where they have the size ``first``."""
    return radius - growing(first, radius, ratio)[::-1]
