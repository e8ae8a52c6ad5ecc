"""What is found before anything is solved: ``porocore check``, and faults with file, line and key."""

import io
from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from pydantic import ValidationError

import porocore
from porocore.core.console import Console
from porocore.core.inputs import NAMES, InputSpace, least_volume
from porocore.core.units import OutputUnits, ResultUnits, Scales
from porocore.errors import ConfigurationError
from porocore.macro.problem import MacroSetup, TimePlan
from porocore.plugins import registry
from porocore.study.config.loading import load_config
from porocore.study.notes.checks import check_backends, check_sampling, place
from porocore.study.notes.forecast import as_time, decision_time, decisions, rounds
from porocore.study.notes.linear_reach import prescribed_reach
from porocore.study.notes.magnitudes import left_out, unloaded
from porocore.study.notes.outline import outline
from porocore.study.run import reference
from porocore.study.run.composition import backends_of, make_backend
from porocore.study.run.folder import RunFolder
from tests.helpers.invoked import BENCHMARK, invoke


def test_check_tells_what_a_run_would_do():
    done = invoke("check", BENCHMARK.with_name("brain-indentation.yaml"))
    assert done.exception is None, done.output
    for part in (
        "porosity: 0.41",
        "; of the solid's mesh 0.41",
        "; of the fluid's mesh 0.41",
        "macro-driven, ",
        "p in [-20 Pa, 200 Pa]; ",
        "body: axisymmetric, 10 × 10 mm, volume 3141.6 mm³, 126 quadrilateral elements",
        " unknowns with those that are prescribed",
        "indenter ball, a sphere, on y+: displacement = 0 to 0.6 mm until t = 20 s",
        "probe beneath the ball at 0, 8, 0 mm",
        "up to t = 2000 s",
        "not given in macro.time, so at the defaults, multiples of the scales: smallest_step ",
        "no faults; next: porocore run",
    ):
        assert part in done.stdout, part


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (("[0, 1, 0]", "[0, 0, 0]"), "warning: nothing loads the body"),
        (
            ("[-0.2, -0.01]", "[0.2]"),
            "note: t_2 on y+ times the load 0.2 points out of the body and pulls",
        ),
        (
            (
                "cell:\n",
                "scales: {modulus: 1e5, length: 1e-3, pore: 1e-2, viscosity: 1e-3}\ncell:\n",
            ),
            "warning: the body is thinner than one cell",
        ),
    ],
)
def test_a_warning_proposes_no_run(change, told, tmp_path):
    path, text = tmp_path / "study.yaml", BENCHMARK.read_text(encoding="utf-8")
    assert change[0] in text
    path.write_text(text.replace(*change, 1), encoding="utf-8")
    done = invoke("check", path)
    assert told in done.stdout, done.output
    last = done.stdout.splitlines()[-1]
    assert last.startswith(
        "no faults, but a run would be wasted" if told.startswith("warning") else "no faults; next"
    )


def test_check_tells_the_time_of_macro_runs_between_rounds(tmp_path):
    """It told 9.6 s of a sampling that took 30."""
    options = {
        "sampling__sampler": "macro-driven",
        "sampling__options": {"count": 24, "initial": 12, "batch": 6, "elements": 4},
    }
    config = load_config(study_of(tmp_path, **options))
    sampler = make_backend("sampler", config)
    assert rounds(sampler) == 3  # after 12, 18 and 24 states; none is made before the first of them
    (line,) = decisions(config.macro, config.closure, sampler)
    each = decision_time(config.macro, config.closure, sampler)
    assert line.startswith(
        f"  exploring by macro runs between the rounds: at most some 3 times {as_time(each)}, "
    )
    loads = config.model_copy(update={"macro": config.macro.model_copy(update={"loads": (0.02, 0.04, 0.06)})})
    assert decision_time(loads.macro, loads.closure, sampler) == pytest.approx(3 * each)
    fine = make_backend("sampler", load_config(study_of(tmp_path, sampling__options={"count": 24})))
    assert (
        decision_time(config.macro, config.closure, fine) > 1.3 * each
    )  # on 6 and 20 elements along each axis, not 4
    plan = {"sampler": "sobol", "inputs": {"p": {"range": [-0.1, 0.1]}}, "options": {"count": 24}}
    plain = load_config(study_of(tmp_path, sampling=plan))
    assert list(decisions(plain.macro, plain.closure, make_backend("sampler", plain))) == []


