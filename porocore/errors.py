"""Kinds of errors that a user meets: configuration, plugin, run folder, data, solve, unexpected.

Every message says what was expected, what came and what to do. Only the command line turns one of these
into text on a terminal and exit status 2; a library caller catches :class:`PorocoreError`.
"""

from __future__ import annotations


class PorocoreError(Exception):
    """Base class of all errors that porocore raises on purpose."""


class ConfigurationError(PorocoreError):
    """A configuration file or an option holds something that cannot be used."""


class MemberError(ConfigurationError):
    """A family of cells has no member with some parameters, or its mesh cannot be moved to them."""


class PluginError(PorocoreError):
    """A backend is unknown, missing, broken or offered twice."""


class RunFolderError(PorocoreError):
    """A run folder cannot be used: it holds another run, or it cannot be written."""


class DataError(PorocoreError):
    """A file that porocore was asked to read is truncated, foreign or of another version."""


class UnexpectedError(PorocoreError):
    """Something raised what it should not have raised, in another process or another file than the one that asked.

    Attributes
    ----------
    details
        The whole of it, as Python writes a traceback.
    """

    def __init__(self, message: str, details: str = "") -> None:
        super().__init__(message)
        self.details = details


class SolveError(PorocoreError):
    """The macroscale problem could not be solved; a cell that cannot be solved is a status instead."""
