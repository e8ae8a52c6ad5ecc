"""Every numeric option and every text option of every command with values that no command can use."""

from __future__ import annotations

from typing import Annotated, Any, get_args, get_origin, get_type_hints

from porocore.cli.entry import whole_program
from tests.bad_input.bad_row import CONFIG, Row, commands, study

#: Values that no numeric option takes.
NUMBERS = ("many", "", "--", "1e999999x", "0x10", "１２３x")
#: What else a command needs beside the option that is tried, by command.
NEEDED = {
    "tune": (CONFIG, "--out", "out"),
    "sensitivity": (CONFIG, "--out", "out"),
    "stability": (CONFIG, "--out", "out"),
    "cell state": (CONFIG,),
    "units": (),
    "reproduce": ("dehghani2022", "--out", "out"),
    "data check": (CONFIG,),
    "cell fields": (CONFIG, "--no-pictures", "--out", "out"),
    "plugin new": (),
    "crosscheck": (CONFIG, "--out", "out"),
    "verify": (),
    "run": (CONFIG, "--out", "out"),
    "sample": (CONFIG, "--out", "out"),
    "check": (CONFIG,),
    "cell rev": (CONFIG, "--out", "out"),
    "sweep": (CONFIG, "--out", "out"),
    "store clear": ("--store", "none-there"),
}
#: Options of commands with a value that cannot be used, and a part of the message.
REFUSED = [
    ("cell state", "--p", "1e308", "expected a pressure p of at most"),
    ("cell state", "--p", "-1e308", "expected a pressure p of at most"),
    ("cell state", "--p", "1e4", "expected a pressure p of at most"),
    ("cell state", "--p", "nan", "expected a finite number"),
    ("cell state", "--p", "inf", "expected a finite number"),
    ("cell state", "--p", "1e999", "expected a finite number"),
    ("cell state", "--grad-u", "1e300 0 0; 0 0 0; 0 0 0", "expected components of H of at most"),
    ("cell state", "--grad-u", "0 0 0; 0 0 1e300; 0 0 0", "expected components of H of at most"),
    ("cell state", "--grad-u", "11 0 0; 0 0 0; 0 0 0", "expected components of H of at most 10, got 11"),
    ("cell state", "--grad-u", "-1 0 0; 0 0 0; 0 0 0", "det F = 0"),
    ("cell state", "--grad-u", "-2 0 0; 0 0 0; 0 0 0", "det F = -1"),
    ("cell state", "--grad-u", "0 2 0; 2 0 0; 0 0 0", "det F = -3"),
    ("cell state", "--grad-u", "nan 0 0; 0 0 0; 0 0 0", "nine finite numbers"),
    ("cell state", "--grad-u", "inf 0 0; 0 0 0; 0 0 0", "nine finite numbers"),
    ("cell state", "--grad-u", "1", "nine finite numbers"),
    ("cell state", "--grad-u", "", "nine finite numbers"),
    ("cell state", "--grad-u", "0 " * 5000, "nine finite numbers"),
    ("cell state", "--grad-u", "0 0 0; 0 0 0; 0 0 " + "9" * 5000, "nine finite numbers"),
    ("cell state", "--grad-u", "a b c; d e f; g h i", "nine finite numbers"),
    *((c, "--cell", "clay", "--cell: there is no cell 'clay'; the file has no 'cells:'; leave it out")
      for c in ("cell state", "cell fields", "cell rev")),
    ("cell fields", "--at", "H22=-1", "det F = 0"),
    ("cell fields", "--at", "H22=-1.5,H11=-1.5,H33=-1.5", "det F = -0.125"),
    ("cell fields", "--at", "H11=1e300", "expected components of H of at most"),
    ("cell fields", "--at", "p=1e308", "expected a pressure p of at most"),
    ("cell fields", "--at", "p=nan", "--at p: expected"),
    ("cell fields", "--at", "p", "--at: expected"),
    ("cell fields", "--at", "=1", "--at: expected"),
    ("cell fields", "--at", "p=1,p=2", "--at: p is given twice"),
    ("cell fields", "--at", "H44=1", "expected finite values of some of"),
    ("cell fields", "--at", "H" * 4000 + "=1", "expected finite values of some of"),
    ("cell fields", "--at", "x" * 4000, "--at: expected"),
    ("sensitivity", "--loads", "shear=-0.5:0.5:1e-9", "at most 10000 are solved"),
    ("sensitivity", "--loads", "pressure=-1:1:1e-300", "at most 10000 are solved"),
    ("sensitivity", "--loads", "uniaxial=-1:1:0.1", "det F = 0"),
    ("sensitivity", "--loads", "volumetric=-3:1:0.1", "det F = -8"),
    ("sensitivity", "--loads", "pressure=-1e308:1:1e307", "expected a pressure p of at most"),
    ("sensitivity", "--loads", "uniaxial=0:1e300:1e299", "expected components of H of at most"),
    ("sensitivity", "--loads", "shear=0:0:1", "not both 0"),
    ("sensitivity", "--loads", "shear=nan:1:0.1", "expected finite goals"),
    ("sensitivity", "--loads", "shear=0:inf:0.1", "expected finite goals"),
    ("sensitivity", "--loads", "shear=0:1:-0.1", "expected a positive step"),
    ("sensitivity", "--loads", "shear=0:1:0", "expected a positive step"),
    ("sensitivity", "--loads", "shear=1", "expected goals and a step"),
    ("sensitivity", "--loads", "shear=" + "1" * 5000, "expected goals and a step"),
    ("sensitivity", "--loads", "s" * 5000, "expected some of"),
    ("sensitivity", "--loads", "shear,shear", "there twice"),
    ("sensitivity", "--loads", "", "expected some of"),
    ("sensitivity", "--tolerance", "nan", "--tolerance: expected"),
    ("sensitivity", "--tolerance", "0", "--tolerance: expected"),
    ("sensitivity", "--tolerance", "1e-300", "--tolerance: expected"),
    ("sensitivity", "--tolerance", "inf", "--tolerance: expected"),
    *((c, "--workers", n, "--workers: expected 1 to 512") for c in ("sensitivity", "tune", "reproduce")
      for n in ("0", "-1", "1000", "100000", "1" + "0" * 30)),
    ("stability", "--steps", "0", "--steps: expected"),
    ("stability", "--steps", "1000000000", "--steps: expected"),
    ("stability", "--steps", "1" + "0" * 30, "--steps: expected"),
    ("stability", "--tolerance", "nan", "--tolerance: expected"),
    ("stability", "--tolerance", "1e-300", "--tolerance: expected"),
    ("stability", "--along", "H22=-1", "det F = 0"),
    ("stability", "--along", "H22=-9", "det F = -8"),
    ("stability", "--along", "H22=1e300", "expected components of H of at most"),
    ("stability", "--along", "H12=0.1", "unknown input"),
    ("stability", "--along", "x" * 5000 + "=1", "unknown input"),
    ("stability", "--along", "H22", "--along: expected"),
    ("stability", "--along", "H22=nan", "--along: H22: expected a finite number, got 'nan'"),
    ("stability", "--across", "p=1e308", "expected a pressure p of at most"),
    ("stability", "--across", "p=inf", "--across: expected"),
    ("stability", "--across", "p=" + "0," * 4000, "--across: expected"),
    ("stability", "--across", "p=" + ",".join(map(str, range(2000))), "at most 1000 are followed"),
    ("stability", "--across", "H22=1", "both along the lines and across"),
    ("sweep", "--over", "radius=0.2:1e999:3", "expected a finite number"),
    ("sweep", "--over", "radius=0.2:0.3:" + "9" * 400, "expected a COUNT from 2 to 10000"),
    ("sweep", "--over", "radius=" + "0.2," * 4000, "radius: expected a number"),
    ("sweep", "--over", "radius=" + ",".join(f"{0.2 + k * 1e-6:.6f}" for k in range(10001)), "at most 10000 values"),
    ("sweep", "--over", "radius=nan,0.2", "expected a finite number"),
    ("sweep", "--over", "r" * 5000 + "=0.2,0.3", "no parameter of the cell has this name"),
    ("sweep", "--over", "r" * 5000, "expected a parameter and its values"),
    ("sweep", "--over", "pore=2um:10um:5", "the size of the pore is a scale"),
    ("sweep", "--over", "pore=0.3,0.4", "'--over viscosity=...' has the same effect, or run copies of the study"),
    ("sweep", "--over", "size=0.3,0.4", "no parameter of the cell has this name"),
    ("sweep", "--over", "poisson_ratio=0.2,0.3", "closure 'mean-gradient' takes the stress"),
    ("tune", "--depths", "1000000", "--depths: expected whole numbers from 1 to 20"),
    ("tune", "--depths", "0", "--depths: expected whole numbers"),
    ("tune", "--depths", "1.5", "--depths: expected whole numbers"),
    ("tune", "--depths", "", "--depths: expected whole numbers"),
    ("tune", "--depths", "9" * 5000, "--depths: expected whole numbers"),
    ("tune", "--widths", "1000000000", "--widths: expected whole numbers from 1 to 1024"),
    ("tune", "--widths", "-1", "--widths: expected whole numbers"),
    ("tune", "--widths", ",".join(map(str, range(1, 900))), "at most 1000 are trained"),
    ("tune", "--widths", "w" * 5000, "--widths: expected whole numbers"),
    ("tune", "--activations", "a" * 5000, "--activations: expected some of"),
    ("tune", "--margin", "nan", "--margin: expected"),
    ("tune", "--margin", "-1", "--margin: expected"),
    ("tune", "--margin", "inf", "--margin: expected"),
    ("units", "--force", "1e308", "--force: expected"),
    ("units", "--force", "nan", "--force: expected"),
    ("units", "--pore", "0", "--pore: expected"),
    ("units", "--length", "-1", "--length: expected"),
    ("units", "--viscosity", "1e-308", "--viscosity: expected"),
    ("units", "--viscosity", "inf", "--viscosity: expected"),
    ("units", "--scenario", "s" * 5000, "unknown scenario"),
    ("run", "--executor", "b", "expected one of 'auto', 'serial', 'processes', 'dask', got 'b'"),
    ("run", "--law", "b", "expected one of 'surrogate', 'linear', 'direct', got 'b'"),
    ("cell rev", "--count", "1.5", "expected a whole number, got '1.5'"),
    ("store clear", "--unused", "-1", "expected at least 0, got '-1'"),
    ("store clear", "--unused", "some", "expected a number, got 'some'"),
    ("data check", "--tolerance", "nan", "--tolerance"),
    ("data check", "--tolerance", "-1", "--tolerance"),
    
    ("verify", "--case", "c" * 5000, "unknown"),
    ("verify", "--fem", "f" * 5000, "fff"),
    ("crosscheck", "--fem", "f" * 5000, "fff"),
    ("crosscheck", "--surrogate", "s" * 5000, "sss"),
    ("reproduce", "--figure", "f" * 5000, "figure"),
    ("reproduce", "--figure", "1" + "0" * 400, "figure"),
    *((c, o, "b" * 5000, "bbb") for c, o in (
        ("run", "--fem"), ("run", "--macro"), ("run", "--surrogate"), ("run", "--closure"), ("sample", "--fem"),
        ("check", "--fem"), ("check", "--macro"), ("check", "--surrogate"), ("check", "--closure"),
        ("run", "--executor"), ("run", "--fallback"), ("tune", "--surrogate"), ("stability", "--fem"),
        ("sensitivity", "--fem"), ("cell state", "--fem"), ("cell fields", "--fem"), ("reproduce", "--fem"),
    )),
]  # fmt: skip
#: Words behind a command that cannot be used, and a part of the message.
WORDS = [
    ("units", "time", "expected a quantity and its dimensionless value"),
    ("units", "time=nan", "expected a quantity"),
    ("units", "time=1e308", "expected a quantity"),
    ("units", "time=" + "9" * 5000, "expected a quantity"),
    ("units", "t" * 5000 + "=1", "unknown quantity"),
    ("reproduce", "p" * 5000, "unknown publication"),
    ("init", "k" * 5000, "kkk"),
    *(("plugin new", name, "") for name in ("", "a b", "../x", "a/b", "1", "-", "ä", "a" * 5000, "a\nb",
                                            "skfem\0", "__init__", ".", "CON!")),
]  # fmt: skip


