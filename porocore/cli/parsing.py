"""Groups of commands, with those of plugins; messages that say what commands, options and values there are."""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Callable, Mapping
from functools import wraps
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar

import typer
from typer.core import TyperCommand, TyperGroup

from porocore.cli.common import interruptible, shell_line
from porocore.core.echo import choices, cut, did_you_mean, echo, joined, suggestion, without_long_words
from porocore.errors import PluginError

if TYPE_CHECKING:
    from porocore.plugins.discovery import Offered

#: Heading of the commands that other packages offer.
OF_PLUGINS = "Commands of plugins"
#: Names, without their dashes, under which a run folder is given to commands that take it as an argument.
OF_A_FOLDER = ("o", "out", "output", "output-dir", "dir", "folder", "run", "in")
#: Similarity of an option that is meant.
LIKE = 0.75


class Commands(TyperGroup):
    """Group of commands, with those that plugins offer; it names them all where it does not know one."""

    #: Heading of a command on the help page.
    panels: ClassVar[Mapping[str, str]] = MappingProxyType({})

    @property
    def group(self) -> str:
        """Name by which offers mean this group."""
        return self.name or ""

    def find(self, name: str) -> Any:
        """Return the command of that name, loaded if a plugin offers it; None without one."""
        if name in self.commands:
            return self.commands[name]
        from porocore.plugins.hookspecs import NAME
        from porocore.plugins.registry import find_command

        if not NAME.fullmatch(name):
            return None
        found = find_command(lambda offer: (offer.group, offer.name) == (self.group, name))
        return None if found is None else self._loaded(found)

    def offered(self, own: bool = False) -> dict[str, Offered]:
        """Return the offers of commands of this group by name, or only those of porocore itself."""
        from porocore.plugins import registry
        from porocore.plugins.hookspecs import CommandOffer

        found: dict[str, Offered] = {}
        for offered in (registry.own() if own else registry.registry()).offers:
            if isinstance(offered.offer, CommandOffer) and offered.offer.group == self.group:
                found.setdefault(offered.offer.name, offered)
        return found

    def load(self) -> None:
        """Load the commands that porocore itself offers, here and in the groups below, in the order of the help."""
        for name, offered in self.offered(own=True).items():
            self.commands.setdefault(name, self._loaded(offered))
        self.commands = {name: self.commands[name] for name in self._sorted(self.commands)}
        for command in self.commands.values():
            if isinstance(command, Commands):
                command.load()

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of all commands."""
        return self._sorted([*self.offered(), *self.commands])

    def get_command(self, ctx: Any, name: str) -> Any:
        """Return a command; of one that is not loaded only what the help page of the group shows."""
        if name in self.commands:
            return self.commands[name]
        summary = self.offered()[name].offer.summary
        return TyperCommand(name, help=summary, rich_help_panel=self._panel(name))

    def _panel(self, name: str) -> str | None:
        return self.panels.get(name, OF_PLUGINS) if self.panels else None

    def _sorted(self, names: Any) -> list[str]:
        order = list(self.panels)
        return sorted(
            dict.fromkeys(names), key=lambda name: order.index(name) if name in order else len(order)
        )

    def _loaded(self, offered: Offered) -> Any:
        from porocore.plugins.foreign_code import reason_of
        from porocore.plugins.registry import make_command

        name, made = offered.offer.name, typer.Typer(rich_markup_mode="markdown", add_completion=False)
        run = _interruptible(make_command(offered).run)
        made.command(name, rich_help_panel=self._panel(name))(run)
        try:
            return typer.main.get_command(made)
        except Exception as error:  # foreign code
            raise PluginError(
                f"command '{name}' of {offered.source} has arguments that typer cannot read: {reason_of(error)} "
                f"({offered.source.file}); report this to its authors"
            ) from error

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return name, command and further words; fail with the names of the commands."""
        name = args[0]
        found = self.find(name)
        if found is not None:
            return name, found, args[1:]
        if not name.startswith("-") and not ctx.resilient_parsing:
            what = (
                f"a file is given behind a command, as in 'porocore run {cut(name)}'; "
                if Path(name).is_file()
                else ""
            )
            known = suggestion(name, self.list_commands(ctx), "the commands are")
            ctx.fail(f"There is no command {echo(name)}; {what}{known}")
        return super().resolve_command(ctx, args)


def _interruptible(run: Callable[..., None]) -> Callable[..., None]:
    """Return a command that acknowledges Ctrl-C and says how to go on: as it was called, with ``--resume`` if known."""
    resumes = "resume" in inspect.signature(run).parameters

    @wraps(run)
    def guarded(*arguments: Any, **options: Any) -> None:
        again = ["porocore", *sys.argv[1:]]
        again += ["--resume"] if resumes and "--resume" not in again else []
        with interruptible(shell_line(again)):
            run(*arguments, **options)

    return guarded


def command_group(what: str, **settings: Any) -> typer.Typer:
    """Return a group of commands with the look that all of them have."""
    return typer.Typer(
        help=what,
        cls=settings.pop("cls", Commands),
        pretty_exceptions_enable=False,
        rich_markup_mode="markdown",
        context_settings={"help_option_names": ["-h", "--help"]},
        **settings,
    )


class Program(Commands):
    """The group of all commands; its parser's messages are in plain words, and long words in them are cut."""

    group = ""

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
        advice = "words with blanks in them stand in quotes"
        if all("=" in word[1:] for word in extra[1].split()):
            over = any("--over" in param.opts for param in command.params)
            advice = (
                f"a parameter and its values follow an option: --over {cut(extra[1])}"
                if over
                else "a comma stands between values by name, and no blank"
            )
        return f"Expected {few}, got {echo(extra[1])}, too; {advice}"
    if (faults := getattr(error.__cause__, "errors", None)) is not None:
        from porocore.core.models.strict import fault_text  # Pydantic is slow to import.

        return fault_text(faults()[0])
    return message
