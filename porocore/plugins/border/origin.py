"""Origin of an object that a plugin made: its distribution and file; the error that names them."""

from __future__ import annotations

import sys
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from porocore.errors import PluginError
from porocore.plugins.hookspecs import short_repr

_KNOWN: WeakKeyDictionary[type, str] = WeakKeyDictionary()


def note_origin(implementation: type, words: str) -> None:
    """Remember where a class comes from, such as "sampler 'halton' of acme 1.0"."""
    _KNOWN[implementation] = words


def origin_of(thing: object) -> str:
    """Return where the class of an object comes from, with its file."""
    classes = type(thing).__mro__
    known = next((cls for cls in classes if cls in _KNOWN), classes[0])
    file = getattr(sys.modules.get(known.__module__), "__file__", None)
    words = _KNOWN.get(known, known.__name__)
    return f"{words} ({file})" if file else words


def refuse(thing: object, fault: str) -> PluginError:
    """Return the error to raise for something wrong that came out of ``thing``."""
    return PluginError(f"{origin_of(thing)} returned something wrong: {fault}; report this to its authors")


def described(value: Any) -> str:
    """Return shape and type of an array, and anything else as code has it."""
    if isinstance(value, np.ndarray):
        return f"shape {value.shape} of type {value.dtype}"
    return short_repr(value)
