"""Names of a package that are imported when they are first used, as the stub beside its file lists them."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any


def lazy(package: str, file: str) -> tuple[Callable[[str], Any], list[str]]:
    """Return the function that imports a name of a package, and all its names.

    Type checkers read the same stub: ``file`` with an ``i`` behind it, of lines such as ``from porocore.errors import
    DataError as DataError``.
    """
    with open(f"{file}i", encoding="utf-8") as stub:
        imports = stub.read().replace("(", " ").split("from ")[1:]
    homes = {words[2]: words[0] for words in map(str.split, imports)}

    def get(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module '{package}' has no attribute '{name}'")
        return getattr(importlib.import_module(homes[name]), name)

    return get, sorted(homes)
