"""Places where nothing can be written, or must not be: each command says so before it begins to work."""

from __future__ import annotations

from tests.bad_input.bad_files import fifo, folder, from_run, link
from tests.bad_input.bad_row import CONFIG, Content, Row, study

LONG = "x" * 300
#: Commands that make a folder, with what else they need.
FOLDERS = {
    "run": (CONFIG,),
    "sample": (CONFIG,),
    "tune": (CONFIG, "--surrogate", "torch"),
    "sensitivity": (CONFIG,),
    "stability": (CONFIG,),
    "crosscheck": (CONFIG,),
    "cell fields": (CONFIG, "--no-pictures"),
    "cell show": (CONFIG,),
    "reproduce": ("dehghani2022", "--no-pictures"),
}
#: Commands that write one file: option, ending, what else they need.
FILES = {
    "schema": ("--to", ".json", ()),
    "init": ("--to", ".yaml", ("filter",)),
    "verify": ("--out", ".json", ("--case", "terzaghi")),
    "data merge": ("--out", ".h5", ("samples.h5", "test.h5")),
    "data export": ("--out", ".csv", ("samples.h5",)),
    "data plot": ("--out", ".png", ("samples.h5",)),
}
#: Where a folder is asked for: the path, what is there, words of the message.
NO_FOLDER: dict[str, tuple[str, dict[str, Content], str]] = {
    "a file": ("out", {"out": "mine"}, "out: expected a folder, got a file"),
    "below a file": ("out/run", {"out": "mine"}, "--out out/run: out is a file, not a folder"),
    "below a device": ("/dev/null/run", {}, "/dev/null is a device, not a folder"),
    "a device": ("/dev/null", {}, "/dev/null"),
    "a named pipe": ("out", {"out": fifo}, "out"),
    "a loop of links": ("out", {"out": link("out")}, "--out out: a symbolic link that leads back to itself"),
    "a dangling link": (
        "out",
        {"out": link("nowhere")},
        "--out out: a symbolic link to nowhere, which does not exist; remove or mend that link",
    ),
    "below a dangling link": (
        "out/run",
        {"out": link("nowhere")},
        "--out out/run: out is a symbolic link to nowhere, which does not exist",
    ),
    "a name of 300 characters": (LONG, {}, "name"),
    "where nothing can be made": ("/proc/out", {}, "/proc/out"),
    "a run folder": ("run", {"run/run.json": "{}", "run/config.yaml": "mine"}, "run"),
    "in a run folder": ("run/deep/out", {"run": from_run()}, "in the run folder"),
}
#: Where a file is asked for, without its ending.
NO_FILE: dict[str, tuple[str, dict[str, Content], str]] = {
    "a folder": ("out{}", {"out{}": folder}, "out"),
    "below a file": ("out/new{}", {"out": "mine"}, "out is a file, not a folder"),
    "a dangling link": (
        "out{}",
        {"out{}": link("nowhere")},
        ": a symbolic link to nowhere, which does not exist; remove or mend that link",
    ),
    "a full device": ("out{}", {"out{}": link("/dev/full")}, "out"),
    "a named pipe": ("out{}", {"out{}": fifo}, "out"),
    "a loop of links": ("out{}", {"out{}": link("out{}")}, "a symbolic link that leads back to itself"),
    "a name of 300 characters": (LONG + "{}", {}, "name"),
    "where nothing can be made": ("/proc/out{}", {}, "/proc/out"),
    "below a device": ("/dev/null/out{}", {}, "/dev/null"),
}


def no_folder(command: str, kind: str) -> Row:
    path, files, expected = NO_FOLDER[kind]
    words = (*command.split(), *FOLDERS[command], "--out", path)
    return Row(f"{command} --out {kind}", words, (expected,), {CONFIG: study(), **files})


def no_file(command: str, kind: str) -> Row:
    path, files, expected = NO_FILE[kind]
    option, ending, others = FILES[command]
    made = {name: from_run("samples.h5") for name in others if name.endswith(".h5")}
    given = {
        name.format(ending): link("out" + ending) if kind == "a loop of links" else content
        for name, content in files.items()
    }
    words = (*command.split(), *others, option, path.format(ending))
    return Row(f"{command} {option} {kind}", words, (expected,), {**made, **given})


def locked(name: str, content: Content, words: str, files: dict[str, Content] | None = None) -> Row:
    """A run folder whose lock is no ordinary file."""
    made = {"run": from_run(), "run/.lock": remove, **(files or {})}
    return Row(f"a lock that is {name}", ("train", "run"), (words,), {**made, "run/./.lock": content})


def remove(path):
    path.unlink()


def beside(content: Content, name: str) -> Row:
    """A data set whose lock is no ordinary file."""
    files = {"samples.h5": from_run("samples.h5"), "test.h5": from_run("samples.h5"), ".new.h5.lock": content}
    words = ("data", "merge", "samples.h5", "test.h5", "--out", "new.h5")
    return Row(f"a data set's lock that is {name}", words, ("new.h5",), {**files, "mine": "mine"})


ROWS = [
    *(no_folder(command, kind) for command in FOLDERS for kind in NO_FOLDER),
    *(no_file(command, kind) for command in FILES for kind in NO_FILE),
    locked("a link to another file", link("../mine"), "symbolic link", {"mine": "mine"}),
    locked("a link to nothing", link("../nothing"), "symbolic link"),
    locked("a folder", folder, "run"),
    locked("a named pipe", fifo, "run"),
    beside(link("mine"), "a link to another file"),
    beside(link("nothing"), "a link to nothing"),
    beside(folder, "a folder"),
    beside(fifo, "a named pipe"),
    Row("report --out", ("report", "run", "--out", "mine"), ("--out",), {"mine": "mine", "run": from_run()}),
    Row("init over a file", ("init", "filter", "--to", "mine"), ("not overwritten",), {"mine": "mine"}),
    Row("schema over a file", ("schema", "--to", "mine"), ("no JSON schema",), {"mine": "mine"}),
    Row(
        "plugin new into a file",
        ("plugin", "new", "my-thing", "--kind", "cell", "--to", "mine"),
        ("mine",),
        {"mine": "mine"},
    ),
    Row(
        "plugin new into a name of 300 characters",
        ("plugin", "new", "my-thing", "--kind", "cell", "--to", LONG),
        ("name",),
    ),
]
