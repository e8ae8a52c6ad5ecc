"""``porocore units``: dimensionless results in SI units."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from porocore.cli.tables import page, plain_table
from porocore.core.echo import echo
from porocore.core.models.bounds import LARGEST_NUMBER
from porocore.errors import ConfigurationError

if TYPE_CHECKING:
    from porocore.core.units.scales import Scales


def units(
    values: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="QUANTITY=VALUE",
            help="Dimensionless values, such as time=38 pressure=0.2.",
            show_default="1 of every quantity",
        ),
    ] = None,
    scenario: Annotated[
        list[str] | None,
        typer.Option(
            "--scenario", metavar="NAME", help="brain-tissue or soil. Repeatable.", show_default="both"
        ),
    ] = None,
    force: Annotated[
        float | None, typer.Option(metavar="N", help="Force f_c of your own scenario; E is f_c/L².")
    ] = None,
    pore: Annotated[float | None, typer.Option(metavar="M", help="Its pore size d.")] = None,
    length: Annotated[float | None, typer.Option(metavar="M", help="Its length L.")] = None,
    viscosity: Annotated[float, typer.Option(metavar="PA_S", help="Its viscosity μ_c.")] = 1.0,
) -> None:
    """Convert dimensionless results to SI units.

    The scenarios of the paper are brain tissue and soil; four characteristic values give any other.
    """
    from porocore.core.units.scales import QUANTITIES, known_quantity

    scenarios = _scenarios(scenario, force, pore, length, viscosity)
    wanted = [_value(text) for text in values or [f"{name}=1" for name in QUANTITIES]]
    headings = ("quantity", "dimensionless", *scenarios, "unit", "scale")
    table = plain_table(headings, range(1, len(headings) - 2))
    for name, value in wanted:
        quantity = known_quantity(name)
        found = [f"{value * scales.factor(name):.4g}" for scales in scenarios.values()]
        table.add_row(name, f"{value:g}", *found, quantity.unit, quantity.formula)
    page().print(table)


def _scenarios(
    names: list[str] | None, force: float | None, pore: float | None, length: float | None, viscosity: float
) -> dict[str, Scales]:
    from porocore.core.units.scales import LARGEST, SCENARIOS, SMALLEST, Scales, known_scenario

    own = {"--force": force, "--pore": pore, "--length": length}
    given = [name for name, value in own.items() if value is not None]
    found = {name: known_scenario(name) for name in names or ()}
    if given:
        missing = [name for name in own if name not in given]
        if missing:
            raise ConfigurationError(
                f"a scenario needs --force, --pore and --length; {' and '.join(missing)} "
                f"{'is' if len(missing) == 1 else 'are'} missing"
            )
        for name, value in (*own.items(), ("--viscosity", viscosity)):
            if value is None or not SMALLEST <= value <= LARGEST:
                raise ConfigurationError(
                    f"{name}: expected a number from {SMALLEST:g} to {LARGEST:g}, got {value:g}"
                )
        found["yours"] = Scales(force=force or 0, pore=pore or 0, length=length or 0, viscosity=viscosity)
    return found or dict(SCENARIOS)


def _value(text: str) -> tuple[str, float]:
    name, _, number = text.partition("=")
    try:
        value = float(number)
        if not abs(value) <= LARGEST_NUMBER:
            raise ValueError
    except ValueError:
        raise ConfigurationError(
            f"expected a quantity and its dimensionless value, such as time=38, got {echo(text)}"
        ) from None
    return name, value
