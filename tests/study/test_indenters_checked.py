"""What ``porocore check`` tells of indenters and of the bodies that they are pressed into."""

import numpy as np
import pytest

from porocore.errors import ConfigurationError
from porocore.macro.boundary.rigid import RigidIndenter
from porocore.study.config.loading import load_config
from porocore.study.notes.outline import outline
from tests.helpers.invoked import BENCHMARK

GEL = BENCHMARK.with_name("gel-indentation.yaml").read_text(encoding="utf-8")


def lines(tmp_path, *changes):
    text = GEL
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = tmp_path / "study.yaml"
    path.write_text(text, encoding="utf-8")
    return list(outline(load_config(path)))


def test_an_indenter_that_reaches_the_body_gets_no_warning(tmp_path):
    assert not [line for line in lines(tmp_path) if line.startswith("warning: macro.contact")]


@pytest.mark.parametrize(
    ("old", "new", "part"),
    [
        ("ramp: 0.1 mm", "ramp: -0.1 mm", "moves the indenter against its direction under the load 1"),
        (
            "place: [0 mm, 3 mm, 0 mm]",
            "place: [0 mm, 3.5 mm, 0 mm]",
            "0.1 mm, 0.4 mm are left along its direction",
        ),
    ],
)
def test_an_indenter_that_cannot_reach_the_body_is_told(tmp_path, old, new, part):
    (line,) = (each for each in lines(tmp_path, (old, new)) if each.startswith("warning: macro.contact"))
    assert "macro.contact.ball.displacement" in line
    assert part in line


def test_what_is_left_is_the_way_along_the_direction():
    """A sphere of radius 2 beside a point of a body 1 below it and 1 across: 2 − √3 further down."""
    indenter = RigidIndenter.model_validate(
        {"shape": {"radius": 2}, "place": (0, 1, 0), "displacement": 0.1, "surfaces": ["y+"]}
    )
    assert indenter.way_to(np.array([[1.0, -1.0, 0.0]])) == pytest.approx(1 + 2 - 3**0.5, rel=1e-12)
    assert indenter.way_to(np.array([[3.0, -1.0, 0.0]])) == np.inf


def test_an_indenter_under_a_force_far_from_the_body_is_told(tmp_path):
    force = ("displacement: {ramp: 0.1 mm, until: 5 s}", "force: 1 uN")
    moved = ("place: [0 mm, 3 mm, 0 mm]", "place: [0 mm, 3.5 mm, 0 mm]")
    (line,) = (each for each in lines(tmp_path, force, moved) if "macro.contact.ball" in each)
    assert line.startswith("note: macro.contact.ball.place lies 0.5 mm before the undeformed body")
    assert not [each for each in lines(tmp_path, force) if "macro.contact.ball" in each]


def test_a_round_indenter_in_a_section_is_told_to_be_long(tmp_path):
    told = lines(
        tmp_path,
        (
            "{kind: axisymmetric, radius: 4 mm, height: 3 mm,",
            "{kind: plane-strain, size: [4 mm, 3 mm], symmetry: [x-],",
        ),
        ("side: {pressure: 0}", "x-: {normal: 0}\n    x+: {pressure: 0}"),
    )
    (line,) = (each for each in told if "macro.contact.ball" in each)
    assert line.endswith("in a section the sphere is a cylinder of that radius, infinitely long along z")


def test_the_body_line_of_a_hollow_body_has_its_radii(tmp_path):
    told = lines(
        tmp_path,
        ("radius: 4 mm, height", "radius: 4 mm, inner_radius: 1 mm, height"),
        ("[0 mm, 2.8 mm, 0 mm]", "[2 mm, 2.8 mm, 0 mm]"),
    )
    (line,) = (each for each in told if each.startswith("body: "))
    assert "radii 1 to 4, height 3 mm" in line


@pytest.mark.parametrize(
    ("radius", "part"),
    [
        ("2 kPa", "expected a length, such as 5 mm, got '2 kPa'"),
        ("-1 mm", "expected a number with 0 < radius"),
    ],
)
def test_a_wrong_radius_is_told_once_with_its_key(tmp_path, radius, part):
    with pytest.raises(ConfigurationError) as caught:
        lines(tmp_path, ("kind: sphere, radius: 2 mm", f"kind: sphere, radius: {radius}"))
    assert str(caught.value).count("macro.contact.ball.shape") == 1
    assert f"macro.contact.ball.shape.radius: {part}" in str(caught.value)
