"""HDF5 files from elsewhere or damaged: data sets, surrogates and solutions, with every command that reads them."""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np

from porocore.surrogates.file import file as surrogate_file
from porocore.surrogates.file.file import read_archive, write_archive
from tests.bad_input.bad_files import (
    SAMPLES,
    SOLUTION,
    SURROGATE,
    Edit,
    fifo,
    folder,
    from_run,
    hdf5,
    holes,
    link,
)
from tests.bad_input.bad_row import Content, Row


def replaced(name: str, value: object, **how: object) -> Edit:
    """Put something else in the place of an array."""

    def edit(file: h5py.File) -> None:
        if name in file:
            del file[name]
        file.create_dataset(name, data=value, **how)

    return edit


def declared(name: str, shape: tuple[int, ...], **how: object) -> Edit:
    """Declare an array and write nothing into it."""

    def edit(file: h5py.File) -> None:
        if name in file:
            del file[name]
        file.create_dataset(name, shape, "f8", **how)

    return edit


def with_entry(name: str, value: float) -> Edit:
    """Change the first number of an array."""

    def edit(file: h5py.File) -> None:
        numbers = file[name][()]
        numbers.flat[0] = value
        del file[name]
        file[name] = numbers

    return edit


def linked(name: str, target: object) -> Edit:
    """Put a link in the place of a member."""

    def edit(file: h5py.File) -> None:
        if name in file:
            del file[name]
        file[name] = target

    return edit


def without(name: str) -> Edit:
    def edit(file: h5py.File) -> None:
        del file[name]

    return edit


def to_itself(file: h5py.File) -> None:
    file["again"] = file["/"]


def no_utf8(file: h5py.File) -> None:
    file.create_group(b"\xff\xfe")


def deep(file: h5py.File) -> None:
    file.create_group("/".join("abcdefghij"))


def virtual(name: str) -> Edit:
    def edit(file: h5py.File) -> None:
        shape = file[name].shape
        del file[name]
        layout = h5py.VirtualLayout(shape, "f8")
        layout[...] = h5py.VirtualSource("elsewhere.h5", "x", shape)
        file.create_virtual_dataset(name, layout)

    return edit


def attribute(name: str, value: object) -> Edit:
    def edit(file: h5py.File) -> None:
        file.attrs[name] = value

    return edit


def reference(name: str) -> Edit:
    def edit(file: h5py.File) -> None:
        del file[name]
        file.create_dataset(name, data=file.ref, dtype=h5py.ref_dtype)

    return edit


def bomb(name: str) -> Edit:
    return replaced(name, np.zeros((4_000_000, 2)), compression="gzip", compression_opts=9)


def folder_with(name: str) -> Content:
    def make(path: Path) -> None:
        path.mkdir()
        (path / name).touch()

    return make


def general(array: str) -> dict[str, tuple[Edit, str]]:
    """Faults that every file of ours can have, at one of its arrays, and what the message must hold."""
    return {
        "a huge array": (declared(array, (10**10, 2)), "not whole"),
        "a huge array of pieces": (declared(array, (10**10, 2), chunks=(1024, 2)), "not whole"),
        "a huge array that is compressed": (bomb(array), ""),
        "huge pieces": (declared(array, (2**28, 2), chunks=(2**28 - 1, 1)), "pieces larger than the file"),
        "a link to itself": (linked(array, h5py.SoftLink(f"/{array}")), "a link to elsewhere"),
        "a link to a pipe": (linked(array, h5py.ExternalLink("pipe", "/x")), "a link to elsewhere"),
        "a group in itself": (to_itself, "linked twice"),
        "numbers in another file": (
            declared(array, (3, 2), external=[("elsewhere.bin", 0, 48)]),
            "holds its numbers in other files",
        ),
        "a virtual array": (virtual(array), "holds its numbers in other files"),
        "a reference": (reference(array), "neither numbers nor texts"),
        "texts for numbers": (replaced(array, ["a", "b"]), ""),
        "complex numbers": (replaced(array, np.zeros((3, 2), complex)), "neither numbers nor texts"),
        "another number of axes": (replaced(array, np.zeros((3, 2, 2, 2))), ""),
        "a group for an array": (lambda file: (without(array)(file), file.create_group(array)), ""),
        "a missing array": (without(array), ""),
        "a name that is no UTF-8": (no_utf8, "no UTF-8"),
        "groups in groups": (deep, "groups within groups"),
        "no format": (lambda file: file.attrs.__delitem__("format"), ""),
        "a format that is a number": (attribute("format", 7), ""),
        "a version that is a text": (attribute("version", "one"), ""),
        "another version": (attribute("version", 99), "version"),
        "a version of many numbers": (attribute("version", np.ones(1000)), ""),
    }


