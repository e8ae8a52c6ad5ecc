"""Two-scale finite-strain poroelasticity with surrogate models of the cell problem and exchangeable solvers.

This is the public interface: ``Study`` and ``CellProblem`` for whoever computes, ``Law`` for solvers of one's own, and
what a plugin needs, besides ``porocore.testing``. ``dir(porocore)`` shows all names, docs/reference/names.md has them
in groups. Names are imported when they are first used, so that ``import porocore`` costs nothing;
``__init__.pyi`` lists them.
"""

from __future__ import annotations

from typing import Any

from porocore.core.lazy import lazy

_get, __all__ = lazy(__name__, __file__)


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("porocore")
    value = globals()[name] = _get(name)
    return value


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