def study_of(tmp_path, **changes):
    """The strip of examples/ on a coarse cell with other values, by dotted key with ``__`` for the dot."""
    data = yaml.safe_load(BENCHMARK.with_name("soil-strip.yaml").read_text(encoding="utf-8"))
    data["cell"]["mesh"] = {"size": 0.5, "fluid_size": 0.5, "element": "linear"}
    for key, value in changes.items():
        *sections, last = key.split("__")
        part = data
        for section in sections:
            part = part.setdefault(section, {})
        part[last] = value
    path = tmp_path / "study.yaml"
    path.write_text(yaml.safe_dump(data, allow_unicode=True), encoding="utf-8")
    return path


def test_check_refuses_a_solid_that_a_run_refuses(tmp_path):
    """By the same sentence; it was said before what the cell is like."""
    path = study_of(tmp_path, cell__geometry={"kind": "sphere-pores", "lattice": "bcc", "radius": 0.7})
    done = invoke("check", path)
    assert isinstance(done.exception, ConfigurationError)
    assert "the solid has no stiffness: there is no solid" in done.stdout
    assert "no faults" not in done.stdout
    with pytest.raises(ConfigurationError) as refused:
        load_config(path).cell.require_stiffness()
    assert str(refused.value) in str(done.exception)
    assert "is not connected across the periodic cell" in str(refused.value)


def test_check_says_what_left_out_defaults_mean(tmp_path):
    """A plan in minutes that leaves out ramp_step got a ramp of half an hour."""
    scales = Scales(modulus=5e5, length=1e-3, pore=23e-9)
    units = ResultUnits(scales, OutputUnits(length="mm", time="min"))
    boundary = {"y+": {"pressure": 0}}
    given = {
        "body": {"kind": "box", "size": [1, 1, 1]},
        "time": {"end": 3, "step": 0.1},
        "boundary": boundary,
    }
    scale = scales.factor("time") / 60
    assert 0.05 * scale == pytest.approx(3.151, rel=1e-3)
    (line,) = left_out(MacroSetup.model_validate(given), units)
    assert line == (
        "not given in macro.time, so at the defaults, multiples of the scales: ramp_step 3.151 min; "
        "smallest_step 6.301e-05 min; profiles 63.01 min"
    )
    time, body = sorted(left_out(MacroSetup.model_validate({"boundary": boundary}), units), reverse=True)
    assert time.split(": ")[1].startswith("end 6301 min; step 31.51 min; ramp_step 3.151 min")
    assert (
        body
        == "not given in macro.body, so at the defaults, multiples of the scales: size 0.1 mm, 7.5 mm, 0.1 mm"
    )
    assert not list(left_out(MacroSetup.model_validate(given), ResultUnits()))
    plan = {"end": 3, "step": 0.1, "ramp_step": 0.05, "smallest_step": 1e-6, "profiles": []}
    assert not list(left_out(MacroSetup.model_validate(given | {"time": plan}), units))


def test_check_and_run_tell_numbers_without_a_unit_beside_values_with_one(tmp_path, monkeypatch):
    """An end of 20, beside a ramp of 20 s, was taken for 20 scale times in silence."""
    text = BENCHMARK.with_name("brain-indentation.yaml").read_text(encoding="utf-8")
    assert "end: 2000 s" in text
    path = tmp_path / "study.yaml"
    path.write_text(text.replace("end: 2000 s", "end: 2000"), encoding="utf-8")
    config, said = load_config(path), io.StringIO()
    (note,) = (line for line in outline(config) if line.startswith("note: macro.time.end: 2000 has no unit"))
    assert note.endswith(" s; write '2000 s' if that is meant")
    conducts = SimpleNamespace(conductivity=np.eye(3))
    monkeypatch.setattr(reference, "load_reference", lambda *each: conducts)
    reference.warn_of_loading(RunFolder(tmp_path, config), console=Console(said))
    assert note.removeprefix("note: ") in " ".join(said.getvalue().split())


