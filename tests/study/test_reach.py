"""What ``porocore check`` predicts of the states that a body reaches, and the lines of YAML that sample them."""

import re
from dataclasses import replace

import numpy as np
import pytest
import yaml

from porocore.core.inputs import InputSpace, components
from porocore.core.units import ResultUnits, Scales
from porocore.errors import SolveError
from porocore.macro.body.kinds import point_states
from porocore.macro.body.mesh import BodyMesh
from porocore.macro.laws.linear import LinearCoefficients
from porocore.report.metrics import LoadCase, case_metrics
from porocore.report.text import flagged_sentence
from porocore.report.words.results import case_warnings
from porocore.states import CellResponse, MacroState
from porocore.study.config.loading import load_config
from porocore.study.notes import linear_reach
from porocore.study.notes import linear_reach as reach_notes
from porocore.study.notes.linear_reach import predicted_reach
from porocore.study.notes.reach import Reach, beyond, flagged_place, left_out_shear, visited
from tests.helpers.invoked import BENCHMARK

SHEAR, POISSON = 1 / 6, 0.2
ONE = np.eye(3)


def coefficients(K=200.0, cubic=0.0):
    """An isotropic solid with Poisson's ratio 0.2; ``cubic`` makes its axes stiffer."""
    lame = 2 * SHEAR * POISSON / (1 - 2 * POISSON)
    swap = np.einsum("ik,jl->ijkl", ONE, ONE)
    C = lame * np.einsum("ij,kl->ijkl", ONE, ONE) + SHEAR * (swap + swap.swapaxes(2, 3))
    C[range(3), range(3), range(3), range(3)] += cubic
    alpha = 0.8 * ONE
    return LinearCoefficients(C, alpha, alpha, 0.05, K * ONE, np.zeros((3, 3, 3, 3)), np.zeros((3, 3)))


TIME = {"end": 40, "step": 1, "ramp_increments": 4, "ramp_step": 5, "profiles": []}
PLANES = {name: {"normal": 0} for name in ("x-", "y-", "z-")}
DRAINED = {"pressure": 0}
PRESSED = PLANES | {
    "x+": DRAINED,
    "z+": DRAINED,
    "y+": {"displacement": [None, -0.16, None], "pressure": 0},
}


def study(tmp_path, boundary, inputs, body=None, loads=(1,), **time):
    data = yaml.safe_load(BENCHMARK.with_name("soil-strip.yaml").read_text(encoding="utf-8"))
    data["sampling"]["inputs"] = {name: {"range": list(ends)} for name, ends in inputs.items()}
    data["macro"] = {
        "body": body or {"kind": "box", "size": [1, 2, 1], "elements": [1, 2, 1]},
        "boundary": boundary,
        "loads": list(loads),
        "time": TIME | time,
    }
    path = tmp_path / "study.yaml"
    path.write_text(yaml.safe_dump(data), encoding="utf-8")
    return load_config(path)


def lines_of(said):
    """The lines of YAML in a text, as ranges by name."""
    found = re.findall(r"(\w+): \{range: \[(\S+), (\S+)\]\}", said)
    return {name: (float(low), float(high)) for name, low, high in found}


def leaving(lines):
    """What is said before the notes on ranges that are too wide, or not needed."""
    lines = list(lines)
    texts = "the body uses less than", "the body does not move it"
    wide = [k for k, line in enumerate(lines) if any(text in line for text in texts)]
    return lines[: wide[0]] if wide else lines


def test_check_says_which_ranges_are_much_too_wide(tmp_path):
    """A guess of 1 kPa for a pressure of 0.08 kPa was never told, and states were spent where the body never came."""
    inputs = {"H11": (-0.02, 0.1), "H22": (-0.1, 0.02), "H33": (-0.02, 0.1), "H12": (-0.1, 0.1)}
    boundary = PLANES | {"y+": {"displacement": [None, -0.16, None]}}
    reached = {"p": (-0.5, 0.5)}
    (solution,) = linear_reach.linear_solutions(
        study(tmp_path, boundary, inputs | reached, **FAST), coefficients()
    )
    top = float(visited(solution, ResultUnits())[0].p.max())
    wide = {"p": (-20 * top, 20 * top)}
    said = list(predicted_reach(study(tmp_path, boundary, inputs | wide, **FAST), coefficients()))
    k = said.index(
        "note: by linear poroelasticity the body uses less than one part in 10 of a range, and states are spent where "
        "it never comes; write under 'sampling.inputs:'"
    )
    unmoved = "the body does not move it, by linear poroelasticity; keep it where large strains may"
    assert said[k + 2] == f"note: remove H12 from 'sampling.inputs:': {unmoved}"
    assert f"since p reaches 0 to {top:.3g} and is sampled 40 times as wide" in said[k + 1]
    (low, high) = lines_of(said[k + 1])["p"]
    assert low == pytest.approx(-0.5 * top, rel=0.01)
    assert high == pytest.approx(1.5 * top, rel=0.01)
    narrow = study(tmp_path, boundary, inputs | {"p": (low, high)}, **FAST)
    assert "uses less than" not in "".join(predicted_reach(narrow, coefficients()))


