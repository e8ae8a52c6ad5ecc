"""List of the publication's figures, each with what it needs and the function that draws it.

They are numbered as in the paper. Figures 1, 10 and 12 are sketches and hold no results.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from porocore.core.echo import echo
from porocore.errors import ConfigurationError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from porocore.commands.reproduce.study import Results

Stage = Literal["fields", "sensitivity", "column"]
SKETCHES = (1, 10, 12)


@dataclass(frozen=True)
class PaperFigure:
    """One panel of a figure.

    Attributes
    ----------
    number, panel
        Such as 13 and ``"a"``; the panel is empty where there is one only.
    label
        Of the paper's source.
    shows
        In words.
    stage
        What must be computed for it.
    draw
        Of ``column``; the other stages draw their pictures themselves, named by the label.
    """

    number: int
    panel: str
    label: str
    shows: str
    stage: Stage
    draw: Callable[[Results], Figure] | None = None

    @property
    def name(self) -> str:
        """Number and panel."""
        return f"{self.number}{self.panel}"

    @property
    def file(self) -> str:
        """Name of its PNG."""
        return f"figure-{self.number:02d}{self.panel}.png"


def _fields(number: int, state: str, load: str) -> list[PaperFigure]:
    shows = (f"|u¹| on the deformed cell under {load}", f"Ψ on the undeformed cell under {load}")
    return [
        PaperFigure(number, panel, f"{kind}_{state}", text, "fields")
        for panel, kind, text in zip("ab", ("disp", "energy"), shows, strict=True)
    ]


def _sensitivity(number: int, panel: str, label: str, shows: str) -> PaperFigure:
    return PaperFigure(number, panel, label, shows, "sensitivity")


def _column(
    number: int, panel: str, label: str, shows: str, draw: str, *args: object, **how: object
) -> PaperFigure:
    def made(results: Results) -> Figure:
        from porocore.commands.reproduce import column_figures

        figure: Figure = getattr(column_figures, draw)(results, *args, **how)
        return figure

    return PaperFigure(number, panel, label, shows, "column", made)


def _both_loads(number: int, label: str, shows: str, draw: str, quantity: str) -> list[PaperFigure]:
    return [
        _column(number, panel, f"{label}{suffix}", f"{shows}, P = {load:g}", draw, quantity, load)
        for panel, load, suffix in (("a", -0.2, "02"), ("b", -0.01, "001"))
    ]


FIGURES: tuple[PaperFigure, ...] = (
    *_fields(2, "pressure", "pore pressure"),
    *_fields(3, "uni", "H_11"),
    *_fields(4, "shear", "H_12"),
    _sensitivity(5, "a", "dyu1_Av_1", "average of ∇u¹, components with the indices of the load"),
    _sensitivity(5, "b", "dyu1_Av_2", "average of ∇u¹, other components"),
    _sensitivity(6, "a", "dyu1_max_1", "largest |∇u¹|, components with the indices of the load"),
    _sensitivity(6, "b", "dyu1_max_2", "largest |∇u¹|, other components"),
    _sensitivity(7, "a", "psi_Av", "average of Ψ"),
    _sensitivity(7, "b", "psi_max", "largest Ψ"),
    _sensitivity(8, "a", "K11", "K_t,11 by its initial value"),
    _sensitivity(8, "b", "K22", "K_t,22 by its initial value"),
    _sensitivity(9, "a", "Mijkl_reference", "M in the reference configuration"),
    _sensitivity(9, "b", "Mijkl_deformed", "M multiplied by Ĵ"),
    _sensitivity(9, "c", "Q_11", "Q, in the reference configuration and multiplied by Ĵ"),
    _sensitivity(9, "d", "Biot_Modulus", "Biot modulus, in both forms"),
    _column(11, "", "ANN_test", "network against the cell on states that it never saw", "network_test"),
    *_both_loads(13, "T_SettlementMax", "largest settlement against time", "history", "settlement"),
    *_both_loads(14, "T_PorepressureMax", "largest pore pressure against time", "history", "pressure_max"),
    *_both_loads(15, "T_DrainedFluid", "drained volume against time", "history", "drained_paper"),
    _column(16, "a", "y_K22", "K_t,22 along the column", "conductivity", "22"),
    _column(16, "b", "y_K11", "K_t,11 along the column", "conductivity", "11"),
    *_both_loads(17, "y_Porepressure", "pore pressure along the column", "along_column", "p"),
    *_both_loads(18, "y_Settlement", "settlement along the column", "along_column", "settlement"),
    _column(19, "", "y_dxu022", "∂u_2/∂X_2 along the column", "along_column", "H22"),
    _column(20, "a", "y_dyu122", "⟨∇u¹⟩_22 along the column", "along_column", "mean_grad_22"),
    _column(20, "b", "y_dyu111", "⟨∇u¹⟩_11 along the column", "along_column", "mean_grad_11"),
    _column(21, "a", "y_F022", "F̄_22 along the column", "along_column", "F22", linear=False),
    _column(21, "b", "y_F011", "F̄_11 along the column", "along_column", "F11", linear=False),
    _column(22, "a", "y_w02", "relative fluid velocity along the column", "velocity", transformed=False),
    _column(22, "b", "y_w_tr02", "relative fluid velocity and transformed one", "velocity", transformed=True),
    _column(23, "a", "y_M2222", "M_2222 along the column", "tangent", "M_2222"),
    _column(23, "b", "y_M2211", "∂⟨∇u¹⟩_11/∂H_22 along the column", "tangent", "M_2211"),
    _column(23, "c", "y_Q22", "Q_22 along the column", "tangent", "Q_22"),
    _column(23, "d", "y_Q11", "Q_11 along the column", "tangent", "Q_11"),
)


def select_figures(wanted: Sequence[str] | None) -> tuple[PaperFigure, ...]:
    """The figures with these numbers, ``13`` or ``13a``; all for None.

    Raises
    ------
    ConfigurationError
        There is no such figure.
    """
    if not wanted:
        return FIGURES
    found: list[PaperFigure] = []
    for name in wanted:
        which = [figure for figure in FIGURES if name.lower() in (str(figure.number), figure.name)]
        if not which:
            numbers = sorted({figure.number for figure in FIGURES})
            raise ConfigurationError(
                f"--figure: there is no figure {echo(name)} to be computed; expected one of "
                f"{', '.join(map(str, numbers))}, with or without its panel, such as 13 or 13a "
                f"(figures {', '.join(map(str, SKETCHES))} are sketches)"
            )
        found += [figure for figure in which if figure not in found]
    return tuple(found)
