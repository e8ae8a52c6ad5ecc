"""Long numbers, towers of powers, deep nesting, bombs of aliases, foreign bytes: in YAML, formulas, energies, units."""

from __future__ import annotations

from tests.bad_input.bad_files import fifo, link
from tests.bad_input.bad_row import CONFIG, Content, Row, faulty, study

LONG = 4000
#: Whole files that are no configuration, and a part of the message.
FILES: dict[str, tuple[Content, str]] = {
    "nested flow lists": ("cell: " + "[" * LONG + "]" * LONG, "nested more than 30 levels deep"),
    "nested flow sections": ("cell: " + "{a: " * 500 + "1" + "}" * 500, "nested more than 30 levels deep"),
    "nested block lists": ("cell:\n  " + "- " * 900 + "1\n", "nested more than 30 levels deep"),
    "bomb of aliases": (
        "a0: &a0 [x, x]\n" + "".join(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 25)),
        "aliases spelt out",
    ),
    "bomb of merged sections": (
        "a0: &a0 {x: 1}\n"
        + "".join(f"a{i}: &a{i} {{'<<': [{', '.join([f'*a{i - 1}'] * 9)}]}}\n" for i in range(1, 25)),
        "aliases spelt out",
    ),
    "an alias of itself": ("cell: &loop {geometry: *loop}", "an alias that contains itself"),
    "an alias of itself in a list": ("cell: &loop [*loop]", "an alias that contains itself"),
    "an alias of nothing": ("cell: *nothing", "not valid YAML"),
    "a large file": ("# " + "x" * 1_100_000 + "\n", "expected at most"),
    "many keys": ("".join(f"k{i}: 1\n" for i in range(60_000)), "more than 50000 keys and values"),
    "a whole number of 5000 digits": (f"title: {'9' * 5000}", "a number of 5000 characters; at most 60 are read"),
    "a hexadecimal of 5000 digits": (f"title: 0x{'f' * 5000}", "at most 60 are read"),
    "a sexagesimal of 5000 digits": (f"title: 1{':59' * 1700}", "at most 60 are read"),
    "a float of 5000 digits": (f"title: 0.{'3' * 5000}", "at most 60 are read"),
    "a month that is none": ("title: 2026-99-99", "month"),
    "a hexadecimal without digits": ("title: 0x_", f"{CONFIG}:1"),
    "a tag for numbers": ("title: !!int many", f"{CONFIG}:1"),
    "a tag for floats": ("title: !!float many", f"{CONFIG}:1"),
    "a tag for bytes": ("title: !!binary x", f"{CONFIG}:1"),
    "a tag for sets": ("cell: !!set [a]", f"{CONFIG}:1"),
    "an unknown tag": ("title: !mine x", "not valid YAML"),
    "a section as key": ("? {a: 1}\n: 2", "not valid YAML"),
    "a list as key": ("? [1, 2]\n: 2", "not valid YAML"),
    "two documents": ("a: 1\n---\na: 2", "not valid YAML"),
    "a control character": ("title: a\x07b", CONFIG),
    "Latin 1": ("title: Porosität".encode("latin-1"), "expected YAML text in UTF-8"),
    "UTF-16": ("title: x".encode("utf-16"), "expected YAML text in UTF-8"),
    "lone surrogates": (b"title: \xed\xa0\x80", "expected YAML text in UTF-8"),
    "zeros": (b"\0" * 5000, CONFIG),
    "a named pipe": (fifo, "expected a file, got a"),
    "a device": (link("/dev/zero"), "expected a file, got a"),
    "a key of 1000 characters": (study() + f"{'k' * 1000}: 1\n", "unknown key"),
    "a key with line breaks": (study() + '"a\\nb": 1\n', "unknown key"),
    "a kind of 4000 characters": (study({"cell.geometry.kind": "k" * LONG}), "cell.geometry.kind: expected one of"),
    "a surface of 4000 characters": (
        study({"macro.boundary." + "s" * LONG: {"pressure": 0}}), "expected a name of at most 200 characters, got 4000",
    ),
    "a closure of 4000 characters": (study(closure="c" * LONG), "unknown closure"),
    "a sampler of 4000 characters": (study({"sampling.sampler": "s" * LONG}), "sampler"),
    "a backend of 4000 characters": (study({"fem.backend": "f" * LONG}), "cell solver"),
    "a surrogate of 4000 characters": (study({"surrogate.backend": "s" * LONG}), "surrogate"),
    "an option of 4000 characters": (study({"surrogate.options": {"o" * LONG: 1}}), "surrogate.options"),
    "a sampler's option of 4000 characters": (
        study({"sampling.options": {"o" * LONG: 1}}), "sampling.options: unknown option",
    ),
    "a solver's option of 4000 characters": (study({"macro.options": {"o" * LONG: 1}}), "macro"),
    "a cell solver's option of 4000 characters": (study({"fem.options": {"o" * LONG: 1}}), "fem.options"),
    "a text for a number": (study({"cell.viscosity": "v" * LONG}), "cell.viscosity: expected a number"),
    "a list for a number": (study({"cell.viscosity": list(range(5000))}), "cell.viscosity: expected a number"),
    "an unknown input": (study({"sampling.inputs." + "i" * LONG: {"range": [0, 1]}}), "unknown key"),
    "a path of 5000 characters": (
        study({"cell.geometry": {"kind": "voxels", "path": "p" * 5000}}), "cell.geometry.path",
    ),
    "a body's path of 5000 characters": (
        study({"macro.body": {"kind": "file", "path": "p" * 5000}}), "macro.body.path",
    ),
}  # fmt: skip
#: Formulas of t that are not evaluated, and a part of the message.
FORMULAS = {
    "9" * 1900: "numbers beyond 1e+100 are refused",
    "9" * LONG: "at most 2000 characters",
    "1e999": "numbers beyond 1e+100 are refused",
    "t**9999": "powers beyond 100 are refused",
    "t**" + "9" * 400: "numbers beyond 1e+100 are refused",
    "9**9**9**9": "too large a number",
    "(" * 900 + "t" + ")" * 900: "no formula",
    "-" * 1900 + "t": "nested",
    "sin(" * 390 + "t" + ")" * 390: "formula",
    "+".join(["t"] * 900): "nested more than 400 levels deep",
    "__import__('os').system('touch hacked')": "may stand here",
    "(lambda: t)()": "may stand here",
    "[t for t in t]": "may stand here",
    "t.real": "may stand here",
    "'a'*10**9": "may stand here",
    "True": "may stand here",
    "1j": "may stand here",
    "t if t else 0": "may stand here",
    "sin(t, t)": "one argument",
    "sinus(t)": "unknown function",
    "x" * 1900: "unknown name",
    "t^2": "write a power as **",
    "": "no formula",
    "t +": "no formula",
    "\0": "no formula",
    "t;t": "no formula",
    "0.2 kPa*t": "formulas take no units; expected plain numbers: t is a multiple of the time scale",
    "2t": "no formula",
}
#: Energies of a solid, and a part of the message.
ENERGIES = {
    "I1**(10**10)": "refused",
    "I1**(9**9**9)": "refused",
    "(I1**30)**30": "refused",
    "((I1**9)**9)**9": "refused",
    "I1**" + "9" * 300: "refused",
    "9" * 900: "numbers beyond 1e+100",
    "9" * LONG: "at most 1000 characters",
    "I1*10**10**10": "refused",
    "exp(" * 13 + "I1" + ")" * 13: "nested more than 12 levels",
    "+".join(["I1"] * 210): "at most 400 are read",
    "(I1 + I2 + J)**64*(I1 + I2 + J)**64": "cell.material",
    "1/(I1 - I1)": "not real or too large",
    "sqrt(-1)*I1": "not real or too large",
    "log(0)*I1": "not real or too large",
    "exp(exp(exp(exp(9))))*I1": "not real or too large",
    "factorial(I1)": "unknown function",
    "I1.diff": "may stand here",
    "I" * 900: "unknown name",
    "I1**I1**I1**I1": "cell.material",
    "0": "cell.material",
    "1e90*(I1 - 3)": "cell.material",
}
#: Values with a unit where a stress is expected, and a part of the message.
VALUES = {
    "9" * 100 + " kPa": "",
    "9" * LONG + " kPa": "",
    "1e999 kPa": "",
    "1 kPa**9**9**9": "is not known",
    "1 (kPa**99)**99": "is not known",
    "1 ((kPa**99)**99)**99": "is not known",
    "1 kPa**(9*9*9*9*9*9*9)": "is not known",
    "1 kPa**999999999": "is not known",
    "1 kPa³³³³³³³³³": "is not known",
    "1 kPa⁹⁹⁹⁹⁹⁹": "is not known",
    "1 kPa^99^99^99": "is not known",
    "1 " + "k" * 50 + "Pa": "is not known",
    "1 " + "kPa*" * LONG: "",
    "1 kPa" + " " * LONG + "x": "",
    "1 m": "which is a",
    "1 degC": "which is a temperature",
    "1 __class__": "is not known",
    "1 kPa/0": "is not known",
    "1 kPa**-": "is not known",
    "1 ()": "is not known",
    "1e300 kPa": "",
}
SCALES = {"modulus": "1 kPa", "length": "1 mm", "pore": "1 um"}


