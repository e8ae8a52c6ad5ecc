"""What ``check`` and ``run`` refuse alike before the first solve: counts, steps, addresses, functions of time."""

from __future__ import annotations

from tests.bad_input.bad_row import Row, faulty

#: Counts that no machine could solve, keep or hold.
COUNTS = (10**9, 10**15, 10**30, 10**50)
#: A configuration of a sampler with a count: inputs without steps.
FREE = {
    "sampling.inputs": {"p": {"range": [-0.02, 0.06]}, "H22": {"range": [-0.1, 0.02]}},
    "sampling.tolerance": None,
}
#: Keys of counts with what a message names.
COUNTED = (
    "sampling.test.count",
    "sampling.workers",
    "macro.time.ramp_increments",
    "macro.newton.iterations",
    "macro.body.elements.1",
    "macro.body.elements.0",
)
OPTIONS = {
    "sobol": ("count", "seed"),
    "latin-hypercube": ("count", "seed"),
    "active": ("count", "seed", "initial", "batch", "candidates"),
    "macro-driven": ("count", "seed", "initial", "batch", "elements", "steps"),
}
#: Functions of time that have no value somewhere between 0 and 12, and a part of the message.
NO_VALUE = {
    "1/t": "divides by zero near t = 0",
    "1/(t - 6)": "divides by zero near t = 6",
    "1/(t - 3.14159265)": "divides by zero near t = 3.14",
    "1/(t**2 - 2)": "divides by zero near t = 1.41",
    "t/(2 - 2)": "divides by zero",
    "1/sin(t)": "divides by zero",
    "tan(t)": "has a pole near t = 1.57",
    "t**-1": "divides by zero near t = 0",
    "(t - 5)**-3": "divides by zero near t = 5",
    "sqrt(5 - t)": "takes the root of a negative number near t = 5",
    "sqrt(-1)": "takes the root of a negative number",
    "(3 - t)**0.5": "takes the root of a negative number near t = 3",
    "(1 - t)**(1/3)": "takes the root of a negative number near t = 1",
    "log(t)": "takes the logarithm of a number that is not positive near t = 0",
    "log(7 - t)": "takes the logarithm of a number that is not positive near t = 7",
    "exp(exp(t))": "becomes too large a number near t = 5.4",
    "exp(1e3*t)": "becomes too large a number",
    "cosh(100*t)": "becomes too large a number",
    "t**99*1e99": "becomes too large a number",
    "1e99*1e99": "becomes too large a number",
    "0/t": "divides by zero",
    "exp(1/(t - 2))": "divides by zero near t = 2",
    "10**t**t": "becomes too large a number",
}
#: Keys under which a function of time may stand, with an index for those of lists.
PLACES = ("traction.1", "pressure", "displacement.1", "follower", "flux")
#: Ranges that reach det F ≤ 0, by input.
FOLDED = {
    "H22 to -1": {"H22": [-1, 0.1]},
    "H22 to -3": {"H22": [-3, 0.1]},
    "two turned inside out": {"H11": [-2.5, 0.1], "H22": [-2.5, 0.1]},
    "a corner of shears": {"H12": [-1.5, 1.5], "H21": [-1.5, 1.5]},
    "a corner of all": {f"H{i}{j}": [-0.5, 0.5] for i in (1, 2, 3) for j in (1, 2, 3)},
}
#: What is no address of a scheduler.
ADDRESSES = {
    "not an address": "expected the address of a dask scheduler",
    "tcp://": "expected the address",
    "tcp://127.0.0.1": "host and port are needed",
    "tcp://127.0.0.1:0": "host and port are needed",
    "tcp://127.0.0.1:1": "no dask scheduler answers",
    "127.0.0.1:1": "no dask scheduler answers",
    "tcp://127.0.0.1:99999": "whose port is no number up to 65535",
    "tcp://127.0.0.1:port": "whose port is no number up to 65535",
    "tcp://[::1": "expected the address",
    "ftp://127.0.0.1:1": "of the protocols, dask knows",
    "tcp://no-such-node.invalid:8786": "no dask scheduler answers",
    "tcp://" + "a" * 70 + ".invalid:1": "no dask scheduler answers",
    "": "scheduler",
    "tcp://" + "x" * 4000 + ":1": "at most 300 characters",
}
#: Values of a length of time that are none.
NO_SECONDS = ("soon", -1, [5], {"s": 5}, True, 10**55, "5 s")


def counted(key: str, count: int) -> Row:
    return faulty(f"{key} = 1e{len(str(count)) - 1}", {key: count}, f"{key}: expected ")


def of_sampler(sampler: str, option: str, count: object) -> Row:
    options = {"count": 20} | {option: count}
    changes = {**FREE, "sampling.sampler": sampler, "sampling.options": options}
    return faulty(
        f"{sampler}: {option} = {count!r}", changes, f"sampling.options.{option}: must be a whole number"
    )


