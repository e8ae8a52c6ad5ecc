"""``porocore sweep``: results of a body over one or two parameters of its cell; values from text."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import typer

from porocore.cli import options
from porocore.cli.common import chosen_store, claim, in_units_of, located, page, plain_table, read_config
from porocore.core.console import Console
from porocore.core.echo import comma_advice, echo
from porocore.errors import ConfigurationError

if TYPE_CHECKING:
    from porocore.core.units import Scales
    from porocore.study.config.config import RunConfig
    from porocore.study.run.composition import LawKind
    from porocore.study.sweep.plan import SweepPlan
    from porocore.study.sweep.results import ParameterSweep

_SUCH_AS = "a parameter and its values, such as radius=0.16:0.28:7 or radius=0.16,0.2,0.28"
#: Results that are printed, by whether the settlement is one.
_PRINTED = {
    True: ("porosity", "final_settlement", "time_to_95_percent", "max_pressure", "flagged_largest"),
    False: ("porosity", "peak", "final", "max_pressure", "flagged_largest"),
}


def sweep(
    config: options.ConfigArgument = None,
    over: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=VALUES",
            help="Number of the cell and its values: LOW:HIGH:COUNT, or a list with commas; with scales they may have "
            "units. Twice for the plane of two numbers.",
            show_default=False,
        ),
    ] = None,
    fem: options.FemOption = None,
    macro: options.MacroOption = None,
    surrogate: options.SurrogateOption = None,
    closure: options.ClosureOption = None,
    law: options.LawOption = None,
    executor: options.ExecutorOption = None,
    scheduler: options.SchedulerOption = None,
    out: options.OutOption = None,
    resume: options.ResumeOption = False,
    store: options.StoreOption = None,
    no_store: options.NoStoreOption = False,
) -> None:
    """Solve the body for each value of a number of its cell, such as the radius of its pores.

    The number becomes a range, unless it is one. The cells of this family are sampled and learned once; then the body
    is solved for each value. Writes sweep.csv, with one row a value, sweep.png and sweep.svg to the run folder of the
    family. Other ranges of the cell need values in macro.fields. --resume continues, also with more values between
    the same ends.
    """
    from porocore.study.notes.checks import check_backends
    from porocore.study.run.composition import USUAL_LAWS
    from porocore.study.sweep.run import require_sweep_laws, run_sweep

    path, settings = read_config(config, fem, surrogate, closure, macro)
    laws: tuple[LawKind, ...] = tuple(kind.value for kind in law) if law else USUAL_LAWS
    require_sweep_laws(laws)
    with located(path):
        plan = parse_over(over or [], settings.with_executor(executor, scheduler))
        check_backends(plan.family)
    kept = chosen_store(store, no_store)
    folder = claim(path.with_name(path.stem + plan.suffix), plan.family, out, resume)
    with located(path), in_units_of(settings.result_units), folder:
        found = run_sweep(folder, plan, console=Console(), laws=laws, store=kept)
        print_sweep(found)
    for written in (found.table, *found.pictures):
        typer.echo(written)


#: What to vary in the place of the pore size, which is a scale.
OF_THE_PORE = (
    "expected a parameter of the cell; the size of the pore is a scale, and only the time, which goes with viscosity "
    "over its square, depends on it: '--over viscosity=...' has the same effect, or run copies of the study with "
    "another scales.pore"
)


def parse_over(texts: Sequence[str], settings: RunConfig) -> SweepPlan:
    """Return the plan of a sweep from the values of ``--over``.

    Raises
    ------
    ConfigurationError
        A text cannot be read, a name is unknown, or the values are no plan.
    """
    from porocore.cell.family.family import require_known
    from porocore.study.sweep.plan import SweepPlan, quantities_of

    if not texts:
        raise ConfigurationError(f"--over: expected {_SUCH_AS}, got nothing")
    quantities, found = quantities_of(settings.cell), dict[str, list[float]]()
    try:
        for text in texts:
            name, equals, values = (part.strip() for part in text.partition("="))
            if not (name and equals and values):
                raise ConfigurationError(f"expected {_SUCH_AS}, got {echo(text)}")
            if name == "pore" and name not in quantities:
                raise ConfigurationError(f"pore: {OF_THE_PORE}")
            require_known([name], [*quantities])
            if name in found:
                raise ConfigurationError(f"'{name}' is there twice")
            found[name] = _values(name, values, quantities[name], settings.scales)
        return SweepPlan.over(settings, found)
    except ConfigurationError as error:
        advice = next(filter(None, (comma_advice(text.partition("=")[2]) for text in texts)), "")
        raise ConfigurationError(
            "\n".join(f"--over: {line}{advice}" for line in str(error).splitlines())
        ) from None


def _values(name: str, text: str, quantity: str, scales: Scales | None) -> list[float]:
    """Return the values of a text such as ``0.16:0.28:7`` or ``0.16,0.2,0.28``."""
    from porocore.study.sweep.plan import MOST_VALUES

    low, *others = text.split(":")
    if not others:
        _require_commas(name, text)
        return [_value(name, part, quantity, scales) for part in text.split(",")]
    try:
        high, count = others
        number = int(count)
    except ValueError:
        raise ConfigurationError(
            f"{name}: expected LOW:HIGH:COUNT, such as 0.16:0.28:7, got {echo(text)}"
        ) from None
    if not 2 <= number <= MOST_VALUES:
        raise ConfigurationError(f"{name}: expected a COUNT from 2 to {MOST_VALUES}, got {echo(number)}")
    ends = [_value(name, end, quantity, scales) for end in (low, high)]
    if not ends[0] < ends[1]:
        raise ConfigurationError(f"{name}: expected LOW:HIGH:COUNT with LOW below HIGH, got {echo(text)}")
    low_end, high_end = ends
    return [low_end + (high_end - low_end) * k / (number - 1) for k in range(number)]


#: Signs that stand between two numbers in the place of a colon or a comma.
_BETWEEN = re.compile(r"(?<=\d)\s*(?:[-–;/]|\.\.|\bto\b)\s*(?=[\d.])")


def _require_commas(name: str, text: str) -> None:
    """Refuse a range or a list with other signs between its numbers."""
    parts = _BETWEEN.split(text.strip())
    if len(parts) > 1 and "," not in text:
        raise ConfigurationError(
            f"{name}: expected LOW:HIGH:COUNT or values with commas between them, such as {parts[0]}:{parts[-1]}:5 or "
            f"{','.join(parts)}, got {echo(text)}"
        )


def _value(name: str, text: str, quantity: str, scales: Scales | None) -> float:
    """Return the dimensionless number of a text, which may have a unit where its quantity has."""
    from porocore.core.units import UnitError, value_of

    try:
        value = value_of(text, quantity, scales) if quantity else float(text)
        if not math.isfinite(value):
            raise ConfigurationError(f"{name}: expected a finite number, got {echo(text.strip())}")
        return value
    except UnitError as error:
        raise ConfigurationError(f"{name}: {error}") from None
    except ValueError:
        raise ConfigurationError(
            f"{name}: expected a number, got {echo(text.strip())}{comma_advice(text)}"
        ) from None


def print_sweep(sweep: ParameterSweep) -> None:
    """Print the main results of each value; of several loads under that which is largest in size."""
    units, mode = sweep.units, sweep.loading_mode
    names = []
    for name in _PRINTED[mode.settles]:
        if name == "final_settlement" and not sweep.moves_along_y:
            name = "largest_displacement"
        whole = f"{mode.displaced[0]}: {name}" if name in ("peak", "final") else name
        whole = whole if name == "porosity" else sweep.named(whole)
        names += [whole] if whole in sweep.figures else []
    headings = [units.titled(each.name, each.quantity) for each in sweep.plan.swept]
    headings += [units.titled(name, sweep.quantity(name)) for name in names]
    table = plain_table(headings, range(len(headings)))
    for k, values in enumerate(sweep.values):
        row = [
            f"{units.value(x, each.quantity):.6g}" for x, each in zip(values, sweep.plan.swept, strict=True)
        ]
        results = [float(sweep.figures[name][k]) for name in names]
        table.add_row(*row, *(f"{x:.4g}" if math.isfinite(x) else "–" for x in results))
    page().print(table)