def of_file(name: str, command: str = "check") -> Row:
    content, expected = FILES[name]
    words = () if command == "check" else ("--out", "out")
    return Row(f"{command}: {name}", (command, CONFIG, *words), (expected,), {CONFIG: content})


def formula(text: str, part: str) -> Row:
    changes = {"macro.boundary.y+": {"traction": [0, {"expression": text}, 0]}}
    return faulty(f"formula {text[:30]!r} of {len(text)}", changes, "macro.boundary.y+.traction.1", part)


def energy(text: str, part: str) -> Row:
    changes = {"cell.material": {"kind": "expression", "energy": text}}
    return faulty(f"energy {text[:30]!r} of {len(text)}", changes, part)


def value(text: str, part: str) -> Row:
    changes = {"scales": SCALES, "macro.boundary.y+": {"traction": [0, text, 0]}}
    return faulty(f"value {text[:30]!r} of {len(text)}", changes, "macro.boundary.y+.traction.1", part)


ROWS = [
    *(of_file(name) for name in FILES),
    *(of_file(name, "run") for name in list(FILES)[::6]),
    *(formula(text, part) for text, part in FORMULAS.items()),
    *(energy(text, part) for text, part in ENERGIES.items()),
    *(value(text, part) for text, part in VALUES.items()),
    *(
        faulty(f"scales.{key} = {number:g}", {"scales": SCALES | {key: number}}, f"scales.{key}")
        for key in ("modulus", "length", "pore", "viscosity")
        for number in (0, -1, 1e300, 1e-300, float("inf"))
    ),
]
