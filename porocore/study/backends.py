"""Configured backends, made with their options; model that a surrogate learns; check before a run."""

from __future__ import annotations

from typing import Any

from porocore.core.echo import cut, echo
from porocore.errors import ConfigurationError, PluginError
from porocore.interfaces.surrogate import Surrogate
from porocore.macro.laws import CLOSURES
from porocore.plugins.kinds import Kind
from porocore.plugins.registry import registry
from porocore.study.config.config import RunConfig
from porocore.study.notes.abilities import (
    require_conductivity,
    require_learner,
    require_parameters_sampled,
    require_parts,
    require_states,
)


def make_backend(kind: Kind, config: RunConfig) -> Any:
    """Return the configured backend of one kind, made with its options.

    Raises
    ------
    PluginError
        The backend is unknown, missing or broken.
    ConfigurationError
        The backend does not take these options.
    """
    name, options = _configured(kind, config)
    positional = (config.input_space(),) if kind == "sampler" else ()
    implementation = registry().get(kind, name)
    if kind == "surrogate" and implementation.models:
        options = {**options, "model": surrogate_model(implementation, config)}
    try:
        return implementation(*positional, **options)
    except TypeError as error:
        if not options:
            raise
        raise ConfigurationError(
            f"{kind} '{name}' does not take its options {echo(options)}: {cut(str(error))}"
        ) from error


def surrogate_model(implementation: Any, config: RunConfig) -> str:
    """Return the model that a surrogate learns: the one that the closure needs, or its only one."""
    models: tuple[str, ...] = implementation.models
    if config.surrogate.model == "auto" and config.surrogate_model not in models:
        return models[0]
    return config.surrogate_model


def with_closure(config: RunConfig, closure: str | None) -> RunConfig:
    """Return the configuration with another closure, without the surrogate's options if it learns another model then.

    Raises
    ------
    ConfigurationError
        There is no such closure.
    """
    other = config.with_closure(closure)
    if other.surrogate_model == config.surrogate_model or not config.surrogate.options:
        return other
    try:
        implementation = registry().get("surrogate", config.surrogate.backend)
    except PluginError:  # a stage that needs the surrogate reports it
        return other
    if not implementation.models or surrogate_model(implementation, other) == surrogate_model(
        implementation, config
    ):
        return other
    return other.model_copy(update={"surrogate": config.surrogate.model_copy(update={"options": {}})})


def backend_name(kind: Kind, config: RunConfig) -> str:
    """Return the name of the configured backend of a kind."""
    return _configured(kind, config)[0]


def _configured(kind: Kind, config: RunConfig) -> tuple[str, dict[str, Any]]:
    """Return the name and the options of the backend of a kind."""
    found: dict[Kind, tuple[str, dict[str, Any]]] = {
        "cell solver": (config.fem.backend, config.fem.options),
        "macro solver": (config.macro_backend, config.macro.options),
        "sampler": (config.sampling.sampler, config.sampling.sampler_options()),
        "surrogate": (config.surrogate.backend, config.surrogate.options),
    }
    return found[kind]


def check(kind: Kind, config: RunConfig) -> None:
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
        require_states(config, backend.expected)
    if kind == "surrogate":
        require_learner(backend, config.surrogate.backend, config.cell)
        _check_responses(backend, config)
    if kind == "macro solver":
        problem = config.macro.problem(config.macro.loads[0])
        require_parts(type(backend), config.macro_backend, problem)
        backend.prepare(problem)


def _check_responses(surrogate: Surrogate, config: RunConfig) -> None:
    """Refuse a surrogate that does not provide what the closure needs, as far as it declares that."""
    provided = surrogate.provides
    if provided is None:
        return
    missing = [name for name in CLOSURES[config.closure].responses if name not in provided]
    if missing:
        model = f" with model '{surrogate.model}'" if surrogate.model else ""
        what = f"'{config.surrogate.backend}'{model}"
        raise ConfigurationError(
            f"closure: '{config.closure}' needs {', '.join(missing)} of the cell, which the surrogate {what} does not "
            "provide; leave surrogate.model at auto, or choose another closure or surrogate"
        )
