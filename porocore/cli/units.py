"""``porocore units``: dimensionless results in SI units, and values with units dimensionless."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from porocore.cli.common import page, plain_table
from porocore.core.echo import comma_advice, echo
from porocore.core.models.bounds import LARGEST_NUMBER
from porocore.errors import ConfigurationError

if TYPE_CHECKING:
    from porocore.core.units import ResultUnits, Scales


def units(
    values: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[CONFIG] QUANTITY=VALUE",
            help="Configuration that has the scales, if any; then values: dimensionless ones such as time=38, or "
            "ones with a unit such as 'p=1 kPa', where there is one set of scales.",
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
    viscosity: Annotated[
        float | None, typer.Option(metavar="PA_S", help="Its viscosity μ_c.", show_default="1")
    ] = None,
) -> None:
    """Convert dimensionless results to SI units, and values with units to dimensionless numbers.

    The scales are those of a configuration, whose output_units are shown, too; those of the paper's brain tissue and
    soil; or four characteristic values of your own.
    """
    from porocore.core.units import QUANTITIES, known_quantity

    texts = list(values or ())
    study = _study(texts.pop(0)) if texts and _is_configuration(texts[0]) else None
    own = any(option is not None for option in (force, pore, length, viscosity))
    if study is not None and (own or scenario):
        raise ConfigurationError(
            "expected either a configuration, which has scales of its own, or --scenario, --force, --pore, --length "
            "and --viscosity; got both"
        )
    if study is not None and study.scales is not None:
        scenarios = {"SI": study.scales}
    else:
        scenarios = _scenarios(scenario, force, pore, length, 1.0 if viscosity is None else viscosity)
    only = next(iter(scenarios.values())) if len(scenarios) == 1 else None
    wanted = [_value(text, only) for text in texts or [f"{name}=1" for name in QUANTITIES]]
    asked = () if study is None else ("output_units", "unit")
    headings = ("quantity", "dimensionless", *asked, *scenarios, "unit", "scale")
    table = plain_table(headings, [k for k in range(1, len(headings) - 2) if headings[k] != "unit"])
    for name, value in wanted:
        quantity = known_quantity(name)
        found = [f"{value * scales.factor(name):.4g}" for scales in scenarios.values()]
        mine = [] if study is None else [f"{value * study.factor(name):.4g}", study.name(name)]
        table.add_row(name, f"{value:.6g}", *mine, *found, quantity.unit, quantity.formula)
    page().print(table)


def _is_configuration(text: str) -> bool:
    """Return whether a word is the path of a configuration rather than a quantity without its value."""
    return "=" not in text and text.endswith((".yaml", ".yml"))


def _study(path: str) -> ResultUnits:
    """Return the units of a configuration, which has scales."""
    from porocore.study.config.loading import load_config

    found = load_config(path, cell_only=True).result_units
    if not found.given:
        raise ConfigurationError(
            f"{path}: expected 'scales:' with modulus, pore and length, got none; add them, or leave the configuration "
            "out and give --force, --pore and --length"
        )
    return found


def _scenarios(
    names: list[str] | None, force: float | None, pore: float | None, length: float | None, viscosity: float
) -> dict[str, Scales]:
    from porocore.core.units import LARGEST, SCENARIOS, SMALLEST, Scales, known_scenario

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


def _value(text: str, scales: Scales | None) -> tuple[str, float]:
    """Return the name and the dimensionless value; ``scales``, unless there are several, for values with units."""
    from porocore.core.units import UnitError, has_unit, quantity_name, value_of

    name, _, given = text.partition("=")
    if has_unit(given):
        if scales is None:
            raise ConfigurationError(
                f"{echo(text)} has a unit, and there are several scales; give a configuration, one --scenario, or "
                "--force, --pore and --length"
            )
        try:
            return name, value_of(given, quantity_name(name), scales)
        except UnitError as error:
            raise ConfigurationError(f"{echo(name)}: {error}") from None
    try:
        value = float(given)
        if not abs(value) <= LARGEST_NUMBER:
            raise ValueError
    except ValueError:
        raise ConfigurationError(
            f"expected a quantity and its dimensionless value, such as time=38, got {echo(text)}{comma_advice(given)}"
        ) from None
    return name, value
