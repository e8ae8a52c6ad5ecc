"""PETSc options from the configuration, under a prefix of their own; unknown ones refused; PETSc's errors."""

from __future__ import annotations

import atexit
import ctypes
from collections.abc import Mapping
from itertools import count
from typing import TypeAlias

import petsc4py.PETSc
from petsc4py import PETSc

from porocore.errors import ConfigurationError

#: Value of a PETSc option; True and None stand for an option without one.
OptionValue: TypeAlias = str | int | float | bool | None
_numbers = count()
#: Prefix of each set of options in PETSc's database, which holds 512 options in all, so that none is entered twice.
_prefixes: dict[tuple[tuple[str, str], ...], str] = {}
#: PETSc's error codes for misspelt options: no support, wrong state, wrong type, value out of range,
#: unknown type, missing package.
OPTION_ERRORS = {56, 58, 62, 63, 73, 86, 92}


@atexit.register
def _forget() -> None:
    """Take our options out of PETSc's database, of which PETSc 3.25 prints at its end what no solver used."""
    database = PETSc.Options()
    for content, prefix in _prefixes.items():
        for name, _ in content:
            database.delValue(prefix + name)


class SolverOptions:
    """Options of one linear solver.

    Parameters
    ----------
    defaults
        Options that the user may override.
    chosen
        The user's options, without a prefix: ``{"ksp_type": "cg"}``.
    key
        Place in the configuration, for messages.

    Raises
    ------
    ConfigurationError
        A name or a value is of a kind that no option has.
    """

    def __init__(
        self, defaults: Mapping[str, OptionValue], chosen: Mapping[str, OptionValue], key: str
    ) -> None:
        self.key, self.chosen = key, dict(chosen)
        for name, value in chosen.items():
            if not isinstance(name, str) or not isinstance(value, str | int | float | bool | None):
                raise ConfigurationError(
                    f"{key}: expected PETSc options such as 'ksp_type: cg', got {name!r}: {value!r}"
                )
        together = {**defaults, **chosen}
        content = tuple(sorted((name, repr(value)) for name, value in together.items()))
        if content not in _prefixes:
            _prefixes[content] = f"porocore_{next(_numbers)}_"
            database = PETSc.Options()
            for name, value in together.items():
                database[_prefixes[content] + name] = None if value is True else value
        self.prefix = _prefixes[content]

    def apply(self, ksp: PETSc.KSP) -> None:
        """Configure a solver.

        Raises
        ------
        ConfigurationError
            PETSc refuses a value.
        """
        ksp.setOptionsPrefix(self.prefix)
        self.apply_further(ksp)

    def apply_further(self, ksp: PETSc.KSP) -> None:
        """Configure a solver within the one of :meth:`apply`, whose prefix it has already.

        Raises
        ------
        ConfigurationError
            PETSc refuses a value.
        """
        try:
            ksp.setFromOptions()
        except PETSc.Error as error:
            raise self.refused(error) from error

    def refused(self, error: PETSc.Error) -> ConfigurationError:
        """Return PETSc's message about an option that it cannot use as an error."""
        return ConfigurationError(f"{self.key}: PETSc refuses {self._text()}: {explanation(error)}")

    def check_used(self) -> None:
        """Check, after the first solve, that PETSc has used every option of the user.

        Raises
        ------
        ConfigurationError
            Some option has had no effect.
        """
        unused = [name for name in self.chosen if not _was_used(self.prefix + name)]
        if unused:
            raise ConfigurationError(
                f"{self.key}: PETSc makes no use of {', '.join(sorted(unused))} here: misspelt, or of another solver "
                "than the one chosen"
            )

    def _text(self) -> str:
        return ", ".join(f"{name}: {value}" for name, value in self.chosen.items()) or "its defaults"


def explanation(error: PETSc.Error) -> str:
    """Return the last line of PETSc's report, which says what is wrong."""
    lines = [line.split("] ", 1)[-1].strip() for line in str(error).splitlines() if line.strip()]
    return lines[-1] if lines else f"error code {error.ierr}"


def _was_used(name: str) -> bool:
    # petsc4py does not wrap this function.
    library = ctypes.CDLL(petsc4py.PETSc.__file__)
    used = ctypes.c_int(1)
    library.PetscOptionsUsed(None, ctypes.c_char_p(name.encode()), ctypes.byref(used))
    return bool(used.value)
