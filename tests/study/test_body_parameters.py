"""Values of the parameters that a body uses: states lie there, others are flagged, and hashes hang on them."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest

from porocore.core.inputs import MOST, NEAR, InputSpace, SampledRange, farthest
from porocore.sampling.samplers.active import Active
from porocore.sampling.samplers.designs import LatinHypercube, RandomStates, SobolDesign
from porocore.states import MacroState
from porocore.study.config.config import LATTICE, RunConfig, told_apart
from porocore.study.notes.abilities import family_lines, members_of
from porocore.surrogates.polynomial.surrogate import PolynomialSurrogate
from porocore.testing.synthetic.porous_family import porous_training_set

SIDE = {"displacement": [0, None, 0]}
CELL: dict[str, Any] = {
    "geometry": {"kind": "orthogonal-channels", "radius": {"range": [0.2, 0.3]}},
    "material": {"poisson_ratio": {"range": [0.2, 0.4]}},
}
STUDY: dict[str, Any] = {
    "cell": CELL,
    "sampling": {
        "sampler": "sobol",
        "inputs": {"H22": {"range": [-0.1, 0.0]}, "p": {"range": [0, 0.1]}},
        "options": {"count": 24},
        "test": {"count": 12},
    },
    "closure": "potential",
    "macro": {
        "body": {"kind": "box", "size": [0.1, 1, 0.1], "elements": [1, 20, 1]},
        "fields": {"radius": "0.22 + 0.04*y", "poisson_ratio": 0.33},
        "boundary": {**dict.fromkeys(("x-", "x+", "z-", "z+"), SIDE), "y-": {"displacement": [0, 0, 0]}},
        "loads": [-0.04],
        "time": {"end": 100, "step": 10, "ramp_increments": 2, "ramp_step": 1},
    },
}


def study(**changes: Any) -> RunConfig:
    """Settings by their keys, joined by two underscores."""
    settings = copy.deepcopy(STUDY)
    for key, value in changes.items():
        *path, last = key.split("__")
        section = settings
        for part in path:
            section = section.setdefault(part, {})
        section[last] = value
    return RunConfig.model_validate(settings)


def used(config: RunConfig) -> np.ndarray:
    return np.array(config.used_parameters)


def test_values_are_those_of_the_fields() -> None:
    """Steps of a fortieth of the range between the ends of the field; a constant stays as it is."""
    found = used(study())
    np.testing.assert_allclose(found[:, 0], np.arange(0.22, 0.2601, 0.1 / LATTICE), rtol=1e-12)
    assert (found[:, 1] == 0.33).all()
    assert len(used(study(macro__fields__radius=0.245))) == 1


def test_values_of_a_course_in_time_are_those_on_the_way() -> None:
    """A ramp that is over before the second time at which fields are looked at passes all that lies between."""
    swells = {"formula": "0.22 + 0.04*y", "initial": 0.2, "over": {"ramp": 1, "until": 0.01}}
    found = used(study(macro__fields__radius=swells))
    np.testing.assert_allclose(np.unique(found[:, 0]), np.arange(0.2, 0.2601, 0.1 / LATTICE), rtol=1e-12)


def test_values_of_a_field_that_goes_to_and_fro_are_those_between_its_ends() -> None:
    """Its period fits twenty times into the run, and five times as many steps."""
    found = used(study(macro__fields__radius="0.24 + 0.03*sin(2*pi*t/5)"))
    np.testing.assert_allclose(np.unique(found[:, 0])[[0, -1]], [0.21, 0.27], atol=0.1 / LATTICE)
    assert len(found) >= 24


def test_values_are_those_of_the_regions_with_the_cell() -> None:
    """Of two cells each is sampled where its regions are; the answer of a part is that of the whole."""
    other = {"geometry": {"kind": "orthogonal-channels", "radius": {"range": [0.1, 0.2]}}}
    config = study(
        cells={"clay": other},
        macro__regions={
            "deep": {"below": 0.5, "cell": "clay", "fields": {"radius": 0.15}},
            "middle": {"above": 0.5, "below": 0.7, "fields": {"radius": 0.29}},
        },
    )
    np.testing.assert_allclose(used(config.of_cell("clay")), [[0.15]])
    rest = used(config.of_cell(None))
    np.testing.assert_allclose(np.unique(rest[:, 0])[[0, -1]], [0.2475, 0.29])
    assert (rest == used(config)).all()


def test_of_many_values_the_farthest_are_kept() -> None:
    random = np.random.default_rng(0).random((5000, 3))
    found = np.array(told_apart([random], {name: (0.0, 1.0) for name in "abc"}))
    assert len(found) == MOST
    inputs = InputSpace.from_ranges(
        {"p": (0.0, 1.0)}, {name: (0.0, 1.0) for name in "abc"}, tuple(map(tuple, found))
    )
    assert not inputs.not_used(random).any()


def test_farthest_points_begin_with_the_ends() -> None:
    line = np.linspace(0, 1, 9)[:, None]
    assert sorted(farthest(line, 3)) == [0, 4, 8]
    assert len(farthest(np.repeat(line, 3, axis=0), 20)) == 9


def test_hashes_hang_on_the_values_where_a_parameter_varies() -> None:
    body, ranges = study(), study(sampling__parameters="ranges")
    assert ranges.used_parameters == ()
    assert body.stages.sampling != ranges.stages.sampling
    assert body.stages.test != ranges.stages.test
    assert body.stages.cell == ranges.stages.cell
    # Another load, and fields with the same values.
    for same in (study(macro__loads=[-0.02]), study(macro__fields__radius="0.26 - 0.04*y")):
        assert same.stages.sampling == body.stages.sampling
    assert study(macro__fields__poisson_ratio=0.34).stages.sampling != body.stages.sampling
    one = study(cell={}, macro__fields={})
    more = study(cell={}, macro__fields={}, sampling__parameters="ranges")
    assert one.stages == more.stages


INPUTS = study().input_space()


@pytest.mark.parametrize(
    "sampler",
    [
        SobolDesign(INPUTS, 24),
        LatinHypercube(INPUTS, 24, states_per_member=1),
        SobolDesign(INPUTS, 40, corners=True),
        Active(INPUTS, 40),
        RandomStates(INPUTS, 24, states_per_member=4),
    ],
    ids=["sobol", "latin hypercube", "corners", "active", "held out"],
)
def test_states_are_at_values_that_the_body_uses(sampler: Any) -> None:
    x = np.array([request.x for request in sampler.ask()])
    values = [tuple(row) for row in x[:, 2:]]
    assert set(values) <= set(INPUTS.used)
    assert len(set(values)) >= 4
    if not isinstance(sampler, RandomStates):
        assert {min(INPUTS.used), max(INPUTS.used)} <= set(values)
    if isinstance(sampler, SobolDesign):
        assert sampler.members >= len(set(values))


@pytest.mark.parametrize(
    ("count", "given", "members"), [(100, None, 25), (24, None, 12), (8, None, 8), (8, 4, 2)]
)
def test_held_out_states_are_of_twelve_members_at_least(count: int, given: int | None, members: int) -> None:
    test = {"count": count} if given is None else {"count": count, "states_per_member": given}
    config = study(sampling__parameters="ranges", sampling__test=test)
    assert members_of(config, SobolDesign(config.input_space(), 24))[1] == members


def test_no_more_members_are_counted_than_the_body_uses() -> None:
    for config, counted in ((study(), (6, 12)), (study(macro__fields__radius=0.24), (1, 1))):
        sampler = SobolDesign(config.input_space(), 24)
        assert members_of(config, sampler) == counted
        (line,) = family_lines(config, sampler)
        assert line.endswith("poisson_ratio 0.33 (sampling.parameters: body)")
    assert "sampling.parameters" not in next(family_lines(study(sampling__parameters="ranges"), sampler))


def test_parameters_away_from_the_body_are_outside() -> None:
    """At rest too; the hull of the undeformed cells alone holds all values."""
    x = np.array([request.x for request in SobolDesign(INPUTS, 40).ask()])
    around = SampledRange.around(INPUTS, x)
    state = INPUTS.scatter([[-0.05, 0.05, 0.24, 0.33]])
    for theta, outside in (
        ([0.24, 0.33], False),
        ([0.2595, 0.33 + 0.9 * NEAR * 0.2], False),
        ([0.24, 0.36], True),
        ([0.28, 0.33], True),
    ):
        for at in (state, MacroState.zeros(1)):
            assert around.outside(at.with_parameters(np.array([theta]))).tolist() == [outside]
            assert around.far(at.with_parameters(np.array([theta]))).tolist() == [outside]
        assert around.contains([[-0.05, 0.05, *theta]]).tolist() == [not outside]


def test_a_surrogate_of_such_states_flags_others_and_is_read_back(tmp_path: Any) -> None:
    """Both with and without an estimated error."""
    whole = porous_training_set(4).inputs
    line = tuple((radius, 0.3) for radius in np.linspace(0.2, 0.25, 9).tolist())
    ranges = dict(zip(whole.names, zip(whole.lower, whole.upper, strict=True), strict=True))
    names = whole.parameters
    inputs = InputSpace.from_ranges(
        {k: v for k, v in ranges.items() if k not in names}, {k: ranges[k] for k in names}, line
    )
    for tolerance in (None, 0.01):
        data = porous_training_set(8, 1, inputs, tolerance=tolerance)
        fitted = PolynomialSurrogate(degree=3).fit(data, seed=0)
        fitted.save(tmp_path / "surrogate.h5")
        again = PolynomialSurrogate.load(tmp_path / "surrogate.h5")
        assert again.inputs == inputs
        states = inputs.scatter(
            [[-0.04, 0.02, 0.22, 0.3], [-0.04, 0.02, 0.22, 0.4], [-0.04, 0.02, 0.29, 0.3]]
        )
        for each in (fitted, again):
            assert each.predict(states).flagged.tolist() == [False, True, True]
