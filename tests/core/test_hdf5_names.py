"""Names of users in HDF5 files: any name comes back, and none is a path."""

from __future__ import annotations

import tempfile
from pathlib import Path

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from porocore.core.hdf5 import LONGEST_NAME, atomic_hdf5, link_to, name_of_link, opened
from porocore.core.models.name import LONGEST

#: Any text that can be UTF-8.
NAMES = st.text(st.characters(exclude_categories=["Cs"]), max_size=LONGEST)


@settings(deadline=None)
@given(NAMES)
@example("a/b")
@example("..")
@example("")
@example("%")
@example("100 %2F")
@example("\U000e0001" * LONGEST)
def test_a_link_is_no_path_and_gives_the_name_back(name):
    link = link_to(name)
    assert name_of_link(link) == name
    assert link
    assert link.isprintable()
    assert "/" not in link
    assert link.strip(".")
    assert len(link.encode()) <= LONGEST_NAME


@pytest.mark.parametrize("name", ["top", "µ-Sonde ü", "中", "left side", "y+", "50 kPa"])
def test_ordinary_names_stay_as_they_are(name):
    assert link_to(name) == name


def test_links_of_older_files_are_names():
    assert name_of_link("50%") == "50%"


@settings(deadline=None, max_examples=25)
@given(st.sets(NAMES, min_size=1, max_size=5))
def test_names_are_written_and_read(names):

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "names.h5"
        with atomic_hdf5(path) as file:
            for k, name in enumerate(sorted(names)):
                file[f"probes/{link_to(name)}"] = [float(k)]
        with opened(path, "table", "write it again") as read:
            found = {
                name_of_link(link): read.array(f"probes/{link}", 1)[0] for link in read.members("probes")
            }
    assert found == {name: float(k) for k, name in enumerate(sorted(names))}
