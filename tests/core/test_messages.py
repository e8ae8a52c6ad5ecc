"""Words of messages: no builder ends in an empty list, in nothing or in the class of an exception."""

from __future__ import annotations

import ast
import json
import re
import traceback
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import porocore
from porocore import Cell, ConfigurationError, Study, load_config
from porocore.core.echo import choices, comma_advice, cut, did_you_mean, echo, joined, reason, suggestion
from porocore.study.config.errors import unexpected

ROOT = Path(porocore.__file__).parent
TEXTS = st.text(max_size=120)
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | TEXTS,
    lambda below: st.lists(below, max_size=3) | st.dictionaries(TEXTS, below, max_size=3),
    max_leaves=8,
)


#: A study with several faults.
BAD = {
    "cell": {"viscosity": "1 kg"},
    "sampling": {"inputs": {}},
    "macro": {"boundary": {"up": {}}, "loads": [0]},
}


def assert_says_something(text):
    assert text.strip(), repr(text)
    assert not text.rstrip().endswith((":", " are", " is", ";", ",", "nothing")), text


@settings(deadline=None)
@given(TEXTS, st.lists(st.text(min_size=1, max_size=20).filter(str.strip), max_size=4))
def test_the_builders_of_lists_never_end_in_nothing(name, names):
    for text in (joined(names), choices(names, "the keys are"), suggestion(name, names, "the keys are")):
        if not names:
            assert_says_something(text)
            assert text in ("none", "there are none")
        assert all(each in text for each in names)


@pytest.mark.parametrize("names", [[], (), {}, iter(())])
def test_no_choices_are_a_sentence(names):
    assert choices(names, "its regions are", "it has no regions") == "it has no regions"


@pytest.mark.parametrize(
    ("text", "advice"),
    [
        ("2,0", "; decimals stand after a point: write 2.0"),
        (" -0,1 mm", "; decimals stand after a point: write -0.1 mm"),
        ("1,5e3", "; decimals stand after a point: write 1.5e3"),
        ("1.200,5", "; decimals stand after a point: write 1200.5"),
        ("1,234", "; decimals stand after a point: write 1.234, or 1234"),
        ("1,200.5", "; digits are not grouped: write 1200.5"),
        ("1,234,567 Pa", "; digits are not grouped: write 1234567 Pa"),
        *((text, "") for text in ("2.0", "1,2,3", "1, 2", ",5", "a,b", "5 mm", "5,", "")),
        (2.0, ""),
    ],
)
def test_a_number_with_commas_is_told_as_it_is_meant(text, advice):
    assert comma_advice(text) == advice


def test_a_short_name_is_like_a_slip_of_it_alone():
    names = ["H22", "H32", "p"]
    assert did_you_mean("h22", names) == did_you_mean("H2", names) == "did you mean 'H22'?"
    assert did_you_mean("H23", names) == "did you mean 'H32'?"
    assert did_you_mean("H24", names) == did_you_mean("q", names) == ""


def test_an_unknown_name_beside_a_similar_one():
    assert suggestion("radus", ["radius"], "the keys are") == "did you mean 'radius'? the keys are radius"


@settings(deadline=None)
@given(VALUES)
def test_what_came_is_said_on_one_line(value):
    text = echo(value)
    assert text
    assert "\n" not in text
    assert len(text) <= 90
    assert text != "nothing"


def test_no_value_is_said_so():
    assert unexpected(("cell", "geometry", "radius"), "a number", None) == (
        "cell.geometry.radius: expected a number, got no value; at 0.5 a pore or an obstacle would touch its image in "
        "the next cell"
    )


@settings(deadline=None)
@given(TEXTS, TEXTS)
def test_a_question_names_what_it_asks_for(name, other):
    question = did_you_mean(name, [other])
    assert question in ("", f"did you mean '{other}'?")


@given(TEXTS)
def test_a_cut_text_is_printable(text):
    assert cut(text).isprintable()


