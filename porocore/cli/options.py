"""Declarations of arguments and options that several commands have."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer


class LawName(StrEnum):
    """Laws of the body that ``--law`` takes."""

    surrogate = "surrogate"
    linear = "linear"
    direct = "direct"


#: Reactions of a macro run to leaving the sampled range.
FallbackName = StrEnum("FallbackName", ["none", "direct"])
#: Places where cells are solved.
ExecutorName = StrEnum("ExecutorName", ["auto", "serial", "processes", "dask"])

ConfigArgument = Annotated[
    Path | None,
    typer.Argument(metavar="CONFIG", help="Configuration (YAML).", show_default="the packaged benchmark"),
]
RunArgument = Annotated[Path, typer.Argument(metavar="RUN", help="Run folder.", show_default=False)]
FemOption = Annotated[
    str | None,
    typer.Option("--fem", metavar="NAME", help="Finite-element backend, instead of the configured one."),
]
MacroOption = Annotated[
    str | None,
    typer.Option("--macro", metavar="NAME", help="Backend of the macroscale, if not that of the cell."),
]
SurrogateOption = Annotated[
    str | None,
    typer.Option("--surrogate", metavar="NAME", help="Surrogate backend, instead of the configured one."),
]
ClosureOption = Annotated[
    str | None,
    typer.Option(
        "--closure", metavar="NAME", help="mean-gradient or potential, instead of the configured one."
    ),
]
LawOption = Annotated[
    list[LawName] | None,
    typer.Option(
        "--law",
        "--laws",
        metavar="LAW",
        help="surrogate, linear or direct (the cell itself, at every point). Repeatable.",
        show_default="surrogate and linear",
    ),
]
FallbackOption = Annotated[
    FallbackName,
    typer.Option(
        "--fallback",
        help="direct: where the body leaves the sampled states, solve the cell, learn from it and go on. "
        "This law is added to the others.",
    ),
]
ExecutorOption = Annotated[
    ExecutorName | None,
    typer.Option("--executor", help="Place where the cells are solved, instead of the configured one."),
]
SchedulerOption = Annotated[
    str | None,
    typer.Option(
        "--scheduler",
        metavar="ADDRESS",
        help="Address of a dask scheduler, such as tcp://node:8786. Without one, --executor dask starts workers here.",
    ),
]
WorkersOption = Annotated[
    int | None,
    typer.Option(metavar="N", help="Processes.", show_default="as configured for sampling"),
]
OutOption = Annotated[
    Path | None,
    typer.Option("--out", metavar="DIR", help="Run folder.", show_default="runs/<name of the configuration>"),
]
StoreOption = Annotated[
    Path | None,
    typer.Option(
        "--store",
        metavar="DIR",
        help="Folder of results that studies share; what it holds is not computed again.",
        show_default="in the user's cache folder",
    ),
]
NoStoreOption = Annotated[bool, typer.Option("--no-store", help="Neither use nor fill the store.")]
ResumeOption = Annotated[bool, typer.Option("--resume", help="Continue the work that the folder holds.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON object.")]

SeveralFemOption = Annotated[
    list[str] | None,
    typer.Option("--fem", metavar="NAME", help="Only this finite-element backend. Repeatable."),
]
