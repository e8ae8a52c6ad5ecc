"""Tables that must name all of something: statuses, hooks and platforms."""

from __future__ import annotations

import re

import yaml

from porocore.plugins.kinds import KINDS
from porocore.report.text import MEANINGS
from porocore.states import Status
from tests.docs.pages import ROOT, page, rows


def test_every_status_is_explained():
    table = {cells[0].strip("`"): cells[1] for cells in rows(page("docs/cell.md")) if len(cells) == 3}
    assert {status.name for status in Status} == {status.name for status in MEANINGS}
    for status in Status:
        assert table[status.name] == ("yes" if status.has_values else "no")


def test_every_hook_is_listed():
    listed = {cells[0].strip("`") for cells in rows(page("docs/plugins.md"))}
    assert {record.hook for record in KINDS.values()} <= listed


def test_every_job_that_tests_a_platform_is_listed():
    jobs = yaml.safe_load((ROOT / ".github/workflows/test.yml").read_text(encoding="utf-8"))["jobs"]
    text = page("docs/install.md").partition("\n## Platforms\n")[2].partition("\n## ")[0]
    listed = set(re.findall(r"job `(\w+)`", text))
    assert listed == set(jobs) - {"distributions", "documents", "coverage"}
    # What stands beside a job that has a matrix of versions.
    for version in jobs["platforms"]["strategy"]["matrix"]["python"]:
        assert re.search(rf"macOS and Windows: .*\b{re.escape(version)}\b.*`platforms`", text)
    (version,) = re.findall(r":v(0\.\d+)", jobs["dolfinx"]["container"])
    assert re.search(rf"dolfinx {re.escape(version)} .*`dolfinx`", text)