def _ends_in_a_list(text: ast.JoinedStr) -> bool:
    """True for a text whose last piece joins names that may be none, as a name in capitals never is."""
    last = text.values[-1]
    call = last.value if isinstance(last, ast.FormattedValue) else None
    if not (isinstance(call, ast.Call) and isinstance(call.func, ast.Attribute) and call.func.attr == "join"):
        return False
    names = [node.id for node in ast.walk(call) if isinstance(node, ast.Name)]
    return not any(name.isupper() for name in names)


#: Errors of which the message says everything: the traceback of the one below is the only one that a caller sees.
SAID = {
    "ConfigurationError", "MemberError", "ValidationError", "OSError", "FileNotFoundError", "IsADirectoryError",
    "NotADirectoryError", "Locked", "yaml.MarkedYAMLError", "UnicodeDecodeError",
}  # fmt: skip


def test_an_error_that_is_said_is_no_cause():
    found = []
    for path in sorted(ROOT.rglob("*.py")):
        for handler in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(handler, ast.ExceptHandler) or handler.type is None:
                continue
            kinds = handler.type.elts if isinstance(handler.type, ast.Tuple) else [handler.type]
            if {ast.unparse(kind) for kind in kinds} <= SAID:
                found += [
                    f"{path}:{node.lineno}"
                    for node in ast.walk(handler)
                    if isinstance(node, ast.Raise)
                    and isinstance(node.cause, ast.Name)
                    and node.cause.id == handler.name
                ]
    assert found == []


@pytest.mark.parametrize(
    "call",
    [
        lambda: Study("no-such-file.yaml"),
        lambda: Study(BAD),
        lambda: Study({**BAD, "cell": {"geometry": {"kind": "voxels", "path": "no-such.tif"}}}),
        lambda: Study("cartilage-confined", macro={"probes": {"far": [9, 9, 9]}}).check(),
        lambda: Study("cartilage-confined", macro={"boundary": {1.5: {"normal": 0}}}),
        lambda: load_config("no-such-file.yaml"),
        lambda: Cell(viscosity=-1),
    ],
)
def test_a_refusal_in_python_has_one_traceback(call):
    with pytest.raises(ConfigurationError) as refused:
        call()
    lines = "".join(traceback.format_exception(refused.value))
    assert lines.count("Traceback (most recent call last)") == 1, lines


def test_no_message_advises_to_delete():
    """A damaged file is moved, which keeps a copy: see ``set_aside``."""
    words = re.compile(r"\bdelete\b", re.IGNORECASE)
    found = []
    for path in sorted(ROOT.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and words.search(node.value):
                found.append(f"{path}:{node.lineno}")
    assert found == []


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (KeyError("format"), "'format' is missing"),
        (KeyError("'x/y' is missing"), "'x/y' is missing"),
        (OSError(28, "No space left on device"), "No space left on device"),
        (TypeError("'int' object is not subscriptable"), "it does not hold what it should"),
        (ValueError("not enough values to unpack (expected 2, got 1)"), "it does not hold what it should"),
        (ValueError(), "it does not hold what it should"),
        (json.JSONDecodeError("Expecting value", "{\n?", 2), "it is no JSON from line 2 on"),
        (ValueError("'x' has\nshape (3,)"), "'x' has shape (3,)"),
    ],
)
def test_the_reason_is_words(error, said):
    assert reason(error) == said


def test_no_message_ends_in_a_list_that_may_be_empty():
    """Messages say names by ``choices``, ``joined`` and ``suggestion``, which know what to say where there is none."""
    found = []
    for path in sorted(ROOT.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Raise):
                texts = [each for each in ast.walk(node) if isinstance(each, ast.JoinedStr) and each.values]
                found += [f"{path}:{each.lineno}" for each in texts if _ends_in_a_list(each)]
    assert found == []


def test_a_whole_number_has_groups_of_digits_and_no_decimals():
    assert comma_advice("1,000", whole=True) == "; digits are not grouped: write 1000"
    assert comma_advice("2,5", whole=True) == ""
