"""The conformance kit: for each interface the checks that its implementations pass, as tests to subclass.

.. code-block:: python

    from porocore.testing import SamplerSuite

    class TestMine(SamplerSuite):
        kit_version = "5"

        @classmethod
        def make_sampler(cls, inputs, **options):
            return MySampler(inputs, **options)

pytest collects the rest; nothing has to be configured. Names are imported when they are first used. All but the
made-up cells needs pytest.
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

from porocore.core.lazy import lazy

_get, __all__ = lazy(__name__, __file__)


def __getattr__(name: str) -> Any:
    if name in __all__ and name != "KIT_VERSION" and find_spec("pytest") is None:
        raise ModuleNotFoundError(
            f"porocore.testing.{name} needs pytest, which is not installed here; install it: pip install pytest",
            name="pytest",
        )
    value = globals()[name] = _get(name)
    return value


def __dir__() -> list[str]:
    return [*globals(), *__all__]