def function(text: str, part: str, command: str = "check", place: str = "traction.1") -> Row:
    name, _, index = place.partition(".")
    course: object = {"expression": text}
    value = (
        course
        if not index
        else [None if name == "displacement" else 0, course, None if name == "displacement" else 0]
    )
    changes = {"macro.boundary.y+": {name: value}}
    words = () if command == "check" else ("--out", "out")
    row = faulty(
        f"{command}: {place} = {text}",
        changes,
        f"macro.boundary.y+.{place}.expression: ",
        part,
        command=command,
    )
    return Row(row.name, row.words + words, row.expected, row.files, prints=row.prints)


def folded(name: str) -> Row:
    inputs = {key: {"range": value} for key, value in FOLDED[name].items()}
    changes = {
        **FREE,
        "sampling.inputs": inputs,
        "sampling.sampler": "sobol",
        "sampling.options": {"count": 64},
    }
    return faulty(f"det F: {name}", changes, "sampling.inputs: the ranges reach det F", "narrow them")


#: MPa was meant.
MILLI = {
    "scales": {"modulus": "3 mPa", "length": "1 mm", "pore": "1 um", "viscosity": "1 mPa*s"},
    "cell.viscosity": "1 mPa*s",
    "sampling.inputs": {"p": {"range": ["-5 kPa", "90 kPa"]}, "H22": {"range": [-0.1, 0.02]}},
    "sampling.sampler": "sobol",
    "sampling.options": {"count": 64},
    "sampling.tolerance": None,
}
ROWS = [
    faulty(
        "a modulus in mPa", MILLI, "no cell bears more: that is 100", "is scales.modulus = 0.003 Pa meant?"
    ),
    *(counted(key, count) for key in COUNTED for count in COUNTS),
    *(counted(key, count) for key in ("sampling.test.seed", "surrogate.seed") for count in COUNTS[1:]),
    *(
        of_sampler(sampler, option, count)
        for sampler, options in OPTIONS.items()
        for option in options
        for count in (10**12, 10**30)
    ),
    *(of_sampler(sampler, "count", count) for sampler in OPTIONS for count in (-1, 1.5, "many", True, [10])),
    *(
        faulty(
            f"{sampler} with 3 states",
            {**FREE, "sampling.sampler": sampler, "sampling.options": {"count": 3}},
            "sampling.options.count: 3 states are too few to train on, at least 6 are needed",
        )
        for sampler in OPTIONS
    ),
    *(
        faulty(
            f"step of {name} = {step:g}", {f"sampling.inputs.{name}.step": step}, "sampling.inputs", "step"
        )
        for name in ("p", "H22")
        for step in (1e-7, 1e-12, 1e-300)
    ),
    *(
        faulty(
            f"range of {name}: {range}",
            {f"sampling.inputs.{name}.range": range},
            # A length that becomes zero is a fault of all ranges together.
            "H22 must stay above -1" if (name, range[0]) == ("H22", -1e5) else f"sampling.inputs.{name}",
        )
        for name in ("p", "H22")
        for range in ([-1e300, 1e300], [-1e5, 1], [0, 1e9], [0.1, 0.1], [1, 0], [0, float("inf")], [0])
    ),
    *(
        faulty(f"{key} = {value}", {key: value}, "macro.time", part)
        for key, value, part in (
            ("macro.time.step", 1e-7, "at most 100000 are taken"),
            ("macro.time.step", 1e-300, "at most 100000 are taken"),
            ("macro.time.end", 1e300, "at most 100000 are taken"),
            ("macro.time.end", 1e7, "at most 100000 are taken"),
            ("macro.time.profiles", [i / 1000 for i in range(1, 10002)], "10000"),
        )
    ),
    *(
        faulty(
            f"elements {elements}", {"macro.body.elements": elements}, "macro.body.elements: ", "at most 1"
        )
        for elements in ([1000, 1000, 1000], [317, 317, 1], [2, 2, 99999])
    ),
    *(function(text, part) for text, part in NO_VALUE.items()),
    *(function(text, part, "run") for text, part in list(NO_VALUE.items())[::5]),
    *(function("1/(t - 3.14159265)", "divides by zero near t = 3.14", place=place) for place in PLACES[1:]),
    *(folded(name) for name in FOLDED),
    *(
        faulty(
            f"scheduler {address[:40]!r} of {len(address)}",
            {"sampling.scheduler": address},
            "scheduler",
            part,
        )
        for address, part in ADDRESSES.items()
    ),
    Row(
        "run: --scheduler",
        ("run", "study.yaml", "--scheduler", "tcp://127.0.0.1:1", "--out", "out"),
        ("no dask scheduler answers",),
        faulty("", {}).files,
    ),
    *(
        faulty(
            f"checkpoint_seconds: {seconds!r}",
            {"macro.options": {"checkpoint_seconds": seconds}},
            "macro.options.checkpoint_seconds: expected a number of at least 0",
        )
        for seconds in NO_SECONDS
    ),
    faulty(
        "solver: fast",
        {"macro.options": {"solver": "fast"}},
        "macro.options.solver: expected auto, direct or iterative, got 'fast'",
    ),
]
