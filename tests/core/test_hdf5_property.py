"""Any HDF5 file, however it was damaged or edited, is read as it was written or refused in one message."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from datetime import timedelta
from functools import cache
from itertools import count
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from porocore.core.hdf5 import seal_of
from porocore.errors import PorocoreError
from tests.helpers.hdf5_samples import KINDS, flat, same, unsealed

Damage = Callable[[bytes], bytes]
#: Longer than a message beside the name of its file.
LONGEST = 400
#: No reading takes longer.
LATEST = timedelta(seconds=10)
NUMBER = count()


def bounded(examples: int) -> Any:
    """Return how many examples are tried; always the same ones, so that a failure is not chance."""
    return settings(
        max_examples=examples, derandomize=True, database=None, deadline=LATEST, phases=[Phase.generate],
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
    )  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("hdf5")
    if sys.platform != "win32":
        os.mkfifo(made / "pipe")
    return made


@cache
def valid(folder: Path, kind: str) -> tuple[bytes, dict[str, Any]]:
    """The bytes of a valid file, and what is read from it."""
    path = folder / f"{kind}.h5"
    KINDS[kind][0](path)
    return path.read_bytes(), flat(KINDS[kind][1](path))


@cache
def members(folder: Path, kind: str) -> tuple[list[str], list[str]]:
    """The arrays of a valid file, and these with its groups."""
    arrays, whole = list[str](), list[str]()
    valid(folder, kind)
    with h5py.File(folder / f"{kind}.h5", "r") as file:
        file.visititems(
            lambda name, item: (whole.append(name), isinstance(item, h5py.Dataset) and arrays.append(name))[0]
        )
    return arrays, whole


def outcome(folder: Path, kind: str, content: bytes) -> dict[str, Any] | None:
    """What is read from a file, or None where it is refused as it should be."""
    path = folder / f"{next(NUMBER)}.h5"
    path.write_bytes(content)
    try:
        return flat(KINDS[kind][1](path))
    except PorocoreError as error:
        message = str(error)
        assert message.startswith(f"{path}: "), message
        assert "\n" not in message
        assert len(message) <= len(str(path)) + LONGEST, message
        return None
    finally:
        path.unlink()


def assert_sound(found: dict[str, Any]) -> None:
    """Numbers are finite, but those of states without a solution, and a step that is not known yet."""
    for name, value in found.items():
        if isinstance(value, (float, np.ndarray)):
            array = np.asarray(value)
            assert array.dtype in (np.float64, np.int64, np.bool_), name
            unknown = "/5/" in name or name.endswith("/proposed")
            assert unknown or np.isfinite(array).all(), name


def flips(places: list[tuple[int, int]]) -> Damage:
    def damage(content: bytes) -> bytes:
        changed = bytearray(content)
        for place, change in places:
            changed[place % len(content)] ^= change
        return bytes(changed)

    return damage


KIND = st.sampled_from(sorted(KINDS))
FLIPS = st.lists(st.tuples(st.integers(0, 1 << 17), st.integers(1, 255)), min_size=1, max_size=6).map(flips)
CUTS = st.integers(0, 1 << 17).map(lambda n: lambda content: content[: n % len(content)])
LONGER = st.binary(min_size=1, max_size=200).map(lambda more: lambda content: content + more)


def sealed_damage(folder: Path, kind: str, damage: Damage) -> None:
    content, expected = valid(folder, kind)
    found = outcome(folder, kind, damage(content))
    assert found is None or same(found, expected)


def bare_damage(folder: Path, kind: str, damage: Damage) -> None:
    found = outcome(folder, kind, damage(unsealed(valid(folder, kind)[0])))
    if found is not None:
        assert_sound(found)


@bounded(150)
@given(kind=KIND, damage=FLIPS | CUTS | LONGER)
def test_a_damaged_file_of_ours_is_whole_or_refused(folder: Path, kind: str, damage: Damage) -> None:
    sealed_damage(folder, kind, damage)


@bounded(60)
@given(kind=KIND, damage=FLIPS | CUTS | LONGER)
def test_a_damaged_file_without_a_seal_is_sound_or_refused(folder: Path, kind: str, damage: Damage) -> None:
    bare_damage(folder, kind, damage)


NAMES: list[str | bytes] = ["x", "again", "a\nb", "∇", "n" * 300, b"\xff\xfe", "profiles/7", "response/heat"]
TYPES: list[Any] = [
    "f4", "f8", "i1", "i8", "u8", "S3", "c16", "?", h5py.string_dtype(), h5py.ref_dtype, h5py.vlen_dtype("f8"),
    [("a", "f8")],
]  # fmt: skip
SHAPES = [(), (0,), (1,), (3,), (2, 3), (3, 3, 3), (1,) * 8, (10**10,), (10**6, 10**6, 10**6)]
VALUES = [np.nan, np.inf, -np.inf, -1.0, 0.0, 1e308, 1e19, 2.0**63]
LINKS = ["/", "/x", "/none", "pipe", "elsewhere", "loop"]
ATTRIBUTES = [np.nan, np.inf, -1, 2**63 - 1, 1e308, "", "x" * 5000, b"\xff", np.zeros(9), h5py.Empty("f8")]


def cast(numbers: np.ndarray, kind: np.dtype) -> np.ndarray:
    """Return numbers as elements of another type, each of the class that h5py expects when it writes them."""
    if not kind.hasobject:
        with np.errstate(invalid="ignore"):
            return numbers.astype(kind)
    text, reference = h5py.check_string_dtype(kind), h5py.check_ref_dtype(kind)
    found = np.empty(numbers.shape, kind)
    for place, number in np.ndenumerate(numbers):
        found[place] = str(number) if text else h5py.Reference() if reference else np.array([number], float)
    return found


@dataclass(frozen=True, eq=False)
class Change:
    """One change of the structure, of a number or of an attribute; what it cannot change stays."""

    what: str
    place: int
    number: float
    shape: tuple[int, ...]
    kind: Any
    pieces: bool
    target: str
    new: str | bytes
    attribute: Any

    def __call__(self, file: h5py.File, arrays: list[str], whole: list[str]) -> None:
        array, name = arrays[self.place % len(arrays)], whole[self.place % len(whole)]
        if self.what == "deleted":
            del file[name]
        elif self.what == "renamed":
            file.move(name, self.new)
        elif self.what == "a group":
            file.create_group(self.new)
        elif self.what == "an array":
            file.create_dataset(self.new, self.shape, self.kind)
        elif self.what == "an attribute":
            names = sorted(file.attrs)
            file.attrs[names[self.place % len(names)]] = self.attribute
        elif self.what == "a link":
            links = h5py.SoftLink(self.target), h5py.ExternalLink(self.target, "/x"), file["/"], file[array]
            del file[name]
            file[name] = links[self.place % 4]
        else:
            self.replace(file, array)

    def replace(self, file: h5py.File, array: str) -> None:
        if self.what != "declared" and file[array].nbytes > 1 << 20:
            return
        numbers = np.zeros(1) if self.what == "declared" else np.array(file[array][()])
        if numbers.dtype.hasobject and self.what in ("a number", "a type"):
            return  # h5py crashes when it writes a number for an array
        if self.what == "a shape":
            numbers = (numbers[:-1], numbers.T, numbers.ravel(), numbers[None])[self.place % 4]
        elif self.what == "a number":
            numbers.flat[self.place % numbers.size] = self.number
        elif self.what == "a type":
            numbers = cast(numbers, np.dtype(self.kind))
        del file[array]
        if self.what == "declared":
            file.create_dataset(
                array, self.shape, self.kind, chunks=(self.pieces and bool(self.shape)) or None
            )
        else:
            file.create_dataset(array, data=numbers)


WHAT = [
    "deleted",
    "renamed",
    "a group",
    "an array",
    "an attribute",
    "a link",
    "a shape",
    "a number",
    "a type",
    "declared",
]
CHANGE = st.builds(
    Change,
    *map(st.sampled_from, (WHAT,)), st.integers(0, 1000),
    *map(st.sampled_from, (VALUES, SHAPES, TYPES, (False, True), LINKS, NAMES, ATTRIBUTES)),
)  # fmt: skip


def edited(folder: Path, kind: str, changes: list[Change], sealed: bool) -> None:
    path = folder / "edited.h5"
    path.write_bytes(unsealed(valid(folder, kind)[0]))
    with h5py.File(path, "r+") as file:
        # Whoever follows a link to a pipe waits for ever, here as elsewhere.
        links = [change for change in changes if change.what == "a link"]
        for change in [*(change for change in changes if change.what != "a link"), *links[:1]]:
            with suppress(Exception):  # a change that cannot be
                change(file, *members(folder, kind))
    content = path.read_bytes()
    found = outcome(folder, kind, content + seal_of(content) if sealed else content)
    if found is not None:
        assert_sound(found)


CHANGES = st.lists(CHANGE, min_size=1, max_size=3)


@bounded(120)
@given(kind=KIND, changes=CHANGES, sealed=st.booleans())
def test_an_edited_file_is_sound_or_refused(
    folder: Path, kind: str, changes: list[Change], sealed: bool
) -> None:
    edited(folder, kind, changes, sealed)


@pytest.mark.slow
def test_many_damaged_and_edited_files(folder: Path) -> None:
    bounded(1500)(given(kind=KIND, damage=FLIPS | CUTS | LONGER)(sealed_damage))(folder)
    bounded(1500)(given(kind=KIND, damage=FLIPS | CUTS | LONGER)(bare_damage))(folder)
    bounded(1500)(given(kind=KIND, changes=CHANGES, sealed=st.booleans())(edited))(folder)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("time", np.inf), ("time", 1.0), ("halvings", -1), ("halvings", 10**6), ("streak", -1),
        ("proposed", 0.0), ("proposed", -np.inf), ("length", -1.0), ("length", np.inf), ("scales", (0.1, -1.0)),
    ],
)  # fmt: skip
def test_a_checkpoint_whose_steps_cannot_be_is_refused(folder: Path, name: str, value: Any) -> None:
    """A solve that went on from it would end too early, or never."""
    path = folder / "steps.h5"
    path.write_bytes(unsealed(valid(folder, "checkpoint")[0]))
    with h5py.File(path, "r+") as file:
        file.attrs[name] = value
    with pytest.raises(PorocoreError, match=f"'{name}'"):
        KINDS["checkpoint"][1](path)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    "make",
    [os.mkdir]
    if sys.platform == "win32"
    else [os.mkfifo, os.mkdir, lambda path: os.symlink("/dev/zero", path)],
)
def test_what_is_no_file_is_refused(tmp_path: Path, kind: str, make: Callable[[Path], None]) -> None:
    make(tmp_path / "data.h5")
    with pytest.raises(PorocoreError) as error:
        KINDS[kind][1](tmp_path / "data.h5")
    assert str(error.value).startswith(f"{tmp_path / 'data.h5'}: ")
