"""The directive ``commands``: every command with its arguments and options, as the command line tells them."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from typing import Any

from docutils import nodes
from sphinx.util.docutils import SphinxDirective

from porocore.cli.entry import whole_program


def document() -> str:
    """All commands as Markdown: a heading for each panel of ``porocore --help``, and one for each command."""
    parts, panel = [], ""
    for name, command in whole_program().commands.items():
        if command.rich_help_panel != panel:
            panel = command.rich_help_panel
            parts.append(f"## {panel}")
        parts += _below(("porocore", name), command)
    return "\n\n".join(parts)


def _below(path: tuple[str, ...], command: Any) -> Iterator[str]:
    """A command, or a group with its commands."""
    commands = getattr(command, "commands", {})
    yield f"### {' '.join(path)}"
    yield inspect.cleandoc(command.help or "") if commands else page(path, command)
    for name, below in commands.items():
        yield from _below((*path, name), below)


def page(path: tuple[str, ...], command: Any) -> str:
    """One command as Markdown, without its heading."""
    arguments = [p for p in command.params if p.param_type_name == "argument" and not p.hidden]
    usage = " ".join([*path, "[OPTIONS]", *map(_usage, arguments)])
    parts = [f"```none\n{usage}\n```", inspect.cleandoc(command.help or "")]
    for title, kind in (("argument", "argument"), ("option", "option")):
        listed = [_row(p) for p in command.params if p.param_type_name == kind and not p.hidden]
        if listed:
            parts.append("\n".join([f"| {title} | default | meaning |", "|---|---|---|", *listed]))
    if command.epilog:
        parts.append(inspect.cleandoc(command.epilog))
    return "\n\n".join(parts)


def _value(parameter: Any) -> str:
    return parameter.metavar or parameter.name.upper()


def _usage(argument: Any) -> str:
    several = "..." if argument.nargs == -1 and "…" not in _value(argument) else ""
    return f"{_value(argument)}{several}" if argument.required else f"[{_value(argument)}]{several}"


def _row(parameter: Any) -> str:
    if parameter.param_type_name == "argument":
        name = f"`{_value(parameter)}`"
    else:
        spellings = [*parameter.opts, *parameter.secondary_opts]
        takes = "" if parameter.is_flag else f" {_value(parameter)}"
        name = "`" + "`, `".join(spellings) + f"{takes}`"
    default = parameter.default
    if parameter.required:
        shown = "required"
    elif isinstance(parameter.show_default, str):
        shown = parameter.show_default.replace("<", "‹").replace(">", "›")
    elif default is None or default is False or callable(default) or default in ((), []):
        shown = ""
    else:
        shown = f"`{default if default is not True else spellings[0]}`"
    meaning = re.sub(r"\s+", " ", (parameter.help or "")).strip()
    return " | ".join(["", name.replace("|", r"\|"), shown, meaning.replace("|", r"\|"), ""]).strip()


class Commands(SphinxDirective):
    """All commands, each below a heading."""

    def run(self) -> list[nodes.Node]:
        return self.parse_text_to_nodes(document(), allow_section_headings=True)


def setup(app: Any) -> dict[str, Any]:
    app.add_directive("commands", Commands)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
