"""List of the kinds of plugins: interface versions, suite, scaffold; plugins of the project itself."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from porocore.core.echo import echo
from porocore.errors import ConfigurationError

PROJECT = "porocore"

Kind = Literal["cell solver", "macro solver", "surrogate", "sampler", "command"]
#: Kinds of which a study chooses one each.
OF_A_STUDY: tuple[Kind, ...] = ("cell solver", "macro solver", "surrogate", "sampler")
#: Modules with the hooks of porocore itself. Unlike those of other packages they are found without metadata.
OWN_HOOKS = ("porocore.sampling.hooks", "porocore.surrogates.hooks", "porocore.commands.hooks")


@dataclass(frozen=True)
class Versions:
    """Versions of an interface: the present one, and the oldest whose implementations still work."""

    present: int
    oldest: int

    def complaint(self, kind: Kind, made_for: int, distribution: str) -> str:
        """Return why a plugin for version ``made_for`` cannot be used, and what to do; empty if it can."""
        if self.oldest <= made_for <= self.present:
            return ""
        old = made_for < self.oldest
        works = (
            f"version {self.present}"
            if self.oldest == self.present
            else f"versions {self.oldest} to {self.present}"
        )
        return (
            f"made for version {made_for} of the {kind} interface, {'older' if old else 'newer'} than this porocore, "
            f"which takes {works}; upgrade {'it' if old else 'porocore'}: "
            f"pip install --upgrade {distribution if old else PROJECT}"
        )


@dataclass(frozen=True)
class Scaffold:
    """New project of a kind, as ``porocore plugin new`` writes it.

    Attributes
    ----------
    about
        What its implementation computes.
    usage
        How a configuration chooses it, with ``{name}``; ``{key}`` is the name with underscores.
    dependencies
        Requirements beside porocore and numpy.
    summary, chosen
        Summary of its offer, and the words before ``usage``.
    more
        Further arguments of the offer, one a line, with ``{key}``.
    """

    about: str
    usage: str
    dependencies: tuple[str, ...] = ()
    summary: str = "{about}"
    chosen: str = "It is chosen in a configuration by"
    more: str = ""

    @property
    def requires(self) -> str:
        """Module by which a missing dependency is noticed."""
        return self.dependencies[0].partition(">")[0] if self.dependencies else "numpy"


@dataclass(frozen=True)
class PluginKind:
    """All that discovery, messages, conformance kit and scaffold know of one kind.

    Attributes
    ----------
    word
        The kind as a user types it; a distribution of the scaffold begins with ``porocore-WORD``.
    hook
        The hook that offers it.
    interface
        The abstract class in ``porocore.interfaces``; ``porocore.testing`` has its suite, with ``Suite`` appended.
    factory
        The method of the suite that makes an instance.
    choice
        Where a study says which one it takes.
    scaffold
        The project for a new one.
    versions
        Raised by one when implementations must change; what changed is in docs/plugins.md.
    offer
        The class of its offers.
    """

    word: str
    hook: str
    interface: str
    factory: str
    choice: str
    scaffold: Scaffold
    versions: Versions = Versions(1, 1)
    offer: str = "Offer"

    @property
    def suite(self) -> str:
        """Name of the suite in :mod:`porocore.testing`."""
        return f"{self.interface}Suite"


KINDS: dict[Kind, PluginKind] = {
    "cell solver": PluginKind(
        word="cell",
        hook="porocore_cell_solvers",
        interface="CellSolver",
        factory="make_solver",
        choice="fem.backend or --fem",
        scaffold=Scaffold(
            "the estimate of Mori and Tanaka for round pores, in closed form",
            "fem:\n  backend: {name}\n  options: {{grain: 0.2}}\nmacro:\n  backend: skfem",
        ),
    ),
    "macro solver": PluginKind(
        word="macro",
        hook="porocore_macro_solvers",
        interface="MacroSolver",
        factory="make_solver",
        choice="macro.backend or --macro",
        scaffold=Scaffold(
            "finite elements with numpy and scipy alone", "macro:\n  backend: {name}", ("scipy>=1.11",)
        ),
    ),
    "surrogate": PluginKind(
        word="surrogate",
        hook="porocore_surrogates",
        interface="Surrogate",
        factory="make_surrogate",
        choice="surrogate.backend or --surrogate",
        scaffold=Scaffold(
            "a polynomial for <∇u¹>, fitted by least squares",
            "closure: mean-gradient\nsurrogate:\n  backend: {name}\n  options: {{degree: 5}}",
        ),
    ),
    "sampler": PluginKind(
        word="sampler",
        hook="porocore_samplers",
        interface="Sampler",
        factory="make_sampler",
        choice="sampling.sampler",
        scaffold=Scaffold(
            "a grid of states in the box of the inputs",
            "sampling:\n  sampler: {name}\n  options: {{points: 5}}\n  inputs:\n    H22: {{range: [-0.12, 0.02]}}\n"
            "    p: {{range: [-0.02, 0.1]}}",
        ),
    ),
    "command": PluginKind(
        word="command",
        hook="porocore_commands",
        interface="Command",
        factory="make_command",
        choice="porocore NAME",
        scaffold=Scaffold(
            "the porosity of a cell's mesh by the size of its elements",
            "{key}:\n  sizes: [0.2, 0.1]",
            summary="Compute {about}.",
            chosen="Its section of a study is",
            more='            section="{key}",\n',
        ),
        offer="CommandOffer",
    ),
}
#: Plugins that the project itself publishes: name → (distribution, kinds).
FIRST_PARTY: dict[str, tuple[str, tuple[Kind, ...]]] = {
    "skfem": ("porocore-fem-skfem", ("cell solver", "macro solver")),
    "dolfinx": ("porocore-fem-dolfinx", ("cell solver", "macro solver")),
    "torch": ("porocore-surrogate-torch", ("surrogate",)),
    "jax": ("porocore-surrogate-jax", ("surrogate",)),
}


def kind_of(word: str) -> Kind:
    """Return the kind that a user means by a word such as ``cell``.

    Raises
    ------
    ConfigurationError
        There is none.
    """
    words = {record.word: kind for kind, record in KINDS.items()}
    if word not in words:
        raise ConfigurationError(f"--kind: expected {', '.join(words)}, got {echo(word)}")
    return words[word]
