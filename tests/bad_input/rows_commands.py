"""What every command must refuse: unknown options, files that are no configuration, folders that hold no run."""

from __future__ import annotations

from tests.bad_input.bad_files import fifo, folder, from_run, holes, link
from tests.bad_input.bad_row import CONFIG, Content, Row, commands, study

#: Commands that read a configuration, with what else they need.
WITH_CONFIG = {
    "check": (),
    "run": ("--out", "out"),
    "sample": ("--out", "out"),
    "tune": ("--out", "out"),
    "sensitivity": ("--out", "out"),
    "stability": ("--out", "out"),
    "crosscheck": ("--out", "out"),
    "cell state": (),
    "cell fields": ("--out", "out"),
    "cell show": ("--out", "out"),
    "cell rev": ("--out", "out"),
}
#: Commands that go on with a run folder.
WITH_RUN = ("train", "solve", "report", "data info", "data check")
#: What is given as a configuration, and what the message must hold.
NO_CONFIGURATION: dict[str, tuple[Content | None, str]] = {
    "missing": (None, "no such file"),
    "folder": (folder, CONFIG),
    "empty": ("", "got an empty file"),
    "words": ("just words", "got a text"),
    "list": ("[1, 2]", "got a list"),
    "not closed": ("cell: {geometry: [", "not valid YAML"),
    "tab": ("a: 1\n\ta: 2", f"{CONFIG}:2: expected an indentation by spaces, got a tab"),
    "object": ("!!python/object/apply:os.system ['touch hacked']", "not valid YAML"),
    "HDF5": (b"\x89HDF\r\n\x1a\n\xff", "expected a configuration, which is YAML text, got an HDF5 file"),
    "JPEG": (b"\xff\xd8\xff\xe0" + bytes(99), "got a JPEG picture by its first bytes; give another file"),
    "PNG": (b"\x89PNG\r\n\x1a\n" + bytes(99), "got a PNG picture by its first bytes"),
    "PDF": ("%PDF-1.4\n1 0 obj\n<< /Type >>", "got a PDF document by its first bytes"),
    "ZIP": (b"PK\x03\x04\x14\0\x06\0", "got a ZIP archive by its first bytes"),
    "web page": ("<!doctype html><html>", "got a web page by its first bytes"),
    "old Office": (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(99), "got a document of an older Office"),
    "null bytes": (b"a: 1\0\0", "got a file that is no text"),
    "bytes": (b"\x80\x00\x01", "expected a configuration, which is YAML text, got a file that is no text"),
    "loop of links": (link(CONFIG), f"{CONFIG}: cannot be read: a symbolic link that leads back to itself"),
    "dangling link": (link("nowhere"), f"{CONFIG}: a symbolic link to nowhere, which does not exist"),
}
#: What ``run.json`` may hold, and what the message must hold.
RECORDS: dict[str, tuple[Content, str]] = {
    "record empty": ("", "run.json is damaged"),
    "record of bytes": (b"\xff\xfe\x00", "run.json is damaged"),
    "record a list": ("[1]", "run.json is damaged"),
    "record a number": ("1e999", "run.json is damaged"),
    "record nested": ("[" * 100000, "run.json is damaged"),
    "record a pipe": (fifo, "run.json cannot be read: expected a file, got a named pipe"),
    "record a device": (link("/dev/zero"), "run.json cannot be read: expected a file, got a device"),
    "record of a terabyte": (holes(1 << 40), "run.json cannot be read: expected at most 16.8 MB"),
    "record a folder": (folder, "run.json cannot be read"),
    "record a loop": (link("run.json"), "run.json cannot be read"),
    "record of a later version": ('{"format": "porocore-run", "version": 99, "identity": ""}', "version 99"),
    "record of another identity": (
        '{"format": "porocore-run", "version": 2, "identity": ""}',
        "was changed after the run began",
    ),
}