def test_check_refuses_a_study_of_a_cell_without_pores(tmp_path):
    with pytest.raises(ConfigurationError, match="has no pores"):
        list(outline(load_config(study_of(tmp_path, cell__geometry={"kind": "no-pores"}))))


def test_check_notes_drained_surfaces_that_no_pore_leads_to(tmp_path):
    path = study_of(tmp_path, cell__geometry={"kind": "sphere-pores", "lattice": "cubic", "radius": 0.3})
    assert "note: the cell conducts no fluid in any direction" in invoke("check", path).stdout
    path = study_of(tmp_path, cell__geometry={"kind": "orthogonal-channels", "axes": "x", "radius": 0.2})
    assert "note: the cell conducts no fluid along y (K_22 = 0)" in invoke("check", path).stdout


FREE = {
    "x-": {"normal": 0},
    "y-": {"displacement": [0, 0, 0]},
    "y+": {"displacement": [0, None, 0], "pressure": 0},
}


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({}, "all prescribed values are 0"),
        (
            {"macro__boundary": {**FREE, "x+": {"traction": [0, {"ramp": 0, "until": 1}, 0]}}},
            "prescribed values",
        ),
        ({"macro__boundary": {**FREE, "x+": {"traction": [0, 1, 0]}}}, ""),
        ({"macro__boundary": {**FREE, "x+": {"flux": {"expression": "t"}}}}, ""),
        ({"macro__body_force": [0, -1, 0]}, ""),
        ({"macro__initial": {"pressure": 0.01}}, ""),
        ({"cell__material": {"kind": "neo-hookean", "swelling": 1.1}}, ""),
    ],
)
def test_check_notes_a_body_that_nothing_loads(changes, said, tmp_path):
    config = load_config(study_of(tmp_path, **({"macro__boundary": FREE, "macro__loads": [1]} | changes)))
    lines = list(unloaded(config.macro, config.all_cells))
    assert len(lines) == bool(said)
    assert all(line.startswith("nothing loads the body") and said in line for line in lines)
    if not changes:
        assert f"warning: {lines[0]}" in list(outline(config))


@pytest.mark.parametrize(
    ("kind", "planes", "said"),
    [
        ("quarter-cylinder", ("x-", "z-"), "a quarter is computed (symmetry planes x- and z-)"),
        ("wedge", ("oblique", "z-"), "one part in 24 is computed (symmetry planes z- and oblique)"),
    ],
)
def test_check_says_of_which_body_the_numbers_are(kind, planes, said, tmp_path):
    body = {"kind": kind, "radius": 1, "height": 1, "elements": [1, 1, 1]}
    faces = {name: {"normal": 0} for name in (*planes, "y-")} | {"y+": {"plate": -0.1, "pressure": 0}}
    settings = {"macro__body": body, "macro__boundary": faces, "macro__surfaces": {}, "macro__probes": {}}
    done = invoke("check", study_of(tmp_path, **settings))
    assert done.exception is None, done.output
    assert f"forces and volumes are those of the whole body, of which {said}" in done.stdout
    note = "note: the cell, of the point group m-3m, is not its own mirror image at 'oblique'"
    assert (note in done.stdout) == (kind == "wedge")


def test_symmetry_planes_are_checked_before_a_run(tmp_path):
    done = invoke("check", study_of(tmp_path, **{"macro__boundary__x-": {"normal": 0, "pressure": 0}}))
    assert isinstance(done.exception, ConfigurationError)
    assert "macro.body.symmetry: 'x-' is no symmetry plane, because it lets fluid through" in str(
        done.exception
    )


def test_default_profile_times_beyond_the_end_are_left_out():
    assert TimePlan().profiles == (1.0, 10.0, 40.0)
    assert TimePlan(end=10).profiles == (1.0, 10.0)
    assert TimePlan.model_validate(TimePlan(end=5).model_dump()) == TimePlan(end=5)
    with pytest.raises(
        ValidationError, match="the profile time 10 lies behind end = 5; leave it out of profiles"
    ):
        TimePlan(end=5, profiles=(1.0, 10.0, 40.0))