DATASET: dict[str, tuple[Edit, str]] = {
    **general("x"),
    "a key that is no UTF-8": (
        replaced("key", np.array([b"\xff\xfe"] * 12, "S2")),
        "",
    ),
    "keys of which two are the same": (lambda file: file["key"].__setitem__(1, file["key"][0]), "same key"),
    "a status that does not exist": (with_entry("status", 99), "status"),
    "a stress that is none": (with_entry("response/potential", np.nan), ""),
    "an infinite pressure": (with_entry("p", np.inf), "'p' holds numbers that are not finite"),
    "a response that is none": (replaced("response/heat", np.zeros(3)), "'response/heat' is no response"),
    "an unknown input": (replaced("inputs/names", ["H99", "p"], dtype=h5py.string_dtype()), "H99"),
    "an empty range": (with_entry("inputs/lower", 5.0), "range of input"),
    "fields that end before they begin": (with_entry("field/end", -5), ""),
}
SOLUTION_FAULTS: dict[str, tuple[Edit, str]] = {
    **general("points"),
    "nodes that are not there": (with_entry("cells", 10**9), "'cells' names nodes that are not there"),
    "infinite nodes": (with_entry("points", np.inf), "'points' holds numbers that are not finite"),
    "a history of another length": (replaced("history/time", np.zeros(3)), "expected"),
    "a history that is no number": (with_entry("history/settlement", np.nan), "not finite"),
    "a profile without a number": (lambda file: file.move("profiles/0", "profiles/last"), "profiles"),
    "a load that is no number": (attribute("load", np.nan), "attribute 'load'"),
}
#: What is no HDF5 file at all.
PATHS: dict[str, tuple[Content, str]] = {
    "empty": ("", "an empty file, no HDF5 file; expected a data set of porocore, such as samples.h5"),
    "words": ("not a data set at all", "no HDF5 file; expected a data set of porocore, such as samples.h5"),
    "a signature alone": (b"\x89HDF\r\n\x1a\n", "cut short"),
    "a signature and zeros": (b"\x89HDF\r\n\x1a\n" + bytes(200), ""),
    "a signature and ones": (b"\x89HDF\r\n\x1a\n" + b"\xff" * 200, "unknown version"),
    "a pipe": (fifo, "named pipe"),
    "a device": (link("/dev/zero"), "a device"),
    "a loop of links": (link("loop.h5"), ""),
    "a terabyte of nothing": (holes(1 << 40), "no HDF5 file"),
}
Header = dict[str, object]
Arrays = dict[str, np.ndarray]


def rewritten(change: Callable[[Header, Arrays], object]) -> Content:
    """A surrogate that somebody changed and gave the right checksum."""

    def make(path: Path) -> None:
        from_run(SURROGATE)(path)
        form, version = surrogate_file.FORMAT, surrogate_file.VERSION
        header, arrays = read_archive(path, form, version, "")
        change(header, arrays)
        write_archive(path, form, version, header, arrays)

    return make


def entries(name: str, value: object) -> Callable[[Header, Arrays], object]:
    """Set some numbers of every array whose name ends so."""

    def change(header: Header, arrays: Arrays) -> None:
        names = [n for n in arrays if n.endswith(name)]
        assert names
        for n in names:
            arrays[n] = np.full_like(arrays[n], value)

    return change


REWRITTEN: dict[str, tuple[Callable[[Header, Arrays], object], str]] = {
    "exponents of 64": (entries("exponents", 64), "exponents that are none"),
    "broken exponents": (entries("exponents", 0.5), "exponents that are none"),
    "exponents below zero": (entries("exponents", -1), "exponents that are none"),
    "normals of length zero": (entries("range/normals", 0), "one of length zero"),
    "normals of another shape": (
        lambda h, a: a.update({"range/normals": np.ones((4, 9))}),
        "range has normals",
    ),
    "numbers that are none": (entries("coefficients", np.nan), "not finite"),
    "an empty range": (entries("inputs/lower", 1.0), "range of input"),
    "inputs that are none": (lambda h, a: h.update(inputs=["H99", "p"]), "H99"),
    "inputs that are a number": (lambda h, a: h.update(inputs=7), "not a complete surrogate"),
    "an unknown model": (lambda h, a: h.update(model="oracle"), "oracle"),
    "a provenance that is none": (lambda h, a: h.update(provenance=[1]), "provenance"),
    "an accuracy that is none": (lambda h, a: h.update(accuracy={"stress": "good"}), "accuracy"),
    "no identity": (lambda h, a: h.pop("identity"), "identity"),
    "variables that are none": (lambda h, a: h.update(active=[99]), ""),
    "variables beyond all numbers": (lambda h, a: h.update(active=[float("inf")]), ""),
}


def flipped(name: str, share: float) -> Content:
    """A file of the run with one byte changed, as far into it as ``share`` says."""

    def make(path: Path) -> None:
        from_run(name)(path)
        whole = bytearray(path.read_bytes())
        whole[int(share * (len(whole) - 1))] ^= 0x55
        path.write_bytes(whole)

    return make


def cut(name: str, share: float) -> Content:
    """The beginning of a file of the run."""

    def make(path: Path) -> None:
        from_run(name)(path)
        os.truncate(path, int(share * path.stat().st_size))

    return make


