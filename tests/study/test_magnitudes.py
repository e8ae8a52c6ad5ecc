"""Notes of ``porocore check`` on lengths and times that do not suit one another."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

from porocore.core.units import OutputUnits, ResultUnits, Scales
from porocore.errors import ConfigurationError
from porocore.macro.problem import MacroSetup, body_mesh
from porocore.study.config.config import MacroSettings
from porocore.study.notes.abilities import late_functions
from porocore.study.notes.magnitudes import (
    formulas,
    free_cuts,
    level_tables,
    part_as_it_is,
    pulls,
    require_right_side_out,
    run_times,
    separation,
    sideways,
    too_thin,
)

SCALES = Scales(modulus=1e3, length=1e-3, pore=1e-6, viscosity=1e-3)
SECOND = 1 / SCALES.factor("time")


def macro(displacement, end=10.0, ramp=0.1, **more):
    faces = {"y-": {"normal": 0}, "y+": {"displacement": [None, displacement, None]}, "side": {"pressure": 0}}
    faces |= {name: {"normal": 0} for name in ("x-", "z-")}
    return MacroSetup.model_validate(
        {
            "body": {"kind": "quarter-cylinder", "radius": 4.0, "height": 3.0, "elements": [2, 1, 2]},
            "boundary": faces,
            "time": {"end": end, "step": end / 4, "ramp_increments": 1, "ramp_step": ramp, "profiles": []},
        }
        | more
    )


@pytest.mark.parametrize("until", [1e-2, 2e-3, 2e-4])
def test_a_short_ramp_of_a_relaxation_is_usual(until):
    assert list(run_times(macro({"ramp": -0.3, "until": until}), 1.0, ResultUnits())) == []


def test_a_ramp_whose_unit_was_left_out_is_seen_with_both_times():
    """0.05 without its s was a multiple of the scale of time, 6.5 ns, and nothing was said."""
    units = ResultUnits(SCALES)
    setup = macro({"ramp": -0.3, "until": 5e-9 * SECOND}, end=10 * SECOND, ramp=SECOND)
    (note,) = run_times(setup, 2 * SECOND, units)
    assert note.startswith(
        "'until' of a ramp under macro.boundary.y+ is 5e-09 s, and the body consolidates in 2 s"
    )
    assert "did you leave out a unit, here or of cell.viscosity? The time grows with cell.viscosity" in note
    (note,) = run_times(macro(-0.3, ramp=1e-6), 1.0, ResultUnits())
    assert note.startswith("the ramp of macro.time, ramp_increments times ramp_step, is 1e-06, and the body")
    assert list(run_times(macro({"ramp": -0.3, "until": 0.1}, ramp=1e-6), 1.0, ResultUnits())) == []


@pytest.mark.parametrize(
    ("end", "step", "said"),
    [
        (10.0, 2.5, ""),
        (1.0, 0.25, ""),
        (0.21, 0.02, ""),
        (
            0.19,
            0.02,
            "the run ends after 0.19, long before the body consolidates (1); check macro.time, cell",
        ),
        (200.0, 0.5, ""),
        (
            200.0,
            50.0,
            "the run ends after 200, and its steps of 50 are longer than the consolidation (1); check",
        ),
    ],
)
def test_a_run_is_compared_with_its_consolidation(end, step, said):
    time = {"end": end, "step": step, "ramp_increments": 1, "ramp_step": 0.01, "profiles": []}
    notes = list(run_times(macro(-0.3, time=time), 1.0, ResultUnits()))
    assert len(notes) == bool(said)
    assert all(note.startswith(said) for note in notes)


def test_every_odd_time_may_come_of_a_viscosity_without_its_unit():
    """970 without mPa s was 970 Pa s: the ramp was blamed, which was right, and viscosity was no cause at all."""
    time = {"end": 0.09, "step": 0.02, "ramp_increments": 1, "ramp_step": 1e-6, "profiles": []}
    for units, consolidation in ((ResultUnits(), 1.0), (ResultUnits(SCALES), SECOND)):
        end = {"end": 0.09 * consolidation, "ramp_step": 1e-6 * consolidation}
        ramp, early = run_times(macro(-0.3, time=time | end), consolidation, units)
        assert "cell.viscosity" in early
        assert ("cell.viscosity" in ramp) == units.given


@dataclass
class Study:
    """What the note looks at."""

    macro: MacroSetup
    edge: float
    scaled: bool = True
    edges: tuple[float, float, float] = (1.2, 1.0, 1 / 1.2)

    @property
    def cell(self):
        return SimpleNamespace(geometry=SimpleNamespace(sides=self.edges, length=None))

    @property
    def scales(self):
        return Scales(modulus=1e3, length=1e-3, pore=self.edge, viscosity=1e-3) if self.scaled else None


def notes(setup, edge, scaled=True):
    return list(separation(Study(setup, edge, scaled), body_mesh(setup)))


def test_a_body_of_few_cells_is_noted_with_both_lengths():
    plug = macro(-0.3)
    assert notes(plug, 100e-6) == notes(plug, 1.0, scaled=False) == []
    # 3 mm along y; along x the whole is 8 mm of cells of 0.6 mm.
    (note,) = notes(plug, 0.5e-3)
    assert note.startswith(
        "the body is 6 cells thick: 3 mm along y, and the edge of the periodic cell along it is 500 µm (13 along x"
    )
    assert not notes(plug, 4e-3)
    (note,) = too_thin(Study(plug, 4e-3, True), body_mesh(plug))
    assert note.startswith("the body is thinner than one cell: 3 mm along y, and the edge of the periodic")
    assert "scales.pore" in note


def test_each_axis_counts_by_its_own_edge_and_a_held_one_is_named():
    """A cell with edges of 0.72, 0.72 and 1.04 mm in 6 by 4 by 5 mm: 4.8 of them along z are the fewest."""
    faces = {
        "x-": {"normal": 0},
        "y-": {"normal": 0},
        "y+": {"normal": -0.3},
        "x+": {"pressure": 0},
        "z-": {"normal": 0},
    }
    body = {"kind": "box", "size": [6, 4, 5], "elements": [1, 1, 1]}
    study = Study(MacroSetup.model_validate({"body": body, "boundary": faces}), 0.72e-3 / 1.2)
    study.edges = (1.2, 1.2, 1.2 * 1.04 / 0.72)
    assert "4.8 cells thick: 5 mm along z" in next(separation(study, body_mesh(study.macro)))
    study.macro = MacroSetup.model_validate({"body": body, "boundary": faces | {"z+": {"normal": 0}}})
    held = next(separation(study, body_mesh(study.macro)))
    assert "4 mm along y" in held
    assert "along z both faces are held" in held


def test_across_rigid_planes_a_column_has_no_size():
    sides = {face: {"normal": 0} for face in ("x-", "x+", "z-", "z+", "y-")}
    column = {"body": {"kind": "box", "size": [0.01, 2, 0.01], "elements": [1, 2, 1]}, "boundary": sides}
    setup = MacroSetup.model_validate(column | {"boundary": sides | {"y+": {"pressure": 0}}})
    assert np.ptp(body_mesh(setup).points, axis=0).min() == pytest.approx(0.01)
    assert notes(setup, 0.1e-3) == []
    assert "2 mm along y" in notes(setup, 0.5e-3)[0]


@pytest.mark.parametrize(
    ("value", "loads", "said"),
    [
        ({"ramp": -160, "until": 1}, [1], "u_2 = -160 mm at t = "),
        ({"ramp": -3.2, "until": 1}, [1], "u_2 = -3.2 mm at t = "),
        (-1.0, [1, 4], "under the load 4"),
        ({"ramp": 2.0, "until": 1}, [-2], "u_2 = -4 mm at t = "),
    ],
)
def test_a_body_is_not_turned_inside_out(value, loads, said):
    """-160 in a plug of 2 mm, without its unit, got a range of [-180, 180], 'no faults', and a crash."""
    setup = MacroSettings.model_validate(macro(value).model_dump() | {"loads": loads})
    with pytest.raises(ConfigurationError) as error:
        require_right_side_out(setup, body_mesh(setup), ResultUnits(SCALES, OutputUnits(length="mm")))
    text = str(error.value)
    assert text.startswith("macro.boundary.y+.displacement: u_2 = ")
    assert said in text
    assert "which is 3 mm long between the surfaces y- and y+" in text
    assert "did you leave out a unit? A number without one is a multiple of 1 mm" in text
    with pytest.raises(ConfigurationError, match="is that its sign and size"):
        require_right_side_out(setup, body_mesh(setup), ResultUnits())


@pytest.mark.parametrize(
    ("value", "loads"), [({"ramp": -2.9, "until": 1}, [1, 0.5, -1]), (-0.7, [4]), (30.0, [1])]
)
def test_a_body_that_is_pressed_or_pulled_far_is_its_own_affair(value, loads):
    setup = MacroSettings.model_validate(macro(value).model_dump() | {"loads": loads})
    require_right_side_out(setup, body_mesh(setup), ResultUnits(SCALES))


FORMULAS = {
    "regions": {
        "top": {
            "kind": "layer",
            "above": 2.0,
            "fields": {"radius": "0.2 + 0.01*z", "axes": {"first": [1, "0.1*x", 0], "second": [0, 1, 0]}},
        }
    },
    "fields": {
        "radius": {"formula": "0.2 + 0.1*x*y/3 + t", "initial": 0.2, "over": {"expression": "sin(t)"}},
        "axes": {"about": [0, 0, 1], "angle": "10*t"},
        "poisson_ratio": "0.3",
        "stiffness": 1.5,
    },
}


def test_formulas_of_a_study_with_scales_are_noted_with_what_their_names_count_in():
    setup = macro({"expression": "-0.1*t"}, **FORMULAS)
    units = ResultUnits(SCALES, OutputUnits(length="mm", time="ms"))
    time = units.text(1.0, "time")
    found = {line.partition(": ")[0]: line.partition(": ")[2] for line in formulas(setup, units)}
    assert found == {
        key: f"the formula '{text}' has {names}, the scales of the study"
        for key, text, names in (
            (
                "macro.fields.radius.formula",
                "0.2 + 0.1*x*y/3 + t",
                f"x, y in multiples of 1 mm and t in multiples of {time}",
            ),
            ("macro.fields.radius.over.expression", "sin(t)", f"t in multiples of {time}"),
            ("macro.fields.axes.angle", "10*t", f"t in multiples of {time}"),
            ("macro.regions.top.fields.radius", "0.2 + 0.01*z", "z in multiples of 1 mm"),
            ("macro.regions.top.fields.axes.first.1", "0.1*x", "x in multiples of 1 mm"),
            ("macro.boundary.y+.displacement.1.expression", "-0.1*t", f"t in multiples of {time}"),
        )
    }
    assert list(formulas(setup, ResultUnits())) == []


def test_a_field_whose_course_goes_on_after_the_end_is_noted():
    over = {"radius": {"formula": "0.3", "initial": 0.2, "over": {"ramp": 1, "until": 20 * SECOND}}}
    (note,) = late_functions(macro(-0.1, end=10 * SECOND, fields=over), ResultUnits(SCALES))
    assert note.startswith(
        "the function of time of macro.fields.radius goes on until t = 20 s, beyond the end, 10 s"
    )
    assert list(late_functions(macro(-0.1, end=20 * SECOND, fields=over), ResultUnits(SCALES))) == []


ALONG_Z = {
    "x-": {"normal": 0},
    "z-": {"normal": 0},
    "z+": {"traction": [0, 0, 1], "pressure": 0},
}


def test_loads_across_y_are_noted():
    """Settlements of 5e-14 µm were read as those of a column that stood along z."""
    body = {"kind": "box", "size": (2, 2, 5), "elements": (1, 1, 4)}
    (told,) = sideways(MacroSetup.model_validate({"body": body, "boundary": ALONG_Z}))
    assert told.startswith("the loads act along z, and settlement and heave are displacements along y;")
    assert "take u_3 of a probe" in told
    plate = {**ALONG_Z, "z+": {"plate": -1, "pressure": 0}}
    assert list(sideways(MacroSetup.model_validate({"body": body, "boundary": plate}))) == [told]
    upright = {**ALONG_Z, "y+": {"traction": [0, 1, 0]}}
    assert list(sideways(MacroSetup.model_validate({"body": body, "boundary": upright}))) == []


def test_a_plate_on_a_part_without_symmetry_is_noted():
    """40 mN on a quarter of a specimen were 160 mN on the whole."""
    body = {"kind": "box", "size": (1, 1, 1), "elements": (2, 2, 2)}
    faces = {"x-": {"normal": 0}, "z-": {"displacement": [None, None, 0]}, "y-": {"normal": 0}}
    faces["y+"] = {"plate": -1}
    (told,) = part_as_it_is(MacroSetup.model_validate({"body": body, "boundary": faces}))
    assert told.startswith("no macro.body.symmetry is given, so the force on y+ is that on the part as it is")
    assert "add 'symmetry: [x-, z-]' under macro.body" in told
    walls = faces | {"x+": {"normal": 0}, "z+": {"normal": 0}}
    pressed = faces | {"y+": {"traction": [0, -1, 0]}}
    clamped = faces | {"x-": {"displacement": [0, 0, 0]}, "z-": {}}
    for others in (walls, pressed, clamped):
        assert list(part_as_it_is(MacroSetup.model_validate({"body": body, "boundary": others}))) == []
    given = body | {"symmetry": ["x-", "z-"]}
    assert list(part_as_it_is(MacroSetup.model_validate({"body": given, "boundary": faces}))) == []


def test_forgotten_planes_of_a_part_are_noted():
    """A quarter of a cylinder without its planes of symmetry was computed as it was, free at both cuts."""
    whole = macro(-0.1).model_dump()
    cut = {name: face for name, face in whole["boundary"].items() if name not in ("x-", "z-")}
    (told,) = free_cuts(MacroSetup.model_validate(whole | {"boundary": cut}))
    assert told.startswith("the plane sides ")
    assert {"x-", "z-"} <= {*told.split()}
    assert "they need 'normal: 0' under macro.boundary" in told
    assert list(free_cuts(macro(-0.1))) == []
    box = {"body": {"kind": "box", "size": (2, 2, 5), "elements": (1, 1, 4)}, "boundary": ALONG_Z}
    assert list(free_cuts(MacroSetup.model_validate(box))) == []


def test_a_table_far_beyond_the_body_is_noted():
    """Coordinates in µm without their unit were in mm, and the field was level."""

    def noted(end):
        field = {"kind": "table", "along": "y", "table": [[0, 0.2], [end, 0.3]]}
        return list(level_tables(macro(-0.1, fields={"radius": field}), ResultUnits(SCALES)))

    (told,) = noted(4000)
    assert told.startswith("macro.fields.radius: the table goes from ")
    assert "a coordinate without a unit is a multiple of 0.001 m" in told
    assert noted(3) == []


@pytest.mark.parametrize(
    ("face", "said"),
    [
        ({"displacement": [None, 0.4, None]}, "u_2 on y+ times the load 1 points out of the body and pulls"),
        ({"normal": 0.4}, "the normal displacement of y+ times the load 1 points out of the body and pulls"),
        ({"plate": 2}, "the force of the plate on y+ times the load 1 points out of the body and pulls"),
        ({"traction": [0, 2, 0]}, "t_2 on y+ times the load 1 points out of the body and pulls"),
        ({"pressure": 0.2}, "all that loads the body is 'pressure:' on y+: that of the fluid in the pores"),
        ({"displacement": [None, -0.4, None], "pressure": 0.2}, ""),
        ({"traction": [0, -2, 0], "pressure": 0}, ""),
    ],
)
def test_what_pulls_is_told(face, said):
    setup = macro(-0.1).model_dump()
    setup["boundary"] |= {"y+": face, "side": {}}
    told = list(pulls(MacroSettings.model_validate(setup | {"loads": [1]})))
    assert [note[: len(said)] for note in told] == ([said] if said else [])