def test_no_range_is_proposed_that_crushes_the_cell(tmp_path):
    """A load under which the linear solution turns the body inside out is told so; it got H22: [-2.6, 0.01]."""
    inputs = {"H11": (-0.5, 0.5), "H22": (-0.1, 0.02), "H33": (-0.5, 0.5), "p": (-2, 2)}
    boundary = PLANES | {name: {"normal": 0} for name in ("x+", "z+")}
    for pressed, what in ((-0.5, "until it is turned inside out at ("), (-0.4, "of its length at (")):
        loaded = boundary | {"y+": {"traction": [0, pressed, 0], "pressure": 0}}
        said = list(predicted_reach(study(tmp_path, loaded, inputs), coefficients()))
        (note,) = (line for line in said if "the body is compressed " in line)
        assert what in note
        assert "under the load 1, which no cell is likely to bear; lower the load, bring it up over" in note
        assert not lines_of("".join(said))
    loaded = boundary | {"y+": {"traction": [0, -0.1, 0], "pressure": 0}}
    assert "no cell is likely" not in "".join(
        predicted_reach(study(tmp_path, loaded, inputs), coefficients())
    )


def test_no_input_is_taken_away_beside_a_length_that_is_wrong(tmp_path):
    """A voxel of 12 m for 12 um left no pressure, and it said to remove p."""
    inputs = {
        "H11": (-0.02, 0.1),
        "H22": (-0.1, 0.02),
        "H33": (-0.02, 0.1),
        "H12": (-0.1, 0.1),
        "p": (-0.5, 0.5),
    }
    config = study(tmp_path, PLANES | {"y+": {"displacement": [None, -0.16, None]}}, inputs, **FAST)
    for pore, thin in ((1e-6, False), (1.0, True)):
        scales = Scales(modulus=1, length=1e-3, pore=pore, viscosity=1)
        said = "".join(predicted_reach(config.model_copy(update={"scales": scales}), coefficients()))
        assert ("remove H12" in said) != thin


def test_the_line_of_a_linear_prediction_goes_further():
    """Told to sample [-0.008, 0], the run of the plug reached -0.0100; one that is left by little, little."""
    assert (
        Reach("H13", -0.00724, None, -0.00724, 0.0, "").line(ResultUnits(), 0.5)
        == "H13: {range: [-0.011, 0]}"
    )
    sampled = Reach("H23", 0.266, (-0.25, 0.16), -0.2, 0.266, "")
    assert sampled.line(ResultUnits(), 0.5) == "H23: {range: [-0.25, 0.32]}"


#: Undrained, the body keeps its volume but for what the fluid gives way.
FAST = {"ramp_step": 1e-6, "end": 1e-5, "step": 1e-5}
STORED = 0.8**2 / 0.05
LAME = 2 * SHEAR * POISSON / (1 - 2 * POISSON) + STORED


@pytest.mark.parametrize(
    ("time", "poisson"), [({}, POISSON), (FAST, LAME / 2 / (LAME + SHEAR))], ids=["drained", "undrained"]
)
def test_check_predicts_how_far_a_body_gives_way_sideways(tmp_path, time, poisson):
    boundary = PRESSED if not time else PLANES | {"y+": {"displacement": [None, -0.16, None]}}
    inputs = {"H22": (-0.1, 0.02), "p": (-0.5, 0.5)}
    said = leaving(predicted_reach(study(tmp_path, boundary, inputs, loads=[0.1, 1], **time), coefficients()))
    assert said[0].startswith(
        "note: by linear poroelasticity up to 100.0 % of the body leaves the sampled ranges at one time; write under"
    )
    assert [line[:5] for line in said[1:]] in (["  H11", "  H33"], ["  H33", "  H11"])
    for line in said[1:]:
        value = float(re.search(r"since H\d\d = (\S+) at \(0.5, ", line)[1])
        assert value == pytest.approx(0.08 * poisson, rel=0.03)
        assert line.endswith("under the load 1 (not sampled)")
    wider = inputs | lines_of("\n".join(said))
    assert leaving(predicted_reach(study(tmp_path, boundary, wider, **time), coefficients())) == [
        "reach of the body: by linear poroelasticity it stays within the sampled ranges"
    ]


