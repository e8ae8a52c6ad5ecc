"""The cases of ``porocore verify``: every item on every installed backend, and the backends against each other."""

from __future__ import annotations

import pytest

from porocore.commands.verify.cases import CASES, run_cases, select_cases, select_solvers, solve_item

#: Items that cost a second or so; the others are for the slow tests.
QUICK = {
    ("channel", "r = 0.25"),
    ("spheres", "c = 0.064"),
    ("cylinders", "c = 0.2"),
    ("homogeneous", "diagonal H"),
    ("relaxation", "limits"),
    ("terzaghi", "10 cells"),
    ("mandel", "moved plates"),
    ("xie-leo", "closed form"),
    ("charges", "equilibrium"),
}
ITEMS = [
    pytest.param(
        case, item, marks=[] if (case.name, item) in QUICK else pytest.mark.slow, id=f"{case.name}, {item}"
    )
    for case in CASES.values()
    for item in case.items
]


def test_the_quick_items_exist():
    assert {(case.name, item) for case in CASES.values() for item in case.items} >= QUICK


@pytest.mark.parametrize(("case", "item"), ITEMS)
def test_known_answers(case, item):
    backends = select_solvers().names[case.kind]
    found = {name: solve_item(case, item, name) for name in backends}
    for rows in found.values():
        assert rows
        assert all(row.passed for row in rows), "\n".join(row.describe() for row in rows if not row.passed)
    # The same meshes and equations: what is a number is the same number.
    for rows in zip(*found.values(), strict=True):
        numbers = {row.backend: row.check.ours for row in rows}
        first = next(iter(numbers.values()))
        if first is not None:
            assert list(numbers.values()) == pytest.approx([first] * len(numbers), rel=1e-7)


@pytest.mark.slow
def test_the_long_form():
    rows = run_cases(select_cases(), select_solvers(), long=True)
    assert all(row.passed for row in rows), "\n".join(row.describe() for row in rows if not row.passed)
    orders = {
        (row.case, row.item): row.check.order for row in rows if row.check.reference and row.check.order
    }
    # Quadratic velocity: the flow converges with order four at best, on meshes that are not nested with some scatter.
    for case in ("channel", "spheres", "cylinders"):
        assert min(order for (name, _), order in orders.items() if name == case) > 2