def numeric() -> list[tuple[str, str]]:
    """Every numeric option of every command."""
    found = []
    for command in sorted(commands()):
        parsed: Any = whole_program()
        for word in command.split():
            parsed = parsed.commands[word]
        for name, hint in get_type_hints(parsed.callback, include_extras=True).items():
            plain, *information = get_args(hint) if get_origin(hint) is Annotated else (hint,)
            if {int, float} & {plain, *get_args(plain)}:
                names = [text for each in information for text in each.param_decls or () if text[0] == "-"]
                found.append((command, names[0] if names else f"--{name}"))
    return found


TORCH = study({"surrogate": {"backend": "torch"}})


def tried(command: str, option: str, text: str, part: str) -> Row:
    words = (*command.split(), *NEEDED[command], f"{option}={text}")
    extra = ("--pore=1", "--length=1", "--force=1") if command == "units" and option != "--scenario" else ()
    extra = tuple(word for word in extra if not word.startswith(option))
    if command == "units" and option == "--viscosity":
        extra = ("--force=1", "--pore=1", "--length=1")
    name = f"{command} {option}={text[:30]!r} of {len(text)}"
    files = {CONFIG: TORCH if command == "tune" else study()}
    return Row(name, words + extra, (part,), files)


def words(command: str, text: str, part: str) -> Row:
    more = (
        ("--kind", "sampler")
        if command == "plugin new"
        else ("--out", "out")
        if command == "reproduce"
        else ()
    )
    return Row(f"{command} {text[:30]!r} of {len(text)}", (*command.split(), *more, "--", text), (part,))


ROWS = [
    *(tried(command, option, text, "") for command, option in numeric() for text in NUMBERS),
    *(tried(*each) for each in REFUSED),
    *(words(*each) for each in WORDS),
]