def test_check_says_that_a_shear_takes_the_whole_cell(tmp_path):
    boundary = {"y-": {"displacement": [0, 0, 0]}, "y+": {"displacement": [0.1, 0, 0], "pressure": 0}}
    inputs = {name: (-0.2, 0.2) for name in ("H11", "H22", "H33", "p")}
    said = leaving(predicted_reach(study(tmp_path, boundary, inputs), coefficients()))
    assert said[1].startswith("  H12: {range: [")
    found = re.fullmatch(
        r"note: since H12.* would be sampled, states are solved on the whole cell instead of an eighth: "
        r"some (\S+) (s|min) a state on one quiet core instead of (\S+) (s|min); H12 .*",
        said[-1],
    )
    seconds = {"s": 1, "min": 60}
    assert float(found[1]) * seconds[found[2]] > 4 * float(found[3]) * seconds[found[4]]
    sampled = inputs | {"H12": (-0.2, 0.2)}
    assert "whole cell" not in "".join(predicted_reach(study(tmp_path, boundary, sampled), coefficients()))


def test_check_says_how_little_an_unsampled_shear_matters(tmp_path):
    """It told the cost of sampling it, 100 s a state instead of 5 s, and not that it is 4 % of the strain."""
    boundary = {"y-": {"displacement": [0, 0, 0]}, "y+": {"displacement": [0.005, -0.1, 0], "pressure": 0}}
    inputs = {name: (-0.2, 0.2) for name in ("H11", "H22", "H33", "p")}
    config = study(tmp_path, boundary, inputs)
    said = leaving(predicted_reach(config, coefficients()))[-1]
    name, value, share, square = re.search(
        r"; (H\d\d) = (\S+) is (\S+) % of the largest component of H; without sampling it states stay flagged, and "
        r"results change by no more than about the square of this share, (\S+) %$",
        said,
    ).groups()
    (solution,) = linear_reach.linear_solutions(config, coefficients())
    H = config.sampling.input_space().without_rotation(visited(solution, ResultUnits())[0]).grad_u
    shear = np.abs(H[:, int(name[1]) - 1, int(name[2]) - 1]).max()
    assert abs(float(value.replace("−", "-"))) == pytest.approx(shear, rel=0.06)
    assert float(share) == pytest.approx(100 * shear / np.abs(H).max(), rel=0.05)
    assert float(square) == pytest.approx(float(share) ** 2 / 100, rel=0.06)
    learned = config.model_copy(update={"surrogate": config.surrogate.model_copy(update={"model": "mlp"})})
    assert "square" not in "".join(predicted_reach(learned, coefficients()))


@pytest.mark.parametrize("fails", [False, True])
def test_where_nothing_is_predicted_what_is_prescribed_is_compared(tmp_path, monkeypatch, fails):
    def fail(*_):
        raise SolveError("of a step")

    if fails:
        monkeypatch.setattr(reach_notes, "linear_solutions", fail)
    else:
        monkeypatch.setattr(linear_reach, "MOST", 10)
    config = study(tmp_path, PRESSED, {"H22": (-0.05, 0.02), "p": (-0.5, 0.5)})
    note, why = predicted_reach(config, coefficients())
    assert note.startswith(
        "note: what is prescribed leaves the sampled ranges, on average or more: H22 = −0.08 "
    )
    if fails:
        assert why == "warning: the linear solution of the body fails, and with it the run would: of a step"
    else:
        assert why.startswith("reach of the body: not predicted, since ")
        assert "unknowns of the body" in why


class Surrogate:
    def __init__(self, inputs):
        self.inputs = inputs


def test_lines_of_a_warning_take_in_all_points_of_a_wedge_under_a_follower(tmp_path):
    """Its pressure varies along y, so it is sheared within its elements, more than in their means."""
    body = {"kind": "wedge", "radius": 1.0, "height": 1.0, "angle": 30, "elements": [2, 1, 2]}
    faces = {name: {"normal": 0} for name in ("oblique", "z-", "y-")}
    boundary = faces | {"y+": {"pressure": 0}, "side": {"follower": 0.05}}
    ranges = {name: (-0.1, 0.1) for name in ("H11", "H22", "H33")} | {"p": (-0.05, 0.05)}
    config = study(tmp_path, boundary, ranges, body, ramp_step=0.02, end=1.0)
    (solution,) = linear_reach.linear_solutions(config, coefficients(K=2.0, cubic=0.1))
    flagged = tuple(replace(p, flagged=np.ones_like(p.flagged)) for p in solution.after_rest)
    solution, inputs = replace(solution, profiles=flagged), InputSpace.from_ranges(ranges)
    said = flagged_place(solution, Surrogate(inputs), objective=True)
    assert said.startswith("Beyond what was sampled: H12 = −")
    states, where = visited(solution, ResultUnits())
    wider = InputSpace.from_ranges(ranges | lines_of(said))
    assert beyond(wider, components(wider.without_rotation(states)), where) == []
    means = [inputs.without_rotation(MacroState(p.grad_u, p.element_p)).grad_u[:, 0, 1] for p in flagged]
    assert lines_of(said)["H12"][0] < 1.2 * np.min(means)


