"""Questions about a suite that another process answers, with another hash seed and folder."""

from __future__ import annotations

import importlib
import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from porocore.testing.expect import Violation
from porocore.testing.suite import Suite

#: Under them a set of two names of inputs is in opposite orders.
HASH_SEEDS = ("1", "2")
#: Seconds that the other process may take.
PATIENCE = 300.0


def ask(suite: type[Suite], question: str, state: str, folder: Path, **facts: Any) -> Any:
    """Return what a function answers about a suite in another process, which works in ``folder``.

    The suite is a class at the top of its module, or has a ``recipe``. The question is ``module:function``; it gets
    the suite and ``facts``, and returns what JSON can hold. ``state`` is for the message where there is no answer.

    Raises
    ------
    Violation
        The process raised an error or died.
    """
    if "<locals>" in suite.__qualname__ and not suite.recipe:
        pytest.skip("the suite is a class of a function, which another process cannot make")
    request = {"suite": _origin(suite), "question": question, "facts": facts}
    # Of the two seeds the one under which a set is in another order than here.
    other = HASH_SEEDS[list({"H22", "p"}) == ["H22", "p"]]
    path = os.pathsep.join(str(Path(part).resolve()) for part in sys.path if part)
    done = subprocess.run(
        [sys.executable, "-m", __name__],
        input=json.dumps(request),
        env={**os.environ, "PYTHONHASHSEED": other, "PYTHONPATH": path},
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=False,
    )
    lines = done.stdout.splitlines()
    if done.returncode or not lines:
        last = [line for line in done.stderr.splitlines() if line.strip()][-1:]
        raise Violation(state, "an answer", last[0] if last else f"exit status {done.returncode}")
    return json.loads(lines[-1])


def _origin(suite: type[Suite]) -> dict[str, Any]:
    """Return how another process finds a suite."""
    file = getattr(sys.modules.get(suite.__module__), "__file__", None)
    return {"recipe": suite.recipe, "module": suite.__module__, "file": file, "name": suite.__qualname__}


def _suite(origin: dict[str, Any]) -> type[Suite]:
    """The suite of :func:`_origin`."""
    if origin["recipe"]:
        function, *arguments = origin["recipe"]
        return _function(function)(*arguments)  # type: ignore[no-any-return]
    found: Any = _module(origin["module"], origin["file"])
    for name in origin["name"].split("."):
        found = getattr(found, name)
    return found  # type: ignore[no-any-return]


def _module(name: str, file: str | None) -> Any:
    """Import a module by its name, or by its file where pytest renamed it."""
    try:
        module = importlib.import_module(name)
    except ImportError:
        module = None
    if module is not None and (file is None or getattr(module, "__file__", None) == file):
        return module
    spec = importlib.util.spec_from_file_location(name, str(file))
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def _function(text: str) -> Any:
    """Return the function named ``module:function``."""
    module, _, name = text.partition(":")
    return getattr(importlib.import_module(module), name)


def _main() -> None:
    request = json.load(sys.stdin)
    answer = _function(request["question"])(_suite(request["suite"]), **request["facts"])
    sys.stdout.write("\n" + json.dumps(answer) + "\n")


if __name__ == "__main__":
    _main()