#: Words of which one is no command, and what the message must hold.
NO_COMMANDS = {
    ("frobnicate",): ("There is no command 'frobnicate'; the commands are init, check, schema",),
    ("chek",): ("There is no command 'chek'; did you mean 'check'? the commands are",),
    ("mine.yaml",): ("a file is given behind a command, as in 'porocore run mine.yaml'",),
    ("data", "summary"): (
        "There is no command 'summary'; the commands are info, check, merge, export, plot",
    ),
    ("data", "inf"): ("did you mean 'info'? the commands are",),
    ("store", "frobnicate"): ("the commands are list, check, clear",),
    ("plugin", "frobnicate"): ("the commands are new, check",),
    ("cell", "fild"): (
        "There is no command and no file 'fild'; did you mean 'fields'? the commands are rev",
    ),
    ("cell", "gone"): ("gone: a symbolic link to nowhere, which does not exist",),
    ("check", "mine.yaml", "more"): ("Expected only CONFIG and options, got 'more', too",),
    ("plugins", "more"): ("Expected options only, got 'more', too",),
    ("train",): ("Missing argument 'RUN'. Run folder.",),
}
#: What is given as a run folder, and what the message must hold.
NO_RUN: dict[str, tuple[str, dict[str, Content], str]] = {
    "a file": ("mine.yaml", {}, "mine.yaml: expected a run folder, got a file"),
    "a file of a run": ("run/config.yaml", {"run": from_run()}, "got a file of one; give the folder: run"),
    "a folder of runs": ("runs", {"runs/a": from_run()}, "but holds some; give one of them: runs/a"),
    "a calibration": (
        "cal",
        {"cal/calibrate.json": "{}", "cal/report.html": "", "cal/cells": from_run()},
        "cal is the folder of a calibration, not of a run; open cal/report.html, which 'porocore calibrate CONFIG "
        "--out cal --resume' writes again",
    ),
    "a study of volumes": (
        "rev",
        {"rev/rev.json": "{}", "rev/rev.png": ""},
        "is the folder of a study of representative volumes, not of a run; open rev/rev.png",
    ),
    "a folder of other files": ("other", {"other/note.txt": "mine"}, "but holds other files"),
    "a dangling link": ("gone", {}, "gone: a symbolic link to nowhere, which does not exist"),
    "a line break": ("a\nb", {}, "a\\nb is not a run folder (there is no such folder)"),
}
#: What is given as a store, and what the message must hold.
NO_STORE = {
    "none-there": "--store none-there: no such folder",
    "mine.yaml": "--store mine.yaml: expected a folder, got a file",
    "gone": "--store gone: a symbolic link to nowhere, which does not exist",
}
BESIDE: dict[str, Content] = {"mine.yaml": "mine", "gone": link("nowhere")}


def unknown_option(command: str) -> Row:
    expected = ("There is no option --frobnicate; the options are --", "--help")
    return Row(f"{command}: unknown option", (*command.split(), "--frobnicate"), expected)


def no_configuration(command: str, kind: str) -> Row:
    content, expected = NO_CONFIGURATION[kind]
    words = (*command.split(), CONFIG, *WITH_CONFIG[command])
    return Row(f"{command}: {kind}", words, (expected,), {} if content is None else {CONFIG: content})


def damaged_record(command: str, kind: str) -> Row:
    content, expected = RECORDS[kind]
    files = {"run/config.yaml": study(), "run/run.json": content}
    return Row(f"{command}: {kind}", (*command.split(), "run"), (expected,), files)


def removed(path):
    path.unlink()


def incomplete_run(command: str, missing: str, expected: str) -> Row:
    files = {"run": from_run(), f"run/{missing}": removed}
    return Row(f"{command}: {missing} is missing", (command, "run"), (expected,), files)


