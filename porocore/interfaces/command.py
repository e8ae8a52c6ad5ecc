"""Interface of a command: its function for the command line, its section of a study, its call from Python."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from porocore.core.files.yaml_document import YamlDocument
    from porocore.core.models.strict import StrictModel


@dataclass(frozen=True)
class FileCheck:
    """Outcome of a command's check of a file.

    Attributes
    ----------
    lines
        Lines for the outline of the study.
    options
        Options with which the command is called next, by name.
    """

    lines: Sequence[str] = ()
    options: Mapping[str, Any] = field(default_factory=dict)


class Command(ABC):
    """A command of the command line. An object is made without arguments where one is needed."""

    @abstractmethod
    def run(self, *args: Any, **kwargs: Any) -> None:
        """Run the command.

        The parameters are its arguments and options, declared as for typer; the docstring is its help page, in which
        numbers have their units. Results are printed with ``typer.echo``, and files are written whole or not at all
        into a folder of the command's own, the option ``--out``.

        Raises
        ------
        ConfigurationError
            An argument, an option or the study cannot be used.
        RunFolderError
            The folder holds other files, or these results while ``--resume`` is not given.
        """

    def section(self) -> type[StrictModel] | None:
        """Return the model of the command's section in a study; None: it has none.

        The docstring below each field describes its key in the JSON schema.
        """
        return None

    def check(self, document: YamlDocument, config: Any, settings: Any) -> FileCheck:
        """Check the command's part of a file for ``porocore check``, before anything long is computed.

        Parameters
        ----------
        document
            The file.
        config
            The study (``porocore.RunConfig``); None for a file of the command's own.
        settings
            The section as :meth:`section` has it; None for a file of the command's own.

        Raises
        ------
        ConfigurationError
            Something does not fit; each line of the message begins with a key.
        """
        return FileCheck()

    def call(self, study: Any, *args: Any, **kwargs: Any) -> Any:
        """Return the results for a ``porocore.Study``, as ``study.NAME(...)``; by default there is no such call."""
        raise NotImplementedError
