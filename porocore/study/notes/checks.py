"""Checks before the first solve: backends, sampled boxes, workers, body."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from porocore.core.echo import joined
from porocore.core.files.yaml_document import YamlDocument
from porocore.core.inputs import least_volume, value_text
from porocore.core.models.bounds import LARGEST_GRADIENT, LARGEST_PRESSURE
from porocore.core.units import using_units
from porocore.errors import ConfigurationError, PluginError
from porocore.interfaces.command import FileCheck
from porocore.interfaces.surrogate import MORE_STATES, Surrogate, least_states
from porocore.macro.body.mesh import BodyMesh
from porocore.macro.boundary.conditions import boundary_data, not_held
from porocore.macro.boundary.reactions import interpolation
from porocore.macro.boundary.symmetry import Symmetry
from porocore.macro.integration.free_swelling import prepared_alone, starts_swollen
from porocore.macro.laws.closure import CLOSURES
from porocore.macro.problem import MacroProblem, body_mesh
from porocore.plugins import registry
from porocore.plugins.border import refuse
from porocore.plugins.discovery import Offered
from porocore.plugins.hookspecs import short_repr
from porocore.plugins.kinds import OF_A_STUDY, Kind
from porocore.sampling.execution.dask_workers import check_reachable
from porocore.study.config.config import RunConfig
from porocore.study.config.errors import located
from porocore.study.config.loading import command_of_section, section_settings
from porocore.study.notes.abilities import (
    check_time_functions,
    require_cells,
    require_conductivity,
    require_fields,
    require_learner,
    require_memory,
    require_parameters_sampled,
    require_parts,
    require_states,
    unit_of_the_modulus,
)
from porocore.study.notes.magnitudes import require_right_side_out
from porocore.study.notes.reach import DIAGONAL
from porocore.study.run.composition import backends_of, make_backend


def check_backends(config: RunConfig, needed: Collection[Kind] | None = None) -> None:
    """Refuse a study with faults that show before the first solve; ``check`` and ``run`` both call this.

    Finds the backends and tries their options, checks the sampled box, the scheduler and the workers, evaluates
    functions of time, and meshes the body with boundary conditions and probes.

    Parameters
    ----------
    config
        The study.
    needed
        Kinds of backends that must be installed; those of later stages may be elsewhere. None: all.

    Raises
    ------
    PluginError
        A needed backend is unknown, missing or broken.
    ConfigurationError
        Options are unusable, the box reaches det F ≤ 0, states are too few or too many, nobody listens at the
        scheduler's address, a function of time has no value somewhere, there is no such surface, boundary conditions
        contradict each other, do not hold the body or turn it inside out, or a probe lies outside.
    """
    with using_units(config.result_units):
        _check(config, OF_A_STUDY if needed is None else needed)


def check_section(document: YamlDocument, config: RunConfig) -> tuple[str, FileCheck] | None:
    """Check the sections of commands in a study; return the command of the last one, and what all say of the file."""
    found = None
    lines: list[str] = []
    for key in config.sections:
        if (offered := command_of_section(key)) is not None:
            checked = check_file(offered, document, config, key)
            lines += checked.lines
            found = offered.offer.name, FileCheck(lines, checked.options)
    return found


def check_file(
    offered: Offered, document: YamlDocument, config: RunConfig | None = None, key: str = ""
) -> FileCheck:
    """Return what a command says of its section ``key`` in a study, or of a file of its own.

    Raises
    ------
    ConfigurationError
        The section or something that it names is faulty.
    PluginError
        The command cannot be loaded, or returns something wrong.
    """
    command, settings = registry.make_command(offered), None
    model = command.section()
    if config is not None and model is not None:
        settings = section_settings(document, key, model, config.scales)
    with located(document):
        checked = command.check(document, config, settings)
    if not isinstance(checked, FileCheck):
        raise refuse(command, f"check: expected a porocore.FileCheck, got {short_repr(checked)}")
    return checked


def _check(config: RunConfig, needed: Collection[Kind]) -> None:
    cells = {name: config.of_cell(name) for name in config.cell_names}
    find_backends(config, needed)
    for name, one in cells.items():
        with config.keys_of(name):
            check_sampling(one, trained="surrogate" in needed)
    check_time_functions(config.macro)
    require_right_side_out(config.macro, place(config), config.result_units)
    for kind in OF_A_STUDY:
        try:
            for name, one in cells.items() if kind != "macro solver" else [(None, config)]:
                with config.keys_of(name):
                    check_backend(kind, one)
        except PluginError:
            if kind in needed:
                raise


def check_backend(kind: Kind, config: RunConfig) -> None:
    """Try the options of a backend, and the macroscale set-up, before anything is solved or written.

    Raises
    ------
    PluginError, ConfigurationError
        See :func:`make_backend`. The boundary conditions contradict one another or do not hold the body, or the
        surrogate does not predict what the closure needs.
    """
    backend = make_backend(kind, config)
    if kind == "cell solver":
        require_conductivity(type(backend), config.fem.backend, config.conductivity)
    if kind == "sampler":
        require_parameters_sampled(type(backend), config.sampling.sampler, config.cell)
        require_states(config.sampling.sampler, backend.expected)
    if kind == "surrogate":
        require_learner(backend, config.surrogate.backend, config.cell)
        _require_responses(backend, config.surrogate.backend, config.closure)
    if kind == "macro solver":
        problem = config.macro.problem(config.macro.loads[0])
        require_parts(type(backend), config.macro_backend, problem)
        backend.prepare(problem)
        if starts_swollen(problem):
            prepared_alone(backend.prepare, problem, problem.time)


def _require_responses(surrogate: Surrogate, backend: str, closure: str) -> None:
    """Refuse a surrogate that does not provide what the closure needs, as far as it declares that."""
    provided = surrogate.provides
    if provided is None:
        return
    missing = [name for name in CLOSURES[closure].responses if name not in provided]
    if missing:
        model = f" with model '{surrogate.model}'" if surrogate.model else ""
        what = f"'{backend}'{model}"
        raise ConfigurationError(
            f"closure: '{closure}' needs {', '.join(missing)} of the cell, which the surrogate {what} does not "
            "provide; leave surrogate.model at auto, or choose another closure or surrogate"
        )


def find_backends(config: RunConfig, needed: Collection[Kind]) -> None:
    """Find the backends; one error names all that are missing, each name once.

    Raises
    ------
    PluginError
        Some are unknown, missing or broken; one line for each.
    """
    faults: dict[str, str] = {}
    for kind in needed:
        name = backends_of(config)[kind][0]
        try:
            registry.registry().find(kind, name)
        except PluginError as error:
            faults.setdefault(name, str(error))
    if faults:
        raise PluginError("\n".join(faults.values()))


def _in_percent(ranges: Mapping[str, tuple[float, float]]) -> str:
    """Return how a strain is written, where ends look like per cent; empty where none does."""
    strains = [end for name, ends in ranges.items() if name.startswith("H") for end in ends]
    likely = strains and max(map(abs, strains)) >= 2 and all(end == 0 or abs(end) >= 0.5 for end in strains)
    return "; components of H are no per cent: 0.05 is 5 %" if likely else ""


def check_sampling(config: RunConfig, *, trained: bool) -> None:
    """Check the sampled box, the workers, and the number of states if a surrogate learns from them.

    Raises
    ------
    ConfigurationError
        See :func:`check_backends`.
    """
    sampling = config.sampling
    inputs = sampling.input_space()
    J, corner = least_volume(inputs)
    percents = _in_percent({name: swept.range for name, swept in sampling.inputs.items()})
    if J <= 0:
        at = ", ".join(f"{name} = {value:g}" for name, value in corner.items())
        flat = [name for name in DIAGONAL if corner.get(name, 0) <= -1]
        above = f"; {joined(flat)} must stay above -1, where a length becomes zero" if flat else ""
        raise ConfigurationError(
            f"sampling.inputs: the ranges reach det F = {J:.4g} at {at}, but a solid has det F > 0 with F = I + H; "
            f"narrow them{above}{percents}"
        )
    for name, swept in sampling.inputs.items():
        largest = LARGEST_PRESSURE * config.cell.modulus if name == "p" else LARGEST_GRADIENT
        if max(map(abs, swept.range)) > largest:
            raise ConfigurationError(
                f"sampling.inputs.{name}.range: expected at most {value_text(name, largest)}, got "
                f"{inputs.range_text(name)}; no cell bears more"
                f"{percents if name != 'p' else ''}{unit_of_the_modulus(config.scales, name)}"
            )
    given, least = sampling.options.get("count"), least_states(len(inputs))
    if trained and type(given) is int and 0 < given < least:
        raise ConfigurationError(
            f"sampling.options.count: {given} states are too few to train on, at least {least} are needed: "
            f"{MORE_STATES}"
        )
    require_memory(config.cell, sampling)
    if sampling.scheduler is not None:
        check_reachable(sampling.scheduler)


def place(config: RunConfig) -> BodyMesh:
    """Return the mesh of the body after a check of its boundary conditions, probes, regions and fields.

    Raises
    ------
    ConfigurationError
        See :func:`check_backends`.
    """
    problem: MacroProblem = config.macro.problem(config.macro.loads[0])
    mesh = body_mesh(problem)
    if turns := boundary_data(mesh, problem).turns:
        raise ConfigurationError(not_held((), turns))
    interpolation(mesh, problem.probes)
    Symmetry.of(problem)
    if config.cells:
        require_cells(problem, mesh)
    require_fields(config.cell_ranges, problem, mesh)
    return mesh
