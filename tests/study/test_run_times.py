"""Time of a whole run that ``porocore check`` tells before anything is measured."""

from dataclasses import replace

import pytest

from porocore.study.config.loading import load_config
from porocore.study.notes.forecast import RunTimes, Workload, as_time, decision_time, expected_steps
from porocore.study.run.composition import make_backend
from tests.helpers.invoked import BENCHMARK, invoke


def example(name, **macro):
    config = load_config(BENCHMARK.with_name(f"{name}.yaml"))
    return config.model_copy(update={"macro": config.macro.model_copy(update=macro)})


def times_of(config):
    """Of two workers, and of the cell of the examples, whose meshes have so many nodes."""
    sampler, nodes = make_backend("sampler", config), (8_444, 17_405)
    work = replace(Workload.of(config, sampler.expected, 1, nodes), workers=2, serial=False)
    return RunTimes.of(config, work, sampler)


#: Time steps that the examples took whose steps are chosen by their error.
@pytest.mark.parametrize(
    ("name", "taken"),
    [("cartilage-confined", 115), ("soil-strip", 102), ("brain-indentation", 222), ("gel-indentation", 219)],
)
def test_the_steps_of_a_tolerance_are_known_about(name, taken):
    """A forecast from the time plan alone told 25, 31 and 23."""
    config = example(name)
    assert 0.7 * taken < expected_steps(config.macro.problem(config.macro.loads[0])) < 1.5 * taken


def test_the_steps_of_a_plan_are_counted():
    config = example("filter")
    assert expected_steps(config.macro.problem(0.02)) == 20
    finer = config.macro.time.model_copy(update={"tolerance": 1e-4})
    tight = example("filter", time=finer).macro.problem(0.02)
    loose = example("filter", time=finer.model_copy(update={"tolerance": 4e-4})).macro.problem(0.02)
    assert expected_steps(tight) == pytest.approx(2 * expected_steps(loose))


#: Processor seconds of the body with both laws, and of the whole run with two workers, on a machine with other work.
MEASURED = {
    "cartilage-confined": (5.1, 25),
    "filter": (3 * 0.38, 33),
    "dehghani2022": (15.2, 65),  # the body by the clock of a busy machine
    "soil-strip": (25.8, 104),
}


@pytest.mark.parametrize("name", MEASURED)
def test_the_time_of_a_run_is_told_within_a_factor_of_two(name):
    body, run = MEASURED[name]
    times = times_of(example(name))
    assert body / 2 < times.macro < 2 * body
    assert run / 2 < times.total < 2 * run


@pytest.mark.parametrize(("name", "measured"), [("soil-strip", 4.7)])
def test_exploring_by_macro_runs_takes_the_time_of_their_bodies(name, measured):
    """It was told to take 2.4 s, whatever the body."""
    config = example(name)
    assert (
        measured / 2
        < decision_time(config.macro, config.closure, make_backend("sampler", config))
        < 2 * measured
    )


def test_the_whole_is_the_sum_of_its_parts():
    config = example("filter")
    times = times_of(config)
    parts = (times.cells, times.training, times.macro, times.around)
    assert (times.choosing, times.total) == (0, pytest.approx(sum(parts)))
    cells, training, macro, around = map(as_time, parts)
    assert times.line(2) == (
        f"  the run takes about {as_time(times.total)} in all on 2 quiet cores, within a factor of two or so: cells "
        f"{cells}, training {training}, macro {macro}, start and report {around}"
    )
    strip = times_of(example("soil-strip"))
    assert f", choosing them {as_time(strip.choosing)}, training" in strip.line(2)


def test_an_unknown_training_is_said_to_come_on_top():
    config = example("filter")
    other = config.model_copy(update={"surrogate": config.surrogate.model_copy(update={"backend": "other"})})
    times, known = times_of(other), times_of(config)
    assert times.training is None
    assert times.total == pytest.approx(known.total - known.training)
    assert "training is not known, and comes on top" in times.line(1)


def test_check_tells_it():
    done = invoke("check", BENCHMARK.with_name("filter.yaml"))
    assert done.exception is None, done.output
    (line,) = [line for line in done.stdout.splitlines() if " in all on " in line]
    assert line.startswith("  the run takes about ")
    assert ", start and report " in line