ROWS = [
    *(Row(f"no command: {' '.join(words)}", words, said, BESIDE) for words, said in NO_COMMANDS.items()),
    *(
        Row(f"{command}: {kind} for a run folder", (command, path), (said,), {**BESIDE, **files})
        for command in ("train", "solve", "report")
        for kind, (path, files, said) in NO_RUN.items()
    ),
    *(
        Row(f"store {command}: {path}", ("store", command, "--store", path), (said,), BESIDE)
        for command in ("list", "check", "clear")
        for path, said in NO_STORE.items()
    ),
    Row(
        "run: a store at a dangling link",
        ("run", CONFIG, "--store", "gone", "--out", "out"),
        (NO_STORE["gone"],),
        {CONFIG: study(), **BESIDE},
    ),
    Row("check: a line break in a path", ("check", "a\nb.yaml"), (r"a\nb.yaml: no such file",)),
    *(unknown_option(command) for command in sorted(commands())),
    *(
        Row(
            f"{command}: {option}",
            (command, "run", option, "out"),
            ("the folder is the argument RUN, without an",),
        )
        for command, option in (("train", "-o"), ("solve", "--out"), ("report", "--output"))
    ),
    *(no_configuration(command, kind) for command in WITH_CONFIG for kind in NO_CONFIGURATION),
    *(damaged_record(command, kind) for command in WITH_RUN for kind in RECORDS),
    *(
        Row(f"{command}: {name}", (*command.split(), "run"), (expected,), files)
        for command in WITH_RUN
        for name, expected, files in (
            ("no folder", "run", {}),
            ("an empty folder", "is not a run folder", {"run": folder}),
        )
    ),
    *(
        Row(f"check: {name}", ("check", "cell.yaml"), (expected,), {"cell.yaml": text})
        for name, text, expected in (
            ("a part of a study", "cell: {viscosity: 1.0}\nsampling: {}\n", "macro: "),
            (
                "no cell",
                "title: of nothing\n",
                "sampling: missing; add 'sampling:' at the top level; 'porocore init'",
            ),
            (
                "a fluid",
                "cell: {}\nfluid: {viscosity: 1}\n",
                "fluid: unknown key; of the fluid the viscosity alone",
            ),
            (
                "a solid",
                "cell: {}\nsolid: {E: 1}\n",
                "solid: unknown key; the solid is 'material:' under 'cell:'",
            ),
            (
                "a force without a length",
                "cell: {}\nscales: {force: 1 N, pore: 1 um}\n",
                "scales.length: missing",
            ),
        )
    ),
    Row(
        "cell: cells without a name",
        ("cell", "cells.yaml"),
        ("cells.yaml:1: cells: expected the name of a cell with --cell: clay",),
        {"cells.yaml": "cells:\n  clay: {}\n"},
    ),
    *(
        incomplete_run(
            command, "config.yaml", "config.yaml: no such file, so the run folder is incomplete; put back"
        )
        for command in ("report", "train")
    ),
    incomplete_run("train", "samples.h5", "make it first: porocore sample run"),
    incomplete_run("solve", "surrogate.h5", "make it first: porocore train run"),
    incomplete_run("report", "solutions/mean-gradient_load-0.04.h5", "make it first: porocore solve run"),
    *(
        Row(
            f"report: a run folder of a {name}",
            ("report", "run"),
            (f"run holds the results of 'porocore {name}': open run/{name}.csv and {name}.png",),
            {"run": from_run(), "run/solutions/mean-gradient_load-0.04.h5": removed, f"run/{name}.csv": ""},
        )
        for name in ("sweep", "tune")
    ),
    *(
        Row(
            f"check: {name} of a run",
            ("check", f"run/{name}"),
            (
                f"run/{name}: expected a configuration file, got a file of the run folder run, whose configuration is",
            ),
            {"run": from_run()},
        )
        for name in ("samples.h5", "run.json")
    ),
    Row(
        "check: a large HDF5 file",
        ("check", "a.h5"),
        ("a.h5: expected a configuration, which is YAML text, got an HDF5 file by its first bytes",),
        {"a.h5": b"\x89HDF\r\n\x1a\n" + bytes(1_100_000)},
    ),
    *(
        Row(
            f"sweep: {text}",
            ("sweep", CONFIG, "--over", f"radius={text}", "--out", "out"),
            (
                "expected LOW:HIGH:COUNT or values with commas between them, such as 0.2:0.25:5 or 0.2,0.25, got",
            ),
            {CONFIG: study()},
        )
        for text in ("0.2-0.25", "0.2;0.25")
    ),
    Row(
        "run: resumed without its surrogate",
        ("run", CONFIG, "--surrogate", "torch", "--out", "run", "--resume"),
        ("repeat --surrogate polynomial if it was begun so, or choose another --out",),
        {"run": from_run(), CONFIG: from_run("config.yaml")},
    ),
    Row(
        "run: without the surrogate",
        ("run", CONFIG, "--laws", "linear", "--out", "out"),
        ("--laws: expected surrogate", "got linear", "by porocore solve RUN"),
        {CONFIG: study()},
    ),
]
