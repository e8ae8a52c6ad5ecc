"""Groups of commands whose parser says what it knows: the commands, options and values there are, and near ones."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

from typer.core import TyperGroup

from porocore.core.echo import choices, cut, did_you_mean, echo, joined, suggestion, without_long_words

#: Names, without their dashes, under which a run folder is given to commands that take it as an argument.
OF_A_FOLDER = ("o", "out", "output", "output-dir", "dir", "folder", "run", "in")
#: Similarity of an option that is meant.
LIKE = 0.75


class Commands(TyperGroup):
    """Group of commands that names them all where it does not know one."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return name, command and further words; fail with the names of the commands."""
        name = args[0]
        if name not in self.commands and not name.startswith("-") and not ctx.resilient_parsing:
            what = (
                f"a file is given behind a command, as in 'porocore run {cut(name)}'; "
                if Path(name).is_file()
                else ""
            )
            ctx.fail(
                f"There is no command {echo(name)}; {what}{suggestion(name, self.commands, 'the commands are')}"
            )
        return super().resolve_command(ctx, args)


class Program(Commands):
    """The group of all commands; its parser's messages are in plain words, and long words in them are cut."""

    def make_context(self, info_name: str | None, args: list[str], parent: Any = None, **extra: Any) -> Any:
        """Return the context of the command line; see :class:`Program`."""
        try:
            return super().make_context(info_name, args, parent, **extra)
        except Exception as error:
            _put_plainly(error)
            raise

    def invoke(self, ctx: Any) -> Any:
        """Return what the command returns; see :class:`Program`."""
        try:
            return super().invoke(ctx)
        except Exception as error:
            _put_plainly(error)
            raise


def _put_plainly(error: Any) -> None:
    """Change the message of an error of the parser; other errors are left."""
    message = getattr(error, "message", None)
    if not isinstance(message, str) or not hasattr(error, "format_message"):
        return
    command = getattr(getattr(error, "ctx", None), "command", None)
    if command is not None:
        message = _plain(error, message, command)
    error.message = without_long_words(message, sys.argv[1:])


def _plain(error: Any, message: str, command: Any) -> str:
    option = getattr(error, "option_name", None)
    if error.format_message().startswith("Missing ") and not message:
        return str(getattr(error.param, "help", None) or "")
    if message.startswith("No such option") and option is not None:
        error.possibilities = None
        names = [name for param in command.params for name in param.opts if name.startswith("--")]
        question = did_you_mean(option, names, cutoff=LIKE)  # all share the dashes
        known = choices([*names, "--help"], "the options are")
        if option.lstrip("-") in OF_A_FOLDER and any(param.metavar == "RUN" for param in command.params):
            question = "the folder is the argument RUN, without an option;"
        return f"There is no option {cut(option)}; {question} {known}".replace(";  ", "; ")
    if extra := re.fullmatch(r"Got unexpected extra argument\(s\) \((.*)\)", message, re.DOTALL):
        takes = [param.metavar or param.name.upper() for param in command.params if param.opts[0][0] != "-"]
        few = f"only {joined(takes)} and options" if takes else "options only"
        return f"Expected {few}, got {echo(extra[1])}, too; words with blanks in them stand in quotes"
    if (faults := getattr(error.__cause__, "errors", None)) is not None:
        from porocore.core.models.strict import fault_text  # Pydantic is slow to import.

        return fault_text(faults()[0])
    return message