def damaged(name: str) -> dict[str, tuple[Content, str]]:
    return {
        **{
            f"a changed byte at {share:.0%}": (flipped(name, share), "")
            for share in (0.0, 0.1, 0.5, 0.9, 1.0)
        },
        **{f"cut at {share:.0%}": (cut(name, share), "cut short: ") for share in (0.2, 0.99)},
    }


#: How a data set is given to a command, and its status: what ``data check`` finds wrong is a finding.
WITH_DATASET = {
    "data info": (("loop.h5",), 2),
    "data check": (("loop.h5",), 1),
    "data export": (("loop.h5", "--out", "table.csv"), 2),
    "data merge": (("loop.h5", "loop.h5", "--out", "both.h5"), 2),
    "data plot": (("loop.h5", "--out", "picture.png"), 2),
}


def dataset_row(command: str, kind: str, content: Content, expected: str) -> Row:
    words, status = WITH_DATASET[command]
    status = (
        2 if kind == "a loop of links" else status
    )  # the system tells no more of it than that nothing is there
    files: dict[str, Content] = {"pipe": fifo, "loop.h5": content}
    return Row(
        f"{command}: data set with {kind}",
        (*command.split(), *words),
        (expected, "loop.h5"),
        files,
        status=status,
        prints=status == 1,
    )


def run_row(command: str, name: str, kind: str, content: Content, expected: str) -> Row:
    def replace(path: Path) -> None:
        path.unlink()
        if isinstance(content, str):
            path.write_text(content)
        elif isinstance(content, bytes):
            path.write_bytes(content)
        else:
            content(path)

    files: dict[str, Content] = {"run": from_run(), f"run/{name}": replace, "run/pipe": fifo}
    return Row(f"{command}: {name} with {kind}", (command, "run"), (expected, name), files)


def contents(name: str, faults: dict[str, tuple[Edit, str]]) -> dict[str, tuple[Content, str]]:
    return {kind: (from_run(name, edit), expected) for kind, (edit, expected) in faults.items()}


DATASETS = {**contents(SAMPLES, DATASET), **PATHS, **damaged(SAMPLES)}
SURROGATES = {
    **{kind: (rewritten(change), expected) for kind, (change, expected) in REWRITTEN.items()},
    **contents(SURROGATE, general("range/normals")),
    **damaged(SURROGATE),
}
SOLUTIONS = {**contents(SOLUTION, SOLUTION_FAULTS), **damaged(SOLUTION)}
ONCE = itertools.cycle(("data export", "data merge", "data plot"))

#: What a user gives where a data set is expected, and what the message must hold.
NO_DATASET: dict[str, tuple[Content, str]] = {
    "a foreign file": (
        hdf5(lambda file: file.create_dataset("mine", data=[1.0])),
        "no dataset of porocore; expected a",
    ),
    "a surrogate": (
        from_run(SURROGATE),
        "expected a data set of solved states, got a trained surrogate, which is undamaged; 'porocore solve RUN' reads "
        "it in its run folder, and the report has its accuracy",
    ),
    "an empty folder": (
        folder,
        "is not a run folder (it has no run.json); expected a data set of porocore, such as",
    ),
    "a folder of files": (folder_with("a.h5"), "; the HDF5 files in it are a.h5"),
    "a dangling link": (
        link("nowhere"),
        "a symbolic link to nowhere, which does not exist; expected a data set",
    ),
}


#: Sound files of a run folder that are no data sets, and what the message must hold.
OF_A_RUN = {
    SURROGATE: ("got a trained surrogate, which is undamaged",),
    SOLUTION: ("got the solution of a body, which is undamaged; 'porocore report RUN' reads it",),
    "run.json": ("no HDF5 file; expected a data set of porocore",),
}


ROWS = [
    *(
        Row(f"data info: {name} of a run", ("data", "info", f"run/{name}"), said, {"run": from_run()})
        for name, said in OF_A_RUN.items()
    ),
    *(
        Row(
            f"{command}: {kind} for a data set",
            (*command.split(), *WITH_DATASET[command][0]),
            ("loop.h5", said),
            {"loop.h5": content},
            status=1 if command == "data check" and kind in ("a foreign file", "a surrogate") else 2,
            prints=command == "data check",
        )
        for command in WITH_DATASET
        for kind, (content, said) in NO_DATASET.items()
    ),
    *(
        dataset_row(command, kind, *fault)
        for kind, fault in DATASETS.items()
        for command in ("data info", "data check", next(ONCE))
    ),
    *(
        run_row("sample", SAMPLES, kind, *fault)
        for kind, fault in list(contents(SAMPLES, DATASET).items())[::3]
    ),
    *(run_row("solve", SURROGATE, kind, *fault) for kind, fault in SURROGATES.items()),
    *(run_row("solve", SOLUTION, kind, *fault) for kind, fault in SOLUTIONS.items()),
]
