"""The conformance kit: for each interface the laws that its implementations obey, as tests to subclass.

.. code-block:: python

    from porocore.testing import SamplerSuite

    class TestMine(SamplerSuite):
        kit_version = "3"

        @classmethod
        def make_sampler(cls, inputs, **options):
            return MySampler(inputs, **options)

pytest collects the rest; nothing has to be configured. Names are imported when they are first used. All but the
made-up cells needs pytest.
"""

from __future__ import annotations

import importlib
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from porocore.plugins.table import KIT_VERSION as KIT_VERSION
    from porocore.testing.cell_laws.base import CellSolverSuite as CellSolverSuite
    from porocore.testing.cell_laws.base import MeshedCellSuite as MeshedCellSuite
    from porocore.testing.cell_laws.exact import CellContactSuite as CellContactSuite
    from porocore.testing.command_laws import CommandSuite as CommandSuite
    from porocore.testing.macro_laws.states import MacroLawSuite as MacroLawSuite
    from porocore.testing.macro_laws.states import MacroSolverSuite as MacroSolverSuite
    from porocore.testing.sampler_laws import SamplerSuite as SamplerSuite
    from porocore.testing.suite import Suite as Suite
    from porocore.testing.surrogate_laws.base import SurrogateSuite as SurrogateSuite
    from porocore.testing.surrogate_laws.potential import PotentialSuite as PotentialSuite

_HOMES = {
    "CellSolverSuite": "porocore.testing.cell_laws.base",
    "CellContactSuite": "porocore.testing.cell_laws.exact",
    "CommandSuite": "porocore.testing.command_laws",
    "MeshedCellSuite": "porocore.testing.cell_laws.base",
    "MacroLawSuite": "porocore.testing.macro_laws.states",
    "MacroSolverSuite": "porocore.testing.macro_laws.states",
    "PotentialSuite": "porocore.testing.surrogate_laws.potential",
    "SamplerSuite": "porocore.testing.sampler_laws",
    "Suite": "porocore.testing.suite",
    "SurrogateSuite": "porocore.testing.surrogate_laws.base",
    "KIT_VERSION": "porocore.plugins.table",
}
__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'porocore.testing' has no attribute '{name}'")
    if name != "KIT_VERSION" and find_spec("pytest") is None:
        raise ModuleNotFoundError(
            f"porocore.testing.{name} needs pytest, which is not installed here; install it: pip install pytest",
            name="pytest",
        )
    value = getattr(importlib.import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return [*globals(), *__all__]