def test_the_share_of_the_body_that_leaves_is_told_and_a_tiny_one_is_none(tmp_path, monkeypatch):
    """A block in two layers of elements, drained at its top: only near it the pressure stays low."""
    boundary = PLANES | {"x+": {"normal": 0}, "z+": {"normal": 0}, "y+": PRESSED["y+"]}
    body = {"kind": "box", "size": [1, 2, 1], "elements": [1, 8, 1]}
    wide = {"H22": (-2, 0.5), "p": (-0.5, 2.0)}
    at_once = FAST | {"ramp_increments": 1}
    states = study(tmp_path, boundary, wide, body, **at_once)
    (solution,) = linear_reach.linear_solutions(states, coefficients())
    mean = float(np.median(solution.profiles[-1].element_p))
    config = study(tmp_path, boundary, wide | {"p": (0.5 * mean, 2.0)}, body, **at_once)
    share = float(re.search(r"up to (\S+) % of the body", next(predicted_reach(config, coefficients())))[1])
    assert 0 < share < 50
    monkeypatch.setattr(reach_notes, "LEAST_FLAGGED", 0.6)
    assert next(predicted_reach(config, coefficients())).startswith("reach of the body: by linear")


class OfTheBox(Surrogate):
    """Flags what leaves its box, by itself or in a component that is no input."""

    def predict(self, states, *, tangent=True):
        unit = self.inputs.to_unit(self.inputs.gather(states))
        outside = self.inputs.moves_other(states) | (np.abs(unit - 0.5) > 0.5).any(axis=1)
        none = np.zeros((len(states), 3, 3))
        return CellResponse(none, np.zeros(len(states), int), doubt=outside.astype(np.int64))


@pytest.mark.parametrize(("tolerance", "remark"), [(0.05, True), (0.02, False)])
def test_a_shear_that_alone_flags_a_body_is_weighed(tmp_path, tolerance, remark):
    """By 0.5 % of the results, the report said that the surrogate is not reliable in 92.6 % of the body."""
    boundary = {"y-": {"displacement": [0, 0, 0]}, "y+": {"displacement": [0.005, -0.1, 0], "pressure": 0}}
    ranges = {name: (-0.2, 0.2) for name in ("H11", "H22", "H33")} | {"p": (-0.5, 0.5)}
    config = study(tmp_path, boundary, ranges)
    (solution,) = linear_reach.linear_solutions(config, coefficients())
    solution = flagged_by(OfTheBox(InputSpace.from_ranges(ranges)), solution)
    surrogate = OfTheBox(InputSpace.from_ranges(ranges))
    found = left_out_shear(solution, surrogate, tolerance)
    checked = re.search(
        r"square of this share, (\S+) %$", leaving(predicted_reach(config, coefficients()))[-1]
    )[1]
    assert 100 * found.change == pytest.approx(float(checked), rel=0.05)
    assert found.is_small == remark
    case = LoadCase(solution, solution, left_out=found)
    metrics = case_metrics(case)
    said, warnings = flagged_sentence(metrics, found), case_warnings(metrics, settles=False, left_out=found)
    estimate = f"changes the results by no more than about {100 * found.change:.2g} %"
    assert estimate in (said if remark else warnings[0])
    assert ("not reliable" in said) != remark
    assert (warnings == []) == remark
    assert lines_of(said if remark else found.line).keys() >= {found.name}
    # A box that is left, and a body that is flagged most between the kept times, are no such case.
    narrow = OfTheBox(InputSpace.from_ranges(ranges | {"H22": (-0.02, 0.2)}))
    assert left_out_shear(flagged_by(narrow, solution), narrow, tolerance) is None
    outside = solution.history.flagged.copy()
    outside[1] = 2 * outside.max()
    history = replace(solution.history, flagged=outside)
    early = replace(solution, profiles=solution.profiles[-1:], history=history)
    assert left_out_shear(early, surrogate, tolerance) is None


def flagged_by(surrogate, solution):
    """The solution with the flags of a surrogate at its kept times."""
    mesh, profiles = BodyMesh(solution.points, solution.cells), []
    for profile in solution.profiles:
        states = point_states(mesh, profile.u, profile.p, np.arange(len(mesh.cells)))
        flagged = surrogate.predict(surrogate.inputs.without_rotation(states)).flagged
        share = flagged.reshape(len(mesh.cells), -1).mean(axis=1)
        profiles.append(replace(profile, flagged=share))
    at = [profile.time for profile in profiles]
    shares = np.interp(solution.history.time, at, [p.flagged.mean() for p in profiles])
    return replace(
        solution,
        profiles=tuple(profiles),
        history=replace(solution.history, flagged=shares),
    )