@pytest.mark.parametrize(("count", "refused"), [(4, True), (9, True), (10, False)])
def test_check_refuses_too_few_states_to_train_on(count, refused, tmp_path):
    """Of four inputs; training would refuse them with the same words, after they were solved."""
    path = study_of(
        tmp_path, sampling__sampler="sobol", sampling__options={"count": count}, sampling__tolerance=None
    )
    config = load_config(path)
    words = f"{count} states are too few to train on, at least 10 are needed"
    with pytest.raises(ConfigurationError, match=words) if refused else nullcontext():
        check_sampling(config, trained=True)
    check_sampling(config, trained=False)


def test_the_least_volume_of_a_box_is_that_of_no_sampled_state():
    """Random states of random boxes have at least it, and one corner has it."""
    generator = np.random.default_rng(3)
    for names in (("H11",), ("H22", "p", "H12"), NAMES[:9]):
        low = generator.uniform(-0.6, -0.1, len(names))
        inputs = InputSpace(names, tuple(low), tuple(low + generator.uniform(0.1, 0.9, len(names))))
        J, corner = least_volume(inputs)
        states = inputs.scatter(
            np.array(inputs.lower)
            + generator.random((4000, len(names))) * np.ptp([inputs.lower, inputs.upper], axis=0)
        )
        assert np.linalg.det(np.eye(3) + states.grad_u).min() >= J - 1e-12
        there = inputs.scatter([[corner.get(name, 0.0) for name in names]])
        assert np.linalg.det(np.eye(3) + there.grad_u[0]) == pytest.approx(J, abs=1e-14)


@pytest.mark.parametrize(
    ("course", "words"),
    [
        ({"ramp": -0.6, "until": 20}, "u_2 = 0 to -0.6 until t = 20"),
        ({"table": [[0, 0.1], [2, -0.5]]}, "u_2 = (0.1 at t = 0; -0.5 at t = 2)"),
        (
            {"table": [[i, i / 10] for i in range(9)]},
            "u_2 = (0 at t = 0; 0.1 at t = 1; 0.2 at t = 2; …; 0.8 at t = 8)",
        ),
        ({"expression": "0.1*sin(t)"}, "u_2 = 0.1*sin(t)"),
    ],
)
def test_check_says_how_a_course_goes(course, words, tmp_path):
    path = study_of(tmp_path, macro__boundary__strip={"displacement": [None, course, None], "pressure": 0})
    (line,) = [line for line in outline(load_config(path)) if "surface strip" in line]
    assert line.split(": ", 1)[1] == f"{words}, p = 0"


def test_check_notes_a_course_that_goes_on_beyond_the_end(tmp_path):
    text = BENCHMARK.with_name("brain-indentation.yaml").read_text(encoding="utf-8")
    path = tmp_path / "study.yaml"
    assert "until: 20 s}" in text
    for until, noted in (("2000 s", False), ("20000", True)):
        path.write_text(text.replace("until: 20 s}", f"until: {until}}}"), encoding="utf-8")
        lines = [
            line
            for line in outline(load_config(path))
            if "the function of time of macro.contact.ball goes on" in line
        ]
        assert len(lines) == noted
    assert "beyond the end, 2000 s" in lines[0]


@pytest.mark.parametrize(
    ("step", "tolerance", "noted"), [(20, None, True), (2, None, False), (20, 0.01, False)]
)
def test_check_notes_a_step_that_is_longer_than_the_run(step, tolerance, noted, tmp_path):
    time = {"end": 2, "step": step, "ramp_increments": 2, "ramp_step": 0.5, "tolerance": tolerance}
    lines = [
        line
        for line in outline(load_config(study_of(tmp_path, macro__time=time)))
        if "macro.time.step" in line
    ]
    assert len(lines) == noted
    if noted:
        assert lines[0].startswith(
            "note: macro.time.step is 20, longer than the whole run, which ends at 2: after"
        )


def test_a_surface_whose_facets_a_patch_has_taken_is_checked(tmp_path):
    patch = {"macro__surfaces": {"strip": {"of": "y+", "x": [0, 1000]}}}
    config = load_config(study_of(tmp_path, **patch))
    check_backends(config)
    assert any("surface y+, 0 facets" in line for line in outline(config))


