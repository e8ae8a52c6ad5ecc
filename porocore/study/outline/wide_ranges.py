"""Notes before a run on sampled ranges that are much wider than what a body reaches, or that it does not need."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from porocore.core.inputs.input_space import NAMES, components
from porocore.states import MacroState
from porocore.study.config.config import RunConfig
from porocore.study.findings.reach import MINUS, written

#: Ranges so many times as wide as what is reached are noted: ample ones of the examples are 7, since pressures between
#: the few steps are higher by a third; a component below the smallest share of its range is zero.
WIDE, SMALLEST = 10.0, 1e-4
#: Beyond what the linear solution reaches, the proposed range goes by this share of it.
MARGIN = 0.5

#: Ends of what a cell reaches, zero included, by input.
Extents = Mapping[str, tuple[float, float]]


def extents(config: RunConfig, found: Sequence[MacroState]) -> Extents:
    """Return the least and largest value of each input of one cell in some states, zero included."""
    inputs, states = config.sampling.input_space(), MacroState.concatenate(list(found))
    if config.surrogate_model == "potential":
        states = inputs.without_rotation(states)
    rows = components(states)
    values = {name: rows[NAMES.index(name)] for name in inputs.names}
    return {name: (min(0.0, float(row.min())), max(0.0, float(row.max()))) for name, row in values.items()}


def too_wide(
    config: RunConfig, cell: str | None, reached: Mapping[str | None, Extents], left: Sequence[str]
) -> Iterator[str]:
    """Yield a note on the inputs of a cell that the body does not move, and on ranges that are much too wide.

    Parameters
    ----------
    config
        Configuration of the body of all cells.
    cell
        Name of the cell; None is that of the rest of the body, whose inputs are those of all cells.
    reached
        What each cell reaches.
    left
        Inputs whose ranges the cell leaves.
    """
    key = "sampling.inputs" if cell is None else f"sampling.cells.{cell}.inputs"
    inputs, units = config.of_cell(cell).sampling.input_space(), config.result_units
    widths = [upper - lower for lower, upper in zip(inputs.lower, inputs.upper, strict=True)]
    still = SMALLEST * min(widths)  # so that it is negligible next to the inputs that are left
    lines, idle = [], []
    for name, *ends in zip(inputs.names, inputs.lower, inputs.upper, strict=True):
        least = SMALLEST * (ends[1] - ends[0])
        heirs = {each: reached[each][name] for each in _heirs(config, name)} if cell is None else {}
        low, high = reached[cell][name]
        if high - low <= least:
            if high - low <= still:
                idle.append((name, [each for each, (below, above) in heirs.items() if above - below > still]))
            continue
        low = min(low, *(below for below, _ in heirs.values())) if heirs else low
        high = max(high, *(above for _, above in heirs.values())) if heirs else high
        times = (ends[1] - ends[0]) / (high - low)
        if name in left or times <= WIDE:
            continue
        more = MARGIN * (high - low)  # at both ends: the law of the cell may turn a sign
        texts = [written(name, end, units) for end in (max(low - more, ends[0]), min(high + more, ends[1]))]
        reaches = f"{written(name, low, units)} to {written(name, high, units)}".translate(MINUS)
        lines.append(
            f"  {name}: {{range: [{', '.join(texts)}]}}, since {name} reaches {reaches} and is sampled {times:.0f} "
            "times as wide"
        )
    if lines:
        yield (
            f"note: by linear poroelasticity the body uses less than one part in {WIDE:g} of a range, and states are "
            f"spent where it never comes; write under '{key}:'"
        )
        yield from lines
    yield from _idle(config, cell, key, idle)


def _heirs(config: RunConfig, name: str) -> Iterator[str]:
    """Yield the named cells whose range of an input is that of ``sampling.inputs``."""
    own = config.sampling.cells
    return (each for each in config.cells if each not in own or name not in own[each].inputs)


def _idle(
    config: RunConfig, cell: str | None, key: str, idle: Sequence[tuple[str, list[str]]]
) -> Iterator[str]:
    """Yield what to do with inputs that stay zero, each with the other cells that need it, where something helps."""
    kept = len(config.sampling.inputs) - len(idle)
    for name, needed in idle:
        if cell is not None and name in config.sampling.inputs:
            continue  # a cell cannot be without what is sampled for all
        if cell is None and not kept:
            continue
        if needed:
            places = " and ".join(f"'sampling.cells.{each}.inputs:'" for each in needed)
            what = f"move {name} from '{key}:' to {places}: the body moves it in no other cell"
        else:
            what = f"remove {name} from '{key}:': the body does not move it"
        yield f"note: {what}, by linear poroelasticity; keep it where large strains may"
