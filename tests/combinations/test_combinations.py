"""Features together: rows by all pairs of their levels, each with the same answer from both backends."""

from __future__ import annotations

import os
import shutil
import time
from collections import Counter
from itertools import combinations

import pytest

from tests.combinations.levels import FACTORS
from tests.combinations.pairs import all_pairs, pairs_of
from tests.combinations.row_runs import SAME, run_row
from tests.combinations.table import FIGURES, PAGE, cells_of, factors
from tests.helpers.platform_parts import without

#: Of the slow test: how long it draws further rows, and by which seed; CI may turn to other rows by the variable.
MINUTES, SEED = 12, int(os.environ.get("POROCORE_COMBINATIONS_SEED", "1"))
#: Fixed rows, cheap ones; the first stands in every run of the suite.
SHORT = (
    {
        "pores": "one-channel",
        "material": "neo-hookean",
        "sampler": "sobol",
        "surrogate": "polynomial",
        "closure": "potential",
        "conductivity": "piola",
        "body": "wedge",
        "load": "plate",
        "time": "steps",
    },
    {
        "pores": "isotropic",
        "material": "expression",
        "sampler": "density-sweep",
        "surrogate": "torch",
        "closure": "mean-gradient",
        "conductivity": "deformed",
        "body": "column",
        "load": "flux",
        "time": "tolerance",
    },
)


def needs_dolfinx():
    """Skip without dolfinx and MPI, which CI has."""
    if not os.environ.get("CI") or without("dolfinx"):
        pytest.importorskip("dolfinx")
        if shutil.which("mpirun") is None:
            pytest.skip("mpirun is missing")


def hold(row, folder, **options):
    """Run a row, and hold it to the one answer."""
    outcome = run_row(row, folder, **options)
    assert not outcome.refused, (row, outcome.refused)
    assert outcome.cells < SAME, (row, outcome)
    assert outcome.bodies < SAME, (row, outcome)
    if options.get("processes", True):
        assert outcome.processes < SAME, (row, outcome)


def test_the_rows_hold_every_pair():
    rows = all_pairs(FACTORS)
    seen = Counter(pair for row in rows for pair in pairs_of(row))
    wanted = [((f, a), (g, b)) for f, g in combinations(FACTORS, 2) for a in FACTORS[f] for b in FACTORS[g]]
    assert set(seen) == set(wanted)
    assert len(rows) < 2 * max(len(a) * len(b) for a, b in combinations(FACTORS.values(), 2))


def test_the_page_has_every_row_of_today():
    text = PAGE.read_text(encoding="utf-8")
    assert factors() in text
    found = cells_of(text)
    rows = {tuple(row.values()) for row in all_pairs(FACTORS)}
    assert set(found) == rows
    for row, figures in found.items():
        assert all(float(figure) < SAME for figure in figures[: len(FIGURES)]), row


@pytest.mark.parametrize(
    "row",
    [SHORT[0], pytest.param(SHORT[1], marks=pytest.mark.slow)],
    ids=lambda row: f"{row['body']}-{row['load']}",
)
def test_short_rows(row, tmp_path):
    needs_dolfinx()
    hold(row, tmp_path, processes=False)


@pytest.mark.slow
def test_rows_drawn_by_a_seed(tmp_path):
    """As many rows as fit into the time; those of the first seeds were run whole, see docs/combinations.md."""
    needs_dolfinx()
    begun, longest, done = time.perf_counter(), 0.0, 0
    for number, row in enumerate(all_pairs(FACTORS, SEED)):
        if time.perf_counter() - begun + longest > 60 * MINUTES:
            break
        before = time.perf_counter()
        folder = tmp_path / str(number)
        folder.mkdir()
        hold(row, folder)
        longest, done = max(longest, time.perf_counter() - before), done + 1
    assert done >= 3