def test_the_checks_mesh_the_body_once(monkeypatch):
    """A large body is not meshed for each of them."""
    from porocore.macro.body import kinds

    made = []
    original = kinds.Box.make
    monkeypatch.setattr(kinds.Box, "make", lambda self: made.append(1) or original(self))
    kinds.make_body.cache_clear()
    check_backends(porocore.load_config(BENCHMARK))
    assert len(made) == 1
    assert backends_of(porocore.load_config(BENCHMARK))["macro solver"][0] == "skfem"


def test_check_notes_a_cell_solver_without_contact(monkeypatch):
    solver = registry.get("cell solver", "skfem")
    words = "note: the cell solver 'skfem' does not know contact of the pore wall with itself"
    config = load_config(BENCHMARK)
    assert words not in "\n".join(outline(config))
    monkeypatch.setattr(solver, "contact", False)
    assert words in "\n".join(outline(config))


GYROID = {"kind": "tpms", "surface": "gyroid", "void_fraction": 0.4}


@pytest.mark.parametrize(
    ("cell", "words"),
    [
        # Each size has a mesh of its own; of one size both phases share one.
        (
            {"geometry": GYROID, "mesh": {"size": 0.4, "fluid_size": 0.2, "element": "linear"}},
            "cell.mesh: 'conductivity: deformed' needs the same pore wall in the meshes of solid and fluid",
        ),
        ({"supercell": [2, 1, 1]}, "conductivity: the conductivity of the deformed pore is that of one cell"),
    ],
    ids=["walls", "block"],
)
def test_check_refuses_a_cell_whose_fluid_cannot_follow(cell, words, tmp_path):
    path = study_of(tmp_path, cell=cell, conductivity="deformed")
    done = invoke("check", path)
    assert isinstance(done.exception, ConfigurationError)
    assert words in str(done.exception)
    assert "no faults" not in done.stdout
    assert invoke("check", study_of(tmp_path, cell=cell, conductivity="piola")).exception is None


def test_check_passes_meshes_of_one_size_whose_fluid_follows(tmp_path):
    mesh = {"size": 0.4, "fluid_size": 0.4, "element": "linear"}
    path = study_of(tmp_path, cell={"geometry": GYROID, "mesh": mesh}, conductivity="deformed")
    assert "no faults" in invoke("check", path).stdout


@pytest.mark.parametrize("model", ["mean-gradient", "potential"])
def test_check_compares_what_is_prescribed_with_the_sampled_ranges(tmp_path, model):
    """Of a block of height 2 that is pressed by 8 %, and sheared by 5 %."""
    inputs = {"H11": {"range": [-0.05, 0.05]}, "H22": {"range": [-0.05, 0.02]}, "p": {"range": [-0.1, 0.1]}}
    pressed = {"displacement": [{"ramp": 0.1, "until": 1}, {"ramp": -0.16, "until": 1}, 0], "pressure": 0.2}
    settings = {
        "closure": model,
        "macro__body": {"kind": "box", "size": [1, 2, 1], "elements": [1, 2, 1]},
        "macro__surfaces": {},
        "macro__probes": {},
        "macro__boundary": {"y-": {"displacement": [0, 0, 0]}, "y+": pressed},
        "macro__loads": [1],
    }
    config = load_config(study_of(tmp_path, sampling__inputs=inputs, **settings))
    (note,) = prescribed_reach(config, place(config))
    assert "H12 = 0.05 between the surfaces y- and y+ at t = 1 under the load 1 (not sampled)" in note
    assert "H22 = −0.08 between the surfaces y- and y+" in note
    assert "(sampled in [−0.05, 0.02])" in note
    assert "p = 0.2 on the surface y+" in note
    for line in ("H12: {range: [0, 0.055]}", "H22: {range: [-0.09, 0.02]}", "p: {range: [-0.1, 0.23]}"):
        assert line in note
    inputs |= {"H12": {"range": [0, 0.06]}, "H22": {"range": [-0.09, 0.02]}, "p": {"range": [-0.1, 0.3]}}
    wider = load_config(study_of(tmp_path, sampling__inputs=inputs, **settings))
    assert not prescribed_reach(wider, place(wider))
