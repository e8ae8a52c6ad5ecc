"""All pairs: few rows in which any two levels of two different factors occur together."""

from __future__ import annotations

import random
from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations

Row = dict[str, str]
#: Candidates for each row, of which the one with most new pairs is taken.
CANDIDATES = 40


def pairs_of(row: Mapping[str, str]) -> Iterator[tuple[tuple[str, str], tuple[str, str]]]:
    """Yield the pairs of (factor, level) that occur in a row."""
    yield from combinations(row.items(), 2)


def all_pairs(factors: Mapping[str, Sequence[str]], seed: int = 0) -> list[Row]:
    """Return rows that hold every pair of levels, by a greedy choice among random candidates.

    Parameters
    ----------
    factors
        Levels by factor.
    seed
        Seed of the candidates; the same seed gives the same rows.
    """
    rng = random.Random(seed)
    open_pairs = {
        ((f, a), (g, b)) for f, g in combinations(factors, 2) for a in factors[f] for b in factors[g]
    }
    rows: list[Row] = []
    while open_pairs:
        first = min(open_pairs)
        candidates = [_candidate(factors, dict(first), open_pairs, rng) for _ in range(CANDIDATES)]
        best = max(candidates, key=lambda row: len(open_pairs & set(pairs_of(row))))
        open_pairs -= set(pairs_of(best))
        rows.append(best)
    return rows


def _candidate(
    factors: Mapping[str, Sequence[str]], fixed: Row, open_pairs: set[object], rng: random.Random
) -> Row:
    """Fill a row factor by factor, in random order, each time by the level that closes most open pairs."""
    chosen = dict(fixed)
    names = [name for name in factors if name not in chosen]
    rng.shuffle(names)
    order = list(factors)
    for name in names:
        levels = list(factors[name])
        rng.shuffle(levels)

        def closed(level: str, name: str = name) -> int:
            new = (name, level)
            found = 0
            for other in chosen.items():
                pair = (new, other) if order.index(name) < order.index(other[0]) else (other, new)
                found += pair in open_pairs
            return found

        chosen[name] = max(levels, key=closed)
    return {name: chosen[name] for name in order}
