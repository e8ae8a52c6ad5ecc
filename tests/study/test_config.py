"""Configurations: what is accepted, what identifies a stage, and how faults are told."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
import yaml

from porocore.core.files.yaml_document import YamlDocument
from porocore.core.inputs import NAMES
from porocore.errors import ConfigurationError
from porocore.study.config import loading as examples
from porocore.study.config.config import InputName, RunConfig, differences
from porocore.study.config.loading import as_stated_path, benchmark_path, crosscheck_path, load_config

EXAMPLES = Path(__file__).parents[2] / "examples"
BENCHMARK = EXAMPLES / "dehghani2022.yaml"


@pytest.fixture
def edit(tmp_path):
    """A function that writes the benchmark with pieces of its text replaced and returns the path."""

    def edit(*replacements):
        text = BENCHMARK.read_text(encoding="utf-8")
        for old, new in replacements:
            assert old in text
            text = text.replace(old, new)
        path = tmp_path / "study.yaml"
        path.write_text(text, encoding="utf-8")
        return path

    return edit


def fault(path, *parts):
    """The one line of the error that has all ``parts``, the line it points at, and the last key."""
    with pytest.raises(ConfigurationError) as error:
        load_config(path)
    (line,) = [line for line in str(error.value).splitlines() if all(part in line for part in parts)]
    name, number, key, *_ = line.split(":")
    assert name == str(path)
    last_key = [part for part in key.strip().split(".") if not part.isdigit()][-1]
    return line, path.read_text(encoding="utf-8").splitlines()[int(number) - 1], last_key


def test_the_benchmark_is_the_papers():
    config = load_config(BENCHMARK)
    assert (config.cell.geometry.radius, config.cell.material.poisson_ratio, config.cell.viscosity) == (
        0.25,
        0.35,
        1e-3,
    )
    assert list(config.sampling.inputs) == ["p", "H22"]
    assert config.sampling.inputs["H22"].range == (-0.4, 0.04)
    assert config.sampling.sampler_options()["step"] == {"p": 0.04, "H22": 0.03}
    assert config.macro.loads == (-0.2, -0.01)
    problem = config.macro.problem(-0.2)
    assert (problem.body.size, problem.body.elements, problem.load) == ((0.1, 7.5, 0.1), (1, 106, 1), -0.2)
    assert problem.boundary["y+"].traction == (0, 1, 0)
    assert problem.boundary["x+"].displacement == (0, None, 0)
    assert problem.time.ramp_increments == 10
    assert problem.time.ramp_step == pytest.approx(problem.time.step / 10)
    assert problem.time.profiles == (1, 10, 40)


def test_the_second_example_differs_in_the_radius_alone():
    stated = load_config(EXAMPLES / "dehghani2022-as-stated.yaml")
    changed = [d for d in differences(load_config(BENCHMARK), stated) if not d.startswith("title")]
    assert changed == ["cell.geometry.radius (0.25, not 0.2)"]


def test_the_packaged_benchmark_is_the_example():
    assert load_config(benchmark_path()) == load_config(BENCHMARK)
    build = tomllib.loads((EXAMPLES.parent / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["hatch"]
    packaged = build["build"]["targets"]["wheel"]["force-include"]
    assert packaged == {
        f"examples/{path.name}": f"porocore/data/{path.name}" for path in EXAMPLES.glob("*.yaml")
    }
    assert crosscheck_path().is_file()
    assert as_stated_path().is_file()


def test_an_installed_package_uses_its_own_copy(tmp_path, monkeypatch):
    monkeypatch.setattr(examples, "__file__", str(tmp_path / "porocore" / "study" / "config" / "examples.py"))
    copy = tmp_path / "porocore" / "data" / examples.BENCHMARK
    copy.parent.mkdir(parents=True)
    copy.write_bytes(BENCHMARK.read_bytes())
    assert benchmark_path() == copy


def test_the_resolved_configuration_is_complete_and_loads_to_the_same(tmp_path):
    config = load_config(BENCHMARK)
    path = tmp_path / "resolved.yaml"
    path.write_text(config.resolved_yaml(), encoding="utf-8")
    again = load_config(path)
    assert again == config
    assert again.identity == config.identity
    assert yaml.safe_load(config.resolved_yaml())["macro"]["newton"]["tolerance"] == 1e-9


def test_numbers_that_yaml_takes_for_text_are_numbers(edit):
    path = edit(("viscosity: 1.0e-3", "viscosity: 1e-3"))
    assert yaml.safe_load(path.read_text())["cell"]["viscosity"] == "1e-3"
    assert load_config(path).cell.viscosity == 1e-3


def test_input_names_agree_with_the_input_space():
    assert InputName.__args__ == NAMES


def test_ranges_of_the_cell_are_the_last_inputs(edit):
    path = edit(("radius: 0.25", "radius: {range: [0.2, 0.3]}"))
    inputs, states = load_config(path).input_space(), load_config(BENCHMARK).input_space()
    assert inputs.names == (*states.names, "radius")
    assert inputs.parameters == ("radius",)
    np.testing.assert_array_equal(inputs.parameter_ranges, [[0.2, 0.3]])
    assert load_config(BENCHMARK).sampling.input_space() == states


def test_workers_are_counted():
    config = load_config(BENCHMARK)
    assert config.sampling.worker_count() >= 1
    assert config.sampling.model_copy(update={"workers": 7}).worker_count() == 7


@pytest.mark.parametrize(
    ("old", "new", "changed"),
    [
        ("radius: 0.25", "radius: 0.24", {"cell", "sampling", "test", "training", "macro"}),
        ("backend: skfem", "backend: dolfinx", {"cell", "sampling", "test", "training", "macro"}),
        ("step: 0.03", "step: 0.02", {"sampling", "training", "macro"}),
        ("tolerance: 0.05", "tolerance: 0.1", {"sampling", "training", "macro"}),
        ("[-0.40, 0.04]", "[-0.30, 0.04]", {"sampling", "test", "training", "macro"}),
        ("count: 120", "count: 50", {"test"}),
        ("backend: torch\n  seed: 2022", "backend: torch\n  seed: 1", {"training", "macro"}),
        ("loads: [-0.2, -0.01]", "loads: [-0.1]", {"macro"}),
        ("    end: 150", "    end: 50", {"macro"}),
        (
            "conductivity: piola-unrotated",
            "conductivity: deformed",
            {"sampling", "test", "training", "macro"},
        ),
        ("conductivity: piola-unrotated", "conductivity: piola", {"macro"}),
        ("workers: auto", "workers: 3", set()),
        ("title: ", "title: Another ", set()),
    ],
)
def test_a_change_touches_the_stages_that_depend_on_it(edit, old, new, changed):
    before, after = load_config(BENCHMARK), load_config(edit((old, new)))
    stages = vars(before.stages)
    assert {name for name in stages if stages[name] != vars(after.stages)[name]} == changed
    assert (before.identity != after.identity) == bool(changed)


def test_the_order_of_the_inputs_counts_and_that_of_the_faces_does_not(edit):
    config = load_config(BENCHMARK)
    data = yaml.safe_load(BENCHMARK.read_text(encoding="utf-8"))
    data["sampling"]["inputs"] = dict(reversed(data["sampling"]["inputs"].items()))
    assert RunConfig.model_validate(data).stages.sampling != config.stages.sampling
    data = yaml.safe_load(BENCHMARK.read_text(encoding="utf-8"))
    data["macro"]["boundary"] = dict(reversed(data["macro"]["boundary"].items()))
    assert RunConfig.model_validate(data).identity == config.identity


def test_another_backend_starts_without_the_options_of_the_configured_one(edit):
    config = load_config(edit(("backend: torch\n", "backend: torch\n  options: {hidden: [8]}\n")))
    before = config.identity
    assert config.with_backends() == config
    assert config.with_backends(surrogate="torch").surrogate.options == {"hidden": [8]}
    other = config.with_backends(fem="dolfinx", surrogate="jax")
    assert (other.fem.backend, other.surrogate.backend) == ("dolfinx", "jax")
    assert other.surrogate.options == {}
    assert other.identity != before
    assert other.surrogate.seed == config.surrogate.seed


def test_the_macroscale_may_have_a_backend_of_its_own(edit):
    config = load_config(edit(("  loads:", "  options: {solver: superlu}\n  loads:")))
    assert (config.macro.backend, config.macro_backend) == (None, "skfem")
    assert config.with_backends(fem="layered", macro="skfem").macro.options == {"solver": "superlu"}
    mixed = config.with_backends(fem="layered", macro="dolfinx")
    assert (mixed.fem.backend, mixed.macro_backend, mixed.macro.options) == ("layered", "dolfinx", {})
    assert mixed.stages.macro != config.with_backends(fem="layered").stages.macro
    # --fem alone is for both again, and what says the same is the same.
    assert mixed.with_backends(fem="skfem").macro_backend == "skfem"
    assert config.with_backends(macro="skfem") == config == config.with_backends(fem="skfem", macro="skfem")
    other = config.with_backends(macro="dolfinx")
    assert other.stages.training == config.stages.training
    assert other.stages.macro != config.stages.macro


@pytest.mark.parametrize("drop", ["", ", drop_grains: true"])
def test_a_study_of_an_image_is_read_from_its_run_folder(edit, tmp_path, drop):
    """With all defaults written, among them true or false."""
    image = tmp_path / "pores.npy"
    np.save(image, np.indices((4, 4, 4)).sum(axis=0) % 2)
    begin = BENCHMARK.read_text(encoding="utf-8").partition("  geometry:\n")[2]
    geometry = "  geometry:\n" + begin[: begin.index("  material:")]
    voxels = f"  geometry: {{kind: voxels, path: {image.name}, pore: 1, repeat: mirror{drop}}}\n"
    config = load_config(edit((geometry, voxels)))
    assert config.cell.geometry.drop_grains is bool(drop)
    held = tmp_path / "config.yaml"
    held.write_text(config.resolved_yaml(), encoding="utf-8")
    assert load_config(held) == config


@pytest.mark.parametrize(
    ("old", "new", "key", "parts"),
    [
        ("radius: 0.25", "radius: 0.5", "cell.geometry.radius", ["0 < radius < 0.5", "got 0.5"]),
        ("radius: 0.25", "radius: 0", "cell.geometry.radius", ["0 < radius < 0.5", "got 0"]),
        ("radius: 0.25", "radius: wide", "cell.geometry.radius", ["expected a number", "got 'wide'"]),
        ("radius: 0.25", "radius:", "cell.geometry.radius", ["expected a number", "got no value"]),
        (
            "radius: 0.25",
            "radius: yes",
            "cell.geometry.radius",
            ["expected a number", "got yes, which YAML reads as true"],
        ),
        ("radius: 0.25", "radios: 0.25", "cell.geometry.radios", ["unknown key", "did you mean 'radius'?"]),
        (
            "poisson_ratio: 0.35",
            "poisson_ratio: 0.5",
            "cell.material.poisson_ratio",
            ["< 0.5", "incompressible"],
        ),
        ("axes: xyz", "axes: xx", "cell.geometry.axes", ["one of x, y, z, xy, xz, yz, xyz", "got 'xx'"]),
        (
            "element: quadratic-curved",
            "element: quadratic",
            "cell.mesh.element",
            ["'linear', 'quadratic-straight' or 'quadratic-curved'", "did you mean"],
        ),
        ("range: [-0.02, 0.24]", "range: [0.24, 0.24]", "sampling.inputs.p", ["[0.24, 0.24] is empty"]),
        (
            "range: [-0.02, 0.24]",
            "range: [0.24]",
            "sampling.inputs.p.range",
            ["a list of 2 entries", "[0.24]"],
        ),
        ("range: [-0.02, 0.24]", "range: [0, 1, 2]", "sampling.inputs.p.range", ["a list of 2 entries"]),
        ("    H22:", "    H44:", "sampling.inputs.H44", ["unknown key", "H11, H12"]),
        (
            "  loads:",
            "  layers: 3\n  loads:",
            "macro.layers",
            ["parts of a body are 'macro.regions:'", "cell.materials"],
        ),
        (
            "  loads:",
            "  indenter: 3\n  loads:",
            "macro.indenter",
            ["'macro.contact:'", "surfaces that it may touch"],
        ),
        ("radius: 0.25", "fibres: 1", "cell.geometry.fibres", ["kind: holzapfel-gasser-ogden"]),
        ("  loads:", "  temperature: 3\n  loads:", "macro.temperature", ["isothermal"]),
        ("  loads:", "  gravity: 9.81\n  loads:", "macro.gravity", ["macro.body_force: [0, "]),
        ("  loads:", "  end: 3\n  loads:", "macro.end", ["unknown key; it belongs under 'macro.time:'"]),
        ("  loads:", "  viscosity: 3\n  loads:", "macro.viscosity", ["it belongs under 'cell:'"]),
        (
            "loads: [-0.2, -0.01]",
            "loads: [yes]",
            "macro.loads.0",
            ["expected a number, got yes, which YAML reads as true"],
        ),
        ("workers: auto", "workers: 0", "sampling.workers", ["'auto' or a", "1 <= workers", "got 0"]),
        ("workers: auto", "wrokers: auto", "sampling.wrokers", ["did you mean 'workers'?"]),
        (
            "closure: mean-gradient",
            "closure: mean-gradiant",
            "closure",
            ["unknown closure 'mean-gradiant'", "did you mean 'mean-gradient'?"],
        ),
        ("loads: [-0.2, -0.01]", "loads: []", "macro.loads", ["at least 1 entry"]),
        ("loads: [-0.2, -0.01]", "loads: [-0.2, 0]", "macro.loads", ["a load of 0 moves nothing"]),
        ("loads: [-0.2, -0.01]", "loads: [.nan]", "macro.loads.0", ["finite number", "got .nan"]),
        (
            "elements: [1, 106, 1]",
            "elements: [1, 10.5, 1]",
            "macro.body.elements.1",
            ["a whole number", "got 10.5"],
        ),
        ("size: [0.1, 7.5, 0.1]", "size: [0.1, -7.5, 0.1]", "macro.body.size.1", ["0 < value", "got -7.5"]),
        (
            "    y-: {",
            "    bottom: {",
            "macro.boundary.bottom",
            ["no such surface", "x-, x+, y-, y+, z-, z+"],
        ),
        ("end: 150", "end: 0.4", "macro.time", ["end = 0.4 does not lie behind the ramp"]),
        ("end: 150", "end: .inf", "macro.time.end", ["expected a finite number", "got .inf"]),
    ],
)
def test_a_fault_names_file_line_key_expectation_and_value(edit, old, new, key, parts):
    line, source, last_key = fault(edit((old, new)), f" {key}: ", *parts)
    assert f"{last_key}:" in source, f"{line!r} points at {source!r}"


def test_an_entry_that_is_refused_is_one_fault(edit):
    with pytest.raises(ConfigurationError) as error:
        load_config(edit(("loads: [-0.2, -0.01]", "loads: ['2 kPa']")))
    assert len(str(error.value).splitlines()) == 1
    assert "macro.loads.0: expected a number without a unit, got '2 kPa'; a load multiplies" in str(
        error.value
    )


def test_a_plate_bears_its_force_alone(edit):
    fault(
        edit(("    y+: {", "    y+: {plate: 1, follower: 1, ")),
        "macro.boundary.y+: ",
        "both a plate",
        "keep one",
    )


def test_a_missing_key_points_at_the_section_that_lacks_it(edit):
    line, source, _ = fault(
        edit(("  loads: [-0.2, -0.01]", "  #")), "macro.loads: missing; add 'loads:' under"
    )
    assert source.startswith("macro:"), line


def test_an_empty_section_is_explained(edit):
    fault(edit(("fem:\n  backend: skfem", "fem:\n #")), " fem: expected a section", "got no value")


def test_all_faults_come_in_one_message_in_the_order_of_the_file(edit):
    path = edit(
        ("radius: 0.25", "radius: 0.7"),
        ("poisson_ratio: 0.35", "poisson_ratio: no"),
        ("    step: 0.75", "    stop: 0.75"),
    )
    with pytest.raises(ConfigurationError) as error:
        load_config(path)
    lines = str(error.value).splitlines()
    assert [line.split(": ")[1] for line in lines] == [
        "cell.geometry.radius",
        "cell.material.poisson_ratio",
        "macro.time.stop",
    ]
    numbers = [int(line.split(":")[1]) for line in lines]
    assert numbers == sorted(numbers)


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("", ["expected sections", "got an empty file"]),
        ("- cell", ["expected sections", "got a list"]),
        ("cell: [1", [":1:", "not valid YAML"]),
        ("cell:\n\tmesh: 1", [":2: expected an indentation by spaces, got a tab", "by two spaces"]),
        ("cell: !!python/object/apply:os.getcwd []", [":1:", "not valid YAML", "python/object"]),
        ("cell: *nowhere", ["undefined alias"]),
        ("cell: &loop {geometry: *loop}", ["an alias that contains itself"]),
        ("title: 2022-13-45", ["month must be in 1..12"]),
        ('title: "a\\0b"', [":1: title: expected text without control characters", r"a\x00b"]),
        ("cell: {geometry: {kind: voxels, file: a.npy}}", ["cell.geometry.file: unknown key", "by 'path:'"]),
        ("sampling: {inputs: {p: [0, 1]}}", ["a section with keys below it (range, step)"]),
        ("title: a\n---\ntitle: b", ["expected a single document"]),
        ("title: a\ncell: {}\ntitle: b", [":3: title: given twice, first on line 1"]),
    ],
)
def test_what_is_not_a_mapping_of_sections_is_refused(tmp_path, text, parts):
    path = tmp_path / "study.yaml"
    path.write_text(text)
    with pytest.raises(ConfigurationError) as error:
        load_config(path)
    assert all(part in str(error.value) for part in [str(path), *parts]), str(error.value)


def test_files_that_cannot_be_read_are_named(tmp_path):
    with pytest.raises(ConfigurationError, match="no such file"):
        load_config(tmp_path / "absent.yaml")
    with pytest.raises(ConfigurationError, match="got a folder"):
        load_config(tmp_path)
    (tmp_path / "binary.yaml").write_bytes(b"\xff\xfe\x00title")
    with pytest.raises(ConfigurationError, match="UTF-8"):
        load_config(tmp_path / "binary.yaml")


def test_merged_keys_may_be_overridden(tmp_path):
    path = tmp_path / "study.yaml"
    path.write_text("side: &side {a: 1, b: 2}\nother:\n  <<: *side\n  b: 3\n")
    document = YamlDocument.read(path)
    assert document.data["other"] == {"a": 1, "b": 3}
    assert document.line(("other", "b")) == 4
