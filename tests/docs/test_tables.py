"""Tables that must name all of something: statuses and hooks."""

from __future__ import annotations

from porocore.plugins.kinds import KINDS
from porocore.report.text import MEANINGS
from porocore.states import Status
from tests.docs.pages import page, rows


def test_every_status_is_explained():
    table = {cells[0].strip("`"): cells[1] for cells in rows(page("docs/cell.md")) if len(cells) == 3}
    assert {status.name for status in Status} == {status.name for status in MEANINGS}
    for status in Status:
        assert table[status.name] == ("yes" if status.has_values else "no")


def test_every_hook_is_listed():
    listed = {cells[0].strip("`") for cells in rows(page("docs/plugins.md"))}
    assert {record.hook for record in KINDS.values()} <= listed
